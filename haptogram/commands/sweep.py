"""``haptogram sweep``: one command over many values of its options, on many processors."""

from __future__ import annotations

import argparse
import contextlib
import functools
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

from haptogram.machine.files import Kind, kind_of_file
from haptogram.settings.command_line import add_command_options
from haptogram.settings.option import Settings, option, option_of, options_of
from haptogram.settings.parser import Acting, Parser, add_file_option, add_flag
from haptogram.settings.run.files import OutputConfig

from .acting_options import refuse_idle_options
from .shell.exit_status import FAIL, INCONCLUSIVE, INTERRUPTED, PASS, USAGE
from .shell.output_files import FILE_HELP, CommandOutputs
from .shell.progress import campaign_progress

if TYPE_CHECKING:
    from haptogram.campaigns.sweep.campaign import OpenWorkers, RunWords, SweepCampaign
    from haptogram.campaigns.sweep.plan import ParserOf


@dataclass(frozen=True, kw_only=True)
class WorkersConfig(Settings):
    """Workers of a sweep, and the files of its result."""

    jobs: int = option(1, unit="N", low=1, high=1024, help="processes of this machine")
    scheduler: str | None = option(
        None,
        unit="ADDRESS|local",
        help="run on the workers of this Dask scheduler, such as tcp://10.0.0.1:8786; local starts "
        "one with --jobs workers",
    )
    rows: Path | None = option(
        None,
        unit="FILE",
        help="write a row for every point, as .csv or .parquet; until the end they are in "
        "FILE.part, from which the same command goes on after an interrupt",
    )
    html: Path | None = option_of(OutputConfig, "html")


_ACTING: Final = {
    "jobs": Acting(
        "on this machine (a cluster has its workers)", lambda a: a.scheduler in (None, "local")
    ),
}


def set_up_sweep(parser: Parser, parser_of: ParserOf, run_words: RunWords) -> None:
    """Add the options of the command; *run_words* runs the command of a point."""
    parser.acting = _ACTING
    parser.set_defaults(run=functools.partial(run_sweep, parser_of=parser_of, run_words=run_words))
    add_file_option(parser, "file", help="the points, as TOML (docs/sweep.md)")
    group = parser.add_argument_group("workers and result", FILE_HELP)
    add_command_options(group, options_of(WorkersConfig).values())
    add_flag(parser, "--quiet", help="no progress")


def run_sweep(arguments: argparse.Namespace, parser_of: ParserOf, run_words: RunWords) -> int:
    """Run the points that are left, write and print the result, and return the exit status."""
    from haptogram.campaigns.sweep.campaign import SweepCampaign
    from haptogram.campaigns.sweep.plan import SweepPlan
    from haptogram.campaigns.sweep.rows import check_rows_file, write_rows
    from haptogram.report.formats.console import document_text
    from haptogram.report.sweep.document import sweep_document

    refuse_idle_options(arguments)
    outputs = CommandOutputs(arguments, "rows", "html")
    if "--rows" in outputs.paths:
        check_rows_file(outputs.paths["--rows"])
    plan = SweepPlan.read(arguments.file, parser_of)
    campaign = SweepCampaign.load(plan, _journal_path(arguments.rows))
    try:
        with _sweep_progress(campaign, quiet=arguments.quiet) as show:
            campaign.run(run_words, _open_sweep_workers(arguments), show)
    except KeyboardInterrupt:
        print(_sweep_resume_hint(campaign), file=sys.stderr)
    document = sweep_document(campaign)
    if campaign.rows:
        outputs.print(document_text(document))
    if not campaign.is_complete:
        return _sweep_exit_status(campaign)
    if not outputs.write(document, rows=lambda path: write_rows(path, campaign.rows_in_order)):
        return USAGE
    if campaign.journal is not None:
        campaign.journal.unlink()
    return _sweep_exit_status(campaign)


def _journal_path(path: Path | None) -> Path | None:
    """Return FILE.part, the journal of finished rows; None without a file, or for a pipe."""
    if path is None or kind_of_file(path) is not Kind.FILE:
        return None
    return path.with_name(f"{path.name}.part")


def _open_sweep_workers(arguments: argparse.Namespace) -> OpenWorkers:
    """Return a function that opens the workers: processes (--jobs), or Dask with --scheduler."""
    from haptogram.campaigns.sweep.workers import dask_workers, process_workers

    if arguments.scheduler is None:
        return functools.partial(process_workers, arguments.jobs)
    return functools.partial(dask_workers, arguments.scheduler, arguments.jobs)


def _sweep_resume_hint(campaign: SweepCampaign) -> str:
    """Return how many points an interrupted sweep has run, and how to go on with it."""
    done = f"haptogram sweep: interrupted after {len(campaign.rows)} of {len(campaign.plan)} points"
    if campaign.journal is None:
        return f"{done}; with --rows FILE a sweep can be gone on with"
    return f"{done}; the same command goes on from {campaign.journal}"


def _sweep_exit_status(campaign: SweepCampaign) -> int:
    """Return the worst status: fail 1, interrupted 130, error 2, inconclusive 3; else pass 0."""
    verdicts = {row["verdict"] for row in campaign.rows.values()}
    if "fail" in verdicts:
        return FAIL
    if not campaign.is_complete:
        return INTERRUPTED
    if "error" in verdicts:
        return USAGE
    return INCONCLUSIVE if "inconclusive" in verdicts else PASS


@contextlib.contextmanager
def _sweep_progress(campaign: SweepCampaign, *, quiet: bool) -> Iterator[Callable[[], None]]:
    """Yield a function that updates the progress bar: points done, and those that did not pass."""
    initial = len(campaign.rows)
    with campaign_progress("sweep", quiet=quiet, unit="points", initial=initial) as bar:

        def show() -> None:
            failed = sum(row["verdict"] != "pass" for row in campaign.rows.values())
            if bar is not None:
                bar(len(campaign.rows), len(campaign.plan), f"{failed} did not pass")

        yield show
