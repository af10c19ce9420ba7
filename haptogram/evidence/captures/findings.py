"""Findings of a capture by itself: what is wrong, whatever the frames were meant to be."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np

from .changes import LatchFound
from .measure import CaptureDrives, ElementDrives, least_capture_rate_hz

_FULL_DUTY: Final = 0.5
_PHASE_BITS: Final = 8


def capture_findings(found: ElementDrives, *, active_low: bool, others_pulse: bool) -> list[str]:
    """Return the defects of the pin of one element, in words; none: it may be right."""
    wrong = []
    if found.edges == 0 and others_pulse:
        level = "high" if found.idle_level else "low"
        is_driven = found.idle_level is not active_low
        wrong.append(f"stuck {level}" if is_driven else f"dead: {level} all the time")
    elif found.idle_level is not None and found.idle_level is not active_low:
        level = "high" if found.idle_level else "low"
        wrong.append(f"{level} while it is silent: inverted polarity")
    elif np.nanmax(found.duties, initial=0.0) > _FULL_DUTY + 0.1:
        wrong.append(f"duty of {np.nanmax(found.duties):.2f}: inverted polarity")
    return wrong


def findings_of_capture(found: CaptureDrives, *, active_low: bool = False) -> list[str]:
    """Return the defects in a capture, one line each."""
    others = any(row.edges for row in found.elements)
    lines = []
    for row in found.elements:
        words = capture_findings(row, active_low=active_low, others_pulse=others)
        if row.channel in found.restless:
            words.append("pulses that differ all the time, which show no latch")
        if row.edges and (undefined := found.capture.channel(row.channel).undefined):
            words.append(f"{undefined} times undefined (x or z)")
        lines += [f"element {row.element} ({row.channel}): {text}" for text in words]
    for number, latch in enumerate(found.latches):
        if found.is_torn(latch):
            lines.append(f"latch {number} is torn: {_torn_capture_text(found, latch)}")
    return lines


def _torn_capture_text(found: CaptureDrives, latch: LatchFound) -> str:
    late = [c.channel for c in latch.changes if c.after > latch.begin + found.period]
    shown = ", ".join(late[:4]) + (", ..." if len(late) > 4 else "")
    return (
        f"{len(late)} of {len(latch.changes)} channels ({shown}) "
        f"{found.seconds(latch.skew) * 1e6:.1f} µs later than the first, "
        f"may be {found.seconds(found.period) * 1e6:.1f} µs"
    )


def notes_of_capture(found: CaptureDrives) -> list[str]:
    """Return the limits of the capture, one line each."""
    notes = []
    if found.capture.cut:
        at = f"read up to {found.capture.duration_s:g} s"
        notes.append(f"cut off: {found.capture.cut}; {at}")
    needed_hz = least_capture_rate_hz(found.carrier_hz, _PHASE_BITS)
    if found.sample_rate_hz < needed_hz * 0.999:
        notes.append(
            f"{found.sample_rate_hz / 1e6:g} Msamples/s cannot show an error of one step of "
            f"{_PHASE_BITS} bits; {needed_hz / 1e6:g} Msamples/s can"
        )
    return notes


def summary_of_capture(found: CaptureDrives) -> list[str]:
    """Return the capture, its resolution and its carrier in lines of text."""
    capture = found.capture
    rate = f"{found.sample_rate_hz / 1e6:.6g} Msamples/s"
    if capture.stated_rate_hz is None:
        rate += " (estimated from its edges, or of the map)"
    degrees = math.degrees(found.resolution_rad)
    reference = "a carrier clock"
    if found.reference_element is not None:
        reference = f"element {found.reference_element}"
    return [
        f"{capture.path}: {capture.duration_s * 1e3:.6g} ms, {capture.edges} edges of "
        f"{len(found.elements)} elements, {rate}",
        f"smallest phase error that shows: {degrees:.2g} degrees ({found.samples:.4g} samples "
        f"a period); phases are relative to {reference}",
        f"carrier: {1.0 / found.seconds(found.period):.2f} Hz, {found.drift_ppm:+.1f} ppm of "
        f"{found.carrier_hz:g} Hz on the analyser's clock",
    ]


def capture_document(found: CaptureDrives, findings: list[str]) -> dict[str, Any]:
    """Return the whole measurement for JSON; phases are in degrees, null: no pulse."""
    rows = [
        {
            "channel": row.channel,
            "element": row.element,
            "edges": row.edges,
            "phase_deg": _listed_capture_findings(
                np.degrees(np.angle(row.weights)), row.weights != 0
            ),
            "amplitude": _listed_capture_findings(np.abs(row.weights)),
            "duty": _listed_capture_findings(row.duties),
            "period_us": _listed_capture_findings(row.periods_s * 1e6),
            "jitter_ns": _listed_capture_findings(row.jitters_s * 1e9),
        }
        for row in found.elements
    ]
    latches = [
        {
            "t_us": found.seconds(latch.begin) * 1e6,
            "channels": len(latch.changes),
            "skew_us": found.seconds(latch.skew) * 1e6,
            "torn": found.is_torn(latch),
            "silent": is_capture_silent_after(found, number),
        }
        for number, latch in enumerate(found.latches)
    ]
    return {
        "file": str(found.capture.path),
        "duration_s": found.capture.duration_s,
        "cut": found.capture.cut or None,
        "sample_rate_hz": found.sample_rate_hz,
        "smallest_phase_error_deg": math.degrees(found.resolution_rad),
        "carrier_hz": 1.0 / found.seconds(found.period),
        "carrier_drift_ppm": found.drift_ppm,
        "reference_element": found.reference_element,
        "latches": latches,
        "elements": rows,
        "findings": findings,
        "notes": notes_of_capture(found),
    }


def is_capture_silent_after(found: CaptureDrives, latch: int) -> bool:
    """Return True if no element has a pulse after the latch with this number."""
    return all(row.weights[latch + 1] == 0 for row in found.elements)


def _listed_capture_findings(values: Any, is_known: Any = True) -> list[float | None]:
    known = np.isfinite(values) & is_known
    pairs = zip(values.tolist(), known.tolist(), strict=True)
    return [round(value, 6) if ok else None for value, ok in pairs]
