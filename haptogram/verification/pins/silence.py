"""The end of a run at the pins: when each falls silent, at once or by a ramp."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from haptogram.records.pins import PinRecord

from .run_drives import RunDrives, fundamentals
from .shown_frames import ShownFrames

_SILENT_PERIODS: Final = 2.5  # without a pulse
_FADED: Final = 0.9  # of its amplitude: a pin that has less before its end is on a ramp
_LAST_PULSES: Final = 3  # the last of which may have been cut


@dataclass(frozen=True, slots=True)
class PinStops:
    """The ends of the pins that sounded in the last frame; times in periods.

    Attributes
    ----------
    stops : dict of int to float
        By element: the end of its last pulse before a silence.
    sounding : tuple of int
        Elements that sound up to the end of the capture.
    faded : int
        Elements whose pulses had become narrower.
    """

    stops: dict[int, float]
    sounding: tuple[int, ...]
    faded: int

    @property
    def is_ramp(self) -> bool:
        """True if most pins faded."""
        return 2 * self.faded > len(self.stops)


def pin_stops(record: PinRecord, run: RunDrives, shown: ShownFrames) -> PinStops | None:
    """Return the ends of the pins after the last frame of the run; None: it is not seen."""
    frames = np.flatnonzero(shown.seen)
    if not len(frames) or shown.ends[-1] > record.end + run.gap:
        return None
    last = frames[-1]
    sizes = np.abs(shown.drives.weights[last])
    stops, sounding, faded = {}, [], 0
    for place, element in enumerate(run.elements):
        pin = record.pins[element]
        first = int(np.searchsorted(pin.rises, shown.starts[last]))
        if sizes[place] <= shown.drives.limit_amplitude or first >= len(pin.rises):
            continue
        silences = np.flatnonzero(np.diff(pin.rises[first:]) > _SILENT_PERIODS)
        end = first + int(silences[0]) if len(silences) else len(pin.rises) - 1
        stops[element] = float(pin.falls[end])
        if not len(silences) and stops[element] > record.end - _SILENT_PERIODS:
            sounding.append(element)
        _, vectors = fundamentals(pin)
        before = np.abs(vectors[max(first, end - _LAST_PULSES) : end])
        if len(before) and before.mean() < _FADED * sizes[place] - shown.drives.limit_amplitude:
            faded += 1
    return PinStops(stops, tuple(sounding), faded)
