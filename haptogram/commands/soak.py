"""``haptogram soak``: hours of streaming over a bad line, and an account of every fault."""

from __future__ import annotations

import argparse
import contextlib
import functools
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from haptogram.campaigns.soak.setup import SoakSetup
from haptogram.errors import ConfigurationError
from haptogram.machine.files import STANDARD_OUTPUT
from haptogram.settings.command_line import add_command_options, settings_of
from haptogram.settings.option import Settings, option, option_of, options_of
from haptogram.settings.parser import Parser, add_flag
from haptogram.settings.run.files import OutputConfig, output_options

from .acting_options import refuse_idle_options
from .shell.exit_status import FAIL, INTERRUPTED, PASS, USAGE
from .shell.output_files import FILE_HELP, CommandOutputs
from .shell.progress import campaign_progress

if TYPE_CHECKING:
    from haptogram.campaigns.soak.campaign import SoakCampaign
    from haptogram.campaigns.soak.comparison import MakeBoard
    from haptogram.campaigns.soak.segment import Progress


@dataclass(frozen=True, kw_only=True)
class SittingConfig(Settings):
    """Processes and files of a sitting of a soak; the account is the same with any."""

    jobs: int = option(1, unit="N", low=1, high=256, help="processes")
    resume: Path | None = option(
        None,
        unit="FILE",
        help="checkpoint: written after every segment, and gone on from if it is there",
    )
    record: Path | None = option_of(
        OutputConfig,
        "record",
        help="write bytes and latches of the seconds around each violation, as MCAP",
    )


def set_up_soak(
    parser: Parser,
    board_maker: Callable[[str | None], MakeBoard],
) -> None:
    """Add the options of the command; *board_maker* makes boards."""
    parser.main_options = "hours fault_rate seed jobs resume json junit html record"
    parser.set_defaults(run=functools.partial(run_soak, board_maker=board_maker))
    add_command_options(parser, options_of(SoakSetup).values())
    sitting = parser.add_argument_group("sitting and result", FILE_HELP)
    add_command_options(sitting, options_of(SittingConfig).values())
    add_command_options(sitting, output_options("json junit html summary stamp"))
    add_flag(parser, "--quiet", help="no progress")


def run_soak(arguments: argparse.Namespace, board_maker: Callable[[str | None], MakeBoard]) -> int:
    """Run what is left of the soak, print the account, and return the exit status."""
    from haptogram.report.formats.console import document_text
    from haptogram.report.soak.document import soak_document

    refuse_idle_options(arguments)
    outputs = CommandOutputs(arguments, "json", "junit", "html", "summary", "resume", "record")
    if outputs.paths.get("--resume") == STANDARD_OUTPUT:
        raise ConfigurationError("--resume -: a checkpoint is read again; name a file")
    campaign, make_board = _make_soak_campaign(arguments), board_maker(arguments.mutant)
    interrupted = False
    with outputs.recording(campaign.setup.as_dict()) as writer:
        if writer is not None:
            writer.begin()
        try:
            with _soak_command_progress(campaign, quiet=arguments.quiet) as progress:
                campaign.run(
                    make_board,
                    jobs=arguments.jobs,
                    checkpoint=arguments.resume,
                    progress=progress,
                    writer=writer,
                )
        except KeyboardInterrupt:
            interrupted = True
    # Before the file: a full disk must not cost the account.
    document = soak_document(campaign)
    if campaign.done:
        outputs.print(document_text(document))
    if interrupted:
        print(_resume_hint(arguments, campaign), file=sys.stderr)
    written = outputs.write(document, json=campaign.save)
    if not outputs.is_recorded(writer) or not written:
        return USAGE
    if campaign.failures:
        return FAIL
    return INTERRUPTED if interrupted else PASS


def _make_soak_campaign(arguments: argparse.Namespace) -> SoakCampaign:
    """Return a new soak, or the one kept in the file --resume, with the same settings."""
    from haptogram.campaigns.soak.campaign import SoakCampaign

    setup = settings_of(arguments, SoakSetup)
    if arguments.resume is None:
        return SoakCampaign(setup)
    return SoakCampaign.load(arguments.resume, setup)


def _resume_hint(arguments: argparse.Namespace, campaign: SoakCampaign) -> str:
    """Return what an interrupted soak has kept, and how to go on with it."""
    if not campaign.done:
        minutes = campaign.setup.segment_s / 60
        return (
            f"haptogram soak: interrupted in the first segment of {minutes:g} virtual minutes: "
            "nothing was kept; --segment-minutes makes segments shorter"
        )
    if arguments.resume is None:
        return "haptogram soak: interrupted; with --resume FILE a soak can be gone on with"
    return f"haptogram soak: interrupted; the same command goes on from {arguments.resume}"


@contextlib.contextmanager
def _soak_command_progress(campaign: SoakCampaign, *, quiet: bool) -> Iterator[Progress | None]:
    """Yield a function that shows virtual seconds done, speed and violations; no bar if quiet."""
    start_s, began_s, all_min = campaign.done_s, time.monotonic(), campaign.setup.seconds / 60
    with campaign_progress(
        "soak", quiet=quiet, unit="virtual min", initial=round(start_s / 60, 2)
    ) as bar:

        def show(done_s: float) -> None:
            speed = (done_s - start_s) / max(time.monotonic() - began_s, 1e-9)
            wrong = sum(campaign.failures.values())
            if bar is not None:
                text = f"{speed:.1f} x real time, {wrong} violations"
                bar(round(done_s / 60, 2), round(all_min, 2), text)

        yield show
