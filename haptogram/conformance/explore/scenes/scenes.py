"""Scenes: a state, what the board is told in it, and what timers do with both."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import product
from typing import Final

from haptogram_protocol.messages import Arm, Feature, TraceMode

from ..actions import SLOT_US
from ..makers.makers import DialogueMakers
from .inputs import SceneInputs, Told, told_as_made
from .states import SceneStates

_SILENT: Final = (3, 3, 6)  # slots, until timers have ended
_RENEWALS: Final = 4  # in a scene
_DEFECTS: Final = 6  # in a scene
_STATUS_SLOTS: Final = 7  # until the next STATUS
_NUMBERS: Final = 8
_LONG_LOOPS: Final = 400  # of a sequence of three frames
_LONG_SLOTS: Final = 14  # until they are over
_CHUNKS: Final = 16  # in a slot
_FRAMES: Final = 3  # that show whether all goes on


class RandomScenes:
    """Makes scenes, each of which no scene of the run was like.

    Parameters
    ----------
    makers : DialogueMakers
        Makers of the frames.
    """

    def __init__(self, makers: DialogueMakers) -> None:
        conditions = makers.conditions
        self._random, self._coverage = conditions.random, conditions.coverage
        self._stream, self._requests = makers.stream, makers.requests
        self._sessions = makers.sessions
        self._exact = conditions.exact
        self._states, self._inputs = SceneStates(makers), SceneInputs(makers)
        self._has_status = makers.configs.with_status
        self._has_timers = makers.configs.with_timers and bool(conditions.can & Feature.CONFIG)

    def scene(self) -> list[list[Told]]:
        """Return the frames of a scene, slot by slot."""
        pick = self._random.random()
        if self._has_timers:
            return self._renewals() if pick < 0.2 else self._timed_pair()
        if self._has_status and pick > 0.8:
            late = [self._requests.plain(Arm()), self._stream.of("late")]
            return [told_as_made(late), *([] for _ in range(_STATUS_SLOTS))]
        if pick < 0.14:
            return self._two_sessions() if pick < 0.07 else self._numbers()
        if self._exact and self._requests.plays and pick > 0.9:
            return self._long()
        return self._defects() if pick < 0.3 else self._quick_pair()

    # --- kinds of scenes -----------------------------------------------------------------------

    def _renewals(self) -> list[list[Told]]:
        """Return leases of about a slot, each with a frame that renews it or does not."""
        found: list[list[Told]] = [told_as_made(self._states.lease())]
        for _ in range(_RENEWALS):
            (name,) = self._next("renewals", ((name,) for name in self._inputs.names))
            found += [self._inputs.told(name), [], told_as_made([self._requests.plain(Arm())])]
        found[-1] = told_as_made(self._requests.probe())
        return found

    def _timed_pair(self) -> list[list[Told]]:
        state, group = self._next(
            "states with timers", product(self._states.timed, self._inputs.groups)
        )
        told = self._random.choice(self._inputs.groups[group])
        silent: list[list[Told]] = [[] for _ in range(self._random.choice(_SILENT))]
        return [*self._pair(state, told), *silent, told_as_made(self._requests.probe())]

    def _quick_pair(self) -> list[list[Told]]:
        state, group = self._next("states", product(self._states.quick, self._inputs.groups))
        found = self._pair(state, self._random.choice(self._inputs.groups[group]))
        if self._random.random() < 0.5:  # does all go on?
            arm, frames = self._requests.plain(Arm()), self._stream.row(_FRAMES, SLOT_US // 2)
            found.append(told_as_made([arm, *frames]))
        return [*found, told_as_made(self._requests.probe())]

    def _two_sessions(self) -> list[list[Told]]:
        """Return a session, another one, and the first again with what was asked in it."""
        requests, sessions = self._requests, self._sessions
        steps = [sessions.greeting(), requests.keeping(), sessions.hello("new")]
        steps += [sessions.hello("last"), sessions.of_earlier_session()]
        return [*(told_as_made([step]) for step in steps), told_as_made(requests.probe())]

    def _numbers(self) -> list[list[Told]]:
        """Return requests around the wrap of their numbers, each of them twice."""
        requests = self._requests
        found = [told_as_made([self._sessions.greeting()])]
        found += [told_as_made([requests.keeping(), requests.repeated()]) for _ in range(_NUMBERS)]
        return found

    def _long(self) -> list[list[Told]]:
        """Return more latches and events than 8 or 10 bits count, or more bytes than 16 bits."""
        (name,) = self._next("long", [("events",), ("records",), ("an upload",)])
        silent: list[list[Told]] = [[] for _ in range(_LONG_SLOTS)]
        if name == "an upload":
            steps = [*self._states.traced(TraceMode.CRC), *self._requests.long_upload()]
            steps.append(self._requests.short_play())
            edges = range(0, len(steps), _CHUNKS)
            return [*(told_as_made(steps[at : at + _CHUNKS]) for at in edges), *silent]
        mode = TraceMode.CRC if name == "events" else TraceMode.RING
        first = told_as_made([*self._states.traced(mode), self._requests.long_play(_LONG_LOOPS)])
        return [first, *silent, told_as_made(self._requests.probe())]

    def _defects(self) -> list[list[Told]]:
        """Return requests with a defect each."""
        found: list[list[Told]] = []
        for _ in range(_DEFECTS):
            name, *defects = self._next("defects", self._inputs.defects())
            found.append(told_as_made([self._inputs.defective(name, defects)]))
        return [*found, told_as_made(self._requests.probe())]

    def _pair(self, state: str, told: str) -> list[list[Told]]:
        return [*map(told_as_made, self._states.slots(state)), self._inputs.told(told)]

    def _next(self, kind: str, names: Iterable[tuple[str, ...]]) -> tuple[str, ...]:
        """Return one of *names* that was not returned for longest, by chance."""
        due = self._coverage.scenes.setdefault(kind, [])
        if not due:
            due += names
            self._random.shuffle(due)
        return due.pop()
