"""``haptogram verify``: display an object, learn where every focus really was."""

from __future__ import annotations

import argparse
import contextlib
import functools
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Final

from haptogram.errors import (
    DeviceError,
    HaptogramError,
    LinkError,
    VersionMismatchError,
    WrongProtocolError,
)
from haptogram.machine.files import check_file_has_content
from haptogram.machine.process import process_without_garbage_collector
from haptogram.settings.command_line import given_options
from haptogram.settings.option import options_of
from haptogram.settings.run.outputs import OutputConfig
from haptogram.settings.run.verify import VerifyConfig
from haptogram.settings.run.verify_file import load_verify_config, read_settings_table
from haptogram.settings.shape import SHAPES

from ..acting_options import refuse_idle_options
from ..shell.exit_status import EXIT_STATUS, INCONCLUSIVE, INTERRUPTED, USAGE
from ..shell.output_files import (
    CommandOutputs,
    announce_interrupted_output,
    print_command_error,
)
from ..shell.progress import progress_bar
from .boards import ProgramBoards, RunBoards, Show
from .captures import verified_captures_at_port, verify_recorded_captures
from .files import verify_seen_by_number, write_run_files
from .live_view import live_view
from .options import add_verify_options

if TYPE_CHECKING:
    from haptogram.evidence.boards import BoardUnderTest
    from haptogram.evidence.recordings.writer import RecordingWriter
    from haptogram.evidence.run_record import RunRecord
    from haptogram.settings.arguments import Progress
    from haptogram.settings.board import BoardConfig
    from haptogram.settings.faults.plan import FaultPlan
    from haptogram.settings.parser import Parser
    from haptogram.verification import RunVerdict


class _BrokenByPlanError(HaptogramError):
    """The planned faults let no session come up: nothing could be judged."""


_EXAMPLES: Final = """\
examples:
  haptogram verify
      the hemisphere at 1 kHz on a virtual board, over a pty
  haptogram verify --virtual-time --resolution-mm 2
      the same job, finer, without a wall clock: exact and repeatable
  haptogram verify --port /dev/ttyUSB0
      a real board, by its own trace
  haptogram verify --from-recording run.mcap --capture pins.sr --channels map.toml
      the same board, by its drive pins: what a logic analyser saw of a run with --record run.mcap
  haptogram verify --object shape.stl --mode sequence --html out.html
      a mesh, uploaded once and played on the board's clock
  haptogram verify --object point --modulation am --mode points --repeat 200
      a standing focus, modulated by 200 Hz, for a second
  haptogram verify --dialect sonicsurface --port /dev/ttyUSB0 --object circle
      a board of another maker; it tells nothing, so that the evidence is the wire
  haptogram verify --fault "line.flip ber=1e-5" --fault "device.stuck column=3 from=2s"
      what a bad line and a broken column do to the focus
"""


def set_up_verify(parser: Parser, made: ProgramBoards) -> None:
    """Describe the command and add its options; *made* makes boards."""
    parser.description = (
        "Display a tactile object point by point and verify, frame by frame, where the "
        "focus of what the board latched really is."
    )
    parser.epilog = _EXAMPLES + "\n" + EXIT_STATUS
    parser.main_options = (
        "object rate_hz array port dialect virtual_time fault tolerance_mm junit html"
    )
    parser.set_defaults(run=functools.partial(run_verify, made=made))
    add_verify_options(parser)


def run_verify(arguments: argparse.Namespace, made: ProgramBoards) -> int:
    """Check the settings, run the job, and return the exit status."""
    from haptogram.report.formats.html import check_html_page

    file, given = arguments.config, given_options(arguments, options_of(VerifyConfig))
    config = load_verify_config(file, given)
    in_file = read_settings_table(file) if file else {}
    arguments.parser.settle_source(file, (key for key in in_file if key not in given))
    settings = argparse.Namespace(
        **config.values(),
        frame_kind=config.frame_kind,
        config=arguments.config,
        command_line=arguments.command_line,
        parser=arguments.parser,
    )
    refuse_idle_options(arguments, settings, file, in_file)
    outputs = CommandOutputs(
        settings,
        *(name for name in options_of(OutputConfig) if name != "stamp"),
        pictures=bool(config.captures.capture),
    )
    if config.captures.from_recording is not None:
        return verify_recorded_captures(config, outputs, quiet=arguments.quiet)
    boards = RunBoards.of(config, arguments, made)
    boards.virtual  # noqa: B018  it checks, before anything starts
    if config.shape.object not in SHAPES:
        check_file_has_content(Path(config.shape.object), "object")
    if arguments.view:
        check_html_page()
    with (
        live_view(wanted=arguments.view) as show,
        outputs.recording(boards.config.result_options()) as writer,
        process_without_garbage_collector(),  # it would look at every frame again and again
    ):
        status = _run_verify(arguments, boards, show, outputs, writer)
        return status if outputs.is_recorded(writer) else USAGE


def _run_verify(
    arguments: argparse.Namespace,
    boards: RunBoards,
    show: Show,
    outputs: CommandOutputs,
    writer: RecordingWriter | None,
) -> int:
    """Run the job on the board that the settings name; write and print its result."""
    from haptogram.report import run as report
    from haptogram.verification import Verdict, tolerance_of, uncertainty_of

    config, virtual = boards.config, boards.virtual
    if writer is not None:
        _begin_verify_recording(writer, config, virtual)
    quiet = arguments.quiet
    planned = virtual.plan
    begin_s = time.time()
    try:
        with (
            boards.open(show) as board,
            progress_bar("displaying", quiet=quiet) as progress,
            progress_bar("waiting for what the board saw", quiet=quiet) as settling,
            _blaming_planned_faults(planned, board),
        ):
            found = _measured_by_verify(boards, board, progress, settling, writer)
    except _BrokenByPlanError as error:
        print_command_error("haptogram verify", error)
        return INCONCLUSIVE
    if found.interrupted:
        announce_interrupted_output("haptogram verify")
    with progress_bar("verifying", quiet=quiet) as progress:
        verdict = found.verdict(
            min_verified=config.least_verified,
            tolerance=tolerance_of(config.tolerance),
            uncertainty=uncertainty_of(config.uncertainty, at_port=config.link.port is not None),
            progress=progress,
        )
    result = report.run_result_dict(
        verdict,
        configuration=config.result_options(),
        seed=config.limits.seed,
        board=_verified_board_dict(found),
        warnings=found.warnings,
        cut_short=None if found.cut is None else found.cut.reason,
        faults=_verified_faults_dict(planned, found.fault_counts)
        if config.link.port is None
        else None,
        troubles=found.troubles,
        host=None if config.link.virtual_time else _verified_host_dict(found),
        environment=None if config.link.virtual_time else report.run_environment(),
    )
    if writer is not None:
        from haptogram.evidence.recordings.recorded_run import record_intended

        record_intended(writer, found.model, found.intended)
        _record_verify_verdicts(writer, verdict, result)
    # Before the files: a full disk must not cost the result.
    outputs.print(str(verdict))
    for line in report.run_faults_wording(result):
        outputs.print(f"  {line}")
    for warning in found.warnings:
        outputs.print(f"  warning   {warning}")
    captures = None
    if config.captures.capture:
        captures = verified_captures_at_port(config, found, begin_s, quiet=quiet)
    if captures is not None:
        outputs.print(f"drive pins\n{captures}")
        result = report.run_result_with_captures(result, captures, is_run_judged=True)
    is_shown = config.outputs.html is not None
    seen = verify_seen_by_number(found.intended, found.observations) if is_shown else {}
    is_written = write_run_files(config, verdict, result, found.model, seen, outputs, captures)
    if not is_written or (config.captures.capture and captures is None):
        return USAGE
    status = Verdict(result["verdict"]).exit_status
    return INTERRUPTED if found.interrupted and status == INCONCLUSIVE else status


def _measured_by_verify(
    boards: RunBoards,
    board: BoardUnderTest,
    progress: Progress | None,
    settling: Progress | None,
    writer: RecordingWriter | None,
) -> RunRecord:
    from haptogram.evidence.run_record import measure_run, measure_run_of_dialect

    config = boards.config
    if boards.dialect is not None:
        return measure_run_of_dialect(
            config, boards.dialect, board, progress, settling, writer=writer
        )
    faulty = bool(boards.virtual.plan.faults)
    return measure_run(config, board, progress, settling, faulty=faulty, writer=writer)


def _record_verify_verdicts(
    writer: RecordingWriter, verdict: RunVerdict, result: dict[str, object]
) -> None:
    from haptogram.evidence.recordings.channels import SUMMARY
    from haptogram.evidence.recordings.scene import ERROR, WARNING
    from haptogram.report import run as report

    for frame in verdict.frames:
        t_us = frame.t_apply_us if frame.t_latch_us is None else frame.t_latch_us
        writer.verdict(t_us, report.run_frame_dict(frame))
    for line, frames in verdict.findings():
        first = frames[0].t_latch_us or frames[0].t_apply_us
        writer.log(writer.host_ns(first), line, ERROR if frames[0].is_wrong else WARNING)
    writer.log(writer.last_ns, verdict.sentence)
    writer.document(SUMMARY, writer.last_ns, result)


def _begin_verify_recording(
    writer: RecordingWriter, config: VerifyConfig, virtual: BoardConfig
) -> None:
    """Write which board is at the other end; of a board in virtual time, when it began."""
    options = None if config.link.port is not None else virtual.non_default()
    boot_ns = 0 if config.link.virtual_time else None
    writer.opened(0, options, boot_ns, paced=options is not None)


@contextlib.contextmanager
def _blaming_planned_faults(planned: FaultPlan, board: BoardUnderTest) -> Iterator[None]:
    """Add a note on injected faults to errors of the session, if any fault fired.

    Not of a board that has died, nor if no fault has fired: then something else did it.
    """
    try:
        yield
    except (LinkError, DeviceError) as error:
        if not planned.faults or not board.give_up():
            raise
        fired = board.fault_counts
        if fired is not None and not any(fired.values()):
            raise
        raise _BrokenByPlanError(
            _planned_faults_text(error, _verified_faults_dict(planned, fired))
        ) from error


def _planned_faults_text(error: HaptogramError, faults: dict[str, object] | None) -> str:
    from haptogram.report import run as report

    counts = next(report.run_faults_wording({"faults": faults, "troubles": {}}))
    # What is at the other end is known: no guess at another device or version.
    is_guess = isinstance(error, WrongProtocolError | VersionMismatchError)
    seen = "no frame came whole" if is_guess else error
    return f"inconclusive: the fault plan broke the session ({seen}); {counts}"


def _verified_board_dict(found: RunRecord) -> dict[str, object]:
    speed_m_s = found.model.medium.sound_speed_m_s
    return {"is": found.board, **found.about, "sound_speed_m_s": speed_m_s}


def _verified_faults_dict(
    planned: FaultPlan, fired: dict[str, int] | None
) -> dict[str, object] | None:
    """Return the injected faults and how often each fired (None: unknown)."""
    if not planned.faults:
        return None
    plan = [fault.written for fault in planned.faults]
    return {"plan": plan, "seed": planned.seed, "fired": fired}


def _verified_host_dict(found: RunRecord) -> dict[str, object] | None:
    """Return the figures of the host's loop, if the run came to its end."""
    from haptogram.driver.dialect_driver import DialectReport
    from haptogram.driver.stream import StreamReport

    report = found.report
    if not isinstance(report, StreamReport | DialectReport):
        return None
    about: dict[str, object] = {
        "skipped": list(report.skipped),
        "late_ticks": report.late_ticks,
        "tick_lateness_us_max": float(report.lateness_us.max()),
    }
    if isinstance(report, StreamReport):
        about["write_stalls"] = report.write_stalls
        about["clock_uncertainty_us"] = report.clock_uncertainty_us
    return about
