"""Scenes of moments: frames within a carrier period, or behind each other at one microsecond."""

from __future__ import annotations

from collections.abc import Callable
from itertools import product
from typing import Any, Final

from haptogram_protocol.messages import Arm, Disarm, Mute, SetConfig, Stop

from ..actions import PARTS, REST, SLOT_US
from ..makers.makers import DialogueMakers
from ..makers.stream import MadeAction
from .inputs import SceneInputs, fault_told
from .states import SceneStates
from .told import Told, ToldSlots, told_as_made

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
    makers : DialogueMakers
        Makers of the frames.
    states : SceneStates
        Brings a board into a state.
    inputs : SceneInputs
        Makes what a board is told.
    """

    def __init__(self, makers: DialogueMakers, states: SceneStates, inputs: SceneInputs) -> None:
        self._conditions, self._makers = makers.conditions, makers
        self._stream, self._requests = makers.stream, makers.requests
        self._states, self._inputs = states, inputs
        self._pick, self._next = makers.conditions.random.choice, makers.conditions.next
        plain, stream = self._requests.plain, self._stream
        self._latches: dict[str, Callable[[], Told]] = {
            "at once": lambda: Told(stream.of(None)),
            "due now": lambda: Told(stream.of(0.0)),
            "late": lambda: Told(stream.of("late")),
            "a period ahead": lambda: Told(stream.of(0.0, apart_us=25)),
        }
        if self._requests.plays:
            self._latches["PLAY"] = lambda: Told(self._requests.play_at_once())
        self._ends: dict[str, Callable[[], Told]] = {
            "MUTE": lambda: Told(plain(Mute()), wait_us=1),  # a write of its own
            "DISARM": lambda: Told(plain(Disarm())),
            "HELLO": lambda: Told(makers.sessions.hello("new")),
            "the session before": lambda: Told(makers.sessions.hello("last")),
            "STOP": lambda: Told(plain(Stop())),
            "SET_CONFIG": lambda: Told(plain(SetConfig(makers.configs.config()))),
            "a fault": fault_told,
            "nothing": lambda: Told(plain(Arm())),
        }

    def trios(self) -> ToldSlots:
        """Return three stream frames in each slot, for times within or around a carrier period."""
        times = _TIMES_EXACT if self._conditions.exact else _TIMES
        found: ToldSlots = [told_as_made([self._requests.plain(Arm())])]
        for _ in range(_TRIOS):
            kinds = self._next("kinds of trios", lambda: product(self._stream.kinds, repeat=3))
            picked = self._next("times of trios", lambda: product(map(str, times), repeat=3))
            by_text: dict[str, Any] = {str(time): time for time in times}
            made = [
                self._frame(kind, by_text[time]) for kind, time in zip(kinds, picked, strict=True)
            ]
            found.append(told_as_made(made))
        return [*found, told_as_made(self._requests.probe())]

    def turns(self) -> ToldSlots:
        """Return a latch, an end of the output, ARM and a latch, around one microsecond.

        Or the first latch is one that was queued for that time.
        """
        first, end, last = self._next(
            "turns", lambda: product(("queued", *self._latches), self._ends, self._latches)
        )
        wait_us = self._pick(_WAITS)
        before = [Told(self._requests.plain(Arm()))]
        word: list[Told] = []
        if first == "queued":
            before.append(Told(self._stream.of(1.0, apart_us=wait_us)))
        else:
            word.append(self._latches[first]())
        word += [self._ends[end](), Told(self._requests.plain(Arm())), self._latches[last]()]
        waits = [wait_us, *(self._pick(_WAITS) for _ in word[1:])]
        timed = [
            told._replace(wait_us=max(told.wait_us, wait))
            for told, wait in zip(word, waits, strict=True)
        ]
        frames = told_as_made([self._requests.plain(Arm()), *self._stream.row(2, SLOT_US // 2)])
        return [before, timed, frames, told_as_made(self._requests.probe())]

    def pause(self, *, timed: bool) -> ToldSlots:
        """Return a frame with a pause in it, of a state; *timed*: of up to seconds.

        Pauses in a dialogue with timers are whole slots: no timer ends when a frame arrives.
        """
        names = self._states.timed if timed else self._states.quick
        state, group = self._next(
            f"pauses with timers: {timed}", lambda: product(names, self._inputs.groups)
        )
        told = self._inputs.told(self._pick(self._inputs.groups[group]))
        long_us = [slots * SLOT_US for slots in _LONG_PAUSES] if timed else []
        pause_us = self._pick((*_SHORT_PAUSES, *long_us))
        if told:
            rest = Told(("", f"the rest, {pause_us} µs later", lambda _: b""), REST, pause_us)
            told[:1] = [told[0]._replace(damage=told[0].damage or PARTS), rest]
        before = [told_as_made(made) for made in self._states.slots(state)]
        return [*before, told, told_as_made(self._requests.probe())]

    def _frame(self, kind: str, time: Any) -> MadeAction:
        message = self._stream.kinds[kind]()
        if isinstance(time, int):
            return self._stream.of(0.5, message, apart_us=time)
        return self._stream.of(time, message)
