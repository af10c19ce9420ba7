"""From what is wanted to what is sent: foci -> expected drive and message.

Three modes: ``phases`` and ``drives``, whose drive the host computes, and ``points``, whose drive
the board computes from the foci as the wire rounds them.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final, Literal, TypeAlias, TypeGuard

import numpy as np
from numpy.typing import ArrayLike, NDArray

from haptogram.acoustics import AcousticModel, Drive, check_target, focus_phases
from haptogram.acoustics.drive import FULL_AMPLITUDE, quantise_phase
from haptogram.acoustics.solvers import METHODS, Method, weights_for_foci
from haptogram.errors import ConfigurationError
from haptogram.records import Focus
from haptogram_protocol.messages import (
    PHASE_FORMAT_BIT,
    Drives,
    Feature,
    FocalPoint,
    HelloReply,
    PhaseFormat,
    Phases,
    Points,
    pack_phases,
)

Mode: TypeAlias = Literal["phases", "drives", "points"]
Targets: TypeAlias = ArrayLike | Sequence[Focus] | Sequence[Sequence[Focus]]

REGISTER_BITS: Final = 8  # resolution of a board's phase registers
_U16: Final = 65_535
_TURN: Final = 65_536
_NEEDS: Final = {"drives": Feature.AMPLITUDE, "points": Feature.POINTS}
_BATCH: Final = 512  # targets whose phases are computed at a time: 3 MB per 256 transducers


@dataclass(frozen=True, slots=True)
class Frame:
    """One frame, ready but for its number and its time.

    Attributes
    ----------
    foci : tuple of Focus
        What it is for; as the wire rounds them where the board computes the drive.
    drive : Drive
        What is expected in the registers.
    message : Phases, Drives or Points
        What is sent.
    solver : str
        What made the drive.
    """

    foci: tuple[Focus, ...]
    drive: Drive
    message: Phases | Drives | Points
    solver: Method = "naive"

    @property
    def phase_bits(self) -> int:
        """Resolution of the phases on the wire; of the registers where the board computes them."""
        return REGISTER_BITS if isinstance(self.message, Points) else int(self.message.bits)

    @property
    def board_computed(self) -> bool:
        """Whether the board computes the drive."""
        return isinstance(self.message, Points)

    @property
    def payload_bytes(self) -> int:
        """Length of the payload."""
        if isinstance(self.message, Points):
            return len(self.message.points) * FocalPoint.LAYOUT.size
        return self.message.LAYOUT.size + len(self.message.data)


def are_frames(targets: object) -> TypeGuard[Sequence[Frame]]:
    """Tell whether *targets* are frames already."""
    return isinstance(targets, Sequence) and bool(len(targets)) and isinstance(targets[0], Frame)


def as_foci(targets: Targets) -> list[tuple[Focus, ...]]:
    """Return the foci of every frame.

    Parameters
    ----------
    targets : (T, 3) array_like, sequence of Focus, or sequence of sequences of Focus
        One focus per frame, as a position in metres or a :class:`Focus`; or several.

    Raises
    ------
    ConfigurationError
        If there is no frame, a frame without a focus, or something that is no focus.
    """
    entries: Iterable[object] = targets if isinstance(targets, Sequence) else np.asarray(targets)
    try:
        frames = [_foci_of(entry) for entry in entries]
    except TypeError as error:
        raise ConfigurationError(f"targets are not (T, 3) positions or foci: {error}") from error
    if not frames:
        raise ConfigurationError("0 targets; there must be 1 or more")
    return frames


def _foci_of(entry: object) -> tuple[Focus, ...]:
    if isinstance(entry, Focus):
        return (entry,)
    if isinstance(entry, Sequence) and entry and all(isinstance(f, Focus) for f in entry):
        return tuple(entry)
    return (Focus.at(np.asarray(entry)),)


class FrameBuilder:
    """Turns foci into frames for one board.

    Parameters
    ----------
    model : AcousticModel
        Array and air that the host assumes.
    identity : HelloReply
        What the board can do.
    phase_bits : int
        Bits per phase on the wire, in the mode ``phases``.

    Raises
    ------
    ConfigurationError
        If the board has no such phase format.
    """

    def __init__(self, model: AcousticModel, identity: HelloReply, phase_bits: int) -> None:
        self._model = model
        self._identity = identity
        self._bits = _phase_format(identity, phase_bits)

    def build(
        self, foci: list[tuple[Focus, ...]], mode: Mode, solver: Method = "naive"
    ) -> list[Frame]:
        """Return a frame per entry of *foci*.

        Parameters
        ----------
        solver : str
            What makes the drive where a frame has several foci.

        Raises
        ------
        ConfigurationError
            A target out of reach, foci that mode or solver cannot express, or a mode that the
            board does not have; the text names the frame.
        """
        self._check_mode(mode)
        _check_solver(solver, mode)
        for number, group in enumerate(foci):
            self._check(number, group, mode, solver)
        if mode == "points":
            return [self._points(group) for group in foci]
        if mode == "drives":
            return [self._drives(group, solver) for group in foci]
        batches = [foci[start : start + _BATCH] for start in range(0, len(foci), _BATCH)]
        return [frame for batch in batches for frame in self._phases(batch, solver)]

    def _check_mode(self, mode: Mode) -> None:
        if mode not in ("phases", "drives", "points"):
            raise ConfigurationError(f"mode is {mode!r}; known are phases, drives and points")
        if mode in _NEEDS and not self._identity.features & _NEEDS[mode]:
            raise ConfigurationError(f"mode {mode}: the board takes no such frames")
        if mode == "points" and self._model.calibration is not None:
            raise ConfigurationError(
                "mode points: the board computes the drives, without the calibration; phases and "
                "drives are computed with it"
            )

    def _check(self, number: int, foci: tuple[Focus, ...], mode: Mode, solver: Method) -> None:
        try:
            for focus in foci:
                check_target(self._model, focus.position_m)
        except ConfigurationError as error:
            raise ConfigurationError(f"frame {number}: {error}") from error
        if mode == "points" and len(foci) > self._identity.max_points:
            raise ConfigurationError(
                f"frame {number}: {len(foci)} foci; the board takes {self._identity.max_points}"
            )
        if mode == "phases" and len(foci) == 1 and foci[0].amplitude != 1.0:
            raise ConfigurationError(
                f"frame {number}: a focus of amplitude {foci[0].amplitude:g}; mode phases drives "
                "every transducer at full amplitude, drives and points do not"
            )
        if solver != "naive" and any(focus.phase_rad != 0.0 for focus in foci):
            raise ConfigurationError(
                f"frame {number}: a focus with a phase of its own; the solver {solver} chooses "
                "the phases, naive does not"
            )

    def _phases(self, foci: list[tuple[Focus, ...]], solver: Method) -> list[Frame]:
        shift = REGISTER_BITS - self._bits
        codes = quantise_phase(self._phases_rad(foci, solver), self._bits)
        full = np.full(codes.shape[1], FULL_AMPLITUDE, dtype=np.uint8)
        return [
            Frame(
                group,
                Drive(row << shift, full),
                Phases(self._bits, 0, pack_phases(row.tobytes(), self._bits)),
                solver,
            )
            for group, row in zip(foci, codes, strict=True)
        ]

    def _phases_rad(self, foci: list[tuple[Focus, ...]], solver: Method) -> NDArray[np.float64]:
        """Return the (T, N) phases; several foci in a frame: those of the solver's drive."""
        if all(len(group) == 1 for group in foci):
            positions = np.array([group[0].position_m for group in foci])
            lags = np.array([[group[0].phase_rad] for group in foci])
            phases: NDArray[np.float64] = focus_phases(self._model, positions) + lags
            return phases
        return np.array([np.angle(_weights(self._model, group, solver)) for group in foci])

    def _drives(self, foci: tuple[Focus, ...], solver: Method) -> Frame:
        drive = Drive.from_weights(_weights(self._model, foci, solver), REGISTER_BITS)
        data = drive.phase_codes.tobytes() + drive.amplitude_codes.tobytes()
        return Frame(foci, drive, Drives(PhaseFormat.BITS_8, 0, data), solver)

    def _points(self, foci: tuple[Focus, ...]) -> Frame:
        points = tuple(_on_wire(focus) for focus in foci)
        rounded = tuple(_from_wire(point) for point in points)
        model = with_sound_speed(self._model, sound_speed_mm_s(self._model))
        drive = Drive.from_weights(_weights(model, rounded, "naive"), REGISTER_BITS)
        return Frame(rounded, drive, Points(points))


def sound_speed_mm_s(model: AcousticModel) -> int:
    """Return the model's speed of sound as a board is told it, in whole mm/s."""
    return round(model.medium.sound_speed_m_s * 1000)


def with_sound_speed(model: AcousticModel, speed_mm_s: int) -> AcousticModel:
    """Return *model* with another speed of sound, in mm/s."""
    medium = dataclasses.replace(model.medium, sound_speed_m_s=speed_mm_s / 1000)
    return dataclasses.replace(model, medium=medium)


def _phase_format(identity: HelloReply, bits: int) -> PhaseFormat:
    offered = [int(f) for f, bit in PHASE_FORMAT_BIT.items() if identity.phase_formats & bit]
    if bits not in offered:
        raise ConfigurationError(
            f"phase_bits is {bits}; the board takes {', '.join(map(str, offered)) or 'none'}"
        )
    return PhaseFormat(bits)


def _check_solver(solver: Method, mode: Mode) -> None:
    if solver not in METHODS:
        raise ConfigurationError(f"solver is {solver!r}; known are {', '.join(METHODS)}")
    if mode == "points" and solver != "naive":
        raise ConfigurationError(
            f"solver {solver}: in the mode points the board computes the drive, by superposition"
        )


def _weights(
    model: AcousticModel, foci: tuple[Focus, ...], solver: Method
) -> NDArray[np.complex128]:
    points, levels, lags = zip(
        *((f.position_m, f.amplitude, f.phase_rad) for f in foci), strict=True
    )
    return weights_for_foci(model, points, levels, lags, method=solver)


def _on_wire(focus: Focus) -> FocalPoint:
    x_um, y_um, z_um = (round(value * 1e6) for value in focus.position_m)
    turns = math.floor(focus.phase_rad / math.tau * _TURN + 0.5)
    return FocalPoint(x_um, y_um, z_um, math.floor(focus.amplitude * _U16 + 0.5), turns % _TURN)


def _from_wire(point: FocalPoint) -> Focus:
    position_m = (point.x_um / 1e6, point.y_um / 1e6, point.z_um / 1e6)
    return Focus(position_m, point.amplitude / _U16, point.phase / _TURN * math.tau)
