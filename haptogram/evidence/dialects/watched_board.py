"""A board by its back door, or by a capture of its pins, without knowledge of the intended foci."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from haptogram.acoustics.arrays import FloatArray
from haptogram.acoustics.model.boards.layout import Z_UP, Rows
from haptogram.errors import ConfigurationError, reads_as
from haptogram.evidence.backdoor import board_model_of_evidence, observation_of_record
from haptogram.evidence.dialects.latches import PulseObservation, pulse_observation_of
from haptogram.records.frame import Evidence
from haptogram.records.remark import About
from haptogram.verification.pins.held.drives import HeldDrives
from haptogram.verification.pins.pin_verdict import captured_elements_text
from haptogram.verification.watch import SeenLatch
from haptogram.verification.watch.latch import MODULATED
from haptogram_protocol.dialects.looks_like import HAPTOGRAM
from haptogram_protocol.dialects.table import DIALECTS

_OWN_STEPS: Final = 256


class WatchedBoard:
    """A board of any dialect.

    Parameters
    ----------
    record : mapping
        The first record of its back door.
    evidence : Evidence
        Who saw its latches.
    timed : bool
        Whether the times of its records mean anything.

    Attributes
    ----------
    model : AcousticModel
        Array and air.
    dialect : str
        Name of the dialect.
    channels : int
        Channels of one board.
    missing : int
        Latches between those that were seen, which were not.

    Raises
    ------
    ConfigurationError
        It is no such record.
    """

    def __init__(
        self,
        record: Mapping[str, Any],
        *,
        evidence: Evidence = Evidence.EXTERNAL,
        timed: bool = True,
    ) -> None:
        if record.get("kind") != "board":
            raise ConfigurationError("the first record of a back door must be of the kind board")
        self.model = board_model_of_evidence(record)
        self.dialect = str(record.get("dialect", HAPTOGRAM))
        with reads_as("a board record"):
            self._channels = [int(channel) for channel in record.get("channels", ())]
            self.channels = self._channels_of_a_board(record)
            self._axes = np.array(record.get("client_axes", Z_UP), dtype=np.float64)
        self._steps = record.get("steps")
        is_simulated = record.get("simulator") is not None
        self._evidence, self._timed = Evidence.SIMULATED if is_simulated else evidence, timed
        self._next: int | None = None
        self._dark: str | None = None  # cause of a drive that has not sounded yet
        self.missing = 0

    def _channels_of_a_board(self, record: Mapping[str, Any]) -> int:
        """Return how many channels one board has.

        That is the figure of its dialect, else that of the first record, else the array's elements.
        """
        if self.dialect in DIALECTS:
            return DIALECTS[self.dialect].channels
        return int(record.get("channel_count", self.model.array.count))

    @property
    def client_axes(self) -> Rows:
        """Rows of our axes in those of the client: ours = rows @ theirs."""
        return tuple(map(tuple, self._axes.tolist()))

    def ours_m(self, client_m: FloatArray) -> FloatArray:
        """Return (..., 3) points in the client's axes in those of the model."""
        return client_m @ self._axes.T

    def clients_m(self, ours_m: FloatArray) -> FloatArray:
        """Return (..., 3) points of the model in the client's axes."""
        points: FloatArray = ours_m @ self._axes
        return points + 0.0

    def latch(self, record: Mapping[str, Any]) -> SeenLatch | None:
        """Return the latch in a record; None: the record is of something else.

        Raises
        ------
        ConfigurationError
            A record that cannot be read.
        """
        kinds = {"pulses": self._of_pulses, "latch": self._of_codes, PINS: self._of_pins}
        with reads_as("a latch record"):
            if (read := kinds.get(record["kind"])) is None:
                return None
            found = read(record)
            if self._next is not None:
                self.missing += max(0, found.number - self._next)
            self._next = found.number + 1
        return found

    def _of_pulses(self, record: Mapping[str, Any]) -> SeenLatch:
        """Convert a record of pulses to a latch, with the driven channels that have no element."""
        seen = pulse_observation_of(record, self._channels)
        driven = np.flatnonzero((seen.pulses.widths > 0) & (seen.pulses.widths < seen.pulses.steps))
        stray = np.setdiff1d(driven, self._channels)
        return SeenLatch(
            number=seen.number,
            weights=seen.weights,
            steps=min(filter(None, (seen.pulses.steps, self._steps, seen.phase_steps))),
            t_us=seen.t_latch_us if self._timed else None,
            cause=self._cause_of_pulses(seen),
            counted=seen.counted,
            stray=tuple(int(channel) for channel in stray),
            evidence=self._evidence,
        )

    def _of_pins(self, record: Mapping[str, Any]) -> SeenLatch:
        """Convert a record of captured pins to a latch."""
        steps = DIALECTS[self.dialect].steps if self.dialect in DIALECTS else _OWN_STEPS
        return SeenLatch(
            number=record["number"],
            weights=record["weights"],
            steps=min(filter(None, (steps, self._steps))),
            t_us=record["t_latch_us"],
            evidence=self._evidence,
        )

    def _cause_of_pulses(self, seen: PulseObservation) -> str:
        """Return what changed the pulses: an operation of the client, or its modulation.

        While modulation mutes the output a new drive is not heard; it is then given as the cause of
        the first sound.
        """
        is_dark = not (np.abs(seen.weights) > 0.0).any()
        if seen.cause != MODULATED:
            self._dark = seen.cause if is_dark else None
            return seen.cause
        cause, self._dark = (seen.cause, self._dark) if is_dark else (self._dark, None)
        return cause or seen.cause

    def _of_codes(self, record: Mapping[str, Any]) -> SeenLatch:
        """Convert a record of phase and amplitude codes to a latch; refuse one without a drive."""
        seen = observation_of_record(record)
        drive = seen.output
        if drive is None:
            raise ConfigurationError("not a latch record of a back door: it has no drive")
        return SeenLatch(
            number=record["number"],
            weights=drive.weights(),
            steps=1 << record["commanded_bits"],
            t_us=seen.t_latch_us if self._timed else None,
            cause="frame",
            evidence=self._evidence,
        )


# --- Latches in a capture of the drive pins ------------------------------------------------------


#: Kind of the records of latches that pins show.
PINS: Final = "pins"


def records_of_held_drives(held: HeldDrives, board: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return records of a capture, as those of a back door: the *board*, its latches, the end.

    Raises
    ------
    ConfigurationError
        An element that the board lacks.
    """
    record, count = held.record, len(board["positions_m"])
    if held.elements[-1] >= count:
        element = held.elements[-1]
        raise ConfigurationError(
            f"channel {record.pins[element].channel} is element {element}; the board has the "
            f"elements 0 to {count - 1}"
        )
    records = [dict(board)]
    remark = {"kind": "event", "event": "remark", "about": About.CLIENT}
    records += [{**remark, "text": text} for text in _limits_of_capture(held, count)]
    begins = np.array([held.begins[0], *(latch.end for latch in held.latches)])
    times_us = np.rint(record.seconds(begins) * 1e6).astype(np.int64).tolist()
    for number, t_us in enumerate(times_us):
        weights = np.zeros(count, np.complex128)
        weights[list(held.elements)] = held.weights[number]
        records.append({"kind": PINS, "number": number, "t_latch_us": t_us, "weights": weights})
    end = {"kind": "end", "clean": True, "dropped": 0, "cut": record.cut}
    return [*records, end]


def _limits_of_capture(held: HeldDrives, count: int) -> list[str]:
    """Return notes: how many of *count* elements were captured, defects of pins and capture."""
    record = held.record
    found = [f"pins of {captured_elements_text(len(held.elements), count)} were captured"]
    found += [
        f"element {element} ({pin.channel}): {text}"
        for element, pin in record.pins.items()
        for text in pin.defects
    ]
    return [*found, *record.notes]
