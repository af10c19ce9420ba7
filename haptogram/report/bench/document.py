"""The result of one benchmark of the loop as a document, with its pictures."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from haptogram.campaigns.bench.attribution import MISS_LIMITS_US
from haptogram.campaigns.bench.measure import BenchRun
from haptogram.campaigns.bench.percentiles import LEVELS
from haptogram.campaigns.bench.result import STAGES

from ..figures import style
from ..formats.document import Document, Finding, Level, Listing, Picture, Section, Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure


Result = Mapping[str, Any]

_STAGE_HEAD: Final = ("stage (µs)", *(f"p{level:g}" for level in LEVELS), "max", "n", "meaning")
_MISS_HEAD: Final = ("later than", "measured", "frames", "causes", "control loop stalled too")

_NOTABLE_SHARE: Final = 0.01  # share of all frames that is mentioned
_PLACES: Final = {"at_port": "at the port", "at_board": "complete at the board"}


def bench_document(run: BenchRun, result: Result, changes: Sequence[str] = ()) -> Document:
    """Return *run* as a document; nothing is judged, so that it has warnings only.

    Parameters
    ----------
    result : mapping
        As of :func:`haptogram.campaigns.bench.result.bench_dict`.
    changes : sequence of str
        Differences from an earlier run, one in each line.
    """
    tone, outcome = bench_outcome(result)
    return Document(
        command="bench",
        heading=f"Timing of the loop: {outcome}",
        title="timing of the loop",
        tone=tone,
        findings=[Finding(Level.WARNING, "bench", text) for text in result["warnings"]],
        lead=[_bench_conditions_text(result), _bench_frames_text(result)],
        sections=[
            _bench_stages_section(run, result),
            Section(
                "Late frames and their causes",
                [Table(_MISS_HEAD, list(_bench_misses_rows(result)), (0, 2, 4), (3,))],
            ),
            Section("Against the run before", [Listing(changes)] if changes else []),
            Section("Machine", [Listing(list(_bench_machine_rows(result)))], folds=True),
        ],
    )


def _bench_stages_section(run: BenchRun, result: Result) -> Section:
    """Return table and picture of the stages of a frame, and a text on the clocks."""
    last = len(_STAGE_HEAD) - 1
    rows = list(_bench_stages_rows(result))
    return Section(
        "Stages of a frame",
        [
            Table(_STAGE_HEAD, rows, range(1, last), (last,)),
            Listing([_bench_clocks_text(result)]),
            Picture(
                lambda: style.embed_picture(
                    draw_bench_histograms(run.stages_us),
                    "Histogram of the stages of a frame and of the control loop.",
                    "Both axes are logarithmic, so that rare delays show. The control loop does "
                    "nothing but wake up, in a process of its own: where it is late too, the "
                    "machine was.",
                )
            ),
        ],
    )


def _bench_conditions_text(result: Result) -> str:
    """Return rate, duration, line and board of the run."""
    asked = result["configuration"]
    extras = [f"spin {asked['spin_us']} µs"] if asked["spin_us"] else []
    extras += ["fixed priority asked"] if asked["realtime"] else []
    return "; ".join(
        [
            f"{asked['rate_hz']:g} Hz for {asked['seconds']:g} s at "
            f"{asked['baudrate']} baud, on {result['board']}",
            *extras,
        ]
    )


def bench_outcome(result: Result) -> tuple[str, str]:
    """Return tone and sentence of a run: what reached the output late, else what ran late."""
    frames = result["frames"]
    due = frames["due"]
    if not result["stages"]["latch"]["n"] and not result["stages"]["margin"]["n"]:
        return "plain", "nobody saw what reached the output"
    missed = frames["late"] + due - frames["latched"]
    if missed:
        tone = "bad" if missed >= _NOTABLE_SHARE * due else "doubt"
        return tone, f"{missed} of {due} frames were late or lost at the output"
    misses = (miss for found in result["misses"].values() for miss in found)
    worst = max(misses, key=lambda miss: (miss["limit_us"], miss["count"]))
    if worst["count"] >= _NOTABLE_SHARE * due:
        late = f"{worst['count']} of {due} came later than {worst['limit_us']:g} µs"
        return "doubt", f"every frame was in time at the output, by its lead: {late}"
    return "good", "every frame was in time at the output"


def _bench_frames_text(result: Result) -> str:
    """Return the counts of frames due and latched, and the losses of the port."""
    frames = result["frames"]
    return (
        f"{frames['due']} frames due, {frames['skipped']} skipped, {frames['latched']} latched; "
        f"lead {frames['lead_us'] / 1000:g} ms, moved {frames['lead_moves']} times; "
        f"{frames['write_stalls']} stalls of the port"
    )


def _bench_stages_rows(result: Result) -> Iterator[tuple[str, ...]]:
    """Yield the percentiles (µs) of each stage, under :data:`_STAGE_HEAD`; blank if unmeasured."""
    for name, meaning in STAGES.items():
        found = result["stages"][name]
        if found["n"]:
            values = (*found["levels"].values(), found["max"])
            yield name, *(f"{value:.1f}" for value in values), str(found["n"]), meaning
        else:
            yield name, *("" for _ in LEVELS), "", "0", f"{meaning}: not observed"


def _bench_clocks_text(result: Result) -> str:
    """Return a text on the clock error, and on the definition of lateness."""
    return (
        "The stages board, complete and margin join two clocks, to within "
        f"{result['clock_uncertainty_us']:.0f} µs. Percentiles are of all frames, from the "
        "intended time."
    )


def _bench_misses_rows(result: Result) -> Iterator[tuple[str, ...]]:
    """Yield a row for each limit of lateness (µs), at port and at board: late frames and causes.

    The last cell counts those for which the control loop stalled too.
    """
    for place, found in result["misses"].items():
        for miss in found:
            causes = (f"{cause} {n}" for cause, n in miss["by_cause"].items() if n)
            yield (
                f"{miss['limit_us']:g} µs",
                _PLACES[place],
                f"{miss['count']} of {miss['n']}",
                ", ".join(causes),
                str(miss["control_stalled_too"]),
            )


def _bench_machine_rows(result: Result) -> Iterator[str]:
    """Yield lines on processor and system of the machine and, if known, the processors' load."""
    found = result["environment"]
    yield (
        f"{found['cpu']}, {found['cpus_usable']} of {found['cpus']} processors, "
        f"{found['virtualisation'] or 'virtualisation unknown'}, "
        f"governor {found['governor'] or 'unknown'}"
    )
    system = [found["kernel"], found["preemption"]]
    load = found["load_1_min"]
    yield ", ".join(
        [
            " ".join(filter(None, system)),
            f"clock {found['clock_source']}",
            found["python"],
            *([] if load is None else [f"load {load:.2f}"]),
        ]
    )
    shares = ", ".join(f"{name} {100 * v:.1f} %" for name, v in result["processors"].items())
    if shares:
        yield f"processors during the run: {shares}"


_BINS: Final = np.geomspace(0.1, 1e6, 141)  # borders of the histogram, in microseconds
_SHOWN: Final = (
    ("wake", "wake, from the intended time", style.BLUE),
    ("work", "encode and write", style.ORANGE),
    ("board", "complete at the board, after the line", style.GREEN),
    ("complete", "all of it, from the intended time", style.VERMILION),
    ("control", "control loop beside it", style.BLACK),
)


def draw_bench_histograms(stages_us: Mapping[str, NDArray[np.float64]]) -> Figure:
    """Draw a histogram of the duration of each stage, both axes logarithmic to show the tail.

    Lines mark the limits from which on a frame counts as late.
    """
    with style.new_figure(8.0, 4.8) as figure:
        axes = figure.add_subplot()
        for name, label, colour in _SHOWN:
            values = stages_us[name][~np.isnan(stages_us[name])]
            if len(values):
                width = 1.0 if name == "control" else 1.6
                axes.hist(
                    np.clip(values, _BINS[0], _BINS[-1]),
                    _BINS.tolist(),
                    histtype="step",
                    color=colour,
                    linewidth=width,
                    label=f"{label} (n = {len(values)})",
                )
        axes.set(xscale="log", yscale="log", xlabel="time (µs)", ylabel="frames")
        for axis in (axes.xaxis, axes.yaxis):
            axis.set_major_formatter("{x:g}")
        most = max(np.nanmax(stages_us[name], initial=0.0) for name, *_ in _SHOWN)
        axes.set_xlim(_BINS[0] / 1.5, min(_BINS[-1], 3.0 * max(most, *MISS_LIMITS_US)))
        for limit_us in MISS_LIMITS_US:
            name = "limits of the miss counts"
            axes.axvline(limit_us, color=style.GREY, linewidth=1.0, linestyle="--", label=name)
        style.figure_legend(figure, columns=2)
    return figure
