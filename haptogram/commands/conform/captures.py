"""Results of clauses by captures of the drive pins, of a run at a port or in a recording."""

from __future__ import annotations

import dataclasses
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from haptogram.errors import ConfigurationError
from haptogram.records.frame import Evidence

from ..shell.captures import read_capture_arguments, wait_for_capture_arguments
from ..shell.output_files import print_command_error

if TYPE_CHECKING:
    from haptogram.conformance.verdict import SuiteResult
    from haptogram.settings.run.captures import CaptureConfig


def conform_captures_at_port(
    config: CaptureConfig,
    suite: SuiteResult,
    since_s: float,
    expected: dict[str, str],
    *,
    simulated: bool = False,
) -> SuiteResult | None:
    """Return a run at a port with the results of its captures; as it is if there is none.

    None: a capture did not come, or cannot be judged; that was said.
    """
    from haptogram.conformance.pins.judge import (
        captured_share_of_run,
        judge_clauses_by_pins,
        suite_with_clauses_by_pins,
    )

    if not config.capture:
        return suite
    try:
        if suite.is_interrupted:
            raise KeyboardInterrupt
        wait_for_capture_arguments(config, since_s)
        records = read_capture_arguments(config)
        shares = [
            captured_share_of_run(record, suite.nonces, "the one at the port") for record in records
        ]
        judged = judge_clauses_by_pins(records, expected)
        if simulated:
            judged = tuple(dataclasses.replace(one, evidence=Evidence.SIMULATED) for one in judged)
        return suite_with_clauses_by_pins(suite, judged, shares)
    except KeyboardInterrupt:
        print("haptogram conform: interrupted; --capture was not judged", file=sys.stderr)
    except ConfigurationError as error:
        print_command_error("haptogram conform", error)
    return None


def conform_recorded_captures(
    config: CaptureConfig, path: Path, expected: dict[str, str]
) -> SuiteResult:
    """Return the run in a recording with the results of its captures.

    Raises
    ------
    ConfigurationError
        A recording without a result, or of another run than a capture; a capture or a map that
        cannot be read.
    """
    from haptogram.conformance.pins.judge import (
        captured_share_of_run,
        judge_clauses_by_pins,
        suite_with_clauses_by_pins,
    )
    from haptogram.evidence.recordings.channels import SUMMARY
    from haptogram.evidence.recordings.reader import Recording
    from haptogram.evidence.recordings.sent_frames import recorded_sessions
    from haptogram.report.conformance.result import suite_of_conformance_json

    recording = Recording(path)
    found = [entry.fields for entry in recording.entries((SUMMARY,))]
    if not found:
        what = recording.run.get("command", "another program")
        raise ConfigurationError(
            f"{path}: the recording (of {what}) holds no result; haptogram conform --record "
            "writes one that does, at the end of its run"
        )
    try:
        suite = suite_of_conformance_json(found[-1])
    except (ValueError, KeyError, TypeError) as error:
        raise ConfigurationError(f"{path}: its result is none of haptogram conform") from error
    records = read_capture_arguments(config)
    asked = recorded_sessions(recording)
    shares = [captured_share_of_run(record, asked, str(path)) for record in records]
    return suite_with_clauses_by_pins(suite, judge_clauses_by_pins(records, expected), shares)
