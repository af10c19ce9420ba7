"""``haptogram verify``: display an object, learn where every focus really was."""

from __future__ import annotations

import argparse
import functools
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from haptogram.errors import DeviceError, LinkError, VersionMismatchError, WrongProtocolError
from haptogram.machine.files import check_file_has_content
from haptogram.machine.process import process_without_garbage_collector
from haptogram.settings.arguments import Progress
from haptogram.settings.board import BoardConfig
from haptogram.settings.command_line import given_options
from haptogram.settings.option import options_of
from haptogram.settings.parser import Parser
from haptogram.settings.run.files import OutputConfig
from haptogram.settings.run.verify import VerifyConfig, read_settings_table, verify_config_of
from haptogram.settings.shape import SHAPES

from ..acting_options import refuse_idle_options
from ..shell.captures import judge_captures_at_port, read_channel_maps
from ..shell.exit_status import INCONCLUSIVE, INTERRUPTED, USAGE
from ..shell.output_files import CommandOutputs, announce_interrupted_output, print_command_error
from ..shell.progress import progress_bar
from .boards import ProgramBoards, RunBoards, Show, live_view
from .options import add_verify_options
from .results import (
    verify_recorded_captures,
    verify_run_by_captures,
    verify_seen_by_number,
    write_run_files,
)

if TYPE_CHECKING:
    from haptogram.evidence.boards import BoardUnderTest
    from haptogram.evidence.recordings.writer import RecordingWriter
    from haptogram.evidence.run_record import RunRecord
    from haptogram.settings.faults.plan import FaultPlan
    from haptogram.verification import RunVerdict


def set_up_verify(parser: Parser, made: ProgramBoards) -> None:
    """Add the options of the command; *made* makes boards."""
    parser.main_options = (
        "object rate_hz array port dialect virtual_time fault tolerance_mm junit html"
    )
    parser.set_defaults(run=functools.partial(run_verify, made=made))
    add_verify_options(parser)


def run_verify(arguments: argparse.Namespace, made: ProgramBoards) -> int:
    """Check the settings, run the job, and return the exit status."""
    from haptogram.report.formats.html import check_html_page

    file, given = arguments.config, given_options(arguments, options_of(VerifyConfig))
    in_file = read_settings_table(file) if file else {}
    config = verify_config_of(file, in_file, given)
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
    if (recorded := config.captures.from_recording) is not None:
        return verify_recorded_captures(config, recorded, outputs, quiet=arguments.quiet)
    read_channel_maps(config.captures)  # to refuse one before the run, which takes longer
    boards = RunBoards.of(config, arguments, in_file, made)
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
    """Run the job on the board that the settings name; write and print its result.

    Returns the exit status; INCONCLUSIVE if planned faults ended the session.
    """
    from haptogram.report.run.wording import run_faults_wording
    from haptogram.verification import Verdict, tolerance_of, uncertainty_of

    config, virtual, quiet = boards.config, boards.virtual, arguments.quiet
    begin_s, broken = time.time(), ""
    if writer is not None:
        _begin_verify_recording(writer, config, virtual)
    with (
        boards.open(show) as board,
        progress_bar("displaying", quiet=quiet) as progress,
        progress_bar("waiting for what the board saw", quiet=quiet) as settling,
    ):
        try:
            found = _measured_by_verify(boards, board, progress, settling, writer)
        except (LinkError, DeviceError) as error:
            broken = _broken_by_planned_faults(error, virtual.plan, board)
            if not broken:
                raise
    if broken:
        print_command_error("haptogram verify", broken)
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
    result = _verify_result(config, virtual.plan, found, verdict)
    if writer is not None:
        _record_verify_result(writer, found, verdict, result)
    # Before the files: a full disk must not cost the result.
    outputs.print(str(verdict))
    for line in (*run_faults_wording(result), *(f"warning   {text}" for text in found.warnings)):
        outputs.print(f"  {line}")
    captures = None
    if config.captures.capture:
        captures = judge_captures_at_port(
            "haptogram verify",
            config.captures,
            begin_s,
            lambda: verify_run_by_captures(config, found.model, found.intended, quiet=quiet),
            interrupted=found.interrupted,
        )
    if captures is not None:
        from haptogram.report.run.pins import run_result_with_captures

        outputs.print(f"drive pins\n{captures}")
        result = run_result_with_captures(result, captures, is_run_judged=True)
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
    """Display the object on the board and return the record of the run.

    *writer* (None: no recording) takes the bytes; *progress* counts the frames, and *settling* what
    the board has still to tell after them.
    """
    from haptogram.evidence.run_record import measure_run, measure_run_of_dialect

    config = boards.config
    if boards.dialect is not None:
        return measure_run_of_dialect(
            config, boards.dialect, board, progress, settling, writer=writer
        )
    faulty = bool(boards.virtual.plan.faults)
    return measure_run(config, board, progress, settling, faulty=faulty, writer=writer)


def _verify_result(
    config: VerifyConfig, planned: FaultPlan, found: RunRecord, verdict: RunVerdict
) -> dict[str, Any]:
    """Return the result for JSON; in virtual time it does not depend on the machine.

    *planned* are the faults to inject, *found* the record of the run.
    """
    from haptogram.report.run.result import run_environment, run_result_dict

    is_virtual, is_at_port = config.link.virtual_time, config.link.port is not None
    return run_result_dict(
        verdict,
        configuration=config.result_options(),
        seed=config.limits.seed,
        board=_verified_board_dict(found),
        warnings=found.warnings,
        cut_short=None if found.cut is None else found.cut.reason,
        faults=None if is_at_port else _verified_faults_dict(planned, found.fault_counts),
        troubles=found.troubles,
        host=None if is_virtual else _verified_host_dict(found),
        environment=None if is_virtual else run_environment(),
    )


def _record_verify_result(
    writer: RecordingWriter, found: RunRecord, verdict: RunVerdict, result: dict[str, Any]
) -> None:
    """Record the intended frames, the verdict on each, and the summary."""
    from haptogram.evidence.recordings.channels import SUMMARY
    from haptogram.evidence.recordings.recorded_run import record_intended
    from haptogram.evidence.recordings.scene import ERROR, WARNING
    from haptogram.report.run.result import run_frame_dict

    record_intended(writer, found.model, found.intended)
    for frame in verdict.frames:
        t_us = frame.t_apply_us if frame.t_latch_us is None else frame.t_latch_us
        writer.verdict(t_us, run_frame_dict(frame))
    for line, frames in verdict.findings():
        first = frames[0].t_latch_us or frames[0].t_apply_us
        writer.log(writer.host_ns(first), line, ERROR if frames[0].is_wrong else WARNING)
    writer.log(writer.last_ns, verdict.sentence)
    writer.document(SUMMARY, writer.last_ns, result)


def _begin_verify_recording(
    writer: RecordingWriter, config: VerifyConfig, virtual: BoardConfig
) -> None:
    """Record which board is under test and, in virtual time, that it was powered up at 0 ns.

    A board at a port has no options and no known time.
    """
    options = None if config.link.port is not None else virtual.non_default()
    boot_ns = 0 if config.link.virtual_time else None
    writer.opened(0, options, boot_ns, paced=options is not None)


def _broken_by_planned_faults(
    error: LinkError | DeviceError, planned: FaultPlan, board: BoardUnderTest
) -> str:
    """Return the text that the fault plan ended the session; "" if something else did.

    It did if the board gave up and any fault has fired, or this is not known.
    """
    from haptogram.report.run.wording import run_faults_wording

    if not planned.faults or not board.give_up():
        return ""
    fired = board.fault_counts
    if fired is not None and not any(fired.values()):
        return ""
    faults = _verified_faults_dict(planned, fired)
    counts = next(run_faults_wording({"faults": faults, "troubles": {}}))
    # What is at the other end is known: no guess at another device or version.
    is_guess = isinstance(error, WrongProtocolError | VersionMismatchError)
    seen = "no frame came whole" if is_guess else error
    return f"inconclusive: the fault plan broke the session ({seen}); {counts}"


def _verified_board_dict(found: RunRecord) -> dict[str, object]:
    """Return what is known of the board under test, for JSON."""
    speed_m_s = found.model.medium.sound_speed_m_s
    return {"is": found.board, **found.about, "sound_speed_m_s": speed_m_s}


def _verified_faults_dict(
    planned: FaultPlan, fired: dict[str, int] | None
) -> dict[str, object] | None:
    """Return the injected faults and how often each *fired* (None: unknown); None without any."""
    if not planned.faults:
        return None
    plan = [fault.written for fault in planned.faults]
    return {"plan": plan, "seed": planned.seed, "fired": fired}


def _verified_host_dict(found: RunRecord) -> dict[str, object] | None:
    """Return the figures of the host's stream loop; None for a run that was not streamed."""
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
