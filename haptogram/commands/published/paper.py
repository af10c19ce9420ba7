"""``haptogram paper``: the paper's simulation, next to what it printed."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from haptogram.machine.files import is_standard_output, write_json_file
from haptogram.settings.parser import file_name_option

from ..acting_options import refuse_idle_options
from ..shell.exit_status import FAIL, PASS
from ..shell.job import provenance_of_run
from ..shell.output_files import CommandOutputs

if TYPE_CHECKING:
    from haptogram.machine.provenance import Provenance
    from haptogram.published.paper.document import PaperReproduction
    from haptogram.settings.parser import Parser

_PAGE: Final = Path("paper.html")
_EPILOG: Final = """\
examples:
  haptogram paper                       equations, Table 1, readings and figure 4 as text
  haptogram paper --presets             the published figures of other systems too
  haptogram paper --html paper.html     one page with pictures
  haptogram paper --html out            the page, and every picture as PNG and SVG, in a folder
  haptogram paper --json -              everything as JSON on standard output

exit status:
  0    all sixteen averages of Table 1 are within 7 % of the printed ones
  1    one is not
  2    usage or environment error
  130  interrupted (Ctrl-C, SIGTERM, SIGHUP)
"""


def set_up_paper(parser: Parser) -> None:
    """Describe the command and add its options."""
    parser.description = (
        "Reproduce the simulation of the paper 'Haptogram: aerial display of 3D "
        "vibrotactile sensation' (2014): its equations as printed, with their faults, and as "
        "corrected; Table 1 cell by cell, with one fitted scale; the foci of figure 4. The "
        "averages of Table 1 follow from a stated reading of the text. Its standard deviations "
        "do not, and every cell says so."
    )
    parser.epilog = _EPILOG
    parser.add_argument(
        "--presets",
        action="store_true",
        help="print the published figures of the systems behind the paper, and of open boards, "
        "next to ours, as 'haptogram presets' does [not printed]",
    )
    parser.add_argument(
        "--json",
        type=file_name_option,
        metavar="FILE",
        help="write everything as JSON; - is standard output [none]",
    )
    parser.add_argument(
        "--html",
        type=file_name_option,
        metavar="FILE.html|DIR",
        help="write a page with pictures, or a folder with the page and the pictures [none]",
    )
    parser.add_argument(
        "--stamp",
        metavar="DATE",
        help="date that --html states (ISO 8601; UTC without a zone) [now]",
    )
    parser.rename(report="html")
    parser.set_defaults(run=run_paper)


def run_paper(arguments: argparse.Namespace) -> int:
    """Compute, write and print; return the exit status."""
    from haptogram.published.paper.document import reproduce_paper
    from haptogram.published.presets import PRESETS, compare_preset
    from haptogram.report.paper.text import paper_text
    from haptogram.report.presets import presets_text

    refuse_idle_options("paper", arguments)
    outputs = _paper_outputs(arguments)
    provenance = provenance_of_run(arguments)
    paper = reproduce_paper()
    wanted = arguments.presets or outputs.paths
    compared = [(preset, compare_preset(preset)) for preset in PRESETS] if wanted else []
    presets = [row for _, rows in compared for row in rows]
    # Before the files: a full disk must not cost the result.
    print(paper_text(paper), file=outputs.text, end="")
    if arguments.presets:
        print("\n" + presets_text(compared), file=outputs.text, end="")
    if arguments.json:
        write_json_file(arguments.json, paper.as_dict() | {"presets": presets})
    if arguments.html:
        _write_paper_report(paper, presets, arguments.html, provenance)
    return PASS if paper.averages_reproduced else FAIL


def _paper_outputs(arguments: argparse.Namespace) -> CommandOutputs:
    """Return the files, after a check that they can be written."""
    from haptogram.report.paper.page import check_paper_report

    page: Path | None = arguments.html
    if page is not None and not is_standard_output(page):
        check_paper_report(page)
        page = page if page.suffix else page / "index.html"
    return CommandOutputs(argparse.Namespace(json=arguments.json, html=page), "json", "html")


def _write_paper_report(
    paper: PaperReproduction, presets: list[dict[str, Any]], place: Path, provenance: Provenance
) -> None:
    from haptogram.machine.files import write_file_atomically
    from haptogram.report.paper.page import paper_report_files

    if is_standard_output(place):
        ((_, page),) = paper_report_files(paper, presets, _PAGE, provenance)
        write_file_atomically(place, page)
        return
    for path, content in paper_report_files(paper, presets, place, provenance):
        write_file_atomically(path, content)
