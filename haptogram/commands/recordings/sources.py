"""Bytes to decode: a recording, a dump of raw bytes or hex text, piece by piece."""

from __future__ import annotations

import contextlib
import itertools
import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, TYPE_CHECKING, Final

from haptogram.errors import ConfigurationError, reading_file
from haptogram.evidence.recordings.channels import MAGIC

if TYPE_CHECKING:
    from haptogram.evidence.recordings.reader import Recording

#: Values of the option that says what a file holds; the first one finds out.
FORMATS: Final = ("auto", "recording", "raw", "hex")
_STDIN: Final = Path("-")
_CHUNK: Final = 65_536
_LOOKED_AT: Final = 4096
#: Bytes as two digits each, with a prefix or not, and what may stand between them.
_BYTES: Final = re.compile(rb"(?:(?:0[xX]|\\x)?[0-9a-fA-F]{2}|[\s,:;]+)*+")
_LONGEST_REST: Final = 3  # most characters of an unfinished byte: its prefix and first digit
_LEFT_OUT: Final = re.compile(rb"0[xX]|\\x|[\s,:;]+")


@dataclass(frozen=True, slots=True)
class RecordedChunk:
    """Bytes of one direction.

    Attributes
    ----------
    sender : str
        ``host`` or ``board``; empty: not known.
    t_ns : int or None
        Time since the first bytes, on the host's clock.
    """

    data: bytes
    sender: str = ""
    t_ns: int | None = None


@dataclass(slots=True)
class Source:
    """An input that was opened.

    Attributes
    ----------
    chunks : iterator of RecordedChunk
        Its bytes; read once.
    first : bytes
        Its first bytes, by which a wire is recognised.
    note : str
        Peculiarity of the input, once it was read; empty: none.
    """

    chunks: Iterator[RecordedChunk]
    first: bytes = b""
    note: str = field(default="")


@contextlib.contextmanager
def open_recorded_source(path: Path, kind: str) -> Iterator[Source]:
    """Open an input for as long as the context lasts.

    Parameters
    ----------
    kind : str
        One of :data:`FORMATS`.

    Raises
    ------
    ConfigurationError
        If it cannot be read; from ``chunks`` if it turns out to be something else.
    """
    with _opened_byte_source(path) as file:
        begin = _read_byte_source(file, path, _LOOKED_AT)
        if kind == "auto":
            kind = _detected_format(begin)
        if kind == "recording":
            yield _recording_as_source(path)
            return
        blocks: Iterator[bytes] = itertools.chain([begin], _source_blocks(file, path))
        if kind == "hex":
            blocks = _source_blocks_from_hex(blocks, path)
        first = next(blocks, b"")
        chunks = (RecordedChunk(block) for block in itertools.chain([first], blocks))
        yield Source(chunks, first[:_LOOKED_AT])


def _detected_format(begin: bytes) -> str:
    """Return "recording", "hex" or "raw", as a file of bytes begins."""
    if begin.startswith(MAGIC):
        return "recording"
    found = _BYTES.match(begin)
    rest = len(begin) - found.end() if found else len(begin)
    whole = len(begin) < _LOOKED_AT
    return "hex" if begin.strip() and rest <= (0 if whole else _LONGEST_REST) else "raw"


def _opened_byte_source(path: Path) -> contextlib.AbstractContextManager[IO[bytes]]:
    """Open a file of bytes, or standard input."""
    if path == _STDIN:
        if sys.stdin is None:
            raise ConfigurationError("-: standard input is closed; name a file")
        return contextlib.nullcontext(sys.stdin.buffer)
    with reading_file(path):
        return path.open("rb")


def _read_byte_source(file: IO[bytes], path: Path, size: int) -> bytes:
    """Return up to *size* bytes of *file*; an error names *path*."""
    with reading_file(path):
        return file.read(size)


def _source_blocks(file: IO[bytes], path: Path) -> Iterator[bytes]:
    """Yield the bytes of *file* in blocks."""
    while block := _read_byte_source(file, path, _CHUNK):
        yield block


# --- Hex text ----------------------------------------------------------------------------------


def _source_blocks_from_hex(blocks: Iterator[bytes], path: Path) -> Iterator[bytes]:
    """Yield the bytes that hex digits in *blocks* are; prefixes and separators are left out."""
    rest, place = b"", 0  # what is not yet understood, and where it begins
    for block in itertools.chain(blocks, [b""]):
        text = rest + block
        found = _BYTES.match(text)
        end = found.end() if found else 0
        rest = text[end:]
        if len(rest) > _LONGEST_REST or (rest and not block):
            at = place + end
            raise ConfigurationError(
                f"{path}: no hex text at character {at}: {rest[:1].decode('latin-1')!r}; --input "
                "raw takes any bytes"
            )
        place += end
        yield bytes.fromhex(_LEFT_OUT.sub(b"", text[:end]).decode("ascii"))


# --- Recordings --------------------------------------------------------------------------------


def _recording_as_source(path: Path) -> Source:
    """Return the bytes of a recording as a source to decode; refuse standard input."""
    from haptogram.evidence.recordings.reader import Recording

    if path == _STDIN:
        raise ConfigurationError("-: a recording is read from a file; name the file")
    recording = Recording(path)
    source = Source(iter(()), recording.first_bytes(_LOOKED_AT))
    source.chunks = _recorded_source_chunks(recording, source)
    return source


def _recorded_source_chunks(recording: Recording, source: Source) -> Iterator[RecordedChunk]:
    """Yield the bytes of a recording with sender and time, from its first entry on."""
    from haptogram.evidence.recordings.channels import TO_BOARD, TO_HOST

    senders = {TO_BOARD: "host", TO_HOST: "board"}
    start_ns: int | None = None
    for entry in recording.entries(tuple(senders)):
        start_ns = entry.t_ns if start_ns is None else start_ns
        yield RecordedChunk(entry.data, senders[entry.topic], entry.t_ns - start_ns)
    source.note = recording.note
