"""``python -m haptogram_paper``: the paper's simulation, next to what it printed."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Final

from haptogram.errors import ConfigurationError
from haptogram.machine.files import check_file_writable, write_file_atomically
from haptogram.machine.provenance import Provenance
from haptogram.published import PRESETS, compare_preset
from haptogram.report.presets import presets_text

from .document import reproduce_paper
from .page import check_paper_report, paper_report_files
from .text import paper_text

_DESCRIPTION: Final = (
    "Reproduce the simulation of the paper 'Haptogram: aerial display of 3D vibrotactile "
    "sensation' (2014): its equations as printed, with their faults, and as corrected; Table 1 "
    "cell by cell, with one fitted scale; the foci of figure 4. The averages of Table 1 follow "
    "from a stated reading of the text. Its standard deviations do not, and every cell says so. "
    "Exit status: 0 if all sixteen averages are within 7 % of the printed ones, 1 if one is not."
)


def parse(words: list[str] | None) -> argparse.Namespace:
    """Return the options."""
    parser = argparse.ArgumentParser("python -m haptogram_paper", description=_DESCRIPTION)
    parser.add_argument(
        "--presets", action="store_true", help="print what 'haptogram presets' prints too"
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="write everything as JSON")
    parser.add_argument(
        "--html",
        type=Path,
        metavar="FILE.html|DIR",
        help="write a page with pictures, or a folder with the page and its pictures",
    )
    parser.add_argument("--stamp", metavar="DATE", help="date that the page states [now]")
    return parser.parse_args(words)


def main(words: list[str] | None = None) -> int:
    """Compute, print and write; return the exit status."""
    options = parse(words)
    provenance = Provenance.of_run("python -m haptogram_paper", options.stamp)
    if options.html:
        check_paper_report(options.html)
    if options.json:
        check_file_writable(options.json)
    paper = reproduce_paper()
    compared = [(preset, compare_preset(preset)) for preset in PRESETS]
    presets = [row for _, rows in compared for row in rows]
    print(paper_text(paper), end="")
    if options.presets:
        print("\n" + presets_text(compared), end="")
    files = []
    if options.json:
        text = json.dumps(paper.as_dict() | {"presets": presets}, indent=2)
        files.append((options.json, text.encode()))
    if options.html:
        files += paper_report_files(paper, presets, options.html, provenance)
    for path, content in files:
        write_file_atomically(path, content)
    return 0 if paper.averages_reproduced else 1


if __name__ == "__main__":
    try:
        sys.exit(main())
    except ConfigurationError as error:
        sys.exit(f"haptogram_paper: {error}")
