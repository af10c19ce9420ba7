"""Scenes of moments: frames within a carrier period, or behind each other at one microsecond."""

from __future__ import annotations

from collections.abc import Callable
from itertools import product
from typing import Final

from haptogram_protocol.messages import Arm, Disarm, Mute, SetConfig, Stop

from ..actions import PARTS, REST, SLOT_US
from ..makers.conditions import Told, ToldSlots
from ..makers.frames import At
from ..makers.requests import RandomRequests
from .inputs import SceneInputs, fault_told
from .states import SceneStates

#: Microseconds behind a multiple of the carrier period of 25 us.
_TIMES: Final = (-24, 0, 1, 10, 25, 26)
#: Where bytes arrive to the microsecond, frames that are latched at once as well.
_TIMES_EXACT: Final = (*_TIMES, "late", None)
_TRIOS: Final = 3  # in a scene
_WAITS: Final = (0, 0, 0, 1, 24, 25, 26)  # microseconds
#: A pause within a frame, in microseconds and in slots: the longest is 3 s.
_SHORT_PAUSES: Final = (1, 30, 1000)
_LONG_PAUSES: Final = (1, 4, 38, 75)


class MomentScenes:
    """Makes scenes of moments.

    Parameters
    ----------
    makers : RandomRequests
        Makes frames.
    states : SceneStates
        Brings a board into a state.
    inputs : SceneInputs
        Makes what a board is told.
    """

    def __init__(self, makers: RandomRequests, states: SceneStates, inputs: SceneInputs) -> None:
        self._makers, self._states, self._inputs = makers, states, inputs
        self._pick, self._next = makers.conditions.random.choice, makers.conditions.next
        self._times = _TIMES_EXACT if makers.conditions.exact else _TIMES
        frame = makers.frame
        self._latches: dict[str, Callable[[], Told]] = {
            "at once": lambda: inputs.frame(None),
            "due now": lambda: inputs.frame(0.0),
            "late": lambda: inputs.frame("late"),
            "a period ahead": lambda: inputs.frame(0.0, apart_us=25),
        }
        if makers.plays:
            self._latches["PLAY"] = makers.play_at_once
        self._ends: dict[str, Callable[[], Told]] = {
            "MUTE": lambda: frame(Mute())._replace(wait_us=1),  # a write of its own
            "DISARM": lambda: frame(Disarm()),
            "HELLO": lambda: makers.hello("new"),
            "the session before": lambda: makers.hello("last"),
            "STOP": lambda: frame(Stop()),
            "SET_CONFIG": lambda: frame(SetConfig(makers.configs.config())),
            "a fault": fault_told,
            "nothing": lambda: frame(Arm()),
        }

    def trios(self) -> ToldSlots:
        """Return three stream frames in each slot, for times within or around a carrier period."""
        found: ToldSlots = [[self._makers.frame(Arm())]]
        for _ in range(_TRIOS):
            kinds = self._next("kinds of trios", lambda: product(self._makers.kinds, repeat=3))
            times = self._next("times of trios", lambda: product(self._times, repeat=3))
            found.append([self._frame(*one) for one in zip(kinds, times, strict=True)])
        return found

    def turns(self) -> ToldSlots:
        """Return a latch, an end of the output, ARM and a latch, around one microsecond.

        Or the first latch is one that was queued for that time.
        """
        makers = self._makers
        first, end, last = self._next(
            "turns", lambda: product(("queued", *self._latches), self._ends, self._latches)
        )
        wait_us = self._pick(_WAITS)
        before = [makers.frame(Arm())]
        turn: list[Told] = []
        if first == "queued":
            before.append(self._inputs.frame(1.0, apart_us=wait_us))
        else:
            turn.append(self._latches[first]())
        turn += [self._ends[end](), makers.frame(Arm()), self._latches[last]()]
        waits = [wait_us, *(self._pick(_WAITS) for _ in turn[1:])]
        timed = [
            told._replace(wait_us=max(told.wait_us, wait))
            for told, wait in zip(turn, waits, strict=True)
        ]
        return [before, timed, [makers.frame(Arm()), *makers.row(2, SLOT_US // 2)]]

    def pause(self, *, timed: bool) -> ToldSlots:
        """Return a frame with a pause in it, of a state; *timed*: of up to seconds.

        Pauses in a dialogue with timers are whole slots: no timer ends when a frame arrives.
        """
        states, groups = self._states.timed if timed else self._states.quick, self._inputs.groups
        state, group = self._next(f"pauses with timers: {timed}", lambda: product(states, groups))
        told = self._inputs.told(self._pick(groups[group]))
        long_us = [slots * SLOT_US for slots in _LONG_PAUSES] if timed else []
        pause_us = self._pick((*_SHORT_PAUSES, *long_us))
        if told:
            rest = Told("", f"the rest, {pause_us} µs later", lambda _: b"", REST, pause_us)
            told[:1] = [told[0]._replace(damage=told[0].damage or PARTS), rest]
        return [*states[state](), told]

    def _frame(self, kind: str, time: At) -> Told:
        """Return a frame for microseconds behind the middle of a slot, or for another time."""
        message = self._makers.kinds[kind]()
        if isinstance(time, int):
            return self._makers.frame(message, 0.5, apart_us=time)
        return self._makers.frame(message, time)
