"""``haptogram decode``: any bytes as annotated frames, damage included."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from haptogram.settings.parser import Parser, add_file_option

from ..acting_options import refuse_idle_options, without_option
from .sources import FORMATS, Source, open_recorded_source

if TYPE_CHECKING:
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
    parser.add_argument(
        "--from-board",
        action="store_true",
        help="the bytes of a dump are what a board sent [what a host sent]",
    )
    parser.add_argument("--verbose", action="store_true", help="print every field in full")
    parser.add_argument("--json", action="store_true", help="print a line of JSON for each frame")


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
    """Return the wire that the first bytes look like, ours if unsure, and a doubt (or "")."""
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
    """Return the annotator for the wire of a dialect, else for Haptogram's own."""
    from haptogram_protocol.annotation.frames import FrameAnnotator
    from haptogram_protocol.annotation.operations import OperationAnnotator
    from haptogram_protocol.dialects.table import DIALECTS

    if name not in DIALECTS:
        return FrameAnnotator()
    return OperationAnnotator(DIALECTS[name], from_board=from_board)


def _decoded_source(source: Source, name: str, *, from_board: bool) -> Iterator[_Found]:
    """Yield the decoded pieces of both directions, in the order of their last bytes."""
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
    """Print a piece as a line of JSON with all fields; return False if output is broken."""
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
    """Print *text*; return False if standard output has failed."""
    print(text)
    return getattr(sys.stdout, "error", None) is None
