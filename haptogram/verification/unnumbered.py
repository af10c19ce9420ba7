"""Latches of boards whose wires number nothing, joined with the frames that were intended.

Such latches are joined by their order. A latch that is the drive of a frame is taken for it;
between such pairs the others are paired as they come, and what is left over of either side is lost,
or was not intended.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from haptogram.acoustics import Drive
from haptogram.records.frame import STREAM, Evidence, FrameKey, Intended, Observation
from haptogram.settings.frozen import dataclass

_TURN: Final = 256  # codes of a drive in a period
_WINDOW: Final = 8  # frames or latches that may be missing in a row before order alone counts
_NOBODY_INTENDED: Final = 1  # loop in the key of a latch that nobody intended; others have loop 0


@dataclass(frozen=True, slots=True)
class UnnumberedLatch:
    """One observed latch, without the key of a frame.

    Attributes
    ----------
    number : int
        Number of the latch at the board.
    t_latch_us : int
        Device time of the latch, microseconds.
    drive, radiated : Drive
        Latched and radiated drive, up to one phase that all channels share.
    evidence : Evidence
        Who saw it.
    """

    number: int
    t_latch_us: int
    drive: Drive
    radiated: Drive
    evidence: Evidence = Evidence.EXTERNAL


def observations_of_unnumbered(
    intended: Sequence[Intended], latches: Sequence[UnnumberedLatch]
) -> list[Observation]:
    """Return *latches*, each with the key of its frame and without the phase that all share.

    A latch without an intended frame has a key of its own.
    """
    return [
        _unnumbered_observation(latch, frame)
        for frame, latch in _joined_unnumbered(intended, latches)
        if latch is not None
    ]


def _joined_unnumbered(
    intended: Sequence[Intended], latches: Sequence[UnnumberedLatch]
) -> Iterator[tuple[Intended | None, UnnumberedLatch | None]]:
    """Yield frames with their latches, in order.

    None for a latch: the frame was lost; None for a frame: nobody intended the latch.
    """
    frame, latch = 0, 0
    while frame < len(intended) and latch < len(latches):
        lost, extra = _next_unnumbered_pair(
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


def _next_unnumbered_pair(
    frames: Sequence[Intended], latches: Sequence[UnnumberedLatch], missing: int
) -> tuple[int, int]:
    """Return how many frames and latches to skip up to the next pair with equal drives.

    Equal numbers of both come first; then more frames if latches are *missing* in total, else more
    latches, since a repeated object fits in several ways. (0, 0) if no pair is equal.
    """
    places = [
        (frame, total - frame)
        for total in range(2 * _WINDOW + 1)
        for frame in range(total + 1)
        if frame < len(frames) and total - frame < len(latches)
    ]
    places.sort(key=lambda place: (place[0] != place[1], (place[0] - place[1]) * missing <= 0))
    for is_near in (False, True):
        for at in places:
            if _has_drive(latches[at[1]], frames[at[0]], is_near=is_near):
                return at
    return 0, 0


def _has_drive(latch: UnnumberedLatch, frame: Intended, *, is_near: bool) -> bool:
    """Return True if a latch has the drive of *frame* up to a common lag.

    Phase codes may be off by one; if *is_near*, by a step of the frame's phases.
    """
    found, wanted = latch.drive, frame.drive
    sounding = wanted.amplitude_codes > 0
    if not np.array_equal(found.amplitude_codes > 0, sounding):
        return False
    if not sounding.any():
        return True
    error = _channel_lags(found, wanted)[sounding]
    off = (error - error[0] + _TURN // 2) % _TURN - _TURN // 2  # within half a turn
    if is_near:  # outputs that are late, by a step or between two
        return bool(np.ptp(off) <= max(1, _TURN // frame.steps))
    return bool(np.abs(off).max() <= 1)


def _unnumbered_observation(latch: UnnumberedLatch, frame: Intended | None) -> Observation:
    """Return a latch as the observation of *frame*, its common lag removed; None: of no frame."""
    if frame is None:
        key, lag = FrameKey(0, STREAM, _NOBODY_INTENDED, latch.number), 0
    else:
        key, lag = frame.key, _common_lag(latch.drive, frame.drive)
    drive, radiated = (
        _unnumbered_without_lag(latch.drive, lag),
        _unnumbered_without_lag(latch.radiated, lag),
    )
    return Observation(
        key=key,
        t_latch_us=latch.t_latch_us,
        late=False,
        evidence=latch.evidence,
        drive=drive,
        radiated=None if radiated == drive else radiated,
    )


def _common_lag(found: Drive, wanted: Drive) -> int:
    """Return the commonest of *found* - *wanted* phase codes, 0 to 255; 0 if no channel counts.

    Channels count that sound in both drives; differences are wrapped to a turn (256).
    """
    sounding = (found.amplitude_codes > 0) & (wanted.amplitude_codes > 0)
    if not sounding.any():
        return 0
    return int(np.bincount(_channel_lags(found, wanted)[sounding] % _TURN).argmax())


def _channel_lags(found: Drive, wanted: Drive) -> NDArray[np.int64]:
    """Return (N,) the phase code of *found* minus that of *wanted* by channel, not wrapped."""
    return found.phase_codes.astype(np.int64) - wanted.phase_codes.astype(np.int64)


def _unnumbered_without_lag(drive: Drive, lag: int) -> Drive:
    """Return *drive* with *lag* subtracted from each phase code; silent elements keep code 0."""
    codes = (drive.phase_codes.astype(np.int64) - lag) % _TURN
    return Drive(np.where(drive.amplitude_codes > 0, codes, 0), drive.amplitude_codes)
