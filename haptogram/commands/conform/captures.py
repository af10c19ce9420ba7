"""Results of clauses by captures of the drive pins, of a run at a port or in a recording."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection
from pathlib import Path
from typing import TYPE_CHECKING

from haptogram.errors import ConfigurationError, refusing_other_content
from haptogram.records.frame import Evidence

from ..shell.captures import read_capture_arguments

if TYPE_CHECKING:
    from haptogram.conformance.verdict import SuiteResult
    from haptogram.settings.run.files import CaptureConfig


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
