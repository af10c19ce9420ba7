"""Frames in words and figures, for people: every number with its unit."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from typing import Any

from haptogram.verification import (
    FrameStatus,
    FrameVerdict,
    Verdict,
    verdict_consequence_text,
    verdict_pressure_text,
)

NOTHING = "–"


def run_figure_wording(value: float | None, digits: int = 3) -> str:
    """Return *value* with *digits* decimals; a dash if there is none."""
    return NOTHING if value is None else f"{value:.{digits}f}"


def run_count_wording(number: int, noun: str) -> str:
    """Return "1 frame", "2 frames"."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def run_frame_wording(frame: FrameVerdict) -> str:
    """Return number and time of a frame, its faults and their consequence, in one line."""
    return "; ".join(
        [
            f"frame {frame.number} {_run_frame_time_wording(frame)}: {frame.status}",
            *_run_frame_findings_wording(frame),
        ]
    )


def _run_frame_time_wording(frame: FrameVerdict) -> str:
    place = f"(sequence {frame.key.sequence}, loop {frame.key.loop}, index {frame.key.index})"
    if frame.key.sequence == 0:
        place = f"(stream index {frame.key.index})"
    due = "as soon as complete" if frame.t_apply_us is None else f"due at {frame.t_apply_us} µs"
    return f"{place}, {due}"


def _run_frame_findings_wording(frame: FrameVerdict) -> Iterator[str]:
    if (frame.late or frame.early) and frame.lateness_us is not None:
        yield f"latched {run_timeliness_wording(frame)}"
    if frame.latches > 1:
        yield f"latched {frame.latches} times"
    yield from frame.faults
    failed = [name for name, passed in frame.criteria.items() if not passed]
    if failed:
        yield f"{', '.join(failed)} failed"
    if frame.status is not FrameStatus.ON_TARGET and frame.lateral_error_mm is not None:
        yield f"focus {run_focus_place_wording(frame)}"
    if (pressure := verdict_pressure_text(frame)) is not None:
        yield pressure
    if frame.consequence is not None:
        yield verdict_consequence_text(frame.consequence)
    if frame.note:
        yield frame.note


def run_timeliness_wording(frame: FrameVerdict) -> str:
    """Return the time by which a frame was latched early or late."""
    if frame.lateness_us is None:
        return NOTHING
    return f"{abs(frame.lateness_us)} µs {'early' if frame.lateness_us < 0 else 'late'}"


def run_focus_place_wording(frame: FrameVerdict) -> str:
    """Return the distance of the focus from its target."""
    if frame.lateral_error_mm is None:
        return NOTHING
    axial = frame.axial_error_mm
    along = "" if axial is None else f", {axial:+.3f} mm along the beam"
    return f"{frame.lateral_error_mm:.3f} mm across{along}"


def run_faults_wording(result: Mapping[str, Any]) -> Iterator[str]:
    """Yield the planned faults that fired, the host's own delay, and the damage on the line."""
    if "faults" in result:
        yield f"faults on purpose: {_run_fired_faults_wording(result['faults'])}"
    if (delay := run_host_delay_text(result)) is not None:
        yield f"host: {delay}"
    if (remedy := run_remedy_text(result)) is not None:
        yield f"to do: {remedy}"
    sides = [
        f"the {side} counted " + ", ".join(f"{name} {number}" for name, number in counts.items())
        for side, counts in result["troubles"].items()
    ]
    if sides:
        yield f"line: {'; '.join(sides)} (SPEC.md 9.2)"


def run_host_delay_text(result: Mapping[str, Any]) -> str | None:
    """Return the number of frames that host and machine held up, by cause; None: none."""
    held_up = [f for f in result["not_on_target"] if f["status"] == FrameStatus.HELD_UP]
    if not held_up:
        return None
    known = Counter(frame["faults"][0] for frame in held_up)
    causes = "; ".join(f"{run_count_wording(n, 'frame')}: {why}" for why, n in known.items())
    host = result.get("host")
    loop = f", its loop by up to {host['tick_lateness_us_max'] / 1e3:.0f} ms" if host else ""
    return f"this machine, not the board, was held up{loop} ({causes})"


def run_remedy_text(result: Mapping[str, Any]) -> str | None:
    """Return the remedy for a run that a busy machine left inconclusive, or None."""
    if result["verdict"] != str(Verdict.INCONCLUSIVE) or "faults" in result:
        return None
    is_virtual = result["configuration"].get("port", "") is None
    if run_host_delay_text(result) is None or "host" not in result:
        return None
    text = (
        "run it again while this machine has less to do, with a longer --lead-ms or at a lower "
        "--rate-hz"
    )
    return f"{text}; with --virtual-time its load does not count" if is_virtual else text


def _run_fired_faults_wording(faults: Mapping[str, Any]) -> str:
    if faults["fired"] is None:
        return f"{', '.join(faults['plan'])}; the board did not report how often each fired"
    times = (
        f"{name} {run_count_wording(number, 'time')}" for name, number in faults["fired"].items()
    )
    return f"{', '.join(times)}; seed {faults['seed']}"
