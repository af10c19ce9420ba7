"""Write the table of the effect of every fault on the focus: a run of each, in virtual time.

Plan, seed and job are fixed and no wall clock is read, so the same program writes the same table.
"""

from __future__ import annotations

import argparse
import re
import sys
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from tqdm import tqdm

from haptogram.cli.boards import board_in_virtual_time
from haptogram.errors import HaptogramError
from haptogram.evidence.run_record import RunRecord, measure_run
from haptogram.settings.faults.kinds import FAULT_KINDS
from haptogram.settings.run.verify import VerifyConfig
from haptogram.verification import FrameVerdict, RunVerdict

WORKERS: Final = 2
SEED: Final = 1
HEALTHY: Final = ""
_SESSION_IS_UP: Final = "from=10ms"
_IN_MID_RUN: Final = "from=250ms"
_NOTHING: Final = "–"

#: A telling strength of every fault that has none by default: enough to show in 380 frames.
STRENGTHS: Final = {
    "line.flip": f"ber=2e-5 {_SESSION_IS_UP}",
    "line.drop": f"p=1e-4 {_SESSION_IS_UP}",
    "line.insert": f"p=1e-4 {_SESSION_IS_UP}",
    "line.burst": f"p=1e-4 {_SESSION_IS_UP}",
    "line.duplicate": f"p=0.1 {_SESSION_IS_UP}",
    "line.truncate": f"p=0.05 {_SESSION_IS_UP}",
    "line.overrun": f"p=0.05 {_SESSION_IS_UP}",
    "line.break": f"p=0.05 {_SESSION_IS_UP}",
    "line.baud": "ppm=60000 from=250ms until=300ms",
    "line.half_open": _IN_MID_RUN,
    "line.disconnect": f"ms=30 {_IN_MID_RUN}",
    "line.delay": "us=97000 jitter_us=4000 from=250ms until=350ms",
    "line.slice": f"gap_us=40 {_SESSION_IS_UP}",
    "line.coalesce": f"us=20000 {_SESSION_IS_UP}",
    "line.batch": f"ms=16 {_SESSION_IS_UP}",
    "clock.ppm": "ppm=200",
    "clock.step": f"us=150000 {_IN_MID_RUN}",
}
_FRAME_STRENGTH: Final = f"p=0.05 {_SESSION_IS_UP}"
_DEVICE_PLACE: Final = "column=3"

HEAD: Final = """\
# What each fault does to the focus

One fault at a time on the virtual board, in virtual time: a circle of 30 mm radius, 100 mm above
16 x 16 transducers, 380 frames at 1 kHz, seed {seed}. Made by `ci/fault-table`; every row is

    haptogram verify --virtual-time --object circle --radius-mm 30 --repeat 10 --seed {seed} \\
        --fault "..."

The parameters are in [faults.md](faults.md); where none is given, the default is meant.

- *across*, *along*: the largest distance of a radiated focus from its target, or of the pressure
  peak from its place. Rounding of the phases alone makes up to {smallest_miss:.2f} mm.
- *elsewhere*: for how long the focus was not the intended one, in all and at a time. The board
  holds the last drive meanwhile: *away* is how far from the target its focus was at most (points
  are 5 mm apart), *Pa* the average pressure at the target, of what it should have been.
- *cause*: as the summary names it.

A lost frame or a wrong drive makes a run fail; behind the break of a link it is inconclusive.

"""
HARMLESS: Final = "The same figures as without a fault have "
COLUMNS: Final = (
    "fault",
    "lost",
    "wrong",
    "across mm",
    "along mm",
    "elsewhere ms",
    "away mm",
    "Pa",
    "verdict",
    "cause",
)


def plans() -> list[str]:
    """Return the plan of the healthy board, then of every fault at its strength."""
    return [HEALTHY, *(f"{name} {_strength(name)}".strip() for name in FAULT_KINDS)]


def _strength(name: str) -> str:
    layer = name.partition(".")[0]
    by_layer = {"frame": _FRAME_STRENGTH}
    if "column" in FAULT_KINDS[name]:
        by_layer["device"] = _DEVICE_PLACE
    return STRENGTHS.get(name, by_layer.get(layer, ""))


@dataclass(frozen=True, slots=True)
class Row:
    """The row of one fault."""

    cells: tuple[str, ...]
    smallest_miss_mm: float | None = None

    def __str__(self) -> str:
        """Return the line of the table."""
        return f"| {' | '.join(cell.replace('|', '/') for cell in self.cells)} |"


def row(fault: str) -> Row:
    """Run the job with *fault*; return its row."""
    config = VerifyConfig.of(
        object="circle",
        radius_mm=30.0,
        repeat=10,
        seed=SEED,
        virtual_time=True,
        fault=(fault,) if fault else (),
    )
    name = f"`{fault}`" if fault else "none"
    try:
        with board_in_virtual_time(config.virtual_board()) as board:
            found = measure_run(config, board, None)
    except HaptogramError as error:
        return Row((name, *[_NOTHING] * (len(COLUMNS) - 3), "no result", str(error)))
    run = found.verdict()
    cells = (name, *_figures(run), _cause(run, found))
    return Row(cells, run.as_dict()["smallest_miss_mm"])


def _figures(run: RunVerdict) -> tuple[str, ...]:
    counts, result, effect = run.counts, run.as_dict(), run.effect
    wrong = counts["off_target"] + counts["wrong_drive"] + counts["corrupt"]
    errors = (result[name]["max"] for name in ("lateral_error_mm", "axial_error_mm"))
    figures = [str(number) for number in (counts["lost"], wrong)]
    figures += [_NOTHING if error is None else f"{error:.2f}" for error in errors]
    if effect is None:
        return (*figures, "0", _NOTHING, _NOTHING, str(run.verdict))
    return (
        *figures,
        f"{effect.away_ms:.0f} ({effect.longest_ms:.0f})",
        _NOTHING if effect.farthest_mm is None else f"{effect.farthest_mm:.1f}",
        _NOTHING
        if effect.radiated_pa is None
        else f"{effect.radiated_pa:.0f} of {effect.intended_pa:.0f}",
        str(run.verdict),
    )


def _cause(run: RunVerdict, found: RunRecord) -> str:
    """Return the causes that the run itself names."""
    named = Counter(fault for frame in run.frames for fault in _faults(frame))
    causes = [f"{fault} ({times} x)" for fault, times in named.most_common(1)]
    causes += [] if found.cut is None else [found.cut.reason]
    causes += sorted(set(found.warnings))
    for side, counts in found.troubles.items():
        told = ", ".join(f"{number} {name}" for name, number in counts.items())
        causes.append(f"{side}: {told}")
    return "; ".join(causes) or _NOTHING


def _faults(frame: FrameVerdict) -> list[str]:
    """Return the faults of *frame* by name, without figures that differ between frames."""
    bare = (fault.removesuffix(": the latched drive is right") for fault in frame.faults)
    return [re.sub(r", by up to [^,]*", "", fault) for fault in bare]


def page(rows: list[Row]) -> str:
    """Return the page; the first row is that of the healthy board."""
    head = HEAD.format(seed=SEED, smallest_miss=rows[0].smallest_miss_mm)
    harmless = [row.cells[0] for row in rows[1:] if row.cells[1:] == rows[0].cells[1:]]
    shown = [row for row in rows if row.cells[0] not in harmless]
    lines = [f"| {' | '.join(COLUMNS)} |", f"|{' --- |' * len(COLUMNS)}", *map(str, shown)]
    return f"{head}{HARMLESS}{', '.join(harmless)}.\n\n" + "\n".join(lines) + "\n"


def main() -> int:
    """Run all faults, two at a time, and write the page."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("target", type=Path, metavar="FILE")
    arguments = parser.parse_args()
    faults = plans()
    with ProcessPoolExecutor(WORKERS) as pool:
        rows = list(tqdm(pool.map(row, faults), total=len(faults), unit=" faults"))
    arguments.target.write_text(page(rows), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
