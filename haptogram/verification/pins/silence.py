"""The end of a run at the pins: when each falls silent, at once or by a ramp."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from haptogram.records.pins import PinRecord

from .line_frames import mute_on_captured_line
from .run_drives import PinRunDrives, fundamentals_of_run_drives
from .shown_frames import FramesShownByPins

_SILENT_PERIODS: Final = 2.5  # periods without a pulse after which a pin is silent
_FADED: Final = 0.9  # least amplitude before the end, relative to full: a fainter pin is on a ramp
_MUTE_SAMPLES: Final = 2.0  # tolerance of two edges, or of an edge and the last bit of MUTE
_FAINT: Final = 4.0  # samples of a pulse: a shorter one may be taken for a disturbance
_FAINT_PERIODS: Final = 0.008
_LAST_PULSES: Final = 3  # pulses; the last one may have been cut


@dataclass(frozen=True, slots=True)
class EndOfSound:
    """The verdict on the end of the output.

    Attributes
    ----------
    findings : tuple of str
        Findings about the silence.
    not_judged : str
        Why the end cannot be judged; empty: it was.
    spread_periods : float or None
        Time that lies between the silence of the first pin and that of the last, at least.
    after_mute_periods : float or None
        From the arrival of MUTE to the last pulse that began; None: MUTE was not captured.
    """

    findings: tuple[str, ...] = ()
    not_judged: str = ""
    spread_periods: float | None = None
    after_mute_periods: float | None = None


@dataclass(frozen=True, slots=True)
class PinStops:
    """The ends of the pins that sounded in the last frame; times in periods.

    Attributes
    ----------
    stops : dict of int to float
        By element: the end of its last pulse before a silence.
    rises : dict of int to float
        By element: the begin of that pulse.
    sounding : tuple of int
        Elements that sound up to the end of the capture.
    faded : int
        Elements whose pulses had become narrower.
    """

    stops: dict[int, float]
    rises: dict[int, float]
    sounding: tuple[int, ...]
    faded: int

    @property
    def is_ramp(self) -> bool:
        """True if most pins faded."""
        return 2 * self.faded > len(self.stops)


def pin_stops(record: PinRecord, run: PinRunDrives, shown: FramesShownByPins) -> PinStops | None:
    """Return the ends of the pins after the last frame of the run; None: it is not seen."""
    frames = np.flatnonzero(shown.seen)
    if not len(frames) or shown.ends[-1] > record.end + run.gap:
        return None
    last = frames[-1]
    sizes = np.abs(shown.drives.weights[last])
    faint = math.sin(math.pi * max(_FAINT / record.samples, _FAINT_PERIODS))
    stops, rises, sounding, faded = {}, {}, [], 0
    for place, element in enumerate(run.elements):
        pin = record.pins[element]
        first = int(np.searchsorted(pin.rises, shown.starts[last]))
        if sizes[place] <= max(shown.drives.limit_amplitude, faint) or first >= len(pin.rises):
            continue
        silences = np.flatnonzero(np.diff(pin.rises[first:]) > _SILENT_PERIODS)
        end = first + int(silences[0]) if len(silences) else len(pin.rises) - 1
        stops[element], rises[element] = float(pin.falls[end]), float(pin.rises[end])
        if not len(silences) and stops[element] > record.end - _SILENT_PERIODS:
            sounding.append(element)
        _, vectors = fundamentals_of_run_drives(pin)
        before = np.abs(vectors[max(first, end - _LAST_PULSES) : end])
        if len(before) and before.mean() < _FADED * sizes[place] - shown.drives.limit_amplitude:
            faded += 1
    return PinStops(stops, rises, tuple(sounding), faded)


def end_of_sound_on_pins(
    record: PinRecord, run: PinRunDrives, shown: FramesShownByPins
) -> EndOfSound:
    """Judge how the pins fall silent after the last frame of the run.

    With the host's line of the UART, MUTE is known on the clock of the pins, and no pulse may begin
    later than a period after it. Without it, all pins fall silent within a period.
    """
    found = pin_stops(record, run, shown)
    if found is None:
        return EndOfSound(not_judged="not verified: the capture ends before the run")
    if not found.stops:
        return EndOfSound(not_judged="not verified: no captured pin sounds in the last frame")
    mute, armed = None, record.end
    if record.to_board is not None:
        begin = float(shown.starts[-1])
        mute, armed = mute_on_captured_line(record.to_board, begin, record.end)
    after = None if mute is None else max(found.rises.values()) - mute
    if mute is not None and (late := _pins_sounding_after_mute(record, mute, armed)):
        return EndOfSound((late,), after_mute_periods=after)
    if mute is not None and record.end < mute + _SILENT_PERIODS:
        return EndOfSound(not_judged="not verified: the capture ends with MUTE")
    if mute is None and len(found.sounding) == len(found.stops):
        return EndOfSound(not_judged=_why_pins_not_muted(record, shown))
    if found.is_ramp:
        return EndOfSound(
            not_judged="the output fades to silence (a ramp)", after_mute_periods=after
        )
    if found.sounding and mute is None:
        return EndOfSound((f"{listed_pins(found.sounding)} go on after the others fell silent",))
    if mute is None and (again := pins_that_sound_again(record, found)):
        return _pins_sound_again(record, found, again)
    return _pins_stop_together(record, found, after)


def pins_that_sound_again(record: PinRecord, found: PinStops) -> dict[int, float]:
    """Return when each pin begins a pulse after all had fallen silent, in periods."""
    over = max(found.stops.values()) + _SILENT_PERIODS
    begins = {}
    for element, pin in record.pins.items():
        later = pin.rises[np.searchsorted(pin.rises, over) :]
        if len(later):
            begins[element] = float(later[0])
    return begins


def _pins_sound_again(record: PinRecord, found: PinStops, again: dict[int, float]) -> EndOfSound:
    """Return a finding if only some pins sound again after the end; if all do, it is not judged.

    *again* has the time in periods at which each such element sounds.
    """
    first = min(again.values())
    behind_ms = (first - max(found.stops.values())) * 1e3 / record.carrier_hz
    if set(found.stops) <= set(again):
        return EndOfSound(
            not_judged=f"not verified: the output sounds again {behind_ms:.1f} ms after it fell "
            "silent; capture the line of the host (to_board) to know whether it was told to"
        )
    return EndOfSound(
        (
            f"{listed_pins(sorted(again))} sound again {behind_ms:.1f} ms after all fell silent, "
            "and the others do not",
        )
    )


def _pins_sounding_after_mute(record: PinRecord, mute: float, armed: float) -> str:
    """Return as text the pins that pulse over a period after MUTE; "" if none does.

    From the next ARM on (*armed*) they may. Times are in periods of the capture.
    """
    limit = mute + 1.0 + _MUTE_SAMPLES / record.samples
    last: dict[int, float] = {}
    for element, pin in record.pins.items():
        low, high = np.searchsorted(pin.rises, [limit, armed])
        if low < high:
            last[element] = float(pin.rises[high - 1])
    if not last:
        return ""
    us = 1e6 / record.carrier_hz
    is_end = min(last.values()) > record.end - _SILENT_PERIODS
    return (
        f"{listed_pins(sorted(last))} still on {(max(last.values()) - mute) * us:.0f} µs after "
        f"MUTE arrived, may be for {us:.0f} µs{', up to the end of the capture' if is_end else ''}"
    )


def _pins_stop_together(record: PinRecord, found: PinStops, after: float | None) -> EndOfSound:
    """Return how many periods apart the first and last pin stop; over one is a finding.

    *after* is the time from MUTE to silence, which is passed on; None: not known.
    """
    us = 1e6 / record.carrier_hz
    # A pin is off from its last pulse on, or as late as when it would have begun the next one.
    first, last = min(found.rises.values()) + 1.0, max(found.stops.values())
    allowed = 1.0 + _MUTE_SAMPLES / record.samples
    findings = []
    if last - first > allowed:
        behind = [e for e, stop in found.stops.items() if stop - first > allowed]
        findings.append(
            f"{listed_pins(behind)} fall silent {(last - first) * us:.0f} µs or more after the "
            f"first, may be {us:.0f} µs"
        )
    return EndOfSound(
        tuple(findings), spread_periods=max(0.0, last - first), after_mute_periods=after
    )


def _why_pins_not_muted(record: PinRecord, shown: FramesShownByPins) -> str:
    """Return the text that the output sounds to the capture's end, and no MUTE is to be seen."""
    behind_ms = max(0.0, record.end - float(shown.ends[-1])) * 1e3 / record.carrier_hz
    what = "no MUTE is on the captured line"
    if record.to_board is None:
        what = "capture the line of the host (to_board) to know when it muted the board"
    return (
        f"not verified: the output sounds up to the end of the capture, {behind_ms:.1f} ms after "
        f"the run; {what}"
    )


def listed_pins(elements: Sequence[int]) -> str:
    """Return elements in words, the first eight by number."""
    shown = ", ".join(map(str, elements[:8])) + (", ..." if len(elements) > 8 else "")
    return f"element{'s' if len(elements) > 1 else ''} {shown}"
