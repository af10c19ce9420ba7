"""Wrong programs of a SonicSurface, each of which the recipe of its page must fail.

A program is right or wrong by how it is made: phases come from the distance in the client's own
coordinates, codes are cut down as those of ``SonicSurface.py``, and bytes are put together here.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

CHANNELS, STEPS, HALF = 256, 32, 16
MM_OF_346 = 346.0 / 40.0  # wavelength in mm
APART_MM = 243.0
BEGIN, SWAP, PRIMARY, SECONDARY = b"\xfe", b"\xfd", b"\xc0", b"\xc1"
_CELL = ((0, 7, 1, 2), (4, 3, 6, 5))  # [row % 2][column % 4]
#: Off every plane of symmetry, at several heights.
TARGETS_MM = ((20, 150, -15), (-35, 170, 20), (10, 120, -40), (40, 185, 30), (-15, 100, -25))
BETWEEN_MM = ((6, 118, -9), (-11, 130, 7), (4, 109, 12), (13, 125, 5), (-7, 112, -13))


def channel(row: int, column: int) -> int:
    return 64 * (column // 4) + 8 * (row // 2) + _CELL[row % 2][column % 4]


#: Channel of each element, the elements row by row from above.
MAP = np.array([channel(row, column) for row in range(16) for column in range(16)])
_ROWS, _COLUMNS = np.divmod(np.arange(CHANNELS), 16)
LOWER = np.stack([-78.75 + 10.5 * _COLUMNS, 0.0 * _ROWS, 80.75 - 10.5 * _ROWS], axis=1)
UPPER = LOWER * [1, 1, -1] + [0, APART_MM, 0]


@dataclass(frozen=True)
class Program:
    """A program that shows one focus after the other; as it stands it is right.

    Attributes
    ----------
    place : callable
        From a target in mm to the point that the phases are computed for.
    code : callable
        From turns in 0 to 1 to codes, in the order of the elements.
    spoil : callable
        From the codes of all channels, and the number of the frame, to what is sent.
    map : (256,) numpy.ndarray
        Channel that the program takes for each element.
    send : callable
        From the bytes of each frame to those on the line.
    """

    targets_mm: Sequence[Sequence[float]] = TARGETS_MM
    elements_mm: Sequence[np.ndarray] = (LOWER,)
    wavelength_mm: float = MM_OF_346
    place: Callable[[np.ndarray], np.ndarray] = lambda target: target
    code: Callable[[np.ndarray], np.ndarray] = lambda turns: np.floor(turns * STEPS)
    spoil: Callable[[np.ndarray, int], np.ndarray] = lambda codes, _: codes
    map: np.ndarray = dataclasses.field(default_factory=lambda: MAP)
    send: Callable[[list[bytes]], bytes] = b"".join

    def codes(self, target: Sequence[float]) -> np.ndarray:
        """Codes of all channels, board after board."""
        found = []
        for elements in self.elements_mm:
            gaps = elements - self.place(np.array(target, dtype=float))
            turns = -np.linalg.norm(gaps, axis=1) / self.wavelength_mm % 1.0
            wire = np.zeros(CHANNELS, dtype=int)
            wire[self.map % CHANNELS] = self.code(turns).astype(int) % 256
            found.append(wire)
        return np.concatenate(found)

    def bytes(self) -> bytes:
        frames = []
        for number, target in enumerate(self.targets_mm):
            codes = self.spoil(self.codes(target), number)
            wire = [np.asarray(part, dtype=np.uint8).tobytes() for part in _by_board(codes)]
            body = wire[0] if len(wire) == 1 else PRIMARY + wire[0] + SECONDARY + wire[1]
            frames.append(BEGIN + body + SWAP)
        return self.send(frames)


def _by_board(codes: np.ndarray) -> list[np.ndarray]:
    return [codes[first : first + CHANNELS] for first in range(0, len(codes), CHANNELS)]


@dataclass(frozen=True)
class Wrong:
    """A wrong program, and the name that it must have; an empty one has no cause to name.

    With two foci in turn, a second commit shows the one that is expected next.
    """

    name: str
    program: Program
    told: str = ""
    of_two_foci: bool = True


RIGHT = Program()
RIGHT_PAIR = Program(targets_mm=BETWEEN_MM, elements_mm=(LOWER, UPPER))


def _exchanged(first: int, second: int) -> Callable[[np.ndarray], np.ndarray]:
    def place(target: np.ndarray) -> np.ndarray:
        target = target.copy()
        target[[first, second]] = target[[second, first]]
        return target

    return place


def _swapped(first: int, second: int) -> Callable[[np.ndarray, int], np.ndarray]:
    def spoil(codes: np.ndarray, _: int) -> np.ndarray:
        codes = codes.copy()
        codes[[first, second]] = codes[[second, first]]
        return codes

    return spoil


def _set(channels: Sequence[int], change: Callable[[np.ndarray], np.ndarray], only: int | None):
    """Change codes of some channels, in one frame or in all."""

    def spoil(codes: np.ndarray, number: int) -> np.ndarray:
        codes = codes.copy()
        if only is None or number == only:
            codes[list(channels)] = change(codes[list(channels)])
        return codes

    return spoil


def _without_swap(*missing: int) -> Callable[[list[bytes]], bytes]:
    def send(frames: list[bytes]) -> bytes:
        return b"".join(
            frame[:-1] if number in missing else frame for number, frame in enumerate(frames)
        )

    return send


def _in_frame(number: int, change: Callable[[bytes], bytes]) -> Callable[[list[bytes]], bytes]:
    def send(frames: list[bytes]) -> bytes:
        return b"".join(change(f) if n == number else f for n, f in enumerate(frames))

    return send


def _at_half_the_baud(frames: list[bytes]) -> bytes:
    """What a UART at twice the rate makes of 8N1 bytes: it reads each bit twice."""
    data, found = b"".join(frames), bytearray()
    bits = [
        bit
        for byte in data
        for bit in (0, *((byte >> place) & 1 for place in range(8)), 1)
        for _ in range(2)
    ]
    at = 0
    while at + 10 <= len(bits):
        if bits[at]:
            at += 1
            continue
        found.append(sum(bits[at + 1 + place] << place for place in range(8)))
        at += 10
    return bytes(found)


def _of_another_wire(frames: list[bytes]) -> bytes:
    """InteractLab's: 256 phases of 7 bits, the first with bit 7, and 256 duties."""
    found = b""
    for frame in frames:
        phases = bytes(4 * code for code in frame[1:-1])
        found += bytes([phases[0] | 0x80]) + phases[1:] + bytes([64]) * 256
    return found


def _half_turn_above(codes: np.ndarray, _: int) -> np.ndarray:
    return np.concatenate([codes[:CHANNELS], (codes[CHANNELS:] + HALF) % STEPS])


def _boards_exchanged(codes: np.ndarray, _: int) -> np.ndarray:
    return np.roll(codes, CHANNELS)


REVERSED = (3, 50, 77, 130, 200, 241)
MISSING = (17, 99, 180)
_change = dataclasses.replace

WRONG = (
    Wrong("x and z exchanged", _change(RIGHT, place=_exchanged(0, 2)), "x and z exchanged"),
    Wrong("x mirrored", _change(RIGHT, place=lambda t: t * [-1, 1, 1]), "x mirrored"),
    Wrong(
        "sign of the phase",
        _change(RIGHT, code=lambda turns: np.floor(-turns % 1.0 * STEPS)),
        "phases of the opposite sign",
    ),
    Wrong(
        "wavelength of 0 C",
        _change(RIGHT, wavelength_mm=331.3 / 40),
        r"another speed of sound: the client assumes 331\.\d m/s(?!.*shift)",
    ),
    Wrong(
        "wavelength of 20 C",
        _change(RIGHT, wavelength_mm=343.2 / 40),
        r"another speed of sound: the client assumes 343\.\d m/s(?!.*shift)",
    ),
    Wrong("two elements exchanged", _change(RIGHT, spoil=_swapped(17, 200)), "17.* 200.* swapped"),
    Wrong("map off by one", _change(RIGHT, map=MAP + 1), r"channels.* \+1"),
    Wrong("map applied twice", _change(RIGHT, map=MAP[MAP]), "map.* twice"),
    Wrong("a commit missing", _change(RIGHT, send=_without_swap(0)), "frame without its commit"),
    Wrong("no commit ever", _change(RIGHT, send=_without_swap(*range(5))), "without its commit"),
    Wrong(
        "a byte lost", _change(RIGHT, send=_in_frame(1, lambda f: f[:100] + f[101:])), "bytes lost"
    ),
    Wrong("a bit flipped", _change(RIGHT, spoil=_set([99], lambda c: c ^ 4, 1)), "element 99"),
    Wrong(
        "a byte turned to FD",
        _change(RIGHT, send=_in_frame(1, lambda f: f[:100] + SWAP + f[101:])),
        "bytes lost",
    ),
    Wrong(
        "codes shifted",
        _change(RIGHT, code=lambda turns: np.floor(turns * STEPS) + 1),
        "elements silently off",
    ),
    Wrong(
        "256 steps",
        _change(RIGHT, code=lambda turns: np.floor(turns * 256)),
        "more steps in a period",
    ),
    Wrong(
        "two commits",
        _change(RIGHT, send=_in_frame(1, lambda f: f + SWAP)),
        "frame that comes twice: .* shows 1 again",
        of_two_foci=False,
    ),
    Wrong("a frame repeated", _change(RIGHT, send=_in_frame(1, lambda f: f + f)), "comes twice"),
    Wrong("metres for mm", _change(RIGHT, place=lambda t: t * 1e-3), "metres"),
    Wrong("y and z exchanged", _change(RIGHT, place=_exchanged(1, 2)), "y and z exchanged"),
    Wrong(
        "6 elements reversed",
        _change(RIGHT, spoil=_set(REVERSED, lambda c: (c + HALF) % STEPS, None)),
        "polarity of elements reversed",
    ),
    Wrong(
        "3 NaN",
        _change(RIGHT, spoil=_set(MISSING, lambda c: c * 0 + STEPS, None)),
        "elements silently off: 3 elements, 17, 99, 180",
    ),
    Wrong(
        "5 mm too far",
        _change(RIGHT, place=lambda t: t + np.array([0, 5, 0])),
        r"another coordinate frame: shifted by \(0\.0, 5\.\d, 0\.0\) mm",
    ),
    Wrong("boards exchanged", _change(RIGHT_PAIR, spoil=_boards_exchanged), "order of the boards"),
    Wrong(
        "half a turn on one of two boards",
        _change(RIGHT_PAIR, spoil=_half_turn_above),
        r"twin trap at \(6\.0, 118\.\d, -9\.0\).*boards out of step: half a turn",
    ),
    Wrong("wrong baud", _change(RIGHT, send=_at_half_the_baud)),
    Wrong("another board's wire", _change(RIGHT, send=_of_another_wire), "look like interactlab"),
)
