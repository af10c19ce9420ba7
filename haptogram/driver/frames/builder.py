"""Makes frames of foci: the expected drive and the message.

Three modes: the host computes the drive of ``phases`` and ``drives``; the board computes that of
``points`` from the foci as the wire rounds them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Final, cast

import numpy as np
from numpy.typing import NDArray

from haptogram.acoustics import AcousticModel, Drive, check_focus_target, focus_phases
from haptogram.acoustics.model.drive import FULL_AMPLITUDE, quantise_phase
from haptogram.acoustics.solvers.focus import check_focus_targets
from haptogram.acoustics.solvers.several import METHODS, Method, frame_weights
from haptogram.driver.frames.frame import (
    MODE_OF,
    NEEDED_FEATURE,
    REGISTER_BITS,
    Frame,
    Mode,
    are_driver_frames,
    check_frame_request,
    check_frames_to_send,
)
from haptogram.driver.frames.targets import Targets, as_frame_foci
from haptogram.errors import ConfigurationError
from haptogram.records.frame import Focus
from haptogram.settings.arguments import check_argument_kind, check_choice
from haptogram_protocol import messages

_U16: Final = 65_535
_TURN: Final = 65_536
LEAST_SPEED_MM_S, MOST_SPEED_MM_S = 300_000, 380_000  # of the configuration: HG-7.1
_BATCH: Final = 512  # targets whose phases are computed at a time: 3 MB per 256 transducers


class FrameBuilder:
    """Turns foci into frames for one board.

    Parameters
    ----------
    model : AcousticModel
        Array and air that the host assumes.
    identity : HelloReply
        The board's answer to HELLO, with its features and limits.

    Raises
    ------
    ConfigurationError
        If the board has another number of transducers.
    """

    def __init__(self, model: AcousticModel, identity: messages.HelloReply) -> None:
        check_argument_kind("model", model, AcousticModel, "an AcousticModel")
        if model.array.count != identity.transducers:
            raise ConfigurationError(
                f"the model has {model.array.count} transducers, the board {identity.transducers}"
            )
        self._model = model
        self._identity = identity
        self._geometry_hash = model.array.digest()
        self._graded = bool(identity.features & messages.Feature.AMPLITUDE)

    def frames_of(
        self, targets: Targets | Sequence[Frame], mode: Mode | None, solver: Method | None
    ) -> list[Frame]:
        """Return *targets* as frames: those that are ready are checked, all others are built.

        Raises
        ------
        ConfigurationError
            As :meth:`build`; or ready frames do not fit the board, *mode* or *solver*.
        """
        if are_driver_frames(targets, Frame):
            check_frame_request(targets, mode, solver)
            check_frames_to_send(targets, self._model, self._identity)
            return list(targets)
        foci = as_frame_foci(cast("Targets", targets))
        return self.build(
            foci, "phases" if mode is None else mode, "naive" if solver is None else solver
        )

    def build(
        self, foci: list[tuple[Focus, ...]], mode: Mode, solver: Method = "naive"
    ) -> list[Frame]:
        """Return a frame per entry of *foci*; equal ones are one and the same.

        Parameters
        ----------
        solver : str
            Method that makes the drive of a frame with several foci.

        Raises
        ------
        ConfigurationError
            A target out of reach, foci that mode or solver cannot express, or a mode that the
            board does not have; the text names the frame.
        """
        self._check_mode(mode)
        _check_frame_solver(solver, mode)
        numbers = distinct_frames(self._model, foci, solver)
        for group, number in numbers.items():
            self._check(number, group, mode)
        frames = self._make(list(numbers), mode, solver)
        if len(frames) == len(foci):  # all differ
            return frames
        made = dict(zip(numbers, frames, strict=True))
        return [made[group] for group in foci]

    def _make(self, foci: list[tuple[Focus, ...]], mode: Mode, solver: Method) -> list[Frame]:
        """Return one frame of *mode* for each group of foci.

        *solver* computes the drive of a group on the host; in the mode points the board computes
        it.
        """
        if mode == "points":
            return [self._points(group) for group in foci]
        if mode == "drives":
            return [self._drives(group, solver) for group in foci]
        batches = batches_of_phases(self._model, foci, solver)
        return [f for batch, phases in batches for f in self._phases(batch, phases, solver)]

    def _check_mode(self, mode: Mode) -> None:
        """Refuse a mode that the board lacks; refuse the mode points for a model it cannot carry.

        That is one with a calibration, or a speed of sound outside LEAST_SPEED_MM_S to
        MOST_SPEED_MM_S.
        """
        check_choice("mode", mode, tuple(MODE_OF.values()))
        if mode in NEEDED_FEATURE and not self._identity.features & NEEDED_FEATURE[mode]:
            raise ConfigurationError(f"mode {mode}: the board takes no such frames")
        if mode == "points" and self._model.calibration is not None:
            raise ConfigurationError(
                "mode points: the board computes the drives, without the calibration; phases and "
                "drives are computed with it"
            )
        speed_mm_s = frame_sound_speed_mm_s(self._model)
        if mode == "points" and not LEAST_SPEED_MM_S <= speed_mm_s <= MOST_SPEED_MM_S:
            raise ConfigurationError(
                f"mode points: the speed of sound of the model is {speed_mm_s / 1000:g} m/s; a "
                f"board takes {LEAST_SPEED_MM_S / 1000:g} to {MOST_SPEED_MM_S / 1000:g} m/s"
            )

    def _check(self, number: int, foci: tuple[Focus, ...], mode: Mode) -> None:
        """Refuse frame *number* if the mode or the board cannot carry its foci or amplitudes."""
        if mode == "points" and len(foci) > self._identity.max_points:
            raise ConfigurationError(
                f"frame {number}: {len(foci)} foci; the board takes {self._identity.max_points}"
            )
        if mode == "phases":
            check_full_frame_amplitude(
                number, foci, "mode phases drives", ", drives and points do not"
            )
        if mode == "points" and not self._graded:
            check_full_frame_amplitude(number, foci, "the board drives")

    def _phases(
        self, foci: Sequence[tuple[Focus, ...]], phases_rad: NDArray[np.float64], solver: Method
    ) -> list[Frame]:
        """Return frames of phase codes at full amplitude, one per group of foci."""
        codes = quantise_phase(phases_rad, REGISTER_BITS)
        full = bytes([FULL_AMPLITUDE]) * codes.shape[1]
        return [
            Frame(
                group,
                Drive.from_bytes(data, full),
                messages.Phases(data),
                self._geometry_hash,
                solver,
            )
            for group, data in zip(foci, map(np.ndarray.tobytes, codes), strict=True)
        ]

    def _drives(self, foci: tuple[Focus, ...], solver: Method) -> Frame:
        """Return a frame of phase and amplitude codes, solved here."""
        drive = Drive.from_weights(frame_weights(self._model, foci, solver), REGISTER_BITS)
        data = drive.phase_codes.tobytes() + drive.amplitude_codes.tobytes()
        message = messages.Drives(data)
        return Frame(foci, drive, message, self._geometry_hash, solver)

    def _points(self, foci: tuple[Focus, ...]) -> Frame:
        """Return a frame of points, with the drive that the board will compute for them."""
        points = tuple(_frame_focus_on_wire(focus) for focus in foci)
        rounded = tuple(_frame_focus_from_wire(point) for point in points)
        speed_mm_s = frame_sound_speed_mm_s(self._model)
        model = self._model.with_sound_speed(speed_mm_s / 1000)
        drive = Drive.from_weights(frame_weights(model, rounded, "naive"), REGISTER_BITS)
        if not self._graded:  # HG-5.4/2
            drive = Drive(drive.phase_codes, np.full_like(drive.amplitude_codes, FULL_AMPLITUDE))
        message = messages.Points(points)
        return Frame(rounded, drive, message, self._geometry_hash, sound_speed_mm_s=speed_mm_s)


def distinct_frames(
    model: AcousticModel, foci: Sequence[tuple[Focus, ...]], solver: Method
) -> dict[tuple[Focus, ...], int]:
    """Return the frames that differ, with the number of the first of each.

    Raises
    ------
    ConfigurationError
        For foci that are out of reach, or have phases that *solver* chooses; it names the frame.
    """
    numbers: dict[tuple[Focus, ...], int] = {}
    for number, group in enumerate(foci):
        numbers.setdefault(group, number)
    are_in_reach = _are_frames_in_reach(model, list(numbers))
    if are_in_reach and solver == "naive":  # which takes any phase
        return numbers
    for group, number in numbers.items():
        _check_frame_foci(model, number, group, solver, is_in_reach=are_in_reach)
    return numbers


def _are_frames_in_reach(model: AcousticModel, foci: Sequence[tuple[Focus, ...]]) -> bool:
    """Return True if all foci of all frames are targets in reach of the model's array."""
    places = np.array([focus.position_m for group in foci for focus in group])
    try:
        check_focus_targets(model, places)
    except ConfigurationError:
        return False
    return True


def _check_frame_foci(
    model: AcousticModel, number: int, foci: tuple[Focus, ...], solver: Method, *, is_in_reach: bool
) -> None:
    """Refuse foci of frame *number* that are out of reach, or have phases that *solver* replaces.

    *is_in_reach*: whether it is known that all are in reach.
    """
    try:
        for focus in () if is_in_reach else foci:
            check_focus_target(model, focus.position_m)
    except ConfigurationError as error:
        raise ConfigurationError(f"frame {number}: {error}") from error
    if solver != "naive" and any(focus.phase_rad != 0.0 for focus in foci):
        raise ConfigurationError(
            f"frame {number}: a focus with a phase of its own; the solver {solver} chooses "
            "the phases, naive does not"
        )


def check_full_frame_amplitude(
    number: int, foci: tuple[Focus, ...], who_drives: str, others: str = ""
) -> None:
    """Refuse a single focus of less than full amplitude, which phases alone cannot make."""
    if len(foci) == 1 and foci[0].amplitude != 1.0:
        raise ConfigurationError(
            f"frame {number}: a focus of amplitude {foci[0].amplitude:g}; {who_drives} every "
            f"transducer at full amplitude{others}"
        )


def batches_of_phases(
    model: AcousticModel, foci: Sequence[tuple[Focus, ...]], solver: Method
) -> Iterator[tuple[Sequence[tuple[Focus, ...]], NDArray[np.float64]]]:
    """Yield some T frames and their (T, N) phases; several foci in one: those of the solver."""
    for start in range(0, len(foci), _BATCH):
        batch = foci[start : start + _BATCH]
        if all(len(group) == 1 for group in batch):
            lags = np.array([[group[0].phase_rad] for group in batch])
            yield batch, focus_phases(model, [group[0].position_m for group in batch]) + lags
        else:
            angles = [np.angle(frame_weights(model, group, solver)) for group in batch]
            yield batch, np.array(angles)


def frame_sound_speed_mm_s(model: AcousticModel) -> int:
    """Return the model's speed of sound in whole mm/s, as boards take it."""
    return round(model.medium.sound_speed_m_s * 1000)


def _check_frame_solver(solver: Method, mode: Mode) -> None:
    """Refuse an unknown solver, and one that the board does not use for points."""
    check_choice("solver", solver, METHODS)
    if mode == "points" and solver != "naive":
        raise ConfigurationError(
            f"solver {solver}: in the mode points the board computes the drive, by superposition"
        )


def _frame_focus_on_wire(focus: Focus) -> messages.FocalPoint:
    """Return a focus rounded to the units of the wire: whole µm, 16 bits of level and phase."""
    x_um, y_um, z_um = (round(value * 1e6) for value in focus.position_m)
    turns = math.floor(focus.phase_rad / math.tau * _TURN + 0.5)
    return messages.FocalPoint(
        x_um, y_um, z_um, math.floor(focus.amplitude * _U16 + 0.5), turns % _TURN
    )


def _frame_focus_from_wire(point: messages.FocalPoint) -> Focus:
    """Return a focus in metres and radians."""
    position_m = (point.x_um / 1e6, point.y_um / 1e6, point.z_um / 1e6)
    return Focus(position_m, point.amplitude / _U16, point.phase / _TURN * math.tau)
