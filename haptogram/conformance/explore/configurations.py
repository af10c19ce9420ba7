"""Configurations of a random host: timers that end while it is quiet, or never."""

from __future__ import annotations

import random
from typing import Final

from haptogram_protocol.messages import Config, Feature, HelloReply, TraceMode

from .actions import SLOT_US

_SLOT_MS: Final = SLOT_US // 1000
#: Lengths that no dialogue outlasts; a board that keeps too few bits of them ends early.
_NEVER_MS: Final = (6600, 8200, 10_000)
_UNATTENDED_NEVER_MS: Final = (6600, 10_000, 65_600, 66_000)
_STATUS_MS: Final = round(11.8 * _SLOT_MS)
#: A ramp that begins with a frame, as its hold is over already, ends at 0.45 of a slot.
_RAMPS_MS: Final = (58, 418, 2000)


class RandomConfigs:
    """Makes configurations and lengths of time for one dialogue.

    Frames arrive at the beginning of a slot and are latched there or in its middle, so that the
    hold ends at 0.2 or 0.7 of one; the lease at 0.35, behind a playback that ends at up to 0.58 at
    0.93; an unattended playback at 0.85; a STATUS is sent at 0.8 and 0.6.

    Parameters
    ----------
    identity : HelloReply
        The board.
    source : random.Random
        Chance.
    timed : bool
        Whether timers end in the dialogue.
    drives : bool
        Whether drives may be traced.

    Attributes
    ----------
    with_status : bool
        Whether boards send STATUS in the dialogue.
    """

    def __init__(
        self, identity: HelloReply, source: random.Random, *, timed: bool, drives: bool
    ) -> None:
        self._random = source
        self._can = identity.features
        self._most_unattended_ms = identity.max_unattended_ms
        self._drives = drives
        self.with_status = timed and source.random() < 0.3
        self._with_timers = timed and not self.with_status
        self._ramps = source.choice(((0,), (0, *_RAMPS_MS[:1]), (0, *_RAMPS_MS[1:])))

    def config(self) -> Config:
        """Return a configuration."""
        pick = self._random.choice
        return Config(
            hold_ms=pick(self._lengths((2, 2, 4, 20), 0.2)),
            ramp_ms=pick(self._ramps),
            host_timeout_ms=pick(self._lengths((3, 5, 50), 0.35)),
            status_period_ms=_STATUS_MS if self.with_status and pick((0, 1, 1)) else 0,
            late_window_us=pick((0, 30_000, 30_000, 70_000, 100_000)),
            sound_speed_mm_s=pick((343_200, 331_000, 352_000, 300_000, 380_000)),
            trace_mode=pick(self._modes()),
            amplitude_ceiling=pick((255, 255, 255, 100, 1, 0)),
            trace_divider=pick((1, 1, 2, 3, 257, 0xFFFF)),
        )

    def unattended_ms(self) -> int:
        """Return the time that a playback may go on without a frame of the host."""
        lengths = list(_UNATTENDED_NEVER_MS)
        if self._with_timers:
            lengths += [0, *[4 * _SLOT_MS + 85 * _SLOT_MS // 100] * 3]
        length = self._random.choice(lengths)
        return min(length, self._most_unattended_ms)

    def _lengths(self, slots: tuple[int, ...], part: float) -> list[int]:
        never = [self._random.choice(_NEVER_MS)]
        if not self._with_timers:
            return never
        return [round(_SLOT_MS * (number + part)) for number in slots] + never

    def _modes(self) -> list[TraceMode]:
        modes = [TraceMode.OFF]
        for feature, mode, weight in (
            (Feature.TRACE, TraceMode.CRC, 2),
            (Feature.TRACE_DRIVE, TraceMode.DRIVE, 3),
            (Feature.TRACE_RING, TraceMode.RING, 3),
        ):
            may = mode is not TraceMode.DRIVE or self._drives
            modes += [mode] * weight if self._can & feature and may else []
        return modes
