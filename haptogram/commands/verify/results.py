"""The result of a run: by its board, by captures of the drive pins, and as files.

Each file is written as a whole, and one that cannot be written does not cost the rest.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from haptogram.errors import ConfigurationError

from ..shell.captures import read_capture_arguments
from ..shell.exit_status import USAGE
from ..shell.progress import progress_bar

if TYPE_CHECKING:
    from haptogram.acoustics import AcousticModel
    from haptogram.records.frame import Intended, Observation
    from haptogram.settings.run.verify import VerifyConfig
    from haptogram.verification import RunVerdict
    from haptogram.verification.pins.joined import JoinedCaptureVerdict

    from ..shell.output_files import CommandOutputs


def write_run_files(
    config: VerifyConfig,
    verdict: RunVerdict,
    result: Mapping[str, Any],
    model: AcousticModel,
    seen: Mapping[int, Observation],
    outputs: CommandOutputs,
    captures: JoinedCaptureVerdict | None = None,
) -> bool:
    """Write every file that was asked for; return False if one could not be written.

    *seen* holds the observation of each frame that has one, by its number.
    """
    if not outputs.wants_document and not outputs.paths:
        return True
    from haptogram.report.run.document import run_document
    from haptogram.report.run.result import write_run_frame_lines, write_run_json

    is_virtual = config.link.virtual_time
    seconds = _verify_board_seconds(verdict) if is_virtual else outputs.provenance.elapsed_s
    return outputs.write(
        run_document(verdict, result, model, observations=seen, seconds=seconds),
        in_virtual_time=is_virtual,
        frames=lambda path: write_run_frame_lines(path, verdict),
        json=lambda path: write_run_json(path, result),
        pin_calibration=lambda path: _write_pin_calibration(path, captures, model),
    )


def _write_pin_calibration(
    path: Path, captures: JoinedCaptureVerdict | None, model: AcousticModel
) -> None:
    """Write the gain and phase offsets that the pins of *captures* show; None shows nothing.

    Raises
    ------
    ConfigurationError
        They show nothing, or the file cannot be written.
    """
    from haptogram.verification.pins.elements.offsets import calibration_of_pins

    shown = [one.offsets for one in captures.pins if one.offsets] if captures is not None else []
    if not shown:
        raise ConfigurationError(f"--pin-calibration {path}: the captures show no element")
    calibration_of_pins(shown, model.array).to_file(path)


def _verify_board_seconds(verdict: RunVerdict) -> float:
    """Return the time from the first frame to the last, on the board's clock; 0 if not known."""
    times = (t for frame in verdict.frames for t in (frame.t_apply_us, frame.t_latch_us))
    known = [t for t in times if t is not None]
    return (max(known) - min(known)) / 1e6 if known else 0.0


def verify_seen_by_number(
    intended: Iterable[Intended], observations: Iterable[Observation]
) -> dict[int, Observation]:
    """Return the latches with a known drive by the numbers of their frames.

    A CRC that is that of the intended drive makes the drive known. What is only known to have left
    the host is no latch.
    """
    from haptogram.records.frame import Evidence

    by_key = {seen.key: seen for seen in observations if seen.evidence is not Evidence.WIRE}
    known = {
        frame.number: _verify_drive_by_crc(frame, by_key[frame.key])
        for frame in intended
        if frame.key in by_key
    }
    return {number: seen for number, seen in known.items() if seen.output is not None}


def _verify_drive_by_crc(intended: Intended, seen: Observation) -> Observation:
    """Return *seen*, with the intended drive as its own if the CRC is equal; else unchanged."""
    return dataclasses.replace(seen, drive=intended.drive) if seen.shows_by_crc(intended) else seen


# --- Captures of the drive pins ------------------------------------------------------------------


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


def verify_recorded_captures(
    config: VerifyConfig, path: Path, outputs: CommandOutputs, *, quiet: bool
) -> int:
    """Judge captures by the frames of the recording *path*, and return the exit status."""
    from haptogram.evidence.recordings.reader import Recording
    from haptogram.evidence.recordings.recorded_run import recorded_run
    from haptogram.report.run.pins import run_result_with_captures
    from haptogram.report.run.result import run_result_dict

    recording = Recording(path)
    recorded = recorded_run(recording)
    model = recorded.model
    verdict = verify_run_by_captures(
        config, model, recorded.intended, recorded.incomplete, quiet=quiet
    )
    # A run that FAILs is false, too.
    run = verdict.run if verdict.run is not None else _verify_without_field(verdict, model)
    result = run_result_dict(
        run,
        configuration=config.result_options(),
        seed=config.limits.seed,
        board={
            "is": f"the board of {path}",
            "transducers": model.array.count,
            "sound_speed_m_s": model.medium.sound_speed_m_s,
        },
        warnings=[recording.note] if recording.note else [],
    )
    result = run_result_with_captures(result, verdict, is_run_judged=verdict.run is not None)
    outputs.print(str(verdict))
    seen = verify_seen_by_number(recorded.intended, verdict.observations)
    if not write_run_files(config, run, result, model, seen, outputs, verdict):
        return USAGE
    return verdict.exit_status


def _verify_without_field(verdict: JoinedCaptureVerdict, model: AcousticModel) -> RunVerdict:
    """Return the run verdict from captured pins alone: no frame verified, each with a note."""
    from haptogram.verification import verify_run

    run = verify_run(verdict.frames, [], model=model, unseen=verdict.no_field)
    frames = [
        dataclasses.replace(frame, note=verdict.frame_note(place))
        for place, frame in enumerate(run.frames)
    ]
    return dataclasses.replace(run, frames=frames)
