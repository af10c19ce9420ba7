"""Reads a recording, whole or cut off, message by message in the order of the file."""

from __future__ import annotations

import base64
import contextlib
import json
import os
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, Final

from haptogram.errors import ConfigurationError, reading_file, unreadable_file, writing_file
from haptogram.machine.files import check_distinct_files
from haptogram.records.latch import LatchRecord
from haptogram.settings.arguments import shown_argument

from . import channels
from .writer import begin_recording, check_recordings

_LARGEST_RECORD: Final = 1 << 28
_VERSION_DIGITS: Final = 9
_BACK_DOOR: Final = (
    channels.BOARD,
    channels.LATCH,
    channels.PULSES,
    channels.OUTPUT,
    channels.FAULTS,
)


_JSON_TYPES: Final[Mapping[str, type | tuple[type, ...]]] = {
    "array": list,
    "boolean": bool,
    "integer": int,
    "number": (int, float),
    "object": dict,
    "string": str,
}


class _Fields(dict[str, Any]):
    """Fields of an entry; one that the recording lacks makes it unreadable."""

    def __missing__(self, name: str) -> Any:
        raise ConfigurationError(
            f"the recording is damaged, or of another program: an entry lacks the field '{name}'"
        )


@dataclass(frozen=True, slots=True)
class RecordingEntry:
    """One message of a recording.

    Attributes
    ----------
    topic : str
        Channel, one of :data:`~haptogram.evidence.recordings.channels.CHANNELS`.
    t_ns : int
        Its time, on the host's clock.
    published_ns : int
        Bytes for the board: since when they may have waited.
    content : bytes
        The message, JSON.
    """

    topic: str
    t_ns: int
    published_ns: int
    content: bytes

    @property
    def data(self) -> bytes:
        """The bytes that passed the line.

        Raises
        ------
        ConfigurationError
            If the message holds none.
        """
        try:
            return base64.b64decode(self.fields["data"], validate=True)
        except (TypeError, ValueError) as error:
            raise self.damaged_error("holds no bytes") from error

    @property
    def latch(self) -> LatchRecord:
        """The latch.

        Raises
        ------
        ConfigurationError
            If the message holds none.
        """
        try:
            return LatchRecord.from_record(self.fields)
        except (TypeError, ValueError) as error:
            raise self.damaged_error("holds no latch") from error

    @property
    def fields(self) -> dict[str, Any]:
        """Fields of the message.

        Raises
        ------
        ConfigurationError
            If it is no object of JSON, or a field has another type than in the schema of its
            channel; and where a field is looked up that it lacks.
        """
        try:
            found = json.loads(self.content, object_pairs_hook=_Fields)
        except (ValueError, RecursionError):
            found = None
        if not isinstance(found, _Fields):
            raise self.damaged_error("is no object of JSON")
        for name, schema in channels.CHANNELS[self.topic].properties.items():
            if name in found and not _is_of_json_type(found[name], schema["type"]):
                text = f"holds {name} = {shown_argument(found[name])}, no {schema['type']}"
                raise self.damaged_error(text)
        return found

    def damaged_error(self, what: str) -> ConfigurationError:
        """Return the error for an entry that cannot be read; *what* names the defect."""
        return ConfigurationError(
            f"the recording is damaged, or of another program: an entry of {self.topic} at "
            f"{self.t_ns} ns {what}"
        )


def _is_of_json_type(value: object, kind: str) -> bool:
    """Return True if *value* has this type of a JSON Schema; true and false are no numbers."""
    return isinstance(value, _JSON_TYPES[kind]) and (isinstance(value, bool) == (kind == "boolean"))


class Recording:
    """A recording in a file; every pass reads it again, in bounded memory.

    Parameters
    ----------
    path : Path
        The file.
    remedy : str, optional
        Advice in the error about a damaged file.

    Attributes
    ----------
    library : str
        Program that wrote it.
    run : dict
        Command, configuration and versions.
    is_whole : bool
        Whether the last pass came to the end that the writer wrote.
    damaged : int
        Chunks of some 50 frames that the last pass had to leave out.

    Raises
    ------
    ConfigurationError
        If there is no such file, it is no recording, or it is of a newer version; in one line.
    """

    def __init__(
        self, path: Path, *, remedy: str = "; haptogram repair saves what lies before"
    ) -> None:
        check_recordings()
        self.path = path
        self._remedy = remedy
        self.is_whole = False
        self.damaged = 0
        self.run: dict[str, Any] = {}
        self._check_beginning()

    def entries(self, topics: Collection[str] | None = None) -> Iterator[RecordingEntry]:
        """Yield the messages of *topics*, or of all, up to the end or to where it was cut off.

        Raises
        ------
        ConfigurationError
            If something in the file cannot be read.
        """
        from mcap.records import Channel, Message

        wanted: dict[int, str] = {}
        for record in self.raw_records():
            if isinstance(record, Message):
                if (topic := wanted.get(record.channel_id)) is not None:
                    yield RecordingEntry(topic, record.log_time, record.publish_time, record.data)
            elif isinstance(record, Channel) and (topics is None or record.topic in topics):
                wanted[record.id] = record.topic

    def first_bytes(self, count: int) -> bytes:
        """Return the first *count* bytes that the host sent, by which a wire is known."""
        first = b""
        for entry in self.entries((channels.TO_BOARD,)):
            first += entry.data
            if len(first) >= count:
                break
        return first[:count]

    def latches(self) -> Iterator[LatchRecord]:
        """Yield the latches."""
        return (entry.latch for entry in self.entries((channels.LATCH,)))

    def records(self) -> Iterator[dict[str, Any]]:
        """Yield the records of the back door, as docs/backdoor.md describes them."""
        return (entry.fields for entry in self.entries(_BACK_DOOR))

    @property
    def note(self) -> str:
        """Defect of the file as far as the last pass came, in a line; empty: none."""
        noun, verb = ("part", "was") if self.damaged == 1 else ("parts", "were")
        parts = [f"{self.damaged} damaged {noun} of some 50 frames {verb} left out"]
        parts = parts[: self.damaged > 0] + ["the recording was cut off"][: not self.is_whole]
        return f"{self.path}: {', and '.join(parts)}" if parts else ""

    @property
    def board(self) -> dict[str, Any] | None:
        """The first record of the back door; None: the recording has none."""
        return next((entry.fields for entry in self.entries((channels.BOARD,))), None)

    # --- the file ------------------------------------------------------------------------------

    def _check_beginning(self) -> None:
        """Read version and run; refuse a file without the header of a recording."""
        from mcap.records import Header, Metadata

        seen: list[Any] = []
        for record in self.raw_records():
            seen.append(record)
            if isinstance(record, Metadata):
                break
        header = seen[0] if seen else None
        if isinstance(header, Header) and header.profile != channels.PROFILE:
            profile = header.profile or "none"
            raise ConfigurationError(
                f"{self.path}: an MCAP file of another program (profile {profile}), no recording"
            )
        last = seen[-1] if seen else None
        if not isinstance(last, Metadata) or last.name != channels.METADATA:
            raise ConfigurationError(f"{self.path}: the recording was cut off before its beginning")
        self.library = last.metadata.get("library", "")
        self._check_version(last.metadata.get("version", ""), self.library)
        self.run = next((entry.fields for entry in self.entries((channels.RUN,))), {})

    def _check_version(self, text: str, library: str) -> None:
        """Refuse a recording whose version *text* is not ours; say what can be done.

        *library* is the program that wrote it.
        """
        shown, library = text[:_VERSION_DIGITS], library or "an unknown one"
        if text != str(channels.VERSION):
            is_old = text.isdecimal() and shown == text and int(text) < channels.VERSION
            remedy = "record the run again, or use that program" if is_old else "update haptogram"
            raise ConfigurationError(
                f"{self.path}: recording of version {shown or '?'}, by {library}"
                f"; this version of haptogram reads {channels.VERSION}: {remedy}"
            )

    def raw_records(self) -> Iterator[Any]:
        """Yield the records of the file up to its end, or to where it was cut off.

        Raises
        ------
        ConfigurationError
            If something in the file cannot be read.
        """
        from mcap.records import Chunk
        from mcap.stream_reader import StreamReader

        self.is_whole, self.damaged = False, 0
        with _opened_recording(self.path) as file:
            begun = _RecordingAsItWas(file)
            reader = StreamReader(begun, emit_chunks=True, record_size_limit=_LARGEST_RECORD)
            try:
                for record in reader.records:
                    if isinstance(record, Chunk):
                        yield from self._in_chunk(record)
                    else:
                        yield record
                self.is_whole = True
            except OSError as error:
                raise unreadable_file(self.path, error, "recording") from error
            except Exception as error:  # the library raises what its parsers happen to raise
                if not begun.left:
                    return  # cut off: everything before was given
                raise ConfigurationError(
                    f"{self.path}: damaged near byte {file.tell()}{self._remedy}"
                ) from error

    def _in_chunk(self, chunk: Any) -> list[Any]:
        """Return the records in a chunk of the file; a damaged one is counted.

        For a damaged one, schemas and channels of the summary at the file's end are returned, as it
        may have held them.
        """
        from mcap.stream_reader import breakup_chunk

        try:
            return list(breakup_chunk(chunk, validate_crc=True))
        except Exception:  # what the parsers of the library happen to raise
            self.damaged += 1
            return self._channels_at_end()

    def _channels_at_end(self) -> list[Any]:
        """Return schemas and channels from the summary at the end; none if that is missing."""
        from mcap.reader import make_reader

        try:
            with self.path.open("rb") as file:
                summary = make_reader(file).get_summary()
        except Exception:  # as above
            return []
        return [*summary.schemas.values(), *summary.channels.values()] if summary else []


class _RecordingAsItWas:
    """A file up to where it ended when it was opened: a writer may still be at work."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self.left = os.fstat(file.fileno()).st_size

    def read(self, size: int) -> bytes:
        data = self._file.read(min(size, self.left))
        self.left -= len(data)
        return data


def _opened_recording(path: Path) -> BinaryIO:
    """Open a recording at its begin; refuse a file that does not begin as MCAP does."""
    with reading_file(path, "recording"):
        file = path.open("rb")
        begin = file.read(len(channels.MAGIC))
        file.seek(0)
    if begin == channels.MAGIC:
        return file
    file.close()
    why = "is empty" if not begin else "is no recording: it does not begin as an MCAP file does"
    raise ConfigurationError(f"{path}: {why}")


def repair_recording(source: Path, target: Path) -> tuple[int, str]:
    """Write the messages of *source* that can be read to *target*.

    Returns
    -------
    tuple of int and str
        How many there were, and what was left out; empty: nothing.

    Raises
    ------
    ConfigurationError
        If *source* is no recording or holds no message that can be read, or *target* cannot be
        written or is the same file.
    """
    check_distinct_files({"the copy": target}, [("the recording", source)])
    recording = Recording(source, remedy="")  # says so if the package mcap is missing

    from mcap.writer import CompressionType, Writer

    if next(_readable_entries(recording), None) is None:
        raise ConfigurationError(
            f"{source}: no message in it can be read; {target} was not written"
        )
    count = 0
    with writing_file(target), target.open("wb") as file:
        writer: Any = Writer(file, compression=CompressionType.NONE)
        ids = begin_recording(writer, recording.library)
        for entry in _readable_entries(recording):
            count += 1
            writer.add_message(ids[entry.topic], entry.t_ns, entry.content, entry.published_ns)
        writer.finish()
    return count, recording.note


def _readable_entries(recording: Recording) -> Iterator[RecordingEntry]:
    """Yield the messages that lie before the damage, or all if there is none."""
    with contextlib.suppress(ConfigurationError):
        yield from recording.entries(channels.CHANNELS)
