"""The verdict by captures of the drive pins: of a run at a port, or of one in a recording."""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING

from haptogram.errors import ConfigurationError

from ..shell.captures import read_capture_arguments, wait_for_capture_arguments
from ..shell.exit_status import USAGE
from ..shell.output_files import print_command_error
from ..shell.progress import progress_bar
from .files import verify_seen_by_number, write_run_files

if TYPE_CHECKING:
    from haptogram.acoustics import AcousticModel
    from haptogram.evidence.run_record import RunRecord
    from haptogram.records.frame import Intended
    from haptogram.settings.run.verify import VerifyConfig
    from haptogram.verification import RunVerdict
    from haptogram.verification.pins.joined import JoinedCaptureVerdict

    from ..shell.output_files import CommandOutputs


def verify_run_by_captures(
    config: VerifyConfig,
    model: AcousticModel,
    intended: Sequence[Intended],
    incomplete: str = "",
    *,
    quiet: bool,
) -> JoinedCaptureVerdict:
    """Return the verdict of the captures on the frames of a run.

    *incomplete* is why frames may be missing: then nothing passes or fails. Unless it shall be
    *quiet*, a bar shows the progress.

    Raises
    ------
    ConfigurationError
        A capture or a map that cannot be read, or that does not suit the run.
    """
    from haptogram.verification import tolerance_of, uncertainty_of
    from haptogram.verification.pins.joined import verify_captures

    with progress_bar("reading captures", quiet=quiet, unit="captures") as progress:
        records = read_capture_arguments(config.captures, progress)
    with progress_bar("judging captures", quiet=quiet) as progress:
        return verify_captures(
            records,
            intended,
            model=model,
            min_verified=config.least_verified,
            tolerance=tolerance_of(config.tolerance),
            uncertainty=uncertainty_of(config.uncertainty, at_port=True),
            incomplete=incomplete,
            progress=progress,
        )


def verified_captures_at_port(
    config: VerifyConfig, found: RunRecord, since_s: float, *, quiet: bool
) -> JoinedCaptureVerdict | None:
    """Return the verdict of the captures of a run at a port.

    None: a capture did not come, or cannot be judged; that was said, and the run stands alone.
    """
    try:
        if found.interrupted:
            raise KeyboardInterrupt
        wait_for_capture_arguments(config.captures, since_s)
        return verify_run_by_captures(config, found.model, found.intended, quiet=quiet)
    except KeyboardInterrupt:
        print("haptogram verify: interrupted; --capture was not judged", file=sys.stderr)
    except ConfigurationError as error:
        print_command_error("haptogram verify", error)
    return None


def verify_recorded_captures(config: VerifyConfig, outputs: CommandOutputs, *, quiet: bool) -> int:
    """Judge captures by the frames of a recording, and return the exit status."""
    from haptogram.evidence.recordings.reader import Recording
    from haptogram.evidence.recordings.recorded_run import recorded_run
    from haptogram.report import run as report

    path = config.captures.from_recording
    if path is None:
        raise ConfigurationError("no --from-recording to judge by")
    recording = Recording(path)
    recorded = recorded_run(recording)
    verdict = verify_run_by_captures(
        config, recorded.model, recorded.intended, recorded.incomplete, quiet=quiet
    )
    run = verdict.run
    if run is None:  # a run that FAILs is false, too
        run = _verify_without_field(verdict, recorded.model)
    result = report.run_result_dict(
        run,
        configuration=config.result_options(),
        seed=config.limits.seed,
        board={
            "is": f"the board of {path}",
            "transducers": recorded.model.array.count,
            "sound_speed_m_s": recorded.model.medium.sound_speed_m_s,
        },
        warnings=[recording.note] if recording.note else [],
        cut_short=None,
        host=None,
        environment=None,
    )
    result = report.run_result_with_captures(result, verdict, is_run_judged=verdict.run is not None)
    outputs.print(str(verdict))
    seen = verify_seen_by_number(recorded.intended, verdict.observations)
    if not write_run_files(config, run, result, recorded.model, seen, outputs, verdict):
        return USAGE
    return verdict.exit_status


def _verify_without_field(verdict: JoinedCaptureVerdict, model: AcousticModel) -> RunVerdict:
    """Return the run verdict from captured pins alone, without field reconstruction."""
    from haptogram.verification import verify_run

    run = verify_run(verdict.frames, [], model=model, unseen=verdict.no_field)
    frames = [
        dataclasses.replace(frame, note=verdict.frame_note(place))
        for place, frame in enumerate(run.frames)
    ]
    return dataclasses.replace(run, frames=frames)
