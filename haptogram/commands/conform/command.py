"""``haptogram conform``: whether a board does what SPEC.md demands, clause by clause."""

from __future__ import annotations

import argparse
import dataclasses
import functools
import os
import time
from collections.abc import Callable, Collection, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn, TypeAlias

from haptogram.errors import ConfigurationError, LinkError, refusing_other_content
from haptogram.machine.files import check_files_writable
from haptogram.records.frame import Evidence
from haptogram.settings.arguments import did_you_mean
from haptogram.settings.board import BoardConfig
from haptogram.settings.command_line import settings_of
from haptogram.settings.parser import Parser

from ..acting_options import refuse_idle_options
from ..shell.captures import judge_captures_at_port, read_capture_arguments, read_channel_maps
from ..shell.exit_status import PASS, USAGE
from ..shell.output_files import CommandOutputs, announce_interrupted_output
from ..shell.progress import progress_bar
from .options import (
    PULSE,
    PinConfig,
    add_conform_options,
    asks_to_conform_virtual_board,
    check_conform_arguments,
)

if TYPE_CHECKING:
    from haptogram.conformance.case import Case, Depth
    from haptogram.conformance.run.access import Access
    from haptogram.conformance.verdict import SuiteResult
    from haptogram.evidence.recordings.tap import RecordedBoards
    from haptogram.evidence.recordings.writer import RecordingWriter
    from haptogram.settings.run.files import CaptureConfig

#: Given URL (None: the default board), line rate, seed and the recording of its boards or None,
#: returns a board in this program.
Virtual: TypeAlias = "Callable[[str | None, int, int, RecordedBoards | None], Access]"


def set_up_conform(parser: Parser, virtual: Virtual) -> None:
    """Add the options of the command; *virtual* makes a board inside this program."""
    from haptogram.conformance.verdict import suite_verdict_meaning_table

    epilog = str(parser.epilog)
    parser.epilog = epilog.replace("{verdicts}", suite_verdict_meaning_table())
    parser.main_options = "port baud spawn port_regex reset_cmd clause quick full junit html"
    parser.set_defaults(run=functools.partial(run_conform, virtual=virtual))
    add_conform_options(parser)


def run_conform(arguments: argparse.Namespace, virtual: Virtual) -> int:
    """Run the cases, write and print the result, and return the exit status."""
    from haptogram.conformance.cases import all_cases, select
    from haptogram.report.conformance.text import suite_text

    refuse_idle_options(arguments)
    if arguments.compare:
        return _compare_conform_results(arguments)
    captures = settings_of(arguments, PinConfig)
    for name in arguments.clause:
        if not any(select(all_cases(), [name])):
            _refuse_unknown_clause(name, all_cases())
    cases = tuple(select(all_cases(), arguments.clause))
    if arguments.list:
        return _list_conform_cases(cases)
    outputs = CommandOutputs(
        arguments, "json", "junit", "html", "summary", "write_baseline", "record"
    )
    expected = _expected_to_conform(arguments)
    if (path := captures.from_recording) is not None:
        suite = conform_by_captures(captures, *recorded_suite(path), str(path), expected)
        outputs.print(suite_text(suite, verbose=arguments.verbose))
        return suite.exit_status if _write_conform_results(suite, outputs) else USAGE
    check_conform_arguments(arguments)
    read_channel_maps(captures)
    given = {name: getattr(arguments, name) for name in sorted(arguments.given)}
    with outputs.recording(given) as writer:
        status = _run_conform(arguments, cases, captures, expected, virtual, outputs, writer)
        return status if outputs.is_recorded(writer) else USAGE


def _refuse_unknown_clause(name: str, cases: Sequence[Case]) -> NoReturn:
    """Raise ConfigurationError for an unknown *name*, with the clause or case most like it."""
    from haptogram.conformance.cases import select

    known = [*dict.fromkeys(case.clause for case in cases), *(case.id for case in cases)]
    whole = f"HG-{name.upper().removeprefix('HG').lstrip('-_ ')}"
    guess = f"; did you mean {whole}?" if any(select(cases, [whole])) else did_you_mean(name, known)
    raise ConfigurationError(
        f"--clause {name}: there is no such case or clause; --list shows all cases{guess}"
    )


def _run_conform(
    arguments: argparse.Namespace,
    cases: tuple[Case, ...],
    captures: PinConfig,
    expected: dict[str, str],
    virtual: Virtual,
    outputs: CommandOutputs,
    writer: RecordingWriter | None,
) -> int:
    """Run the suite, judge its captures, write and print the result; return the exit status.

    *writer* (None: no recording) takes the summary; an unwritten file or a capture that does not
    come is 2.
    """
    from haptogram.report.conformance.text import suite_text

    begin_s = time.time()
    suite = _run_conform_cases(arguments, cases, expected, virtual, writer)
    if writer is not None:
        from haptogram.evidence.recordings.channels import SUMMARY
        from haptogram.report.conformance.result import suite_dict

        writer.document(SUMMARY, writer.last_ns, suite_dict(suite))

    if not suite.device and suite.cut_short and not suite.is_interrupted:
        raise LinkError(suite.cut_short)  # no board answered: nothing was judged
    if suite.is_interrupted:
        announce_interrupted_output("haptogram conform")
    judged: SuiteResult | None = suite
    if captures.capture:
        judged = judge_captures_at_port(
            "haptogram conform",
            captures,
            begin_s,
            lambda: conform_by_captures(
                captures,
                suite,
                suite.nonces,
                "the one at the port",
                expected,
                simulated=arguments.simulator is not None,
            ),
            interrupted=suite.is_interrupted,
        )
    suite = judged or suite
    # Before the files: a full disk must not cost it.
    outputs.print(suite_text(suite, verbose=arguments.verbose))
    is_written = _write_conform_results(
        suite, outputs, in_virtual_time=bool(suite.settings["virtual_time"])
    )
    return suite.exit_status if is_written and judged is not None else USAGE


def _run_conform_cases(
    arguments: argparse.Namespace,
    cases: tuple[Case, ...],
    expected: dict[str, str],
    virtual: Virtual,
    writer: RecordingWriter | None,
) -> SuiteResult:
    """Run the chosen cases on the chosen board; recorded if a *writer* is given."""
    from haptogram.conformance.run.runner import SuiteOptions, SuiteRunner

    options = SuiteOptions(
        timeout_s=arguments.timeout,
        seed=_conform_seed(arguments),
        repeat=arguments.repeat,
        strict=arguments.strict,
        expected=expected,
        depth=_conform_depth(arguments),
        explore_s=60 * arguments.explore,
    )
    with progress_bar("conform", quiet=arguments.quiet, unit="cases") as progress:
        return SuiteRunner(_conform_access(arguments, virtual, writer), options, progress).run(
            cases
        )


def _expected_to_conform(arguments: argparse.Namespace) -> dict[str, str]:
    """Return the failures that --baseline expects, by case or clause; {} without it."""
    from haptogram.conformance.cases import all_cases
    from haptogram.conformance.pins.cases import PIN_CASES
    from haptogram.conformance.run.baseline import load_suite_baseline

    if not arguments.baseline:
        return {}
    return load_suite_baseline(arguments.baseline, (*all_cases(), *PIN_CASES.values()))


def _conform_depth(arguments: argparse.Namespace) -> Depth:
    """Return how thorough the cases are: by --quick or --full, else the default."""
    from haptogram.conformance.case import Depth

    if arguments.quick:
        return Depth.QUICK
    return Depth.FULL if arguments.full else Depth.DEFAULT


def _conform_seed(arguments: argparse.Namespace) -> int:
    """Return --seed; else 0 for the virtual board, random at a port: no nonce comes twice."""
    if arguments.seed is not None:
        return int(arguments.seed)
    return 0 if asks_to_conform_virtual_board(arguments) else int.from_bytes(os.urandom(4))


def _conform_access(
    arguments: argparse.Namespace, virtual: Virtual, writer: RecordingWriter | None
) -> Access:
    """Return the way to the board: virtual, at a port or spawned; recorded by *writer* if any."""
    from haptogram.conformance.run.access import RecordedAccess
    from haptogram.evidence.recordings.tap import RecordedBoards

    boards = None if writer is None else RecordedBoards(writer)
    if asks_to_conform_virtual_board(arguments):
        return virtual(_conform_url(arguments), arguments.baud, _conform_seed(arguments), boards)
    access = _conform_access_to_port(arguments)
    return access if boards is None else RecordedAccess(access, boards)


def _conform_url(arguments: argparse.Namespace) -> str | None:
    """Return the URL of the simulated board that the options describe; else --port, or None."""
    if arguments.simulator is None:
        return None if arguments.port is None else str(arguments.port)
    from haptogram.settings.board_url import PortConfig, write_board_url

    capture = next(iter(arguments.capture), None)
    if capture is not None:
        check_files_writable({"--capture": capture})
        capture.unlink(missing_ok=True)  # it would be appended to
    board = BoardConfig.of(simulator=arguments.simulator, simulator_capture=capture)
    return write_board_url(PortConfig(clock="virtual", board=board))


def _conform_access_to_port(arguments: argparse.Namespace) -> Access:
    """Return the way to the board that --spawn starts or that --port names."""
    from haptogram.conformance.run.access import PortAccess
    from haptogram.conformance.run.spawning import DEFAULT_PORT_REGEX, SpawnAccess

    if arguments.spawn is not None:
        return SpawnAccess(
            arguments.spawn,
            port_regex=arguments.port_regex or DEFAULT_PORT_REGEX,
            boot_timeout_s=arguments.boot_timeout,
            baudrate=arguments.baud,
            fault_command=arguments.fault_cmd,
        )
    lines = {"dtr": arguments.dtr, "rts": arguments.rts}
    held = {name: state == "1" for name, state in lines.items() if state in ("0", "1")}
    return PortAccess(
        arguments.port,
        baudrate=arguments.baud,
        reset_command=arguments.reset_cmd,
        boot_timeout_s=arguments.boot_timeout,
        dtr=held.get("dtr"),
        rts=held.get("rts"),
        pulse=next((name for name, state in lines.items() if state == PULSE), None),
        fault_command=arguments.fault_cmd,
    )


def _list_conform_cases(cases: tuple[Case, ...]) -> int:
    """Print each case with its evidence and summary; return 0."""
    for case in cases:
        kind = "" if case.body else " (not observable)"
        print(f"{case.id:<20} {case.evidence.upper():<14} {case.summary}{kind}")
    return 0


def _compare_conform_results(arguments: argparse.Namespace) -> int:
    """Write the page that compares results of devices; return the exit status, 2 if not written."""
    from haptogram.report.conformance.document import suite_comparison_document
    from haptogram.report.conformance.result import read_suite_json

    if arguments.html is None:
        raise ConfigurationError("--compare writes a page: name it with --html")
    outputs = CommandOutputs(arguments, "html")
    suites = [read_suite_json(path) for path in arguments.compare]
    written = outputs.write(suite_comparison_document(suites))
    return PASS if written else USAGE


def _write_conform_results(
    suite: SuiteResult, outputs: CommandOutputs, *, in_virtual_time: bool = False
) -> bool:
    """Write --json, --html and the other files; return False if one could not be written."""
    from haptogram.conformance.run.baseline import write_suite_baseline
    from haptogram.report.conformance.document import suite_document
    from haptogram.report.conformance.result import write_suite_json

    return outputs.write(
        suite_document(suite),
        in_virtual_time=in_virtual_time,
        json=lambda path: write_suite_json(path, suite),
        write_baseline=lambda path: write_suite_baseline(path, suite),
    )


# --- Captures of the drive pins, of a run at a port or in a recording ----------------------------


def conform_by_captures(
    config: CaptureConfig,
    suite: SuiteResult,
    nonces: Collection[int],
    run: str,
    expected: dict[str, str],
    *,
    simulated: bool = False,
) -> SuiteResult:
    """Return the *suite* of a *run*, whose sessions have these *nonces*, with its captures.

    Raises
    ------
    ConfigurationError
        A capture of another run; a capture or a map that cannot be read.
    """
    from haptogram.conformance.pins import judge

    records = read_capture_arguments(config)
    shares = [judge.captured_share_of_run(record, nonces, run) for record in records]
    judged = judge.judge_clauses_by_pins(records, expected)
    if simulated:
        judged = tuple(dataclasses.replace(one, evidence=Evidence.SIMULATED) for one in judged)
    return judge.suite_with_clauses_by_pins(suite, judged, shares)


def recorded_suite(path: Path) -> tuple[SuiteResult, set[int]]:
    """Return the run in a recording, and the nonces of its sessions.

    Raises
    ------
    ConfigurationError
        A recording without a result.
    """
    from haptogram.evidence.recordings.channels import SUMMARY
    from haptogram.evidence.recordings.reader import Recording
    from haptogram.evidence.recordings.recorded_run import recorded_sessions
    from haptogram.report.conformance.result import suite_of_conformance_json

    recording = Recording(path)
    found = [entry.fields for entry in recording.entries((SUMMARY,))]
    if not found:
        what = recording.run.get("command", "another program")
        raise ConfigurationError(
            f"{path}: the recording (of {what}) holds no result; haptogram conform --record "
            "writes one that does, at the end of its run"
        )
    with refusing_other_content(f"{path}: its result is none of haptogram conform"):
        return suite_of_conformance_json(found[-1]), recorded_sessions(recording)
