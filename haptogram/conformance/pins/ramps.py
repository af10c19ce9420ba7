"""Ramps to silence: the amplitude that each pin has on its way to the end of the output."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from haptogram.acoustics.arrays import FloatArray
from haptogram.verification.pins.run_drives import fundamentals_of_run_drives
from haptogram_protocol import messages as m
from haptogram_protocol.state import MuteReason

from .configurations import ConfigurationsByPins
from .dialogue import PinDialogue
from .findings import PinClauseFindings, names_of_pins, time_by_pins
from .reported_drives import DrivesOfPinDialogue

#: Timers whose ramps are judged: during that of an unattended playback latches go on.
_TIMERS: Final = (MuteReason.HOLD_EXPIRED, MuteReason.HOST_SILENT)
_BEFORE: Final = 20.0  # periods of full output before a ramp
_FULL: Final = 255.0
_STEP: Final = 1.0 / _FULL
_PULSE: Final = 2.0  # periods beside a new ceiling: a pulse meanwhile has neither width
_LAG_MS: Final = 1.0  # HG-6.11/2: the line at this moment, or up to so long before
_TIMER_MS: Final = 1.0  # HG-12.1/1
_SAMPLES: Final = 2.0


def judge_ramp_clauses(dialogue: PinDialogue, findings: PinClauseFindings) -> None:
    """Judge the ramp before every silence that a timer made."""
    if dialogue.missing:
        return
    if not any(reply.features & m.Feature.AMPLITUDE for _, reply in dialogue.said(m.HelloReply)):
        return
    configs = ConfigurationsByPins(dialogue, DrivesOfPinDialogue(dialogue))
    per_ms = dialogue.record.carrier_hz * 1e-3
    for frame, changed in dialogue.said(m.StateChanged):
        end = dialogue.capture_time(frame)
        if changed.reason not in _TIMERS or end is None:
            continue
        found = configs.of_ramp(end, per_ms)
        if found is None:
            findings.missing["HG-6.11/2"] = "which configuration a ramp began with is not known"
            continue
        if not found[0].ramp_ms:
            continue
        _, begin = found
        # A latch meanwhile changes the amplitude that the ramp is of.
        since = begin - _BEFORE - 2.0 * _TIMER_MS * per_ms
        source = min(dialogue.next_source(since), dialogue.next_unread(since))
        if since > 0.0 and source > end and not dialogue.is_due(since, end):
            _judge_ramp_clause(dialogue, begin, end, configs.set_between(begin, end), findings)


def _judge_ramp_clause(
    dialogue: PinDialogue,
    begin: float,
    end: float,
    changes: Sequence[tuple[float, float, int | None]],
    findings: PinClauseFindings,
) -> None:
    """Judge that amplitudes fall along a straight line to 0 from *begin* to *end*, and never rise.

    *changes* has the ceiling set meanwhile: (time asked for, time in force, ceiling; None if
    unknown). Times are in carrier periods. A pin whose drive before was not steady is left out.
    """
    record = dialogue.record
    per_ms = record.carrier_hz * 1e-3
    louder, off_line, seen = [], [], 0
    for element, pin in record.pins.items():
        centres, vectors = fundamentals_of_run_drives(pin)
        lead = 2.0 * _TIMER_MS * per_ms
        low, first, high = np.searchsorted(centres, [begin - lead - _BEFORE, begin - lead, end])
        sizes = np.abs(vectors)
        if first - low < _BEFORE / 2.0 or np.ptp(sizes[low:first]) > 2.0 * _STEP:
            continue
        full = float(sizes[low:first].mean())
        if full < 4.0 * _STEP:
            continue
        seen += 1
        times, fading = centres[first:high], sizes[first:high].astype(np.float64)
        # The amplitude of a pulse is known to a sample of its width.
        error = _SAMPLES * math.pi / record.samples * np.sqrt(1.0 - np.minimum(fading, 1.0) ** 2)
        error += _SAMPLES * (math.pi / record.samples) ** 2 + _STEP
        within = dialogue.within(end)
        lag, timer = (_LAG_MS + _TIMER_MS) * per_ms + within, _TIMER_MS * per_ms + within
        upper = full * _ramp_left_by_clause(times - lag, begin, end)
        lower = full * _ramp_left_by_clause(times + timer, begin, end)
        most, least = np.full_like(upper, np.inf), np.full_like(upper, np.inf)
        for asked, set_at, ceiling in changes:  # the ceiling in force cuts the line off
            cut = math.nan if ceiling is None else ceiling / _FULL
            asking, is_set = times >= asked - _PULSE, times >= set_at + _PULSE
            least[asking] = np.fmin(least, np.nan_to_num(cut))[asking]
            most[asking] = np.maximum(most, np.nan_to_num(cut, nan=np.inf))[asking]
            if ceiling is not None:
                most[is_set] = least[is_set] = cut
        upper, lower = np.minimum(upper, most) + error, np.minimum(lower, least) - error
        if (fading > upper).any() or (not changes and _ramp_rises(fading, error)):
            louder.append(element)
        if ((fading > upper) | (fading < lower)).any():
            off_line.append(element)
    if not seen:
        return
    where = f"in the ramp that ends {time_by_pins(record, end)}"
    names = names_of_pins(record, louder) if louder else ""
    wrong = sorted({*louder, *off_line})
    findings.add("HG-6.11/1", f"{names} get louder {where}" if louder else "")
    names = names_of_pins(record, off_line) if off_line else ""
    text = f"{names} leave the straight line to 0 {where}"
    findings.add("HG-6.11/2", text if off_line else "")
    if changes:
        text = f"{names_of_pins(record, wrong)} do not keep what the ramp began with, {where}"
        findings.add("HG-6.11/6", text if wrong else "")


def _ramp_left_by_clause(times: FloatArray, begin: float, end: float) -> FloatArray:
    """Return the share, 1 to 0, that the straight line from *begin* to *end* leaves at *times*."""
    left: FloatArray = np.clip((end - times) / (end - begin), 0.0, 1.0)
    return left


def _ramp_rises(sizes: FloatArray, error: FloatArray) -> bool:
    """Return True if a size is above an earlier one by more than the *error* of both."""
    least = np.minimum.accumulate(sizes + error)
    return bool((sizes - error > least).any())
