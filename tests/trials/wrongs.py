"""Everything that can be wrong with a drive, and with what carries and radiates it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from . import truth
from .cases import Focus, Session, Wanted, log_uniform, triple
from .layouts import Layout, Random, direction
from .truth import Complexes, Floats

Codes = NDArray[np.uint8]
Registers = tuple[Codes, Codes]  # phases and amplitudes, 8 bits each


@dataclass(frozen=True)
class Slip:
    """A frame, and what it should be.

    Attributes
    ----------
    session : Session
    wanted : Wanted
    right : Registers
        What the program makes of it.
    before : Registers
        Of the frame before.
    weights : callable
        The unrounded drive of a frame at a speed of sound and with a pitch this much larger.
    """

    session: Session
    wanted: Wanted
    right: Registers
    before: Registers
    weights: Callable[[Wanted, float, float], Complexes]

    @property
    def bits(self) -> int:
        return self.session.wire_bits

    @property
    def layout(self) -> Layout:
        return self.session.layout

    @property
    def codes(self) -> Codes:
        """Phases as the wire has them."""
        return self.right[0] >> (8 - self.bits)

    def with_codes(self, codes: NDArray[np.integer]) -> Registers:
        """The same amplitudes with these phases, as the wire has them."""
        turn = (np.asarray(codes, dtype=np.int64) % (1 << self.bits)) << (8 - self.bits)
        return turn.astype(np.uint8), self.right[1]

    def with_weights(self, weights: Complexes) -> Registers:
        """The phases of *weights*; the amplitudes too, where the host makes several foci."""
        steps = np.floor(np.angle(weights) / (2.0 * math.pi) * (1 << self.bits) + 0.5)
        phases, amplitudes = self.with_codes(steps.astype(np.int64))
        if len(self.wanted.foci) > 1 and self.session.mode == "drives":
            amplitudes = np.floor(np.minimum(np.abs(weights), 1.0) * 255.0 + 0.5).astype(np.uint8)
        return phases, amplitudes

    def for_other(self, wanted: Wanted, speed_ratio: float = 1.0, pitch: float = 1.0) -> Registers:
        """What a host that takes this for the frame would send."""
        return self.with_weights(self.weights(wanted, speed_ratio, pitch))


@dataclass(frozen=True)
class Wrong:
    """What came of a slip; *size* is how much, in the unit of its kind."""

    kind: str
    registers: Registers
    size: float
    of_host: bool  # whether the host believes in it: its own drive is wrong
    nominal_m: float | None = None  # how far a large array would have missed
    off_rad: Floats | float = 0.0  # how far each phase is from what it should be


# --- the host takes something for what it is not ----------------------------------------------


def _air(slip: Slip, random: Random) -> Wrong:
    """The host is wrong about the air."""
    if len(slip.wanted.foci) > 1 and random.random() < 0.7:
        ratio = 1.0 + random.choice([-1, 1]) * log_uniform(random, 5e-4, 0.05)
    else:
        delta = random.choice([-1, 1]) * log_uniform(random, 0.01, 70.0)
        kelvin = slip.session.temperature_c + 273.15
        ratio = math.sqrt(max(kelvin + delta, 200.0) / kelvin)
    made = slip.for_other(slip.wanted, speed_ratio=ratio)
    distance = float(np.linalg.norm(slip.wanted.targets_m[0] - slip.layout.centre_m))
    return Wrong("air", made, ratio - 1.0, True, abs(ratio - 1.0) * distance)


def _pitch(slip: Slip, random: Random) -> Wrong:
    size = random.choice([-1, 1]) * log_uniform(random, 1e-4, 0.12)
    return Wrong("pitch", slip.for_other(slip.wanted, pitch=1.0 + size), size, True)


def moved(wanted: Wanted, shift: Floats, which: int | None = None) -> Wanted:
    """*wanted* with its foci, or one of them, elsewhere; *shift* in metres."""
    return replace(
        wanted,
        foci=tuple(
            replace(focus, place_m=triple(np.array(focus.place_m) + shift))
            if which in (None, place)
            else focus
            for place, focus in enumerate(wanted.foci)
        ),
    )


def _shift(slip: Slip, random: Random) -> Wrong:
    """The host aims elsewhere."""
    size = log_uniform(random, 1e-5, 0.1)
    made = slip.for_other(moved(slip.wanted, direction(random) * size))
    return Wrong("shifted target", made, size * 1e3, True, size)


def _turn(slip: Slip, random: Random) -> Wrong:
    """The host's coordinates are turned around the axis of the array."""
    angle = random.choice([-1, 1]) * log_uniform(random, 1e-3, math.pi)
    frame, centre = slip.layout.frame, slip.layout.centre_m
    cosine, sine = math.cos(angle), math.sin(angle)
    spin = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])

    def spun(focus: Focus) -> Focus:
        local = (np.array(focus.place_m) - centre) @ frame.T
        return replace(focus, place_m=triple(centre + (spin @ local) @ frame))

    other = replace(slip.wanted, foci=tuple(spun(focus) for focus in slip.wanted.foci))
    away = float(np.linalg.norm(other.targets_m - slip.wanted.targets_m, axis=1).max())
    return Wrong("turned target", slip.for_other(other), math.degrees(angle), True, away)


# --- one of several foci ---------------------------------------------------------------------


def _missing(slip: Slip, random: Random) -> Wrong | None:
    foci = slip.wanted.foci
    if len(foci) < 2:
        return None
    gone = int(random.integers(len(foci)))
    left = tuple(focus for place, focus in enumerate(foci) if place != gone)
    return Wrong("focus missing", slip.for_other(replace(slip.wanted, foci=left)), 1.0, True)


def _one_moved(slip: Slip, random: Random) -> Wrong | None:
    foci = slip.wanted.foci
    if len(foci) < 2:
        return None
    size = log_uniform(random, 1e-4, 0.05)
    which = int(random.integers(len(foci)))
    other = moved(slip.wanted, direction(random) * size, which)
    return Wrong("focus moved", slip.for_other(other), size * 1e3, True)


def _weakened(slip: Slip, random: Random) -> Wrong | None:
    foci = slip.wanted.foci
    if len(foci) < 2:
        return None
    which, left = int(random.integers(len(foci))), random.uniform(0.1, 0.95)
    weak = tuple(
        replace(focus, amplitude=focus.amplitude * left) if place == which else focus
        for place, focus in enumerate(foci)
    )
    made = slip.for_other(replace(slip.wanted, foci=weak))
    return Wrong("focus weakened", made, 1.0 - left, True)


# --- signs and orders ------------------------------------------------------------------------


def _sign(slip: Slip, _: Random) -> Wrong:
    return Wrong("sign", slip.with_codes(-slip.codes.astype(np.int64)), 1.0, True)


def _reordered(slip: Slip, order: NDArray[np.intp]) -> Registers:
    phases, amplitudes = slip.right
    return phases[order], amplitudes[order]


def _order(slip: Slip, random: Random) -> Wrong | None:
    """The elements are taken in another order."""
    count, places = slip.layout.count, np.arange(slip.layout.count)
    kinds = ["reversed", "rolled"]
    if slip.layout.grid is not None:
        nx, ny = slip.layout.grid
        square = places.reshape(nx, ny)
        kinds += ["mirrored x", "mirrored y", "serpentine", "rolled x", "rolled y"]
        kinds += ["transposed"]
    match kind := str(random.choice(kinds)):
        case "reversed":
            order = places[::-1]
        case "rolled":
            order = np.roll(places, int(random.integers(1, max(2, count))))
        case "mirrored x":
            order = square[::-1].ravel()
        case "mirrored y":
            order = square[:, ::-1].ravel()
        case "serpentine":
            order = np.where(np.arange(nx)[:, None] % 2, square[:, ::-1], square).ravel()
        case "rolled x":
            order = np.roll(square, 1, axis=0).ravel()
        case "rolled y":
            order = np.roll(square, 1, axis=1).ravel()
        case _:
            order = places.reshape(ny, nx).T.ravel()
    return Wrong(kind, _reordered(slip, order), 1.0, _is_of_host(random))


def _swapped(slip: Slip, random: Random) -> Wrong | None:
    if slip.layout.count < 2:
        return None
    pairs = max(1, int(log_uniform(random, 1.0, slip.layout.count / 2 + 0.5)))
    chosen = random.permutation(slip.layout.count)[: 2 * pairs].reshape(-1, 2)
    order = np.arange(slip.layout.count)
    order[chosen[:, 0]], order[chosen[:, 1]] = chosen[:, 1], chosen[:, 0]
    return Wrong("swapped pairs", _reordered(slip, order), pairs, _is_of_host(random))


# --- codes -----------------------------------------------------------------------------------


def _is_of_host(random: Random) -> bool:
    """Whether the host believes in what is wrong, so that no code tells."""
    return bool(random.random() < 0.5)


def _some(slip: Slip, random: Random) -> NDArray[np.intp]:
    """One to all of the elements."""
    count = max(1, round(log_uniform(random, 1.0, slip.layout.count)))
    return random.permutation(slip.layout.count)[:count]


def _inverted(slip: Slip, random: Random) -> Wrong:
    chosen = _some(slip, random)
    codes = slip.codes.astype(np.int64)
    codes[chosen] += 1 << (slip.bits - 1)
    return Wrong("inverted elements", slip.with_codes(codes), len(chosen), _is_of_host(random))


def _slipped(slip: Slip, random: Random) -> Wrong:
    """Some elements are a few steps off."""
    chosen = _some(slip, random)
    codes = slip.codes.astype(np.int64)
    steps = int(random.choice([1, 1, 1, 2, 2, 3, 5, 8, 16]))
    signs = random.choice([-1, 1], len(chosen)) if random.random() < 0.5 else 1
    codes[chosen] += steps * signs
    return Wrong(f"off by {steps} steps", slip.with_codes(codes), len(chosen), _is_of_host(random))


def _stuck(slip: Slip, random: Random) -> Wrong:
    chosen = _some(slip, random)
    codes = slip.codes.astype(np.int64)
    codes[chosen] = random.integers(1 << slip.bits)
    return Wrong("stuck elements", slip.with_codes(codes), len(chosen), _is_of_host(random))


def _garbage(slip: Slip, random: Random) -> Wrong:
    chosen = _some(slip, random)
    codes = slip.codes.astype(np.int64)
    codes[chosen] = random.integers(1 << slip.bits, size=len(chosen))
    return Wrong("random phases", slip.with_codes(codes), len(chosen), _is_of_host(random))


def _jitter(slip: Slip, random: Random) -> Wrong:
    """Every phase is off by a little at random."""
    sigma = log_uniform(random, 0.002, 1.0)
    weights = slip.weights(slip.wanted, 1.0, 1.0)
    shaken = weights * truth.turned(random.normal(0.0, sigma, len(weights)))
    phases = slip.with_weights(shaken)[0]
    return Wrong("phase noise", (phases, slip.right[1]), sigma, True)


def _down(slip: Slip, _: Random) -> Wrong:
    """The phases are rounded down."""
    weights = slip.weights(slip.wanted, 1.0, 1.0)
    steps = np.floor(np.angle(weights) / (2.0 * math.pi) * (1 << slip.bits))
    return Wrong("rounded down", slip.with_codes(steps.astype(np.int64)), 1.0, True)


def _bit_order(slip: Slip, _: Random) -> Wrong:
    codes = slip.codes.astype(np.int64)
    turned = sum(((codes >> bit) & 1) << (slip.bits - 1 - bit) for bit in range(slip.bits))
    return Wrong("bit order", slip.with_codes(turned), 1.0, False)


def _coarse(slip: Slip, random: Random) -> Wrong | None:
    """Low bits are lost."""
    lost = int(random.integers(1, slip.bits - 1))
    codes = (slip.codes.astype(np.int64) >> lost) << lost
    return Wrong("low bits lost", slip.with_codes(codes), lost, False)


def _unit(slip: Slip, random: Random) -> Wrong:
    """Neighbours by number, a driver chip or half of the array, are late by one phase."""
    count = slip.layout.count
    size = int(random.choice([8, 16, 32, 64, max(1, count // 2)]))
    first = size * int(random.integers(max(1, count // size)))
    codes = slip.codes.astype(np.int64)
    codes[first : first + size] += int(random.integers(1, 1 << slip.bits))
    return Wrong("unit out of step", slip.with_codes(codes), size, _is_of_host(random))


def _copied(slip: Slip, random: Random) -> Wrong:
    """Every second element has the phase of its neighbour."""
    codes = slip.codes.astype(np.int64)
    pairs = len(codes) // 2
    codes[1 : 2 * pairs : 2] = codes[: 2 * pairs : 2]
    return Wrong("elements copied", slip.with_codes(codes), pairs, _is_of_host(random))


def _shaped(slip: Slip, random: Random) -> Wrong:
    """A twin or a vortex in place of a focus: a half turned by pi, or all around the axis."""
    x, y = ((slip.layout.positions_m - slip.layout.centre_m) @ slip.layout.frame.T)[:, :2].T
    turn, charge = random.uniform(0.0, 2.0 * math.pi), int(random.choice([-2, -1, 0, 1, 2]))
    around = np.arctan2(y, x) + turn
    more = charge * around if charge else math.pi * (np.cos(around) > 0.0)
    steps = np.rint(more / (2.0 * math.pi) * (1 << slip.bits)).astype(np.int64)
    made = slip.with_codes(slip.codes.astype(np.int64) + steps)
    return Wrong("vortex" if charge else "twin", made, charge, _is_of_host(random))


def _stale(slip: Slip, _: Random) -> Wrong:
    return Wrong("drive of the frame before", slip.before, 1.0, False)


# --- amplitudes ------------------------------------------------------------------------------


def _amplitudes(slip: Slip, random: Random) -> Wrong | None:
    if slip.session.mode != "drives":
        return None
    phases, right = slip.right
    levels = right.astype(np.float64)
    kind = str(random.choice(["scaled", "noisy", "dead", "taper", "aperture", "full", "one step"]))
    chosen, size = _some(slip, random), 1.0
    match kind:
        case "scaled":
            size = random.uniform(0.3, 0.999)
            levels *= size
        case "noisy":
            size = log_uniform(random, 0.002, 0.5)
            levels *= 1.0 + random.normal(0.0, size, len(levels))
        case "dead":
            levels[chosen] = 0.0
            size = len(chosen)
        case "taper":
            local = slip.layout.positions_m - slip.layout.centre_m
            far = np.linalg.norm(local, axis=1)
            levels *= np.exp(-((far / max(far.max(), 1e-9)) ** 2) * random.uniform(0.05, 2.0))
        case "aperture":
            levels = np.roll(levels, max(1, len(levels) // 2))
        case "full":
            levels[:] = 255.0
        case _:
            levels[chosen] -= 1.0
            size = len(chosen)
    codes = np.clip(np.rint(levels), 0, 255).astype(np.uint8)
    return Wrong(f"amplitudes: {kind}", (phases, codes), size, False)


_ONE_OF_SEVERAL: Final = (_missing, _one_moved, _weakened, _air)
_ANY: Final = (
    _air, _air, _air, _pitch, _shift, _shift, _shift, _turn, _sign, _order, _order, _swapped,
    _inverted, _inverted, _slipped, _slipped, _stuck, _garbage, _jitter, _down, _bit_order, _coarse,
    _stale, _unit, _unit, _copied, _shaped,
    _amplitudes, _amplitudes, _amplitudes,
)  # fmt: skip


def wrong_with(slip: Slip, random: Random) -> Wrong | None:
    """Something that is wrong, so that the registers differ; None if nothing was found."""
    for _ in range(20):
        several = len(slip.wanted.foci) > 1 and random.random() < 0.6
        kinds = _ONE_OF_SEVERAL if several else _ANY
        made = kinds[int(random.integers(len(kinds)))](slip, random)
        if made is None:
            continue
        same = [np.array_equal(a, b) for a, b in zip(made.registers, slip.right, strict=True)]
        if not all(same):
            off = made.registers[0].astype(np.int64) - slip.right[0]
            return replace(made, off_rad=((off + 128) % 256 - 128) * (2.0 * math.pi / 256.0))
    return None


# --- faults of line, clock and device --------------------------------------------------------

_LINE: Final = (
    "line.flip ber={:.2g}", "line.drop p={:.2g}", "line.insert p={:.2g}", "line.burst p={:.2g}",
)  # fmt: skip
_CHUNK: Final = (
    "line.duplicate p={:.2g}", "line.truncate p={:.2g}", "line.overrun p={:.2g} bytes=40",
    "line.break p={:.2g}", "frame.crc p={:.2g}", "frame.length p={:.2g} bytes={}",
    "frame.sequence p={:.2g} by={}", "frame.session p={:.2g}", "frame.flags p={:.2g}",
    "frame.type p={:.2g} type={type}", "frame.past p={:.2g} us={us}",
    "frame.future p={:.2g} us={us}",
)  # fmt: skip
_TIMING: Final = (
    "line.delay us={us} jitter_us={us}", "line.slice bytes=16 gap_us=300", "line.coalesce us={us}",
    "line.batch ms=16", "line.baud ppm={ppm}", "line.half_open", "line.disconnect ms=30",
    "clock.offset us={us}", "clock.wrap us={us}", "clock.ppm ppm={ppm}", "clock.step us={us}",
    "device.clock p=1 us={us}", "device.status",
)  # fmt: skip
_DEVICE: Final = (
    "device.off", "device.dead", "device.stuck code={code}", "device.delayed code={code}",
    "device.intermittent p=0.5", "device.garbage", "device.wrong", "device.slow us=3000",
)  # fmt: skip


def fault_of(layout: Layout, random: Random) -> str:
    """A fault of docs/faults.md that something may come of; mostly not before the first frame."""
    family = (_DEVICE, _DEVICE, _LINE, _CHUNK, _TIMING)[int(random.integers(5))]
    text = str(random.choice(np.array(family)))
    chance = log_uniform(random, 3e-4, 1e-2) if family is _LINE else random.uniform(0.1, 1.0)
    words = text.format(
        chance,
        int(random.choice([-2, -1, 1, 3])),
        type=int(random.choice([0x11, 0x12, 0x3F])),
        us=int(log_uniform(random, 10, 1e6)),
        ppm=int(log_uniform(random, 10, 9e4)),
        code=int(random.integers(1, 256)),
    )
    if family is _DEVICE:
        return f"{words} {_place(layout, random)}"
    if words.startswith(("clock.offset", "clock.wrap", "clock.ppm")) or random.random() < 0.1:
        return words
    return f"{words} from=115ms"


def _place(layout: Layout, random: Random) -> str:
    columns = layout.grid[0] if layout.grid else 0
    kind = str(random.choice(["transducer", "column", "bank"]))
    if kind == "column" and columns:
        return f"column={random.integers(columns)}"
    if kind == "bank":
        return f"bank={random.integers((layout.count + 63) // 64)}"
    return f"transducer={random.integers(layout.count)}"


def other_foci(wanted: Wanted, random: Random) -> tuple[str, Wanted, float]:
    """For a board that computes the drive itself: other foci than those that are wanted."""
    kinds = ["shifted target", "focus moved", "focus missing", "focus weakened"]
    kind = str(random.choice(kinds if len(wanted.foci) > 1 else kinds[:1]))
    which = int(random.integers(len(wanted.foci)))
    size = log_uniform(random, 2e-6, 0.02)
    match kind:
        case "shifted target":
            return kind, moved(wanted, direction(random) * size), size * 1e3
        case "focus moved":
            return kind, moved(wanted, direction(random) * size, which), size * 1e3
        case "focus missing":
            rest = tuple(focus for place, focus in enumerate(wanted.foci) if place != which)
            return kind, replace(wanted, foci=rest), 1.0
    left = random.uniform(0.1, 0.95)
    weak = tuple(
        replace(focus, amplitude=focus.amplitude * left) if place == which else focus
        for place, focus in enumerate(wanted.foci)
    )
    return kind, replace(wanted, foci=weak), 1.0 - left
