"""The result of one benchmark in words and rows, for the page and for the terminal alike."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Final

from haptogram.campaigns.bench.percentiles import LEVELS
from haptogram.campaigns.bench.result import STAGES

Result = Mapping[str, Any]

STAGE_HEAD: Final = ("stage (µs)", *(f"p{level:g}" for level in LEVELS), "max", "n", "meaning")
MISS_HEAD: Final = ("later than", "measured", "frames", "causes", "control loop stalled too")

_NOTABLE_SHARE: Final = 0.01  # of all frames
_PLACES: Final = {"at_port": "at the port", "at_board": "complete at the board"}


def bench_conditions_rows(result: Result) -> str:
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
    due = result["frames"]["due"]
    if not result["stages"]["latch"]["n"] and not result["stages"]["margin"]["n"]:
        return "plain", "nobody saw what reached the output"
    missed = max(result["focus_error"]["frames"], due - result["frames"]["latched"])
    if missed:
        tone = "bad" if missed >= _NOTABLE_SHARE * due else "doubt"
        return tone, f"{missed} of {due} frames were late or lost at the output"
    misses = (miss for found in result["misses"].values() for miss in found)
    worst = max(misses, key=lambda miss: (miss["limit_us"], miss["count"]))
    if worst["count"] >= _NOTABLE_SHARE * due:
        late = f"{worst['count']} of {due} came later than {worst['limit_us']:g} µs"
        return "doubt", f"every frame was in time at the output, by its lead: {late}"
    return "good", "every frame was in time at the output"


def bench_frames_rows(result: Result) -> str:
    """Return the counts of frames due and latched, and the losses of the port."""
    frames = result["frames"]
    return (
        f"{frames['due']} frames due, {frames['skipped']} skipped, {frames['latched']} latched; "
        f"lead {frames['lead_us'] / 1000:g} ms, moved {frames['lead_moves']} times; "
        f"{frames['write_stalls']} stalls of the port"
    )


def bench_stages_rows(result: Result) -> Iterator[tuple[str, ...]]:
    """Yield the percentiles of each stage, under :data:`STAGE_HEAD`."""
    for name, meaning in STAGES.items():
        found = result["stages"][name]
        if found["n"]:
            values = (*found["levels"].values(), found["max"])
            yield name, *(f"{value:.1f}" for value in values), str(found["n"]), meaning
        else:
            yield name, *("" for _ in LEVELS), "", "0", f"{meaning}: not observed"


def bench_clocks_rows(result: Result) -> str:
    """Return the error between the two clocks, and the quantity that the percentiles count."""
    return (
        "The stages board, complete and margin join two clocks, to within "
        f"{result['clock_uncertainty_us']:.0f} µs. Percentiles are of all frames, from the "
        "intended time."
    )


def bench_misses_rows(result: Result) -> Iterator[tuple[str, ...]]:
    """Yield the number of late frames at each place, by cause, under :data:`MISS_HEAD`."""
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


def bench_space_rows(result: Result) -> str:
    """Return the effect of late and lost frames on the focus."""
    error = result["focus_error"]
    if not error["frames"]:
        return "No frame reached the output late: the focus was always the one due."
    return (
        f"For {error['frames']} frames the old focus was held, {error['held_us'] / 1000:.1f} ms "
        f"in all, {error['mean_mm']:.2f} mm from the one due on average, {error['max_mm']:.2f} mm "
        f"at most; {error['run_mean_mm']:.4f} mm on average over the run."
    )


def bench_machine_rows(result: Result) -> Iterator[str]:
    """Yield processor, system and load of the machine."""
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
