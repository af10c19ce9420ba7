"""What is tried: arrays, air, apertures and targets at random, all of it from one number."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from . import truth
from .truth import Complexes, Floats, Scene

Group = Literal["honest", "wrong"]
Random = np.random.Generator

FRAMES: Final = 12  # of one session: what opening it costs is shared
SOLVERS: Final = ("naive", "ibp", "gs", "wgs", "gspat")
MODES: Final = ("phases", "drives", "points", "sequence")
APERTURES: Final = ("full", "half", "centre", "ring", "random", "gaussian", "cosine")
_FULL: Final = 255
_MOST: Final = 400  # elements
_NEAREST_M: Final = 0.0215  # from an element; the program asks for 20 mm
_MARGIN_M: Final = 0.149  # beside the array; the program allows 150 mm
_STEEPEST_RAD: Final = math.radians(40.0)


@dataclass(frozen=True)
class Layout:
    """An array, in its own place: where it is, and how it is told to the program.

    Attributes
    ----------
    name : str
        Grid such as ``8x8``, or the name of a CSV file to be written.
    positions_m, normals : (N, 3)
        As the program shall have them.
    grid : (nx, ny) or None
    pitch_m : float
    centre_m : (3,)
        Of the elements.
    frame : (3, 3)
        The array's own axes as rows: two across, one along which it faces.
    kind : str
        ``grid``, ``line``, ``bowl``; for the table.
    posed : bool
        Whether it was moved and turned.
    """

    name: str
    positions_m: Floats
    normals: Floats
    grid: tuple[int, int] | None
    pitch_m: float
    centre_m: Floats
    frame: Floats
    kind: str
    posed: bool
    focus_m: Floats | None = None  # of a bowl

    @property
    def count(self) -> int:
        return len(self.positions_m)

    def write(self, folder: Path) -> str:
        """Return what the program takes as its array: the grid, or the file, which is written."""
        if not self.name.endswith(".csv"):
            return self.name
        rows = np.hstack([self.positions_m * 1e3, self.normals])
        lines = [",".join(repr(float(value)) for value in row) for row in rows]
        path = folder / self.name
        path.write_text("\n".join(["x,y,z,nx,ny,nz", *lines]) + "\n", encoding="utf-8")
        return str(path)


@dataclass(frozen=True)
class Elements:
    """How the elements really are: what a calibration file says, and the truth knows."""

    gain: Floats
    phase_rad: Floats
    positions_m: Floats

    def write(self, path: Path) -> str:
        """Write the calibration file and return its name."""
        lines = ["element,gain,phase_rad,x_mm,y_mm,z_mm"]
        for n, place in enumerate(self.positions_m * 1e3):
            values = (self.gain[n], self.phase_rad[n], *place)
            lines.append(",".join([str(n), *(repr(float(value)) for value in values)]))
        path.write_text("\n".join(lines) + "\n", encoding="utf-8")
        return str(path)


@dataclass(frozen=True)
class Allowance:
    """What a user tolerates: a miss, and air that is not quite what it is taken for."""

    miss_mm: float = 0.0
    temperature_c: float = 0.0
    humidity_percent: float = 0.0


@dataclass(frozen=True)
class Focus:
    """One focus that is wanted."""

    place_m: tuple[float, float, float]
    amplitude: float = 1.0
    lag_rad: float = 0.0


@dataclass(frozen=True)
class Wanted:
    """One frame that is wanted.

    Attributes
    ----------
    foci : tuple of Focus
    aperture : str
        Which elements are driven, and how much.
    amplitudes : (N,) uint8 or None
        Their amplitude codes; None: whatever the program makes of the foci.
    solver : str
    """

    foci: tuple[Focus, ...]
    aperture: str = "full"
    amplitudes: NDArray[np.uint8] | None = None
    solver: str = "naive"

    @property
    def targets_m(self) -> Floats:
        return np.array([focus.place_m for focus in self.foci])


@dataclass(frozen=True)
class Session:
    """One board, one host, some frames; a trial is one of the frames.

    Attributes
    ----------
    seed : int
        All of it follows from group and seed.
    group : str
        ``honest`` or ``wrong``.
    layout : Layout
    temperature_c, humidity_percent : float
        Of the air over the board: that of the truth.
    mode : str
        ``phases``, ``drives``, ``points`` or ``sequence`` (of phases).
    frames : list of Wanted
    elements : Elements or None
        How they really are; None: as the layout says, and alike.
    allowance : Allowance or None
        What the judge is told to tolerate; None: nothing.
    host_warmer_c, host_wetter_percent : float
        How much warmer and wetter a correct host takes the air to be: within the allowance.
    tags : dict
        What is special about it.
    """

    seed: int
    group: Group
    layout: Layout
    temperature_c: float
    humidity_percent: float
    mode: str
    frames: list[Wanted]
    elements: Elements | None = None
    allowance: Allowance | None = None
    host_warmer_c: float = 0.0
    host_wetter_percent: float = 0.0
    tags: dict[str, Any] = field(default_factory=dict)

    @property
    def scene(self) -> Scene:
        """Elements and air of the truth."""
        return self.scene_in(self.temperature_c, self.humidity_percent)

    def scene_in(self, temperature_c: float, humidity_percent: float = 50.0) -> Scene:
        """The same elements in other air."""
        wavenumber = 2.0 * math.pi * truth.CARRIER_HZ / truth.sound_speed_m_s(temperature_c)
        lost = truth.absorption_np_m(temperature_c, humidity_percent)
        layout, own = self.layout, self.elements
        if own is None:
            return Scene(layout.positions_m, layout.normals, wavenumber, lost)
        response = own.gain * truth.turned(own.phase_rad)
        return Scene(own.positions_m, layout.normals, wavenumber, lost, response)

    @property
    def wire_bits(self) -> int:
        """Resolution of the phases that reach the registers."""
        return 8


def session_of(group: Group, seed: int) -> Session:
    """Everything about a session but what is wrong with it."""
    random = np.random.default_rng([{"honest": 1, "wrong": 2}[group], seed])
    layout = _layout(random, seed)
    mode = str(random.choice(MODES, p=[0.4, 0.3, 0.15, 0.15]))
    temperature = 20.0 if random.random() < 0.3 else float(random.uniform(-20.0, 50.0))
    solver = str(random.choice(SOLVERS)) if mode != "points" else "naive"
    one = random.random() < 0.6 or layout.count < 8
    frames = [_wanted(random, layout, mode, solver, one=one) for _ in range(FRAMES)]
    session = Session(seed, group, layout, temperature, 50.0, mode, frames)
    how = random.random()
    if mode != "points" and how < 0.2:
        session = replace(session, elements=_elements(random, layout))
    elif how > 0.85:
        session = _tolerant(random, session)
    return session


def _elements(random: Random, layout: Layout) -> Elements:
    """Elements that differ, by a little or a lot, in gain, phase and place."""
    size = math.exp(random.uniform(math.log(0.02), 0.0))
    count = layout.count
    gain = np.clip(1.0 + 0.25 * size * random.normal(size=count), 0.3, 2.0)
    phase = np.clip(0.8 * size * random.normal(size=count), -3.0, 3.0)
    away = np.clip(0.3e-3 * size * random.normal(size=(count, 3)), -0.5e-3, 0.5e-3)
    return Elements(gain, phase, layout.positions_m + away)


def _tolerant(random: Random, session: Session) -> Session:
    """A judge that is told to tolerate, and, if all is well, a host within that."""
    allowance = Allowance(temperature_c=float(random.uniform(0.1, 3.0)))
    if random.random() < 0.3:
        allowance = Allowance(miss_mm=float(random.uniform(0.1, 1.5)))
    elif random.random() < 0.4:
        allowance = replace(allowance, humidity_percent=float(random.uniform(5.0, 50.0)))
    warmer = allowance.temperature_c * float(random.uniform(-0.95, 0.95))
    wetter = allowance.humidity_percent * float(random.uniform(-0.95, 0.95))
    if session.group == "wrong" or not -20.0 <= session.temperature_c + warmer <= 50.0:
        warmer = wetter = 0.0
    return replace(session, allowance=allowance, host_warmer_c=warmer, host_wetter_percent=wetter)


# --- arrays ----------------------------------------------------------------------------------


def _layout(random: Random, seed: int) -> Layout:
    kind = str(random.choice(["grid", "line", "bowl"], p=[0.74, 0.08, 0.18]))
    pitch = float(np.round(random.uniform(5.0, 12.0), 2)) * 1e-3
    if kind == "bowl":
        layout = _bowl(random, pitch, seed)
    else:
        sides = _sides(random, line=kind == "line")
        layout = grid(*sides, pitch)
    return _posed(random, layout, seed)


def _sides(random: Random, *, line: bool) -> tuple[int, int]:
    if line:
        sides = [1, int(random.integers(1, 21))]
    elif random.random() < 0.12:
        sides = [int(side) for side in random.integers(1, 5, 2)]
    elif random.random() < 0.25:
        side = int(random.integers(2, 21))
        sides = [side, side]
    else:
        sides = [int(side) for side in random.integers(2, 21, 2)]
    random.shuffle(sides)
    return sides[0], sides[1]


def grid(nx: int, ny: int, pitch_m: float) -> Layout:
    """Element n = ix * ny + iy, around the origin, facing +z."""
    ix, iy = np.divmod(np.arange(nx * ny), ny)
    x, y = (ix - (nx - 1) / 2) * pitch_m, (iy - (ny - 1) / 2) * pitch_m
    positions = np.stack([x, y, np.zeros(nx * ny)], axis=1)
    kind = "line" if 1 in (nx, ny) else "grid"
    return Layout(
        f"{nx}x{ny}",
        positions,
        np.tile([0.0, 0.0, 1.0], (nx * ny, 1)),
        (nx, ny),
        pitch_m,
        np.zeros(3),
        np.eye(3),
        kind,
        posed=False,
    )


def _bowl(random: Random, pitch_m: float, seed: int) -> Layout:
    """A spherical cap on which every element faces the centre of the sphere."""
    radius = float(random.uniform(0.07, 0.30))
    opening = float(random.uniform(0.15, 0.85))  # half of the cap, in radians
    rings = max(1, int(radius * opening / pitch_m))
    directions = [(0.0, 0.0)] if random.random() < 0.5 else []
    for ring in range(1, rings + 1):
        polar = opening * ring / rings
        around = max(2, int(2.0 * math.pi * math.sin(polar) * radius / pitch_m))
        start = random.uniform(0.0, 2.0 * math.pi)
        if len(directions) + around > _MOST:
            break  # whole rings: it shall face along its axis
        directions += [(polar, start + 2.0 * math.pi * n / around) for n in range(around)]
    polar, turn = np.array(directions).T
    outward = np.stack(
        [np.sin(polar) * np.cos(turn), np.sin(polar) * np.sin(turn), -np.cos(polar)], axis=1
    )
    positions = radius * outward + [0.0, 0.0, radius]
    return Layout(
        f"bowl{seed}.csv",
        positions,
        -outward,
        None,
        pitch_m,
        positions.mean(axis=0),
        np.eye(3),
        "bowl",
        posed=False,
        focus_m=np.array([0.0, 0.0, radius]),
    )


def _posed(random: Random, layout: Layout, seed: int) -> Layout:
    """Move and turn it: not at all, a little, or anyhow."""
    how = random.choice(["not", "tilted", "any"], p=[0.6, 0.15, 0.25])
    if how == "not":
        return layout
    angle = random.uniform(0.0, 0.35) if how == "tilted" else random.uniform(0.0, math.pi)
    turn = rotation(direction(random), angle)
    shift = direction(random) * random.uniform(0.0, 0.3)
    if random.random() < 0.2:
        turn = np.eye(3)  # moved only

    def moved(points: Floats) -> Floats:
        result: Floats = points @ turn.T + shift
        return result

    return replace(
        layout,
        name=f"posed{seed}.csv",
        positions_m=moved(layout.positions_m),
        normals=layout.normals @ turn.T,
        centre_m=moved(layout.centre_m),
        frame=turn.T.copy(),
        posed=True,
        focus_m=None if layout.focus_m is None else moved(layout.focus_m),
    )


def direction(random: Random) -> Floats:
    vector = random.normal(size=3)
    unit: Floats = vector / np.linalg.norm(vector)
    return unit


def rotation(axis: Floats, angle_rad: float) -> Floats:
    """Rodrigues: the matrix that turns by an angle around a unit vector."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + math.sin(angle_rad) * cross + (1.0 - math.cos(angle_rad)) * cross @ cross


# --- frames ----------------------------------------------------------------------------------


def _wanted(random: Random, layout: Layout, mode: str, solver: str, *, one: bool) -> Wanted:
    if not one:
        return Wanted(_several(random, layout, mode, solver), solver=solver)
    level = 1.0
    if mode in ("drives", "points") and random.random() < 0.4:
        level = float(random.uniform(0.3, 1.0))
    target = _target(random, layout)
    focus = Focus(triple(target), level)
    if mode != "drives" or random.random() < 0.25:
        return Wanted((focus,))
    aperture = str(random.choice(APERTURES))
    return Wanted((Focus(triple(target)),), aperture, _aperture(random, layout, aperture))


def triple(point: Floats) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in point)
    return x, y, z


def _target(random: Random, layout: Layout) -> Floats:
    """A place that this array can focus on, in any direction up to 40 degrees."""
    while True:
        if layout.focus_m is not None and random.random() < 0.7:
            radius = float(np.linalg.norm(layout.focus_m - layout.centre_m))
            point = layout.focus_m + direction(random) * radius * random.uniform(0.0, 0.4)
        else:
            distance = math.exp(random.uniform(math.log(0.03), math.log(0.6)))
            polar = 0.0 if random.random() < 0.1 else random.uniform(0.0, _STEEPEST_RAD)
            turn = random.uniform(0.0, 2.0 * math.pi)
            along = [math.cos(turn), math.sin(turn)] * np.array(math.sin(polar))
            local = distance * np.array([*along, math.cos(polar)])
            point = layout.centre_m + local @ layout.frame
        if random.random() < 0.5:
            point = np.round(point, 3)  # whole millimetres, as people say them
        if _in_reach(layout, point):
            return point


def _in_reach(layout: Layout, point: Floats) -> bool:
    local = (point - layout.centre_m) @ layout.frame.T
    elements = (layout.positions_m - layout.centre_m) @ layout.frame.T
    half = np.ptp(elements, axis=0) / 2.0
    ahead = ((point - layout.positions_m) * layout.normals).sum(axis=1)
    # Of an array that is turned, any two axes across may be its own: what is near suits them all.
    across = np.full(2, np.linalg.norm(local[:2])) if layout.posed else np.abs(local[:2])
    limit = np.full(2, half[:2].min()) if layout.posed else half[:2]
    return bool(
        local[2] > _NEAREST_M
        and np.linalg.norm(local) < 0.99
        and (across < limit + _MARGIN_M).all()
        and np.linalg.norm(layout.positions_m - point, axis=1).min() > _NEAREST_M
        and (ahead > 1e-4).all()
    )


def _several(random: Random, layout: Layout, mode: str, solver: str) -> tuple[Focus, ...]:
    """2 to 6 foci around one place, from merged to well apart."""
    count = int(random.integers(2, 7))
    apart = math.exp(random.uniform(math.log(2e-3), math.log(0.06)))
    while True:
        middle = _target(random, layout)
        points = [middle + direction(random) * apart * random.uniform(0.5, 1.5) * (n > 0)
                  for n in range(count)]  # fmt: skip
        if all(_in_reach(layout, point) for point in points):
            break
        apart *= 0.8
    equal = random.random() < 0.6
    levels = np.full(count, 1.0) if equal else random.uniform(0.3, 1.0, count)
    if mode in ("drives", "points"):
        levels = levels / count  # what no element can follow is cut, which is another drive
    lags = random.uniform(0.0, 2.0 * math.pi, count) if solver == "naive" else np.zeros(count)
    return tuple(
        Focus(triple(point), float(level), float(lag))
        for point, level, lag in zip(points, levels, lags, strict=True)
    )


def _aperture(random: Random, layout: Layout, kind: str) -> NDArray[np.uint8]:
    """(N,) amplitude codes; at least one element is driven."""
    local = (layout.positions_m - layout.centre_m) @ layout.frame.T
    half = np.maximum(np.abs(local[:, :2]).max(axis=0), 1e-9)
    x, y = (local[:, :2] / half).T
    radius = np.hypot(x, y)
    match kind:
        case "half":
            side = random.integers(4)
            levels = np.array([x < 0, x > 0, y < 0, y > 0][side], dtype=np.float64)
        case "centre":
            levels = (np.maximum(np.abs(x), np.abs(y)) <= 0.55).astype(np.float64)
        case "ring":
            levels = (radius > random.uniform(0.4, 0.7)).astype(np.float64)
        case "random":
            levels = (random.random(layout.count) < random.uniform(0.3, 0.9)).astype(np.float64)
        case "gaussian":
            levels = np.exp(-((radius / random.uniform(0.4, 1.0)) ** 2))
        case "cosine":
            levels = np.cos(0.5 * math.pi * np.minimum(np.abs(x), 1.0) * 0.95) * np.cos(
                0.5 * math.pi * np.minimum(np.abs(y), 1.0) * 0.95
            )
        case _:
            levels = np.ones(layout.count)
    if kind not in ("gaussian", "cosine") and random.random() < 0.3:
        levels = levels * random.uniform(0.3, 1.0)
    codes = np.rint(levels * _FULL)
    if not codes.any():
        codes[:] = _FULL
    return codes.astype(np.uint8)


# --- the drive that is right -----------------------------------------------------------------


def superposed(scene: Scene, foci: tuple[Focus, ...]) -> Complexes:
    """The naive drive of several foci, cut to what an element can follow."""
    distances = scene.distances(np.array([focus.place_m for focus in foci]))
    levels = np.array([focus.amplitude for focus in foci])
    lags = np.array([focus.lag_rad for focus in foci])
    own = np.angle(np.broadcast_to(scene.sensitivity, distances.shape[1:]))
    phases = lags[:, None] - scene.wavenumber * distances - own
    total: Complexes = (levels[:, None] * truth.turned(phases)).sum(axis=0)
    return total / np.maximum(np.abs(total), 1.0)


def fresnel_number(
    layout: Layout, amplitudes: Floats, target: Floats, wavenumber: float
) -> tuple[float, float]:
    """a^2 / (lambda F) of what is driven, and a in elements; a: half of its narrowest width."""
    share = amplitudes / amplitudes.sum()
    centre = share @ layout.positions_m
    local = (layout.positions_m - centre) @ layout.frame.T
    covariance = (local[:, :2] * share[:, None]).T @ local[:, :2]
    # A uniform width of 2 a has a variance of a^2 / 3; the elements themselves are a pitch wide.
    half = math.sqrt(3.0 * max(float(np.linalg.eigvalsh(covariance)[0]), 0.0))
    distance = float(np.linalg.norm(target - centre))
    return half**2 * wavenumber / (2.0 * math.pi * distance), half / layout.pitch_m
