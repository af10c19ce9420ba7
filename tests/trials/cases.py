"""What is tried: arrays, air, apertures and targets at random, all of it from one number."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from . import truth
from .layouts import Layout, Random, direction, layout_of
from .truth import Complexes, Floats, Scene

Group = Literal["honest", "wrong"]

FRAMES: Final = 12  # of one session: what opening it costs is shared
SOLVERS: Final = ("naive", "ibp", "gs", "wgs", "gspat")
MODES: Final = ("phases", "drives", "points", "sequence")
APERTURES: Final = ("full", "half", "centre", "ring", "random", "gaussian", "cosine")
_FULL: Final = 255
_NEAREST_M: Final = 0.0215  # from an element; the program asks for 20 mm
_MARGIN_M: Final = 0.149  # beside the array; the program allows 150 mm
#: Share of the sessions whose judge is told to tolerate something.
TOLERANT: Final = 0.6
_MOST_TOLERATED_RAD: Final = 0.65  # the program allows half of the focus: 0.831
_STEEPEST_RAD: Final = math.radians(45.0)


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
    """What a user tolerates: a miss, and air that is not quite what it is taken for.

    Attributes
    ----------
    miss_mm, temperature_c, humidity_percent : float
    position_mm : float
        Uncertainty of each coordinate of each element, which the user states beside that.
    """

    miss_mm: float = 0.0
    temperature_c: float = 0.0
    humidity_percent: float = 0.0
    position_mm: float = 0.0

    def speed_share(self, temperature_c: float) -> float:
        """By which share of it the speed of sound may be off: the colder, and the wetter."""
        colder = truth.sound_speed_m_s(temperature_c - self.temperature_c)
        wetter = truth.humid_speed_ratio(temperature_c, self.humidity_percent)
        return truth.sound_speed_m_s(temperature_c) / colder - 1.0 + wetter - 1.0


@dataclass(frozen=True)
class Host:
    """What a host takes the world for.

    Attributes
    ----------
    speed_ratio : float
        Its speed of sound over the true one.
    away_m : (3,)
        How far its focus is off.
    scatter_m : (N, 3) or None
        How far it has each element off its place.
    """

    speed_ratio: float = 1.0
    away_m: Floats = field(default_factory=lambda: np.zeros(3))
    scatter_m: Floats | None = None

    @property
    def knows_places(self) -> bool:
        return not self.away_m.any() and self.scatter_m is None

    def positions_m(self, true: Floats) -> Floats:
        """Where it has the elements: its foci are displaced as they are, the other way."""
        scatter = 0.0 if self.scatter_m is None else self.scatter_m
        places: Floats = true - self.away_m + scatter
        return places


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
    host : Host
        What a correct host is wrong about: within the allowance.
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
    host: Host = field(default_factory=Host)
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
    layout = layout_of(random, seed)
    mode = str(random.choice(MODES, p=[0.4, 0.3, 0.15, 0.15]))
    temperature = 20.0 if random.random() < 0.3 else float(random.uniform(-20.0, 50.0))
    solver = str(random.choice(SOLVERS)) if mode != "points" else "naive"
    one = random.random() < 0.6 or layout.count < 8
    frames = [_wanted(random, layout, mode, solver, one=one) for _ in range(FRAMES)]
    session = Session(seed, group, layout, temperature, 50.0, mode, frames)
    if mode != "points" and random.random() < 0.2:
        session = replace(session, elements=_elements(random, layout))
    return _tolerant(random, session) if random.random() < TOLERANT else session


def _elements(random: Random, layout: Layout) -> Elements:
    """Elements that differ, by a little or a lot, in gain, phase and place."""
    size = math.exp(random.uniform(math.log(0.02), 0.0))
    count = layout.count
    gain = np.clip(1.0 + 0.25 * size * random.normal(size=count), 0.3, 2.0)
    phase = np.clip(0.8 * size * random.normal(size=count), -3.0, 3.0)
    away = np.clip(0.3e-3 * size * random.normal(size=(count, 3)), -0.5e-3, 0.5e-3)
    return Elements(gain, phase, layout.positions_m + away)


def _tolerant(random: Random, session: Session) -> Session:
    """A judge that is told to tolerate, and a host that makes use of it."""
    which = [(random.random() < 0.6) * 1.0 for _ in range(3)]
    if not any(which):
        which[0] = 1.0
    largest = np.array([log_uniform(random, 0.1, 3.0), random.uniform(0.1, 5.0),
                        random.uniform(5.0, 50.0)]) * which  # fmt: skip
    widest = max(_tolerated_rad(session, Allowance(*largest), wanted) for wanted in session.frames)
    largest *= min(1.0, _MOST_TOLERATED_RAD / max(widest, 1e-9))
    allowance = Allowance(*(float(value) for value in largest))
    session = replace(session, allowance=allowance)
    if session.group == "wrong" and random.random() < 0.5:
        return session
    return _within(random, session, allowance)


def _tolerated_rad(session: Session, allowance: Allowance, wanted: Wanted) -> float:
    """The RMS change of the phases by what is tolerated, at the focus that shows it most."""
    found, scene = [], session.scene
    levels = np.ones(session.layout.count) if wanted.amplitudes is None else wanted.amplitudes / 255
    for target in wanted.targets_m:
        lie = truth.lie_of(scene, levels * np.abs(scene.sensitivity), target, session.wire_bits)
        spread = float(np.std(scene.distances(target[None])[0][levels > 0.0]))
        share = allowance.speed_share(session.temperature_c)
        found.append(
            allowance.miss_mm * 1e-3 / lie.units_m.min() + share * scene.wavenumber * spread
        )
    return max(found)


def _within(random: Random, session: Session, allowance: Allowance) -> Session:
    """A host that is off by up to nearly all of the allowance."""
    ratio = 1.0 + random.uniform(-0.97, 0.97) * allowance.speed_share(session.temperature_c)
    left_m, scatter = 0.97e-3 * allowance.miss_mm, None
    if allowance.miss_mm and session.mode != "points" and random.random() < 0.3:
        scatter = np.clip(random.normal(size=(session.layout.count, 3)), -4.0, 4.0)
        moved = max(_moved_by(session, wanted, scatter) for wanted in session.frames)
        size = min(left_m / 2.0 / moved, 1e-4) * random.uniform(0.1, 1.0)
        allowance = replace(allowance, position_mm=1e3 * size)
        scatter, left_m = scatter * size, left_m - moved * size
    away = direction(random) * left_m * math.sqrt(random.random())
    return replace(session, allowance=allowance, host=Host(ratio, away, scatter))


def _moved_by(session: Session, wanted: Wanted, scatter: Floats) -> float:
    """How far, at most, a host that has its elements off by *scatter* moves a focus of *wanted*."""
    used = slice(None) if wanted.amplitudes is None else wanted.amplitudes > 0
    places = session.scene.positions_m[used]
    found = []
    for target in wanted.targets_m:
        rays = (target - places) / np.linalg.norm(target - places, axis=1)[:, None]
        late = (rays * scatter[used]).sum(axis=1)
        slopes = rays - rays.mean(axis=0)
        found.append(np.linalg.norm(np.linalg.pinv(slopes, rcond=1e-3) @ (late - late.mean())))
    return float(max(found)) + 1e-9


def log_uniform(random: Random, low: float, high: float) -> float:
    return math.exp(random.uniform(math.log(low), math.log(high)))


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
    is_free = layout.grid is None or layout.posed
    across = np.full(2, np.linalg.norm(local[:2])) if is_free else np.abs(local[:2])
    limit = np.full(2, half[:2].min()) if is_free else half[:2]
    between = bool((np.abs(local) < half).all())
    return bool(
        (between if layout.kind == "facing pair" else local[2] > _NEAREST_M)
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


def superposed(scene: Scene, foci: tuple[Focus, ...], *, cut: bool = True) -> Complexes:
    """The naive drive of several foci, cut to what an element can follow."""
    distances = scene.distances(np.array([focus.place_m for focus in foci]))
    levels = np.array([focus.amplitude for focus in foci])
    lags = np.array([focus.lag_rad for focus in foci])
    own = np.angle(np.broadcast_to(scene.sensitivity, distances.shape[1:]))
    phases = lags[:, None] - scene.wavenumber * distances - own
    total: Complexes = (levels[:, None] * truth.turned(phases)).sum(axis=0)
    return total / np.maximum(np.abs(total), 1.0) if cut else total


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
