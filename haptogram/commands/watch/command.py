"""``haptogram watch``: what a board radiates, latch by latch, without knowing the intent."""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import functools
import json
import math
import time
from collections.abc import Callable, Iterator
from io import FileIO
from pathlib import Path
from typing import TYPE_CHECKING, Final, TextIO, TypeAlias

from haptogram.errors import ConfigurationError, writing_file
from haptogram.machine.files import STANDARD_OUTPUT, write_json_file
from haptogram.settings.board import BoardConfig
from haptogram.settings.command_line import add_setting_options
from haptogram.settings.option import options_of
from haptogram.settings.parser import Acting, Parser, add_flag, name_option
from haptogram.settings.run.files import output_options
from haptogram.settings.tolerance import ToleranceConfig

from ..acting_options import refuse_idle_options, with_option
from ..shell import output_files
from ..shell.exit_status import USAGE
from ..shell.positions import add_position_option
from .expected import (
    WATCHED_BOARD_OPTIONS,
    Foci,
    WatchConfig,
    expected_frames_mm,
    make_watch_expectation,
)
from .lines import LatchLines
from .records import Record, Replay, WatchedRecords, is_watched_latch, open_watched_records

if TYPE_CHECKING:
    from haptogram.verification.watch import Watch, WatchedLatch, WatchResult

_WriteLine: TypeAlias = Callable[[str], None]
_REST_S: Final = 3.0  # time after an interrupt to judge the latches that have arrived
_FILES: Final = ("json", "junit", "html", "summary")


_OWN_BOARD: Final = Acting(
    "on a board that is started here, or on a file of bytes (not on a back door)",
    lambda s: s.source is None or (s.dialect is not None and not s.source.startswith("unix:")),
)
_ACTING: Final = {
    **dict.fromkeys(WATCHED_BOARD_OPTIONS, _OWN_BOARD),
    **dict.fromkeys(options_of(ToleranceConfig), with_option("expect", "expect_file")),
}


def set_up_watch(parser: Parser, replay: Replay) -> None:
    """Add the options of the command; *replay* hands bytes to a board."""
    parser.main_options = (
        "dialect array link expect expect_file tolerance_mm frames json junit html"
    )
    parser.acting = _ACTING
    parser.program_option = "--as-device"
    parser.set_defaults(run=functools.partial(run_watch, replay=replay))
    parser.add_argument(
        "source",
        nargs="?",
        metavar="SOURCE",
        type=name_option,
        help="back door of a board (unix:PATH, or the file that it appends to); with --dialect a "
        "file of bytes that a program wrote [a board is started at --link]",
    )
    board = parser.add_argument_group("board")
    rows = options_of(BoardConfig)
    add_setting_options(board, [rows[name] for name in WATCHED_BOARD_OPTIONS])
    board.add_argument(
        "--link",
        metavar="PATH",
        type=name_option,
        help="start a board at this pseudo-terminal [none]",
    )
    add_flag(
        board,
        "--as-device",
        help="start a board and COMMAND, behind --, which finds it as a serial device (Linux)",
    )
    parser.add_argument(
        "client", nargs="*", metavar="COMMAND", help="program of --as-device, with its arguments"
    )
    own = options_of(WatchConfig)
    add_setting_options(board, [own["capture"], own["channels"]])
    expected = parser.add_argument_group("expected foci")
    add_position_option(
        expected,
        "--expect",
        action="append",
        help="focus that is expected, in the axes of the board's own programs; may be repeated: "
        "one a frame, and after the last the first again [none]",
    )
    add_setting_options(expected, [own["expect_file"], *options_of(ToleranceConfig).values()])
    result = parser.add_argument_group("result", output_files.FILE_HELP)
    add_setting_options(result, [own[name] for name in ("latches", "fail_on", "frames")])
    add_setting_options(result, output_options("json junit html summary stamp"))
    add_flag(parser, "--quiet", help="no line for each latch")


def run_watch(arguments: argparse.Namespace, replay: Replay) -> int:
    """Watch until the end, and return the exit status."""
    refuse_idle_options(arguments)
    outputs = output_files.CommandOutputs(arguments, *_FILES, "frames")
    _check_watch_source(arguments)
    frames_mm = expected_frames_mm(arguments)
    with (
        open_watched_records(arguments, replay) as records,
        _watch_frames_file(arguments.frames) as frames,
    ):
        run = _WatchRun(arguments, frames_mm, frames, outputs.text, records)
        run.follow()
    return run.finish(outputs)


def _check_watch_source(arguments: argparse.Namespace) -> None:
    """Raise ConfigurationError for contradictory or missing sources.

    With --as-device, all words that follow become the client's command line, and none the source.
    """
    if arguments.as_device:
        arguments.client = [w for w in (arguments.source, *arguments.client) if w is not None]
        arguments.source = None
        if not arguments.client or arguments.dialect is None or arguments.link is not None:
            raise ConfigurationError(
                "--as-device needs --dialect and a program behind --, and no --link"
            )
        return
    if arguments.client:
        raise ConfigurationError(f"{arguments.client[0]}: one source, or --as-device and a program")
    if (arguments.capture is None) != (arguments.channels is None):
        raise ConfigurationError(
            "--capture needs the map of its --channels, and neither goes alone"
        )
    if arguments.capture is not None:
        if arguments.dialect is None or arguments.source or arguments.link:
            raise ConfigurationError("--capture needs --dialect, and neither --link nor a source")
        return
    if arguments.source is not None and arguments.link is not None:
        raise ConfigurationError("--link starts a board; leave it out, or the source")
    if arguments.source is None and (arguments.link is None or arguments.dialect is None):
        raise ConfigurationError(
            "nothing to watch; give a back door (unix:PATH), a file of bytes with --dialect, or "
            "--dialect and --link to start a board, or --dialect and --capture for its pins"
        )


class _WatchRun:
    """One watch, from the first record to the summary."""

    def __init__(
        self,
        arguments: argparse.Namespace,
        frames_mm: list[Foci],
        frames: _WriteLine | None,
        text: TextIO,
        records: WatchedRecords,
    ) -> None:
        from haptogram.evidence.dialects.watched_board import WatchedBoard
        from haptogram.records.frame import Evidence
        from haptogram.report.watch import WatchReport
        from haptogram.verification.watch import Watch

        self._is_raw = arguments.source is not None and arguments.dialect is not None
        evidence = Evidence.WIRE if self._is_raw else Evidence.EXTERNAL
        self._records, self._frames = records, frames
        self._board = WatchedBoard(next(iter(records)), evidence=evidence, timed=not self._is_raw)
        expectation = make_watch_expectation(arguments, frames_mm, self._board)
        self._expected_m = expectation.frames if expectation is not None else ()
        self._report = WatchReport(
            self._board,
            has_page=arguments.html is not None,
            has_checks=arguments.junit is not None,
        )
        self._watch: Watch = Watch(
            self._board.model,
            channels=self._board.channels,
            client_axes=self._board.client_axes,
            expectation=expectation,
        )
        self._lines = LatchLines(text, self._board, quiet=arguments.quiet)
        self._arguments = arguments
        self._missing: str | None = None
        self._count = 0  # latches of the client
        self._until_s = math.inf
        self._not_looked_at = 0

    def follow(self) -> None:
        """Take record after record, until the last one, the count that was asked for, or Ctrl-C.

        Ctrl-C ends the board. What it has told by then is looked at for some seconds, and counted
        from then on, or from a second Ctrl-C on.
        """
        try:
            self._take_all()
        except KeyboardInterrupt:
            output_files.announce_interrupted_output("haptogram watch")
            self._until_s = time.monotonic() + _REST_S
            self._records.end()
            with contextlib.suppress(KeyboardInterrupt):
                self._take_all()
            self._not_looked_at += self._records.latches_left

    def _take_all(self) -> None:
        """Process records until the stream ends or as many latches as asked for were seen."""
        # Closed here: an interrupt that waited for the last record is heard here, too.
        with contextlib.closing(iter(self._records)) as records:
            for record in records:
                if not self._take_record(record):
                    break

    def _take_record(self, record: Record) -> bool:
        """Process one record; return False after the last one that was asked for, or the end."""
        if record["kind"] == "end":
            self._missing = _why_watch_is_incomplete(record)
            return False
        if "event" in record:
            self._take_event(record)
        elif self._count != self._arguments.latches:
            if time.monotonic() > self._until_s:
                self._not_looked_at += is_watched_latch(record)
            elif latch := self._board.latch(record):
                self._take(self._watch.take(latch))
                self._count += latch.is_of_client
        return self._count != self._arguments.latches or self._watch.frames.waits_for_wire

    def _take_event(self, record: Record) -> None:
        """Pass on what the board noticed of its client: its wire, its leaving, a remark."""
        from haptogram.records.remark import About

        event = record["event"]
        if event == "wire_compared":
            self._watch.frames.wire_compared(is_own=record["is_own"])
        elif event == "client_left":
            self._watch.frames.client_left()
        elif event == "remark":
            self._watch.frames.remark(About(record["about"]), record["text"])
            self._lines.print_remark(record["text"])

    def _take(self, seen: WatchedLatch) -> None:
        """Print and report one latch, and append it to the frames file if there is one."""
        from haptogram.report.watch import watched_client_places_mm

        self._lines.print(seen)
        self._report.take(seen)
        if self._frames is not None:
            line = seen.as_dict() | {
                "client_mm": watched_client_places_mm(seen.pattern, self._board)
            }
            self._frames(json.dumps(line, allow_nan=False) + "\n")

    def finish(self, outputs: output_files.CommandOutputs) -> int:
        """Print the summary, write the files, and return the exit status."""
        self._lines.print_modulation()
        missing = self._missing
        if missing is None and self._board.missing:
            missing = f"{self._board.missing} latches were not shown by the back door"
        if count := self._not_looked_at:
            noun = "latch" if count == 1 else "latches"
            missing = f"{count} {noun} came that were not looked at: the watch was interrupted"
        self._watch.frames.cut_short()
        result = self._watch.result(missing)
        result = dataclasses.replace(result, fail_on_unknown=bool(self._arguments.fail_on))
        if (assumed := _assumed_layout(self._arguments)) and _shows_no_pattern(result):
            result = dataclasses.replace(result, hints=(*result.hints, assumed))
        outputs.print(str(result))
        seconds = None if self._is_raw else outputs.provenance.elapsed_s
        written = outputs.write(
            self._report.document(result, self._expected_m, seconds),
            in_virtual_time=self._is_raw,
            json=lambda path: write_json_file(path, result.as_dict()),
        )
        return result.verdict.exit_status if written else USAGE


def _assumed_layout(arguments: argparse.Namespace) -> str:
    """Return a note on the assumed transducer layout of a dialect's board; "" if none is."""
    from haptogram.acoustics.model.boards.table import LAYOUTS
    from haptogram_protocol.dialects.table import DIALECTS

    dialect = DIALECTS.get(arguments.dialect or "")
    if dialect is None or arguments.array is not None:
        return ""
    return LAYOUTS[dialect.layout].assumed


def _shows_no_pattern(result: WatchResult) -> bool:
    """Return True if the drive of at least one latch is of no known pattern."""
    from haptogram.acoustics.reconstruct.patterns.found import Unnamed

    return bool(result.kinds.get(Unnamed.kind, 0))


def _why_watch_is_incomplete(end: Record) -> str | None:
    """Return why latches are missing, by the source's last record, *end*; None if none are."""
    if end.get("cut"):
        return f"the capture was cut off: {end['cut']}"
    if not end["clean"]:
        return "the board was killed before its last latches were told"
    return f"{end['dropped']} latches found the queue full" if end["dropped"] else None


@contextlib.contextmanager
def _watch_frames_file(path: Path | None) -> Iterator[_WriteLine | None]:
    """Yield a function that appends a line to the frames file at once; None without a file.

    Standard output is taken as a file too.
    """
    if path is None:
        yield None
    elif path == STANDARD_OUTPUT:
        yield functools.partial(print, end="", flush=True)
    else:
        with writing_file(path, "--frames"):
            path.parent.mkdir(parents=True, exist_ok=True)
            file = path.open("wb", buffering=0)
        with file:
            yield functools.partial(_write_watch_line, file, path)
        output_files.announce_output_file(path)


def _write_watch_line(file: FileIO, path: Path, line: str) -> None:
    """Write a whole line to a file that may take only a part at a time."""
    rest = line.encode("ascii")
    with writing_file(path, "--frames"):
        while rest:
            rest = rest[file.write(rest) :]
