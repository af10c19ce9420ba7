"""``haptogram decode``: any bytes as annotated frames, damage included."""

from __future__ import annotations

import argparse
import contextlib
import itertools
import json
import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, Final

from haptogram.errors import ConfigurationError, reading_file
from haptogram.evidence.recordings.channels import MAGIC
from haptogram.settings.parser import Parser, add_file_option, add_flag

from ..acting_options import refuse_idle_options, without_option

if TYPE_CHECKING:
    from haptogram.evidence.recordings.reader import Recording
    from haptogram_protocol.annotation.frames import Annotated, Annotator


class _WireNames:
    """The names of all wires; their codecs are loaded for somebody who asks."""

    def __iter__(self) -> Iterator[str]:
        from haptogram_protocol.dialects.looks_like import HAPTOGRAM
        from haptogram_protocol.dialects.table import DIALECTS

        return iter((HAPTOGRAM, *DIALECTS))


def set_up_decode(parser: Parser) -> None:
    """Add the options of the command."""
    parser.acting = {"verbose": without_option("json")}
    parser.set_defaults(run=run_decode)
    add_file_option(parser, "file", help="recording, dump or hex text; - is standard input")
    parser.add_argument(
        "--dialect",
        choices=_WireNames(),
        metavar="NAME",
        help="the wire: %(choices)s [what the first bytes look like]",
    )
    parser.add_argument(
        "--input",
        choices=FORMATS,
        default=FORMATS[0],
        help="what the file holds [auto: a recording by its first bytes, hex text by its "
        "characters, else raw bytes]",
    )
    add_flag(
        parser, "--from-board", help="the bytes of a dump are what a board sent [what a host sent]"
    )
    add_flag(parser, "--verbose", help="print every field in full")
    add_flag(parser, "--json", help="print a line of JSON for each frame")


def run_decode(arguments: argparse.Namespace) -> int:
    """Print what was read; return 0."""
    refuse_idle_options(arguments)
    with open_recorded_source(arguments.file, arguments.input) as source:
        name, doubt = (arguments.dialect, "") if arguments.dialect else _recognised_source(source)
        print_line = _print_decoded_json if arguments.json else _print_decoded_text
        found = None
        for found in _decoded_source(source, name, from_board=arguments.from_board):
            if not print_line(found, verbose=arguments.verbose):
                return 0  # nobody reads any more
    empty = "" if found else f"there are no bytes in {arguments.file}"
    for note in filter(None, (doubt, source.note, empty)):
        print(f"haptogram decode: {note}", file=sys.stderr)
    return 0


@dataclass(frozen=True, slots=True)
class _Found:
    """A piece with its sender and time, where they are known."""

    piece: Annotated
    sender: str
    t_ns: int | None


def _recognised_source(source: Source) -> tuple[str, str]:
    """Return the wire that the first bytes look like, and a sentence on a doubt ("" if none).

    Haptogram's own wire is taken if no board's wire looks like them.
    """
    from haptogram_protocol.dialects.looks_like import HAPTOGRAM, looks_like_dialect
    from haptogram_protocol.dialects.table import DIALECTS

    names = looks_like_dialect(source.first)
    if HAPTOGRAM in names or not source.first:
        return HAPTOGRAM, ""
    known = [name for name in names if name in DIALECTS]
    if not known:
        what = f"{names[0]} and no wire of a board" if names else "no wire"
        return HAPTOGRAM, (
            f"the first bytes look like {what}; they were read as {HAPTOGRAM}, --dialect chooses"
        )
    doubt = (
        f"the bytes look like {' and '.join(known)}; they were read as {known[0]}, --dialect "
        "chooses"
    )
    return known[0], doubt if len(known) > 1 else ""


def _decode_annotator(name: str, *, from_board: bool) -> Annotator:
    """Return the annotator for the dialect *name*, else for Haptogram's own wire.

    *from_board*: its bytes are those of the board.
    """
    from haptogram_protocol.annotation.frames import FrameAnnotator
    from haptogram_protocol.annotation.operations import OperationAnnotator
    from haptogram_protocol.dialects.table import DIALECTS

    if name not in DIALECTS:
        return FrameAnnotator()
    return OperationAnnotator(DIALECTS[name], from_board=from_board)


def _decoded_source(source: Source, name: str, *, from_board: bool) -> Iterator[_Found]:
    """Yield the decoded pieces of both directions, in the order of their last bytes.

    *name* is the wire; *from_board* tells the sender of bytes that have none.
    """
    annotators: dict[str, Annotator] = {}
    for chunk in source.chunks:
        if chunk.sender not in annotators:
            is_board = chunk.sender == "board" if chunk.sender else from_board
            annotators[chunk.sender] = _decode_annotator(name, from_board=is_board)
        for piece in annotators[chunk.sender].feed(chunk.data):
            yield _Found(piece, chunk.sender, chunk.t_ns)
    for sender, annotator in annotators.items():
        for piece in annotator.end():
            yield _Found(piece, sender, None)


def _print_decoded_text(found: _Found, *, verbose: bool) -> bool:
    """Print a piece: place, size and text, if *verbose* its fields; False if output is broken."""
    piece = found.piece
    head = f"{piece.offset:>8} {piece.size:>5}  "
    if found.sender:
        when = " " * 13 if found.t_ns is None else f"{found.t_ns / 1e9:+11.6f} s"
        head = f"{when} {found.sender:<5} {head}"
    lines = [f"{head}{piece.text}"]
    if verbose:
        lines += [f"{'':{len(head)}}{name} = {value}" for name, value in piece.fields.items()]
    return _print_unless_broken("\n".join(lines))


def _print_decoded_json(found: _Found, *, verbose: bool) -> bool:  # noqa: ARG001  it is always in full
    """Print a piece as a line of JSON with all fields; return False if output is broken.

    *verbose* has no effect, but is what :func:`_print_decoded_text` takes.
    """
    from haptogram_protocol.annotation.frames import annotated_fields_of

    piece = found.piece
    line: dict[str, Any] = {"offset": piece.offset, "size": piece.size}
    if found.sender:
        line |= {"sender": found.sender, "t_ns": found.t_ns}
    line |= {"name": piece.name or None, "fault": piece.fault or None}
    if piece.header is not None:
        line["header"] = annotated_fields_of(piece.header)
    return _print_unless_broken(json.dumps(line | {"fields": piece.fields}))


def _print_unless_broken(text: str) -> bool:
    """Print *text*; return False if standard output has failed, now or before."""
    print(text)
    return getattr(sys.stdout, "error", None) is None


# --- Bytes to decode: a recording, a dump of raw bytes or hex text, piece by piece ---------------


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
    """Return "recording", "hex" or "raw", by the first 4096 bytes of a file; "raw" if empty."""
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
    """Return up to *size* bytes of *file*; ConfigurationError, naming *path*, if it fails."""
    with reading_file(path):
        return file.read(size)


def _source_blocks(file: IO[bytes], path: Path) -> Iterator[bytes]:
    """Yield the bytes of *file* in blocks of up to 64 KiB; errors name *path*."""
    while block := _read_byte_source(file, path, _CHUNK):
        yield block


# --- Hex text ----------------------------------------------------------------------------------


def _source_blocks_from_hex(blocks: Iterator[bytes], path: Path) -> Iterator[bytes]:
    """Yield the bytes that hex text in *blocks* stands for, without prefixes and separators.

    ConfigurationError, naming *path*, at the first character that is no hex text.
    """
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
    """Return the bytes of a recording as a source; ConfigurationError for standard input."""
    from haptogram.evidence.recordings.reader import Recording

    if path == _STDIN:
        raise ConfigurationError("-: a recording is read from a file; name the file")
    recording = Recording(path)
    source = Source(iter(()), recording.first_bytes(_LOOKED_AT))
    source.chunks = _recorded_source_chunks(recording, source)
    return source


def _recorded_source_chunks(recording: Recording, source: Source) -> Iterator[RecordedChunk]:
    """Yield the bytes of a recording with their sender, and the ns since its first entry.

    At the end *source* gets a note on damage to the file, such as that it was cut off.
    """
    from haptogram.evidence.recordings.channels import TO_BOARD, TO_HOST

    senders = {TO_BOARD: "host", TO_HOST: "board"}
    start_ns: int | None = None
    for entry in recording.entries(tuple(senders)):
        start_ns = entry.t_ns if start_ns is None else start_ns
        yield RecordedChunk(entry.data, senders[entry.topic], entry.t_ns - start_ns)
    source.note = recording.note
