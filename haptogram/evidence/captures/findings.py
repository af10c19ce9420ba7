"""Findings of a capture by itself: what is wrong, whatever the frames were meant to be."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, Final

import numpy as np

from haptogram.records.pins import PinRecord
from haptogram.verification.pins.elements.faults import grouped_pin_faults
from haptogram.verification.pins.elements.levels import levels_of_pins_in_time
from haptogram.verification.pins.held.drives import HeldDrives, PinLatch

from .capture import Capture

_US: Final = 1e6
_NS: Final = 1e9


def findings_of_capture(found: HeldDrives) -> list[str]:
    """Return the defects in a capture, one line for all pins that have the same."""
    record = found.record
    faults = []
    for element, pin in record.pins.items():
        left_out = [_pulses_left_out_text(pin.every, record)] if pin.every > 1 else []
        faults += [(element, pin.channel, text) for text in (*pin.defects, *left_out)]
    lines = list(grouped_pin_faults(faults))
    for number, latch in enumerate(found.latches):
        if latch.is_torn:
            lines.append(f"latch {number} is torn: {_torn_capture_text(found, latch)}")
    return lines


def _pulses_left_out_text(every: int, record: PinRecord) -> str:
    """Return the finding that pins pulse in one of *every* carrier periods only."""
    hz = 1.0 / record.period_s
    return f"{hz / every:.0f} Hz: a pulse in every {every} periods of the carrier of {hz:.0f} Hz"


def _torn_capture_text(found: HeldDrives, latch: PinLatch) -> str:
    """Return the text that channels latched late: which, and how many µs after the first."""
    pins = [found.record.pins[element] for element in found.elements]
    late = [pins[place].channel for place in latch.places[latch.late]]
    shown = ", ".join(late[:4]) + (", ..." if len(late) > 4 else "")
    us = found.record.period_s * _US
    return (
        f"{len(late)} of {len(latch.places)} channels ({shown}) {latch.skew * us:.1f} µs later "
        f"than the first, may be {us:.1f} µs"
    )


def notes_of_capture(found: HeldDrives) -> list[str]:
    """Return the limits of the capture, one line each."""
    record = found.record
    notes = list(record.notes)
    if record.cut:
        notes.append(f"cut off: {record.cut}; read up to {record.duration_s:g} s")
    notes += [record.coarse_note] if record.coarse_note else []
    if record.carrier is not None and not record.carrier.is_steady:
        held = float((found.ends - found.begins).sum()) / max(record.end, 1.0)
        notes.append(
            f"the carrier is not steady: periods of {record.carrier.shortest_s * _US:.2f} to "
            f"{record.carrier.longest_s * _US:.2f} µs; what moves with it is no latch, and pins "
            f"hold a drive {100.0 * held:.0f} % of the time"
        )
    levels = levels_of_pins_in_time(record)
    if levels is not None and levels.text:
        notes.append(f"amplitude {levels.text}")
    return notes


def summary_of_capture(found: HeldDrives, capture: Capture) -> list[str]:
    """Return the capture, its resolution and its carrier in lines of text."""
    record = found.record
    rate = f"{record.sample_rate_hz / 1e6:.6g} Msamples/s"
    if capture.stated_rate_hz is None:
        rate += " (estimated from its edges, or of the map)"
    reference = "a carrier clock"
    if record.reference_element is not None:
        reference = f"element {record.reference_element}"
    jitter_ns = 0.0 if record.carrier is None else record.carrier.jitter_s * _NS
    return [
        f"{record.name}: {record.duration_s * 1e3:.6g} ms, {capture.edges} edges of "
        f"{len(found.elements)} elements, {rate}",
        f"smallest phase error that shows: {360.0 / record.samples:.2g} degrees "
        f"({record.samples:.4g} samples a period); phases are relative to {reference}",
        f"carrier: {1.0 / record.period_s:.2f} Hz, {record.drift_ppm:+.1f} ppm of "
        f"{record.carrier_hz:g} Hz on the analyser's clock, jitter {jitter_ns:.0f} ns",
    ]


def capture_element_rows(found: HeldDrives) -> Iterator[dict[str, Any]]:
    """Yield the drives of each pin for JSON; phases are in degrees, null: no pulse."""
    us = found.record.period_s * _US
    for place, element in enumerate(found.elements):
        pin, weights = found.record.pins[element], found.weights[:, place]
        jitters = np.where(weights != 0, found.jitters[:, place], np.nan)
        yield {
            "channel": pin.channel,
            "element": element,
            "edges": pin.edges,
            "phase_deg": _listed_capture_findings(np.degrees(np.angle(weights)), weights != 0),
            "amplitude": _listed_capture_findings(np.abs(weights)),
            "duty": _listed_capture_findings(found.duties[:, place]),
            "period_us": _listed_capture_findings(found.lengths[:, place] * us),
            "jitter_ns": _listed_capture_findings(jitters * us * 1e3),
        }


def capture_latch_rows(found: HeldDrives) -> Iterator[dict[str, Any]]:
    """Yield the latches for JSON: time, channels that changed, and whether all did together."""
    us = found.record.period_s * _US
    times_s = found.record.seconds(np.array([latch.begin for latch in found.latches]))
    for number, latch in enumerate(found.latches):
        yield {
            "t_us": float(times_s[number]) * _US,
            "channels": len(latch.places),
            "skew_us": latch.skew * us,
            "torn": latch.is_torn,
            "silent": found.is_silent(number + 1),
        }


def capture_document(found: HeldDrives, findings: list[str]) -> dict[str, Any]:
    """Return the whole measurement for JSON."""
    record = found.record
    return {
        "file": record.name,
        "duration_s": record.duration_s,
        "cut": record.cut or None,
        "sample_rate_hz": record.sample_rate_hz,
        "smallest_phase_error_deg": math.degrees(math.tau / record.samples),
        "carrier_hz": 1.0 / record.period_s,
        "carrier_drift_ppm": record.drift_ppm,
        "carrier_jitter_ns": 0.0 if record.carrier is None else record.carrier.jitter_s * _NS,
        "reference_element": record.reference_element,
        "latches": list(capture_latch_rows(found)),
        "elements": list(capture_element_rows(found)),
        "findings": findings,
        "notes": notes_of_capture(found),
    }


def _listed_capture_findings(values: Any, is_known: Any = True) -> list[float | None]:
    """Return an array as a JSON list, rounded to 6 digits behind the point.

    None stands where a value is not finite, or where the mask *is_known* is False.
    """
    known = np.isfinite(values) & is_known
    pairs = zip(values.tolist(), known.tolist(), strict=True)
    return [round(value, 6) if ok else None for value, ok in pairs]
