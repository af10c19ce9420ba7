"""The JSON of a run: written, and read back."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

from haptogram.campaigns.bench.compare import bench_differences, compare_benches
from haptogram.campaigns.bench.measure import BenchRun
from haptogram.errors import ConfigurationError, refusing_other_content
from haptogram.settings.text_file import read_json_file

FORMAT: Final = "haptogram-bench"
VERSION: Final = 1

#: The meaning of each stage, in the order in which a frame passes them.
STAGES: Final = {
    "wake": "the loop was there, after the intended time",
    "overslept": "of that: with nothing else to do",
    "work": "encode and write",
    "at_port": "the port had taken it, after the intended time",
    "line": "queue and own bytes, from the baud rate",
    "board": "complete at the board, after the line",
    "complete": "all of that but its own bytes, after the intended time",
    "margin": "complete before its time to apply",
    "latch": "latched, after its time to apply",
    "control": "a loop that does nothing, in its own process, beside it",
}


def bench_dict(run: BenchRun) -> dict[str, Any]:
    """Return *run* for JSON: every percentile with its n, every miss with its cause."""
    report = run.report
    return {
        "format": FORMAT,
        "version": VERSION,
        "board": run.board,
        "configuration": run.config.as_dict(),
        "frames": {
            "due": report.frames,
            "skipped": len(report.skipped),
            "latched": run.latched,
            "late": run.late,
            "write_stalls": report.write_stalls,
            "dropped_late": report.status.counters.dropped_late,
            "lead_us": report.lead_us,
            "lead_moves": report.lead_moves,
        },
        "clock_uncertainty_us": report.clock_uncertainty_us,
        "stages": {name: asdict(found) for name, found in run.percentiles().items()},
        "misses": {
            place: [asdict(miss) for miss in misses] for place, misses in run.misses.items()
        },
        "processors": run.processors,
        "environment": run.environment,
        "warnings": run.warnings,
    }


def read_bench_result(path: Path) -> dict[str, Any]:
    """Return the result of an earlier run.

    Raises
    ------
    ConfigurationError
        If the file cannot be read, holds something else, or has another format version.
    """
    result = read_json_file(path, "compare")
    if not isinstance(result, dict) or result.get("format") != FORMAT:
        raise ConfigurationError(
            f"{path}: not a result of haptogram bench: name a file that --json wrote"
        )
    if result.get("version") != VERSION:
        raise ConfigurationError(
            f"{path}: version {result.get('version')} of the format, must be {VERSION}: "
            "measure again with this program"
        )
    with refusing_other_content(f"{path} is damaged: measure again"):
        compare_benches(result, result)
        bench_differences(result, result)
    return result
