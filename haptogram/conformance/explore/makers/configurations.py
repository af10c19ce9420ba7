"""Configurations of a random host: timers that end while it is quiet, or never."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any, Final

from haptogram_protocol import messages as m

from ..actions import LATE_WINDOWS_US, SLOT_US
from .conditions import DialogueConditions, DialogueMaker
from .field_values import REFUSED_CONFIG

_SLOT_MS: Final = SLOT_US // 1000
#: Lengths that no dialogue outlasts; a board that keeps too few bits of them ends early.
_NEVER_MS: Final = (6600, 8200, 10_000)
_UNATTENDED_NEVER_MS: Final = (6600, 10_000, 65_600, 66_000)
#: Parts of a slot at which timers end.
_HOLD_PART: Final = 0.2
_LEASE_PART: Final = 0.35
_UNATTENDED_PART: Final = 0.85
_UNATTENDED_SLOTS: Final = 4
_TRIES: Final = 4
#: Its tenth multiple, 5 s later than most dialogues end, is the first that comes with a latch.
_STATUS_MS: Final = round(12.85 * _SLOT_MS)
#: A ramp that begins with a frame, as its hold is over already, ends at 0.45 of a slot.
_RAMPS_MS: Final = (58, 178, 418, 2000)
_CEILINGS: Final = (255, 200, 100, 60, 0)
_LONGEST_RAMP_MS: Final = 418  # longest ramp in a scene


class RandomConfigs(DialogueMaker):
    """Makes configurations and lengths of time for one dialogue.

    Frames arrive at the beginning of a slot and are latched there or in its middle, so that the
    hold ends at 0.2 or 0.7 of one; the lease at 0.35, after a playback that ends at up to 0.58 at
    0.93; an unattended playback at 0.85; a STATUS is sent at 0.85, 0.7 and
    so on.

    Attributes
    ----------
    with_status : bool
        Whether boards send STATUS in the dialogue.
    with_timers : bool
        Whether hold and lease end in the dialogue.
    last : Config
        The configuration that was made last.
    """

    def __init__(self, conditions: DialogueConditions) -> None:
        super().__init__(conditions)
        source = conditions.random
        self._drives = conditions.drives
        self.with_status = conditions.timed and source.random() < 0.3
        self.with_timers = conditions.timed and not self.with_status
        self._ramps = source.choice(((0,), (0, *_RAMPS_MS[:1]), (0, *_RAMPS_MS[2:])))
        self.last = m.Config()

    def config(self) -> m.Config:
        """Return a configuration."""
        pick = self._random.choice
        self.last = m.Config(
            hold_ms=pick(self._lengths((2, 2, 4, 20), _HOLD_PART)),
            ramp_ms=pick(self._ramps),
            host_timeout_ms=pick(self._lengths((3, 5, 50), _LEASE_PART)),
            status_period_ms=_STATUS_MS if self.with_status and pick((0, 1, 1)) else 0,
            late_window_us=pick(LATE_WINDOWS_US),
            sound_speed_mm_s=pick((343_987, 331_000, 352_000, 300_000, 380_000)),
            trace_mode=pick(self.modes()),
            amplitude_ceiling=pick(self._ceilings((255, 255, 255, 100, 1, 0))),
            trace_divider=pick((1, 1, 2, 3, 257, 0xFFFF)),
        )
        return self.last

    def timed_config(
        self, lease: int | None, hold: int | None, ramp_ms: int | None = None
    ) -> m.Config:
        """Return a configuration with timers of these slots and a part; None: they never end."""
        never = self._random.choice(_NEVER_MS)
        ramps = [length for length in self._ramps if length <= _LONGEST_RAMP_MS]
        self.last = dataclasses.replace(
            self.config(),
            hold_ms=never if hold is None else _in_slots_ms(hold, _HOLD_PART),
            host_timeout_ms=never if lease is None else _in_slots_ms(lease, _LEASE_PART),
            ramp_ms=self._random.choice(ramps) if ramp_ms is None else ramp_ms,
            amplitude_ceiling=self._random.choice(self._ceilings((255, 100))),
            status_period_ms=0,
        )
        return self.last

    def traced_config(self, mode: m.TraceMode | None, divider: int) -> m.Config:
        """Return a configuration that traces, if the board can in *mode*, and no timer ends."""
        modes = {one for one in self.modes() if one not in (m.TraceMode.OFF, m.TraceMode.DRIVE)}
        if mode not in modes:
            mode = self._random.choice(sorted(modes) or [m.TraceMode.OFF])
        config = self.timed_config(None, None)
        self.last = dataclasses.replace(config, trace_mode=mode, trace_divider=divider)
        return self.last

    def changed(self, name: str) -> m.Config:
        """Return the last configuration with another value of one field."""
        last = self.last
        others = [getattr(self.config(), name) for _ in range(_TRIES)]
        if name == "ramp_ms":
            others = self._random.sample(_RAMPS_MS, len(_RAMPS_MS))
        elif name == "amplitude_ceiling":
            ceilings = self._ceilings(_CEILINGS)
            others = self._random.sample(ceilings, len(ceilings))
        value = next((other for other in others if other != getattr(last, name)), others[0])
        self.last = dataclasses.replace(last, **{name: value})
        return self.last

    def _ceilings(self, wanted: Sequence[int]) -> Sequence[int]:
        """Return the wanted ceilings; without amplitude control only 0 and 255 (HG-7.9/2)."""
        is_graded = m.Feature.AMPLITUDE in self._can
        return [ceiling for ceiling in wanted if is_graded or ceiling in (0, 255)]

    def refused(self, name: str) -> m.Config:
        """Return the last configuration with a value of one field that no board takes."""
        changes: dict[str, Any] = {name: self._random.choice(REFUSED_CONFIG[name])}
        return dataclasses.replace(self.last, **changes)

    def unattended_ms(self) -> int:
        """Return the time that a playback may go on without a frame of the host."""
        lengths = list(_UNATTENDED_NEVER_MS)
        if self.with_timers:
            lengths += [0, *[self.short_unattended_ms] * 3]
        length = self._random.choice(lengths)
        return min(length, self._identity.max_unattended_ms)

    @property
    def short_unattended_ms(self) -> int:
        """An unattended time that ends in a dialogue."""
        return min(
            _in_slots_ms(_UNATTENDED_SLOTS, _UNATTENDED_PART), self._identity.max_unattended_ms
        )

    def _lengths(self, slots: tuple[int, ...], part: float) -> list[int]:
        """Return lengths for timers in ms: one for each of *slots*, and one that never ends.

        Each is that many slots of 40 ms plus *part* (0 to 1) of one. If timers must not end in this
        dialogue, the endless one, 6.6 s or more, is alone.
        """
        never = [self._random.choice(_NEVER_MS)]
        if not self.with_timers:
            return never
        return [_in_slots_ms(number, part) for number in slots] + never

    def modes(self) -> list[m.TraceMode]:
        """Return the modes of the trace, as often as they are to be likely."""
        modes = [m.TraceMode.OFF]
        for feature, mode, weight in (
            (m.Feature.TRACE, m.TraceMode.CRC, 2),
            (m.Feature.TRACE_DRIVE, m.TraceMode.DRIVE, 3),
            (m.Feature.TRACE_RING, m.TraceMode.RING, 3),
        ):
            may = mode is not m.TraceMode.DRIVE or self._drives
            modes += [mode] * weight if self._can & feature and may else []
        return modes


def _in_slots_ms(number: int, part: float) -> int:
    """Return the duration in ms of *number* slots of 40 ms and a *part*, 0 to 1, of another."""
    return round(_SLOT_MS * (number + part))
