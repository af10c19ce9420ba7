"""The files of a run: each is written as a whole, and one that cannot be does not cost the rest."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from haptogram.errors import ConfigurationError

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
    from haptogram.report import run as report

    if not outputs.wants_document and not outputs.paths:
        return True
    is_virtual = config.link.virtual_time
    seconds = _verify_board_seconds(verdict) if is_virtual else outputs.provenance.elapsed_s
    return outputs.write(
        report.run_document(verdict, result, model, observations=seen, seconds=seconds),
        in_virtual_time=is_virtual,
        frames=lambda path: report.write_run_frame_lines(path, verdict),
        json=lambda path: report.write_run_json(path, result),
        pin_calibration=lambda path: _write_pin_calibration(path, captures, model),
    )


def _write_pin_calibration(
    path: Path, captures: JoinedCaptureVerdict | None, model: AcousticModel
) -> None:
    """Write the gain and phase offsets measured at the captured pins.

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
    """Return *seen* with the intended drive if its CRC matches."""
    return dataclasses.replace(seen, drive=intended.drive) if seen.shows_by_crc(intended) else seen


def _verify_board_seconds(verdict: RunVerdict) -> float:
    """Return the time from the first frame to the last one, on the board's clock."""
    times = (t for frame in verdict.frames for t in (frame.t_apply_us, frame.t_latch_us))
    known = [t for t in times if t is not None]
    return (max(known) - min(known)) / 1e6 if known else 0.0
