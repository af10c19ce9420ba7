"""Latches of a run on boards of another dialect, joined with what the host intended.

Their wires carry no number, so latches are joined by their order. A latch that is the drive of a
frame is taken for it; between such pairs the others are paired as they come, and what is left over
of either side is lost, or was not intended. Latches in which every channel is off are the host's
own before the first and behind the last that sounds, and are left out there; between its frames a
board that goes dark is a latch that nobody intended.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from haptogram.acoustics import Drive
from haptogram.acoustics.arrays import ComplexArray
from haptogram.acoustics.model.drive import saturated_weights
from haptogram.evidence.backdoor import backdoor_observations, observations_on_clock_of
from haptogram.evidence.dialects.pulse_records import PulseObservation, pulse_observation_of
from haptogram.records.frame import STREAM, Evidence, FrameKey, Intended, Observation
from haptogram.settings.dialects import OWN_DIALECT
from haptogram.verification.watch.latch import OWN_CAUSES

_TURN: Final = 256  # codes of a drive in a period
_WINDOW: Final = 8  # frames or latches that may be missing in a row before order alone counts
_PULSES: Final = "pulses"
_NOBODY_INTENDED: Final = 1  # loop of their keys: the frames of a host have loop 0


def run_observations(
    intended: Sequence[Intended], records: Sequence[Mapping[str, Any]], session: int | None
) -> list[Observation]:
    """Return the latches in the records of a back door, of any board, with the keys of frames."""
    if not is_of_another_dialect(records):
        return observations_on_clock_of(intended, backdoor_observations(records, session))
    latches = _latches_of_the_run(records)
    return [
        _observation(latch, frame)
        for frame, latch in _joined(intended, latches)
        if latch is not None
    ]


def is_of_another_dialect(records: Sequence[Mapping[str, Any]]) -> bool:
    """Return True if the records of a back door are those of another board than Haptogram's."""
    return bool(records) and records[0].get("dialect", OWN_DIALECT) != OWN_DIALECT


def has_latched_all(intended: Sequence[Intended], records: Sequence[Mapping[str, Any]]) -> bool:
    """Return True if the records of another board hold a latch for each frame."""
    return len(_latches_of_the_run(records)) >= len(intended)


class _Latch:
    """A latch, and its drive up to the phase that all channels share."""

    def __init__(self, seen: PulseObservation, weights: ComplexArray) -> None:
        self.seen = seen
        self.drive = _drive(weights)
        self.is_sounding = bool(weights.any())

    def is_of(self, frame: Intended) -> bool:
        """Return True if the latched drive is that of *frame*."""
        found, wanted = self.drive, frame.drive
        sounding = wanted.amplitude_codes > 0
        if not np.array_equal(found.amplitude_codes > 0, sounding):
            return False
        if not self.is_sounding:
            return True
        error = _lags(found, wanted)[sounding]
        return bool(np.abs(_signed(error - error[0])).max(initial=0) <= 1)


def _latches_of_the_run(records: Sequence[Mapping[str, Any]]) -> list[_Latch]:
    channels = [int(channel) for channel in records[0]["channels"]] if records else []
    found = []
    for record in records:
        if record["kind"] == _PULSES and record["cause"] not in OWN_CAUSES:
            seen = pulse_observation_of(record, channels)
            found.append(_Latch(seen, seen.pulses.weights()[channels]))
    sounding = [place for place, latch in enumerate(found) if latch.is_sounding]
    return found[sounding[0] : sounding[-1] + 1] if sounding else []


def _joined(
    intended: Sequence[Intended], latches: Sequence[_Latch]
) -> Iterator[tuple[Intended | None, _Latch | None]]:
    """Yield frames with their latches, in order; None: lost, or not intended."""
    frame, latch = 0, 0
    while frame < len(intended) and latch < len(latches):
        lost, extra = _next_pair(
            intended[frame : frame + _WINDOW],
            latches[latch : latch + _WINDOW],
            (len(intended) - frame) - (len(latches) - latch),
        )
        both = min(lost, extra)
        for step in range(both):
            yield intended[frame + step], latches[latch + step]
        yield from ((wanted, None) for wanted in intended[frame + both : frame + lost])
        yield from ((None, seen) for seen in latches[latch + both : latch + extra])
        frame, latch = frame + lost, latch + extra
        if frame < len(intended) and latch < len(latches):
            yield intended[frame], latches[latch]
            frame, latch = frame + 1, latch + 1
    yield from ((wanted, None) for wanted in intended[frame:])
    yield from ((None, seen) for seen in latches[latch:])


def _next_pair(
    frames: Sequence[Intended], latches: Sequence[_Latch], missing: int
) -> tuple[int, int]:
    """Return how many frames and latches come before the first pair that is the same drive.

    As many of both, if there is such a pair. Else more frames if latches are *missing* in all, more
    latches if there are too many: an object that repeats fits in several ways. None of either
    without any pair.
    """
    places = [
        (frame, total - frame)
        for total in range(2 * _WINDOW + 1)
        for frame in range(total + 1)
        if frame < len(frames) and total - frame < len(latches)
    ]
    places.sort(key=lambda place: (place[0] != place[1], (place[0] - place[1]) * missing <= 0))
    return next((at for at in places if latches[at[1]].is_of(frames[at[0]])), (0, 0))


def _observation(latch: _Latch, frame: Intended | None) -> Observation:
    """Return *latch* as the observation of *frame*, without the phase that all channels share."""
    seen = latch.seen
    if frame is None:
        key, offset = FrameKey(0, STREAM, _NOBODY_INTENDED, seen.number), 0
    else:
        key, offset = frame.key, _common_lag(latch.drive, frame.drive)
    back = np.exp(-1j * math.tau * offset / _TURN)
    drive = _drive(latch.drive.weights() * back)
    radiated = _drive(seen.weights * back)
    return Observation(
        key=key,
        t_latch_us=seen.t_latch_us,
        late=False,
        evidence=Evidence.EXTERNAL,
        drive=drive,
        radiated=None if radiated == drive else radiated,
    )


def _common_lag(found: Drive, wanted: Drive) -> int:
    """Return the lag that most channels share, which the shape of the pulses makes."""
    sounding = (found.amplitude_codes > 0) & (wanted.amplitude_codes > 0)
    if not sounding.any():
        return 0
    return int(np.bincount(_lags(found, wanted)[sounding] % _TURN).argmax())


def _lags(found: Drive, wanted: Drive) -> NDArray[np.int64]:
    return found.phase_codes.astype(np.int64) - wanted.phase_codes.astype(np.int64)


def _signed(lags: NDArray[np.int64]) -> NDArray[np.int64]:
    return (lags + _TURN // 2) % _TURN - _TURN // 2


def _drive(weights: ComplexArray) -> Drive:
    return Drive.from_weights(saturated_weights(weights))
