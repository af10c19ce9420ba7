"""A run as text."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from haptogram.campaigns.bench.percentiles import Percentiles, heading
from haptogram.campaigns.bench.result import STAGES

_PLACES = {"at_port": "at the port", "at_board": "complete at the board"}


def as_text(result: Mapping[str, Any]) -> str:
    """Return what *result* says, for people."""
    parts = (_head(result), _stages(result), _misses(result), _space(result), _machine(result))
    return "\n\n".join(parts)


def _head(result: Mapping[str, Any]) -> str:
    asked, frames = result["configuration"], result["frames"]
    extras = [f"spin {asked['spin_us']} us"] if asked["spin_us"] else []
    extras += ["fixed priority asked"] if asked["realtime"] else []
    return (
        f"{asked['rate_hz']:g} Hz for {asked['seconds']:g} s, {asked['phase_bits']} bit at "
        f"{asked['baudrate']} baud, on {result['board']}\n"
        f"  {frames['due']} frames due, {frames['skipped']} skipped, {frames['latched']} latched; "
        f"lead {frames['lead_us'] / 1000:g} ms, moved {frames['lead_moves']} times; "
        f"{frames['write_stalls']} stalls of the port" + "".join(f"; {extra}" for extra in extras)
    )


def _stages(result: Mapping[str, Any]) -> str:
    rows = [f"{'us':<11}{heading()}"]
    for name, meaning in STAGES.items():
        found = Percentiles.from_dict(result["stages"][name])
        rows.append(f"{name:<11}{found!s:<60}  {meaning}")
    rows.append(
        f"board, complete and margin join two clocks: +- {result['clock_uncertainty_us']:.0f} us; "
        "percentiles are of all frames, from the intended time"
    )
    return "\n".join(rows)


def _misses(result: Mapping[str, Any]) -> str:
    rows = []
    for place, misses in result["misses"].items():
        for miss in misses:
            causes = ", ".join(f"{cause} {n}" for cause, n in miss["by_cause"].items() if n)
            shared = miss["control_stalled_too"]
            beside = f"; in {shared} of them the control loop was stalled too" if shared else ""
            rows.append(
                f"later than {miss['limit_us']:g} us {_PLACES[place]}: {miss['count']} of "
                f"{miss['n']}{': ' if causes else ''}{causes}{beside}"
            )
    return "\n".join(rows)


def _space(result: Mapping[str, Any]) -> str:
    error = result["focus_error"]
    if not error["frames"]:
        return "in space: no frame reached the output late, the focus was always the one due"
    return (
        f"in space: for {error['frames']} frames the old focus was held, "
        f"{error['held_us'] / 1000:.1f} ms in all, {error['mean_mm']:.2f} mm from the one due on "
        f"average, {error['max_mm']:.2f} mm at most; {error['run_mean_mm']:.4f} mm over the run"
    )


def _machine(result: Mapping[str, Any]) -> str:
    found = result["environment"]
    shares = ", ".join(f"{name} {100 * v:.1f} %" for name, v in result["processors"].items())
    lines = [
        f"{found['cpu']}, {found['cpus_usable']} of {found['cpus']} processors, "
        f"{found['virtualisation'] or 'virtualisation unknown'}, "
        f"governor {found['governor'] or 'unknown'}",
        f"{found['kernel']} {found['preemption'] or ''}, clock {found['clock_source']}, "
        f"{found['python']}, load {found['load_1_min']:.2f}"
        if found["load_1_min"] is not None
        else f"{found['kernel']}, {found['python']}",
    ]
    lines += [f"processors during the run: {shares}"] if shares else []
    return "\n".join(lines + [f"warning: {warning}" for warning in result["warnings"]])
