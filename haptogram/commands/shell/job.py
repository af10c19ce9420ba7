"""The origin of a result for its files, and its annotations in a job of GitHub."""

from __future__ import annotations

from argparse import Namespace
from typing import TYPE_CHECKING

from haptogram.machine.terminal import is_terminal_of_github_job

if TYPE_CHECKING:
    from haptogram.machine.provenance import Provenance
    from haptogram.report.formats.document import Document

    from .output_files import CommandOutputs


def provenance_of_run(arguments: Namespace) -> Provenance:
    """Return the origin of the run that *arguments* describe, which begins now.

    Raises
    ------
    ConfigurationError
        If ``--stamp`` is no date.
    """
    from haptogram.machine.provenance import Provenance

    return Provenance.of_run(arguments.command_line, arguments.stamp)


def annotate_job(document: Document, outputs: CommandOutputs) -> None:
    """Print the findings of *document* as annotations, in a job of GitHub."""
    if is_terminal_of_github_job():
        from haptogram.report.formats.job_summary import github_job_annotations

        for line in github_job_annotations(document):
            print(line, file=outputs.text, flush=True)
