"""Scenes of moments: frames within a carrier period, or together in one microsecond."""

from __future__ import annotations

from itertools import product
from typing import Final

from ..actions import PARTS, REST, SLOT_US, ActionSlots, DialogueAction
from .states import SceneMaker

#: Microseconds after a multiple of the carrier period of 25 us.
_TIMES: Final = (-24, 0, 1, 10, 25, 26)
#: The times, and late and immediate frames, where bytes arrive to the microsecond.
_TIMES_EXACT: Final = (*_TIMES, "late", None)
_TRIOS: Final = 3  # groups of three frames in a scene
_WAITS: Final = (0, 0, 0, 1, 24, 25, 26)  # microseconds
#: A pause within a frame, in microseconds and in slots: the longest is 3 s.
_SHORT_PAUSES: Final = (1, 30, 1000)
_LONG_PAUSES: Final = (1, 4, 38, 75)
_LATCHES: Final = (
    *("a frame at once", "a frame due now", "a late frame", "a frame a period ahead"),
    "PLAY at once",
)
_ENDS: Final = (
    *("MUTE", "DISARM", "HELLO new", "HELLO last", "STOP", "another configuration", "a fault"),
    "ARM",
)


class MomentScenes(SceneMaker):
    """Makes scenes of moments."""

    def trios(self) -> ActionSlots:
        """Return three stream frames in each slot, for times within or around a carrier period."""
        makers = self._makers
        times = _TIMES_EXACT if makers.conditions.exact else _TIMES
        found = self._inputs.slots("ARM")
        for _ in range(_TRIOS):
            kinds = self._next("kinds of trios", lambda: product(makers.kinds, repeat=3))
            picked = self._next("times of trios", lambda: product(times, repeat=3))
            found.append(
                [
                    makers.frame(makers.kinds[kind](), 0.5, apart_us=time)
                    if isinstance(time, int)
                    else makers.frame(makers.kinds[kind](), time)
                    for kind, time in zip(kinds, picked, strict=True)
                ]
            )
        return found

    def turns(self) -> ActionSlots:
        """Return a latch, an end of the output, ARM and a latch, around one microsecond.

        Or the first latch is one that was queued for that time.
        """
        latches = [name for name in _LATCHES if self._inputs.knows(name)]
        ends = [name for name in _ENDS if self._inputs.knows(name)]
        first, end, last = self._next("turns", lambda: product(("queued", *latches), ends, latches))
        wait_us = self._random.choice(_WAITS)
        names = [first, end, "ARM", last]
        before, turn = self._inputs.slots("ARM"), []
        if first == "queued":
            before[0].append(self._inputs.frame(1.0, apart_us=wait_us))
            del names[0]
        for action in (self._inputs.named(name)[0] for name in names):
            own_us = int(action.name == "MUTE")  # it has a write of its own
            turn.append(action._replace(wait_us=max(own_us, wait_us)))
            wait_us = self._random.choice(_WAITS)
        return [*before, turn, *self._inputs.slots("ARM + frames")]

    def pause(self, *, timed: bool) -> ActionSlots:
        """Return a frame with a pause in it, of a state; *timed*: of up to seconds.

        Pauses in a dialogue with timers are whole slots: no timer ends when a frame arrives.
        """
        states, groups = self.timed if timed else self.quick, self._inputs.groups
        state, group = self._next(f"pauses with timers: {timed}", lambda: product(states, groups))
        actions = self._inputs.named(self._random.choice(groups[group]))
        long_us = [slots * SLOT_US for slots in _LONG_PAUSES] if timed else []
        pause_us = self._random.choice((*_SHORT_PAUSES, *long_us))
        if actions:
            name = f"the rest, {pause_us} µs later"
            rest = DialogueAction(0, name, lambda _: b"", REST, wait_us=pause_us)
            actions[:1] = [actions[0]._replace(damage=actions[0].damage or PARTS), rest]
        return [*self._state(state), actions]
