"""``haptogram replay``: the bytes of a recording to a board again, and what it does with them."""

from __future__ import annotations

import argparse
import dataclasses
import functools
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypeAlias

from haptogram.errors import ConfigurationError
from haptogram.machine.files import write_json_file
from haptogram.settings.board import DEFAULT_ARRAY, BoardConfig
from haptogram.settings.command_line import add_command_options
from haptogram.settings.option import Settings, option, option_of, options_of
from haptogram.settings.parser import Parser, add_file_option, add_flag
from haptogram.settings.run.files import OutputConfig
from haptogram.settings.run.frames import LinkConfig

from ..acting_options import refuse_idle_options, with_option, without_option
from ..shell.exit_status import USAGE
from ..shell.output_files import FILE_HELP, CommandOutputs

if TYPE_CHECKING:
    from haptogram.evidence.recordings.replay import RecordingReplayBoard, ReplayResult

#: Given the options of a virtual board, and whether a simulated line carries its bytes.
MakeBoard: TypeAlias = "Callable[[Mapping[str, Any], bool], RecordingReplayBoard]"

_FAULTY: Final = ("mutant", "fault", "fault_plan", "fault_seed")


@dataclass(frozen=True, kw_only=True)
class ReplayConfig(Settings):
    """The board that a recording is fed to, and what is written and printed."""

    port: str | None = option_of(LinkConfig, "port", absent="the recorded virtual board")
    baud: int = option_of(LinkConfig, "baud", help="rate of the line of --port")
    mutant: str | None = option_of(BoardConfig, "mutant", absent="as recorded")
    array: str | None = option_of(BoardConfig, "array", default=None, absent="as recorded")
    json: Path | None = option_of(OutputConfig, "json", help="write every difference as JSON")
    show: int = option(20, unit="N", low=0, high=1000, help="differences that are printed")


_ACTING: Final = {
    "baud": with_option("port"),
    **dict.fromkeys(("healthy", "mutant", "array"), without_option("port")),
}


def set_up_replay(parser: Parser, make_board: MakeBoard) -> None:
    """Add the options of the command; *make_board* powers up virtual boards."""
    parser.acting = _ACTING
    parser.set_defaults(run=functools.partial(run_replay, make_board=make_board))
    add_file_option(parser, "file", help="the recording")
    board = parser.add_argument_group("board")
    rows = options_of(ReplayConfig)
    add_command_options(board, [rows["port"], rows["baud"]])
    add_flag(board, "--healthy", help="leave out mutant and faults of the recorded board")
    add_command_options(board, [rows["mutant"], rows["array"]])
    result = parser.add_argument_group("result", FILE_HELP)
    add_command_options(result, [rows["json"], rows["show"]])


def run_replay(arguments: argparse.Namespace, make_board: MakeBoard) -> int:
    """Replay the recording, print the differences, and return the exit status."""
    from haptogram.evidence.recordings.reader import Recording
    from haptogram.evidence.recordings.replay import replay_recording, replay_to_port

    refuse_idle_options(arguments)
    outputs = CommandOutputs(arguments, "json")
    recording = Recording(arguments.file)
    if arguments.port is not None:
        result = replay_to_port(recording, arguments.port, baudrate=arguments.baud)
    else:

        def make(options: Mapping[str, Any], *, paced: bool) -> RecordingReplayBoard:
            return make_board(_changed_replay_options(options, arguments), paced)

        result = replay_recording(recording, make)
    outputs.print("\n".join(_replay_lines(result, arguments.show)))
    written = outputs.write_files(json=lambda path: write_json_file(path, _replay_as_dict(result)))
    return result.exit_status if written else USAGE


def _changed_replay_options(
    options: Mapping[str, Any], arguments: argparse.Namespace
) -> dict[str, Any]:
    """Return the recorded board's options, changed by --healthy, --mutant and --array.

    ConfigurationError for a recorded mutant of the user's own code, unless an option names it.
    """
    if arguments.healthy:
        options = {name: value for name, value in options.items() if name not in _FAULTY}
    elif ":" in (code := str(options.get("mutant") or "")) and arguments.mutant is None:
        raise ConfigurationError(
            f"the recorded board is the mutant {code}, which is code of its own: give --mutant "
            f"{code} to load and run it, or --healthy to leave it out"
        )
    given = {"mutant": arguments.mutant, "array": arguments.array}
    changed = dict(options) | {name: value for name, value in given.items() if value is not None}
    if arguments.array is not None:
        _check_replay_array(options, arguments.array)
    return changed


def _check_replay_array(options: Mapping[str, Any], array: str) -> None:
    """Raise ConfigurationError if *array* has more or fewer transducers than that of *options*."""
    from haptogram.acoustics import TransducerArray

    BoardConfig.of(array=array)  # refuses a grid that none is
    before = TransducerArray.parse(str(options.get("array", DEFAULT_ARRAY))).count
    after = TransducerArray.parse(array).count
    if before != after:
        raise ConfigurationError(
            f"--array {array} has {after} transducers; the recording is of {before}: name the "
            "array of the recording, or leave the option out"
        )


def _replay_lines(result: ReplayResult, shown: int) -> list[str]:
    """Return the outcome in lines, with the first *shown* differences."""
    heads = {
        0: "PASS: the board did what was recorded",
        1: f"FAIL: {result.differing} of {result.differing + result.same} entries differ",
        3: "INCONCLUSIVE: there was nothing to compare",
    }
    lines = [heads[result.exit_status]]
    lines.append(f"  bytes     {result.to_board} to the board, {result.to_host} from it")
    clock = "the board's, every field compared"
    if not result.is_exact:
        clock = "the host's, fields of the moment left out"
    lines.append(f"  clock     {clock}")
    for kind in ("frames", "latches", "output", "pulses"):
        same = sum(comparison.same[kind] for comparison in result.comparisons)
        other = sum(comparison.differing[kind] for comparison in result.comparisons)
        if same or other:
            lines.append(f"  {kind:<9} {same} the same, {other} different")
    lines += [f"  note      {note}" for note in result.notes]
    differences = [d for comparison in result.comparisons for d in comparison.differences]
    lines += [f"  {difference}" for difference in differences[:shown]]
    if len(differences) > shown:
        lines.append(f"  ... and {result.differing - shown} more (--show, --json)")
    return lines


def _replay_as_dict(result: ReplayResult) -> dict[str, Any]:
    """Return the outcome of a replay for JSON."""
    return {
        "exit_status": result.exit_status,
        "exact": result.is_exact,
        "to_board": result.to_board,
        "to_host": result.to_host,
        "notes": result.notes,
        "boards": [
            {
                "same": dict(comparison.same),
                "differing": dict(comparison.differing),
                "differences": list(map(dataclasses.asdict, comparison.differences)),
            }
            for comparison in result.comparisons
        ],
    }
