"""Frames of a board that speaks another wire: a code for each channel, from foci or from phases."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final, cast

import numpy as np
from numpy.typing import NDArray

from haptogram.acoustics import AcousticModel, Calibration, Drive, Medium, Transducer
from haptogram.acoustics.model.boards.table import LAYOUTS
from haptogram.acoustics.model.drive import FULL_AMPLITUDE
from haptogram.acoustics.solvers.several import METHODS, Method
from haptogram.driver.frames.builder import (
    batches_of_phases,
    check_full_frame_amplitude,
    distinct_frames,
)
from haptogram.driver.frames.frame import are_driver_frames
from haptogram.driver.frames.targets import Targets, as_frame_foci
from haptogram.errors import ConfigurationError
from haptogram.records.frame import Focus, FrameKey, Intended
from haptogram.settings import arguments
from haptogram_protocol.dialects.codec import Codes, Dialect, Display
from haptogram_protocol.errors import LocalProtocolError

_REGISTER_BITS: Final = 8  # phase bits of the drives in records and verdicts
_TURN: Final = 1 << _REGISTER_BITS
_SESSION: Final = 0  # session of every frame: these wires know none
_HIGHEST_CHANNEL: Final = 0xFFFF  # highest channel of any dialect


@dataclass(frozen=True, slots=True)
class DialectFrame:
    """One frame, ready to be sent.

    Attributes
    ----------
    foci : tuple of Focus
        Focal points of the frame; none if the caller gave phases.
    codes : tuple of int or None
        Step of each channel; None: off.
    channels : tuple of int
        Channel that drives each element.
    drive : Drive
        Drive that these codes are, of each element.
    steps : int
        Steps of a period.
    solver : str
        Method that made the drive.
    """

    foci: tuple[Focus, ...]
    codes: tuple[int | None, ...]
    channels: tuple[int, ...]
    drive: Drive
    steps: int
    solver: Method = "naive"

    def intended(self, number: int) -> Intended:
        """Return the record that it is to be latched, as frame *number* on the line."""
        return Intended(
            number=number,
            key=FrameKey.of_stream(_SESSION, number),
            t_apply_us=None,
            foci=self.foci,
            drive=self.drive,
            phase_bits=_REGISTER_BITS,
            phase_steps=self.steps,
            solver=self.solver,
        )


class DialectFrameBuilder:
    """Turns foci and phases into codes for the boards of one line.

    Parameters
    ----------
    model : AcousticModel
        Array and air that the host assumes.
    display : Display
        The boards.
    channels : tuple of int
        Channel that drives each element.

    Raises
    ------
    ConfigurationError
        If there is not a channel of its own for each element.
    """

    def __init__(self, model: AcousticModel, display: Display, channels: tuple[int, ...]) -> None:
        arguments.check_argument_kind("model", model, AcousticModel, "an AcousticModel")
        self._model, self._display = model, display
        self._channels = channels
        if len(self._channels) != model.array.count:
            raise ConfigurationError(
                f"channels holds {len(self._channels)}, must be one for each of "
                f"{model.array.count} elements"
            )
        outside = [c for c in self._channels if not 0 <= c < display.channels]
        if outside or len(set(self._channels)) < len(self._channels):
            told = f"channel {outside[0]}" if outside else "a channel twice"
            raise ConfigurationError(
                f"channels holds {told}; the boards have channels 0 to {display.channels - 1}"
            )

    def frames_of(
        self, targets: Targets | Sequence[DialectFrame], solver: Method
    ) -> list[DialectFrame]:
        """Return *targets* as frames: those that are ready are checked, all others are built.

        Raises
        ------
        ConfigurationError
            As :meth:`build`; or ready frames are not for these boards.
        """
        if not are_driver_frames(targets, DialectFrame):
            return self.build(as_frame_foci(cast("Targets", targets)), solver)
        ours = self._channels, self._display.channels, self._display.steps
        for number, frame in enumerate(targets):
            if (frame.channels, len(frame.codes), frame.steps) != ours:
                raise ConfigurationError(
                    f"frame {number} was made for other boards or channels; make it anew with "
                    "frames()"
                )
        return list(targets)

    def build(self, foci: Sequence[tuple[Focus, ...]], solver: Method) -> list[DialectFrame]:
        """Return a frame for each entry of *foci*; equal ones are one and the same.

        Raises
        ------
        ConfigurationError
            A target out of reach, an amplitude that phases cannot make, or a solver that is not
            known; the text names the frame.
        """
        arguments.check_choice("solver", solver, METHODS)
        numbers = distinct_frames(self._model, foci, solver)
        for group, number in numbers.items():
            check_full_frame_amplitude(
                number, group, "this wire is given phases alone, which drive"
            )
        made = {
            group: self.of_phases(row, group, solver)
            for batch, phases in batches_of_phases(self._model, list(numbers), solver)
            for group, row in zip(batch, phases, strict=True)
        }
        return [made[group] for group in foci]

    def of_phases(
        self,
        phases_rad: NDArray[np.float64],
        foci: tuple[Focus, ...] = (),
        solver: Method = "naive",
    ) -> DialectFrame:
        """Return the frame of (N,) phases, each rounded to the nearest step."""
        steps = self._display.steps
        nearest = np.floor(phases_rad * (steps / math.tau) + 0.5).astype(np.int64) % steps
        codes: list[int | None] = [None] * self._display.channels
        for channel, code in zip(self._channels, nearest.tolist(), strict=True):
            if channel not in self._display.unconnected:
                codes[channel] = code
        return DialectFrame(foci, tuple(codes), self._channels, self.drive_of(codes), steps, solver)

    def drive_of(self, codes: Codes) -> Drive:
        """Return the drive of the elements that *codes* of all channels are."""
        found = [codes[channel] for channel in self._channels]
        turns = np.array([0 if code is None else code for code in found]) / self._display.steps
        level = round(FULL_AMPLITUDE * self._display.level)
        return Drive(
            (np.floor(_TURN * turns + 0.5).astype(np.int64) % _TURN).astype(np.uint8),
            np.array([0 if code is None else level for code in found], dtype=np.uint8),
        )


def checked_display_channels(channels: Any) -> tuple[int, ...]:
    """Return *channels* as whole numbers; whether the boards have them, their display decides.

    Raises
    ------
    ConfigurationError
        If they are no sequence of whole numbers from 0 on.
    """
    is_row = isinstance(channels, np.ndarray) and channels.ndim == 1
    is_list = isinstance(channels, Sequence) and not isinstance(channels, str | bytes)
    if not (is_row or is_list) or len(channels) == 0:
        raise ConfigurationError(
            f"channels is {arguments.shown_argument(channels)}, must be a sequence of whole "
            "numbers, one for each element"
        )
    return tuple(
        arguments.check_whole(f"channels[{place}]", channel, 0, _HIGHEST_CHANNEL)
        for place, channel in enumerate(channels)
    )


def dialect_display_of(dialect: Dialect, boards: int) -> Display:
    """Return the display of *boards* boards of *dialect*.

    Raises
    ------
    ConfigurationError
        If this program does not drive that wire, or not that number of boards.
    """
    if dialect.display is None:
        raise ConfigurationError(
            f"dialect {dialect.name} can be emulated and not driven: its wire says nothing of how "
            "a host shows phases (Dialect.display, docs/dialects.md)"
        )
    try:
        display = dialect.display(boards)
    except LocalProtocolError as error:
        raise ConfigurationError(f"dialect {dialect.name}: {error}") from error
    if display.channels < boards * dialect.channels:
        raise ConfigurationError(
            f"dialect {dialect.name}: {boards} boards are needed for so many elements; the wire "
            f"drives {display.channels // dialect.channels}, of {dialect.channels} channels each"
        )
    return display


def assumed_dialect_frames_model(dialect: Dialect, medium: Medium | None = None) -> AcousticModel:
    """Return the boards' own array, as their clients have it, in *medium*.

    Raises
    ------
    ConfigurationError
        If their array is not known here.
    """
    if dialect.layout not in LAYOUTS:
        raise ConfigurationError(
            f"model is None, and the array of dialect {dialect.name} is not known here: give one"
        )
    array = LAYOUTS[dialect.layout].array()
    return AcousticModel(array, medium or Medium.air(), Transducer())


def mounted_display_model(model: AcousticModel, display: Display) -> AcousticModel:
    """Return *model* with the emitters mounted as the boards of *display* have them."""
    count = model.array.count
    phases_rad = math.tau * np.array(display.mounting[:count])
    return model.calibrated(Calibration(np.ones(count), phases_rad, model.array.positions_m))
