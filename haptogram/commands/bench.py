"""``haptogram bench``: how good the loop is here, and whose fault each late frame was."""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from haptogram.campaigns.bench.config import BenchConfig
from haptogram.settings.command_line import add_command_options, settings_of
from haptogram.settings.option import Settings, option, options_of
from haptogram.settings.parser import Parser, add_flag
from haptogram.settings.run.files import output_options

from .acting_options import refuse_idle_options
from .shell.exit_status import PASS, USAGE
from .shell.output_files import FILE_HELP, CommandOutputs


@dataclass(frozen=True, kw_only=True)
class BenchFiles(Settings):
    """The picture that a benchmark writes, and the file that it is compared with."""

    picture: Path | None = option(
        None, unit="FILE", help="write the histogram alone: .png, .svg or .pdf"
    )
    compare: Path | None = option(None, unit="OLD.json", help="say what changed beyond the noise")


def set_up_bench(parser: Parser) -> None:
    """Add the options of the command."""
    parser.main_options = "port rate_hz seconds baud lead_ms spin_us realtime json html compare"
    parser.set_defaults(run=run_bench)
    add_command_options(parser, options_of(BenchConfig).values())
    add_flag(parser, "--quiet", help="print changes and errors only")
    result = parser.add_argument_group("result", FILE_HELP)
    add_command_options(result, output_options("json html summary stamp record"))
    add_command_options(result, options_of(BenchFiles).values())


def run_bench(arguments: argparse.Namespace) -> int:
    """Measure, print and write; return 0."""
    from haptogram.campaigns.bench.measure import run_bench
    from haptogram.campaigns.bench.result import bench_dict, read_bench_result
    from haptogram.report.bench.document import bench_document, draw_bench_histograms
    from haptogram.report.figures import write_figure
    from haptogram.report.formats.console import document_text
    from haptogram.report.run.result import write_run_json

    refuse_idle_options(arguments)
    outputs = CommandOutputs(
        arguments, "json", "html", "summary", "picture", "record", pictures=True
    )
    old = None if arguments.compare is None else read_bench_result(arguments.compare)
    config = settings_of(arguments, BenchConfig)
    with outputs.recording(config.as_dict()) as writer:
        # Without a progress bar: it would draw between the ticks.
        found = run_bench(config, writer)
        result = bench_dict(found)
        if writer is not None:
            from haptogram.evidence.recordings.channels import SUMMARY

            writer.document(SUMMARY, writer.last_ns, result)
    changes = [] if old is None else _bench_changes(old, result)
    document = bench_document(found, result, changes)
    if not arguments.quiet:
        outputs.print(document_text(document))
    elif changes:
        outputs.print("\n".join(changes))
    written = outputs.write(
        document,
        json=lambda path: write_run_json(path, result),
        picture=lambda path: write_figure(path, draw_bench_histograms(found.stages_us)),
    )
    return PASS if outputs.is_recorded(writer) and written else USAGE


def _bench_changes(old: dict[str, Any], new: dict[str, Any]) -> list[str]:
    """Return lines on the changes between two results that exceed the noise, and how many do not.

    The noise is 4 times the scatter of the percentiles of both runs, and 1 µs. Last come lines on
    circumstances in which the runs differ.
    """
    from haptogram.campaigns.bench.compare import bench_differences, compare_benches

    changes = compare_benches(old, new)
    lines = [f"changed beyond the noise: {change}" for change in changes if change.beyond_noise]
    quiet = sum(not change.beyond_noise for change in changes)
    lines.append(f"unchanged within the noise: {quiet} of {len(changes)} comparisons")
    return lines + bench_differences(old, new)
