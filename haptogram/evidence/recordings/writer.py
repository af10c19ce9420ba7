"""Writes a recording while a run goes on: raw bytes and latches, a few microseconds for a frame.

The recording never ends the run: a disk that is full ends the recording, and :attr:`failure` says
so.
"""

from __future__ import annotations

import base64
import contextlib
import json
import platform
from collections.abc import Mapping
from pathlib import Path
from typing import Any, BinaryIO, Final, cast

import haptogram
from haptogram.errors import missing_extra, plain_reason, writing_file
from haptogram.machine.closing import ClosedByWith
from haptogram.machine.files import STANDARD_OUTPUT
from haptogram.machine.interrupts import DelayedInterrupts
from haptogram.records.latch import LatchRecord
from haptogram_protocol.annotation.frames import FrameAnnotator
from haptogram_protocol.messages import signed_difference, unwrap

from . import channels
from .scene import INFO, array_of_recording, axes_of_recording, focus_of_recording, log_of_recording

_FLUSH_NS: Final = 50_000_000  # 50 frames at 1 kHz: what a killed run can lose
_CHUNK: Final = 256 * 1024
_BATCH: Final = 8  # entries that are encoded at a time
_RECORDS: Final = {
    "board": channels.BOARD,
    "latch": channels.LATCH,
    "output": channels.OUTPUT,
    "pulses": channels.PULSES,
    "end": channels.FAULTS,
}
_TIMES: Final = ("t_us", "t_latch_us")
_SAID: Final = ("kind", "event", *_TIMES)
_PITCH_M: Final = 0.01  # drawn size of the elements of an array without a pitch
_REPLIES: Final = 32  # the quickest of them tells the difference of the clocks
_WRAP: Final = 1 << 32


def check_recordings() -> None:
    """Raise unless recordings can be written and read here.

    Raises
    ------
    ConfigurationError
        If the package ``mcap`` is missing.
    """
    try:
        import mcap  # noqa: F401  only whether it is there
    except ImportError as error:
        raise missing_extra("recordings need the package mcap", "record") from error


def begin_recording(writer: Any, library: str) -> dict[str, int]:
    """Write the head of a recording by *library*; return the numbers of its channels by topic."""
    writer.start(profile=channels.PROFILE, library=library)
    writer.add_metadata(channels.METADATA, {"version": str(channels.VERSION), "library": library})
    ids = {}
    for channel in channels.CHANNELS.values():
        schema = writer.register_schema(channel.schema_name, "jsonschema", channel.schema)
        metadata = {"clock": channel.clock, "meaning": channel.meaning}
        ids[channel.topic] = writer.register_channel(channel.topic, "json", schema, metadata)
    return ids


class RecordingWriter(ClosedByWith):
    """A recording that is being written.

    Parameters
    ----------
    path : Path
        Is written anew; ``-`` is standard output.
    command : str
        Command whose run it is.
    configuration : mapping
        Options of the run, of JSON types.
    waits : bool
        Whether a regular file stays as it is until :meth:`begin`, and for good without it: a run
        that is refused costs no recording that was there.

    Attributes
    ----------
    path : Path
        The file.
    has_heard : bool
        Whether bytes came from a board.
    failure : str
        Why the recording ended early, in one line; empty as long as it goes on.
    last_ns : int
        The latest time of an entry, on the host's clock as all of them.

    Raises
    ------
    ConfigurationError
        If the file cannot be opened, or the package ``mcap`` is missing.
    """

    def __init__(
        self,
        path: Path,
        *,
        command: str = "",
        configuration: Mapping[str, Any] | None = None,
        waits: bool = False,
    ) -> None:
        check_recordings()
        from mcap.writer import CompressionType, Writer

        self.failure = ""
        self.path = path
        self.has_heard = False
        self._file = _RecordingOutput(path, waits=waits)
        # Half an entry would cost all behind it.
        self._whole_entries = DelayedInterrupts()
        if path.is_file():  # a pipe may hold the writer up for good: there Ctrl-C must be heard
            self._whole_entries.install()
        self._writer: Any = Writer(
            self._file, chunk_size=_CHUNK, compression=CompressionType.NONE, enable_crcs=True
        )
        self._ids: dict[str, int] = {}
        self._clock = RecordingClock()
        self._is_array_drawn = False
        self._waiting: list[tuple[str, int, bytes, int]] = []
        self._flushed_ns = self.last_ns = 0
        with self._attempt():
            self._begin(command, configuration or {})

    def _begin(self, command: str, configuration: Mapping[str, Any]) -> None:
        """Write the header, the channels, and the command with its configuration and versions."""
        self._ids = begin_recording(self._writer, f"haptogram {haptogram.__version__}")
        versions = {"haptogram": haptogram.__version__, "python": platform.python_version()}
        run = {"command": command, "configuration": configuration, "versions": versions}
        self._waiting.append((channels.RUN, 0, _encoded_recording_fields(run), 0))
        self._encode()
        self._writer.flush()

    # --- while the run goes on -----------------------------------------------------------------

    def begin(self) -> None:
        """Replace the file that was there, by what waits for it; once is enough."""
        if self._file.waits:
            with self._attempt():
                self._file.begin()

    def to_board(self, t_ns: int, data: bytes, waited_ns: int = 0) -> None:
        """Write bytes that the port took from the host, which may have waited for *waited_ns*."""
        self._take(
            channels.TO_BOARD, t_ns, _encoded_recording_bytes(data), max(0, t_ns - waited_ns)
        )
        self._flush_when_due(t_ns)

    def to_host(self, t_ns: int, data: bytes) -> None:
        """Write bytes that the host read."""
        self.has_heard = True
        self._clock.hear(t_ns, data)
        self._take(channels.TO_HOST, t_ns, _encoded_recording_bytes(data), t_ns)
        self._flush_when_due(t_ns)

    def latch(self, latch: LatchRecord) -> None:
        """Write a latch."""
        self.record(latch.as_record())

    def document(self, topic: str, t_ns: int, fields: Mapping[str, Any]) -> None:
        """Write *fields* at a time of the host; a line that begins has a clock of its own."""
        if topic == channels.LINK and fields["event"] in ("opened", "excerpt"):
            self._clock = RecordingClock(t_ns, fields.get("boot_ns"))
            self._is_array_drawn = False
        self._take(topic, t_ns, _encoded_recording_fields(fields), t_ns)
        if topic == channels.LINK:
            self.log(t_ns, f"line: {fields['event']}")
        elif (
            topic in (channels.BOARD, channels.MODEL)
            and "positions_m" in fields
            and not self._is_array_drawn
        ):
            self._is_array_drawn = True
            self._draw_array(fields)

    def host_ns(self, device_us: int | None) -> int:
        """Return a device time on the host's clock; now, if there is none."""
        return self.last_ns if device_us is None else self._clock.host_ns(device_us, self.last_ns)

    def log(self, t_ns: int, message: str, level: int = INFO) -> None:
        """Write an event in words, as viewers list them."""
        self.document(channels.LOG, t_ns, log_of_recording(t_ns, message, level))

    def verdict(self, t_us: int | None, fields: Mapping[str, Any]) -> None:
        """Write the verdict on a frame, and its target and focus as viewers draw them."""
        t_ns = self.host_ns(t_us)
        self.document(channels.VERDICT, t_ns, fields)
        scene = focus_of_recording(t_ns, fields["target_m"], fields["measured_m"])
        self.document(channels.FOCUS, t_ns, scene)

    def opened(
        self, t_ns: int, board: Mapping[str, Any] | None, boot_ns: int | None, *, paced: bool
    ) -> None:
        """Write that a line to a board begins; *board* has the options of a virtual one."""
        fields = {"event": "opened", "board": board, "boot_ns": boot_ns, "paced": int(paced)}
        self.document(channels.LINK, t_ns, fields)

    def departed(self, t_ns: int) -> None:
        """Write that the host closed the port: what was on the line is lost."""
        self.document(channels.LINK, t_ns, {"event": "departed"})

    def hardware_fault(self, t_ns: int) -> None:
        """Write that the hardware of the board was made to fail."""
        self.document(channels.LINK, t_ns, {"event": "hardware_fault"})

    def record(self, record: Mapping[str, Any]) -> None:
        """Write a record of the back door (docs/backdoor.md) on the channels that hold it."""
        if "boot_us" in record:
            self._clock.power_up(record["boot_us"])
        topic = _RECORDS.get(record["kind"], channels.OUTPUT)
        t_ns = self.host_ns(next((record[name] for name in _TIMES if name in record), None))
        self.document(topic, t_ns, record)
        if topic == channels.OUTPUT:
            self.log(t_ns, _recorded_event_text(record))

    def _draw_array(self, fields: Mapping[str, Any]) -> None:
        """Write axes and elements of the board, dated to the begin of its line.

        A viewer starts there. *fields* has the positions of the elements and the pitch (None: drawn
        as 10 mm).
        """
        begin_ns = self._clock.start_ns
        self.document(channels.FRAME, begin_ns, axes_of_recording())
        pitch_m = fields.get("pitch_m") or _PITCH_M
        self.document(channels.ARRAY, begin_ns, array_of_recording(fields["positions_m"], pitch_m))

    def flush(self) -> None:
        """Hand everything to the operating system."""
        if not self.failure:
            with self._attempt():
                self._encode()
                self._writer.flush()

    def close(self) -> None:
        """Write the end, without which the file counts as cut off; twice does no harm."""
        if self._file.is_open:
            if not self.failure:
                with self._attempt():
                    self._encode()
                    self._writer.finish()
            with self._attempt():
                self._file.close()
        self._whole_entries.remove()

    # --- the file ------------------------------------------------------------------------------

    def _take(self, topic: str, t_ns: int, data: bytes, published_ns: int) -> None:
        """Queue an entry, and write the queue from 8 entries on; nothing after a failure.

        *t_ns* is its time on the host, *published_ns* since when its bytes may have waited.
        """
        if self.failure:
            return
        self.last_ns = max(self.last_ns, t_ns)
        self._waiting.append((topic, t_ns, data, published_ns))
        if len(self._waiting) >= _BATCH:
            with self._attempt():
                self._encode()

    def _flush_when_due(self, t_ns: int) -> None:
        """Flush the file if the last time was 50 ms ago or more, by the clock of the entries."""
        if not 0 <= t_ns - self._flushed_ns < _FLUSH_NS:
            self._flushed_ns = t_ns
            self.flush()

    def _encode(self) -> None:
        """Write all queued entries to the MCAP writer."""
        entries, self._waiting = self._waiting, []
        for topic, t_ns, data, published_ns in entries:
            self._writer.add_message(self._ids[topic], t_ns, data, published_ns)

    @contextlib.contextmanager
    def _attempt(self) -> Any:
        """Guard what is written within: an OSError there ends the recording, and is not passed on.

        The first one is kept as the reason.
        """
        with self._whole_entries:
            try:
                yield
            except OSError as error:  # the first one is the reason why the recording ended
                if not self.failure:
                    why = f"the recording ended early: {plain_reason(error)}"
                    self.failure = f"{self.path}: {why}"
                    self._file.give_up()


class _RecordingOutput:
    """A file that knows how much it has taken, so that a pipe can be one.

    One that *waits* keeps what it takes until :meth:`begin`, and leaves the disk as it was without.
    """

    def __init__(self, path: Path, *, waits: bool) -> None:
        self._path, self._is_new = path, not path.exists()
        self.waits = waits and (self._is_new or path.is_file())
        self._file = _opened_recording_file(path, "r+b" if path.is_file() else "wb")
        self._waiting: list[bytes] = []
        self._size = 0
        self.is_open = True
        if not self.waits:
            self.begin()

    def begin(self) -> None:
        """Replace the content of the file."""
        self.waits = False
        if self._path.is_file():
            self._file.truncate()
        self._file.write(b"".join(self._waiting))
        self._waiting.clear()
        self._file.flush()

    def write(self, data: bytes) -> int:
        self._size += len(data)
        if not self.waits:
            return self._file.write(data)
        self._waiting.append(bytes(data))
        return len(data)

    def tell(self) -> int:
        return self._size

    def flush(self) -> None:
        self._file.flush()

    def close(self) -> None:
        self.is_open = False
        self._file.close()
        if self.waits and self._is_new:
            self._path.unlink(missing_ok=True)

    def give_up(self) -> None:
        """Close without a second error about what is still buffered."""
        self.is_open = False
        with contextlib.suppress(OSError):
            self._file.close()


def _opened_recording_file(path: Path, mode: str) -> BinaryIO:
    """Open a file, or standard output, to write a recording; make its folder."""
    with writing_file(path):
        if path == STANDARD_OUTPUT:
            return open(1, "wb", closefd=False)
        path.parent.mkdir(parents=True, exist_ok=True)
        return cast("BinaryIO", path.open(mode))


def _encoded_recording_bytes(data: bytes) -> bytes:
    """Return JSON {"data": ...} with the bytes in base64."""
    return b'{"data":"' + base64.b64encode(data) + b'"}'


def _recorded_event_text(record: Mapping[str, Any]) -> str:
    """Return an output event as text, with the fields besides kind, event and time."""
    more = (f"{name} {value}" for name, value in record.items() if name not in _SAID)
    return ", ".join([f"output: {record.get('event', record['kind'])}", *more])


def _encoded_recording_fields(fields: Mapping[str, Any]) -> bytes:
    """Return fields as compact JSON; values that JSON lacks become text."""
    return json.dumps(fields, separators=(",", ":"), allow_nan=False, default=str).encode()


class RecordingClock:
    """Turns device times into those of the host.

    Parameters
    ----------
    start_ns : int
        Host time at which the line began.
    boot_ns : int or None
        Host time of the board's power-up, which makes its clock exact; None: the first replies
        tell it to within their time on the line, and without any the first device time is now.
    """

    def __init__(self, start_ns: int = 0, boot_ns: int | None = None) -> None:
        self.start_ns = start_ns
        self._boot_ns = boot_ns
        self._ahead_us: int | None = None  # device over host
        self._told_us: int | None = None  # the same, as replies tell it, without whole wraps
        self._replies = 0 if boot_ns is not None else _REPLIES
        self._annotator = FrameAnnotator()

    def power_up(self, boot_us: int) -> None:
        """Take the device time of the power-up."""
        if self._boot_ns is not None:
            self._ahead_us = boot_us - self._boot_ns // 1000

    def hear(self, t_ns: int, data: bytes) -> None:
        """Learn from bytes that the host read."""
        if not self._replies:
            return
        for piece in self._annotator.feed(data):
            if piece.header is not None:
                self._replies = max(0, self._replies - 1)
                ahead_us = piece.header.time_us - t_ns // 1000
                if self._told_us is None or signed_difference(ahead_us, self._told_us, 32) > 0:
                    self._told_us = ahead_us

    def host_ns(self, device_us: int, now_ns: int) -> int:
        """Return the host time of a device time; the difference is settled by the first one."""
        if self._ahead_us is None:
            self._replies = 0
            self._ahead_us = device_us - now_ns // 1000
            if self._told_us is not None:
                self._ahead_us = unwrap(self._told_us % _WRAP, self._ahead_us, 32)
        return max(0, (device_us - self._ahead_us) * 1000)
