"""Records of a virtual board's back door: as they come from a file or socket, and as observations.

The records are described in docs/backdoor.md.  They come from the board's latch and not over the
line, so they are external evidence: no firmware vouches for itself here.
"""

from __future__ import annotations

import dataclasses
import json
import math
import os
import re
import socket
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, Final

import numpy as np

from haptogram.acoustics import (
    AcousticModel,
    Calibration,
    CircularPiston,
    Drive,
    Medium,
    NoFocus,
    NotSingle,
    PointSource,
    Reconstruction,
    SingleFocus,
    Transducer,
    TransducerArray,
)
from haptogram.errors import ConfigurationError, plain_reason, reading_file, reads_as, refusals_of
from haptogram.machine.closing import ClosedByWith
from haptogram.records.frame import Evidence, FrameKey, Intended, Observation
from haptogram.records.latch import Codes
from haptogram.records.losses import BoardLosses, FrameDrop
from haptogram_protocol.messages import unwrap

_KINDS: Final[Mapping[str, type[SingleFocus] | type[NoFocus] | type[NotSingle]]] = {
    "single_focus": SingleFocus,
    "no_focus": NoFocus,
    "not_single": NotSingle,
}


_PISTON: Final = re.compile(r"CircularPiston\(radius_m=([0-9.e-]+)\)")
_END: Final = "end"
#: Kinds of the records of latches: of Haptogram's own board, and of boards of other dialects.
LATCHES: Final = ("latch", "pulses")
_ARMED: Final = "ARMED"
#: Reasons for which a timer of the board mutes it: the host, or its stream, fell silent.
TIMED_OUT: Final = frozenset({"HOLD_EXPIRED", "HOST_SILENT", "UNATTENDED"})
UNIX_PREFIX: Final = "unix:"
_AT_A_TIME: Final = 1 << 20  # bytes: about a thousand latches
_LONGEST_LINE: Final = 1 << 22
_POLL_S: Final = 0.01


def board_model_of_evidence(board: Mapping[str, Any]) -> AcousticModel:
    """Return the array, the air and the transducers of a ``board`` record.

    Raises
    ------
    ConfigurationError
        It is no such record, or of a transducer that is not known here.
    """
    with reads_as("a board record"), refusals_of("not a board record of a back door:"):
        positions, normals = np.array(board["positions_m"]), np.array(board["normals"])
        shape = board["grid_shape"]
        source = board["transducer"]
        model = AcousticModel(
            TransducerArray(positions, normals, shape and tuple(shape), board["pitch_m"]),
            Medium(**board["medium"]),
            Transducer(
                _parse_directivity(source["directivity"]),
                source["source_strength_pa_m"],
                source["frequency_hz"],
            ),
        )
        if (measured := board["calibration"]) is None:
            return model
        gain, phase_rad = np.array(measured["gain"]), np.array(measured["phase_rad"])
        return model.calibrated(Calibration(gain, phase_rad, np.array(measured["positions_m"])))


def _parse_directivity(written: str) -> CircularPiston | PointSource:
    """Return the directivity whose repr is *written* in a record; refuse one that is not known."""
    if written == repr(PointSource()):
        return PointSource()
    if (piston := _PISTON.fullmatch(written)) is None:
        raise ConfigurationError(f"a back door names the directivity {written!r}, not known here")
    return CircularPiston(float(piston[1]))


def observation_of_record(record: Mapping[str, Any]) -> Observation:
    """Return the observation in a ``latch`` record.

    Raises
    ------
    ConfigurationError
        If it is no such record.
    """
    with reads_as("a latch record"), refusals_of("not a latch record of a back door:"):
        return Observation(
            key=FrameKey.from_record(record),
            t_latch_us=record["t_latch_us"],
            late=record["late"],
            evidence=Evidence.EXTERNAL,
            drive=drive_of_record(record),
            drive_crc=record["drive_crc"],
            reconstruction=observed_reconstruction_of(record["reconstruction"]),
            radiated=None if record["radiated"] is None else drive_of_record(record["radiated"]),
            t_received_us=record["t_received_us"],
        )


def observations_of_backdoor(
    records: Iterable[Mapping[str, Any]], session: int | None = None
) -> list[Observation]:
    """Return the latches among *records*, of one session or of all, in order."""
    return [observation_of_record(record) for record in _latch_records_of(records, session)]


def _latch_records_of(
    records: Iterable[Mapping[str, Any]], session: int | None
) -> Iterator[Mapping[str, Any]]:
    """Yield the records of latches, of one *session*; None: of all."""
    for record in records:
        if record["kind"] == "latch" and session in (None, record["session"]):
            yield record


def observed_fault_counts(records: Sequence[Mapping[str, Any]]) -> dict[str, int] | None:
    """Return the counts of faults that fired; None: the board has not ended, or had none."""
    end = _end_record(records)
    return None if end is None else end.get("faults")


def why_observations_incomplete(
    records: Sequence[Mapping[str, Any]], session: int | None = None, last: FrameKey | None = None
) -> str | None:
    """Return why latches of *session* may be missing among *records*; None: none is.

    Parameters
    ----------
    last : FrameKey, optional
        A frame with which the records are taken to be whole, if the board has not ended.
    """
    if missing := _lacked_latches(records, session):
        return f"the back door lacks {missing} latches that found its queue full"
    end = _end_record(records)
    if end is not None:
        return None if end["clean"] else "the board was killed before its last latches were told"
    if last is not None and any(is_observed_latch_of(record, last) for record in records):
        return None
    return (
        "the back door fell silent before the last frame: its process waits for a processor, "
        "or the board lost it; in virtual time, the default of VirtualBoard, nothing waits"
    )


def _lacked_latches(records: Sequence[Mapping[str, Any]], session: int | None) -> int:
    """Return how many latch records are missing: gaps in a session's numbers, or dropped ones.

    For *session* None only those count that the end record says were dropped.
    """
    numbers = [record["number"] for record in _latch_records_of(records, session)]
    end = _end_record(records)
    gaps = max(numbers) + 1 - len(numbers) if numbers and session is not None else 0
    return max(gaps, end["dropped"] if end else 0)


def _end_record(records: Sequence[Mapping[str, Any]]) -> Mapping[str, Any] | None:
    """Return the last record if it says that the board has ended; else None."""
    return records[-1] if records and records[-1]["kind"] == _END else None


def is_observed_latch_of(record: Mapping[str, Any], key: FrameKey) -> bool:
    """Return True if *record* is of the latch with this *key*, or says that it will not come."""
    if record["kind"] == "latch":
        return key == FrameKey.from_record(record)
    return record.get("event") == "dropped" and key == _dropped_frame_key(record)


def observations_on_clock_of(
    intended: Sequence[Intended], observations: Sequence[Observation]
) -> list[Observation]:
    """Return *observations* with their times counted as those of *intended* are.

    The board counts the wraps of its 32-bit clock from its start, the host from when it came: the
    two are whole wraps apart, the same number for as long as the session lasts.
    """
    shift_us = _wrap_shift_us(intended, ((o.key, o.t_latch_us) for o in observations))
    if not shift_us:
        return list(observations)
    return [dataclasses.replace(o, t_latch_us=o.t_latch_us + shift_us) for o in observations]


def observed_silences_on_clock_of(
    intended: Sequence[Intended], records: Sequence[Mapping[str, Any]]
) -> list[int]:
    """Return the device times at which the output fell silent, counted as *intended* is."""
    shift_us = _wrap_shift_us(intended, _times_of_frames(records))
    return [
        record["t_us"] + shift_us
        for record in records
        if record["kind"] == "output"
        and (
            (record["event"] == "ramp_ended" and not record["restored"])
            or (record["event"] == "state" and record["requested"] and record["state"] != _ARMED)
        )
    ]


def observed_losses_on_clock_of(
    intended: Sequence[Intended],
    records: Sequence[Mapping[str, Any]],
    *,
    is_machine_in_between: bool,
) -> BoardLosses:
    """Return the reasons for frames that were not latched, counted as *intended* is."""
    output = [record for record in records if record["kind"] == "output"]
    drops = [record for record in output if record["event"] == "dropped"]
    states = [r for r in output if r["event"] == "state" and r["state"] != _ARMED]
    shift_us = _wrap_shift_us(intended, _times_of_frames(records))
    return BoardLosses(
        drops={
            _dropped_frame_key(drop): FrameDrop(drop["counter"], drop["t_us"] + shift_us)
            for drop in drops
        },
        timeouts_us=tuple(r["t_us"] + shift_us for r in states if r["reason"] in TIMED_OUT),
        mutes_us=tuple(r["t_us"] + shift_us for r in states if r["requested"]),
        is_machine_in_between=is_machine_in_between,
        is_told_in_order=bool(intended)
        and any(record["kind"] == "latch" for record in records)  # numbered, of our wire
        and not _lacked_latches(records, intended[0].key.session),
    )


def _times_of_frames(records: Iterable[Mapping[str, Any]]) -> Iterator[tuple[FrameKey, int]]:
    """Yield key and device time of every frame that was latched or dropped."""
    for record in records:
        if record["kind"] == "latch":
            yield FrameKey.from_record(record), record["t_latch_us"]
        elif record.get("event") == "dropped":
            yield _dropped_frame_key(record), record["t_us"]


def _dropped_frame_key(record: Mapping[str, Any]) -> FrameKey:
    """Return the key of the stream frame that a record of a drop names."""
    return FrameKey.of_stream(record["session"], record["index"])


def _wrap_shift_us(intended: Sequence[Intended], latched: Iterable[tuple[FrameKey, int]]) -> int:
    """Return the µs to add to latch times so that they fit the due times of *intended*.

    It is a multiple of 2**32 µs, as the board's clock wraps there; the first latch of a frame with
    a due time decides. 0 if there is none.
    """
    frames = ((frame.key, frame.t_apply_us) for frame in intended)
    due_us: dict[FrameKey, int] = {}
    for latched_key, t_us in latched:
        if latched_key not in due_us:  # most often the first latch is of the first frame
            for key, t_apply_us in frames:
                if t_apply_us is not None:
                    due_us[key] = t_apply_us
                if key == latched_key:
                    break
        if latched_key in due_us:
            return unwrap(t_us, due_us[latched_key], 32) - t_us
    return 0


def drive_of_record(fields: Mapping[str, Any]) -> Drive:
    """Return the drive among the fields of a record."""
    codes = Codes.from_record(fields)
    return Drive.from_bytes(codes.phases, codes.amplitudes, codes.bits)


def observed_reconstruction_of(fields: Mapping[str, Any] | None) -> Reconstruction | None:
    """Return the reconstruction in a record; None: the field was not rebuilt."""
    if fields is None:
        return None
    values = {name: _observed_value(value) for name, value in fields.items() if name != "kind"}
    return _KINDS[fields["kind"]](**values)


def _observed_value(value: Any) -> Any:
    """Convert a value read from JSON: lists to tuples, null to infinity."""
    if isinstance(value, list):
        return tuple(_observed_value(item) for item in value)
    return math.inf if value is None else value


class BackdoorReader(ClosedByWith):
    """Reads the records of one board, and never waits for them.

    Parameters
    ----------
    source : str
        ``unix:PATH`` of the socket that a board listens on, or a file that it appends to.

    Attributes
    ----------
    is_open : bool
        Whether more records may come: a file may grow as long as it is read.

    Raises
    ------
    ConfigurationError
        There is no such socket or file.

    Examples
    --------
    >>> BackdoorReader("unix:/nowhere")
    Traceback (most recent call last):
        ...
    haptogram.errors.ConfigurationError: no board listens at unix:/nowhere (there is no such \
directory): start one with haptogram board --backdoor unix:/nowhere
    """

    def __init__(self, source: str) -> None:
        self.is_open = True
        self._source = source
        self._unread = b""
        self._lines = 0
        is_socket = source.startswith(UNIX_PREFIX)
        self._input: _BackdoorSocketReader | _BackdoorFileStream = (
            _BackdoorSocketReader(source) if is_socket else _BackdoorFileStream(source)
        )

    def read(self) -> list[dict[str, Any]]:
        """Return the records that came since the last call, about a thousand at most.

        Raises
        ------
        ConfigurationError
            A line that is no record; it is named by its number.
        """
        while data := self._input.receive():
            *lines, self._unread = (self._unread + data).split(b"\n")
            if len(self._unread) > _LONGEST_LINE:
                raise ConfigurationError(f"{self._source}: line {self._lines + 1} has no end")
            if lines:
                return [self._record(line) for line in lines]
        self.is_open = data is not None
        return []

    def read_first(self, patience_s: float = 5.0) -> list[dict[str, Any]]:
        """Return the first records, as soon as there is one.

        Raises
        ------
        ConfigurationError
            None comes for *patience_s*.
        """
        end_s = time.monotonic() + patience_s
        while not (records := self.read()):
            if time.monotonic() > end_s or not self.is_open:
                raise ConfigurationError(f"{self._source}: no record of a back door came")
            time.sleep(_POLL_S)
        return records

    def close(self) -> None:
        """Close the file or the connection."""
        self.is_open = False
        self._input.close()

    def _record(self, line: bytes) -> dict[str, Any]:
        """Return a line of the back door as a record; raise, naming its number, if it is none."""
        self._lines += 1
        try:
            record: dict[str, Any] = json.loads(line)
            record["kind"]
        except (ValueError, TypeError, KeyError, RecursionError) as error:
            raise ConfigurationError(
                f"{self._source}: line {self._lines} is no record of a back door"
            ) from error
        return record


class _BackdoorSocketReader:
    def __init__(self, source: str) -> None:
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            self._socket.connect(source.removeprefix(UNIX_PREFIX))
        except OSError as error:
            self.close()
            raise ConfigurationError(
                f"no board listens at {source} ({plain_reason(error)}): start one with "
                f"haptogram board --backdoor {source}"
            ) from error
        self._socket.setblocking(False)

    def receive(self) -> bytes | None:
        """Return the bytes that have come, b"" if none yet; None: no more will come."""
        try:
            return self._socket.recv(_AT_A_TIME) or None
        except BlockingIOError:
            return b""
        except OSError:
            return None

    def close(self) -> None:
        self._socket.close()


def _open_backdoor_reader(path: str, flags: int) -> int:
    """Open a file for reading, or a pipe without waiting for a board; return its descriptor."""
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))


class _BackdoorFileStream:
    def __init__(self, path: str) -> None:
        with reading_file(path):
            self._file = open(path, "rb", buffering=0, opener=_open_backdoor_reader)  # noqa: SIM115  closed by close()

    def receive(self) -> bytes | None:
        """Return up to 1 MiB that was appended, b"" if nothing was."""
        return self._file.read(_AT_A_TIME) or b""

    def close(self) -> None:
        self._file.close()
