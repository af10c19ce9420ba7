"""Scenes: a state, what the board is told in it, and what timers do with both."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields
from itertools import product
from typing import Final

from haptogram_protocol.messages import Arm, Config, Feature, SetConfig, TraceMode

from ..actions import SLOT_US
from ..makers.makers import DialogueMakers
from .inputs import SceneInputs
from .memories import MemoryScenes
from .moments import MomentScenes
from .states import SceneStates
from .told import ToldSlots, told_as_made
from .values import ByteValueScenes

_SILENT: Final = (3, 3, 6)  # slots, until timers have ended
_RENEWALS: Final = 4  # in a scene
_DEFECTS: Final = 6  # in a scene
_WATCHED: Final = 8  # slots, of a ramp that lasts for four
_SET_AGAIN: Final = 0.3  # in such a slot
_OF_RAMPS: Final = ("amplitude_ceiling", "ramp_ms")  # what a ramp keeps: set in each of them
_LIKELY: Final = 6  # times as often as other fields
_STATUS_SLOTS: Final = 7  # until the next STATUS
_LONG_LOOPS: Final = 400  # of a sequence of three frames
_LONG_SLOTS: Final = 14  # until they are over
_CHUNKS: Final = 16  # in a slot
_EARLY_SLOTS: Final = 6  # before the first HELLO
_EARLY: Final = 3  # inputs in each of them
_OPENS: Final = frozenset(f"HELLO {which}" for which in ("open", "last", "earlier", "new", "near"))
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
        self._random, self._next = conditions.random, conditions.next
        self._makers, self._stream, self._requests = makers, makers.stream, makers.requests
        self._states, self._inputs = SceneStates(makers), SceneInputs(makers)
        self._kinds = self._shares(makers)

    def _shares(self, makers: DialogueMakers) -> dict[Callable[[], ToldSlots], float]:
        """Return how often scenes of each kind are played."""
        conditions, moments = makers.conditions, MomentScenes(makers, self._states, self._inputs)
        memories, values = MemoryScenes(makers), ByteValueScenes(makers, self._inputs)
        if makers.configs.with_timers and conditions.can & Feature.CONFIG:
            timed: dict[Callable[[], ToldSlots], float] = {
                self._renewals: 0.2,
                self._timed_pair: 0.55,
                self._watched: 0.15,
            }
            return timed | ({lambda: moments.pause(timed=True): 0.1} if conditions.exact else {})
        found: dict[Callable[[], ToldSlots], float] = {
            memories.sessions: 0.07,
            memories.numbers: 0.05,
            moments.trios: 0.08,
            values.scene: 0.08,
            self._defects: 0.14,
            self._quick_pair: 0.5,
        }
        if memories.has_ring:
            found[memories.ring] = 0.04
        if conditions.exact:
            found |= {moments.turns: 0.1, lambda: moments.pause(timed=False): 0.05}
            if self._requests.plays:
                found[self._long] = 0.07
        if makers.configs.with_status:
            found[self._late_until_status] = 0.2
        return found

    def scene(self) -> ToldSlots:
        """Return the frames of a scene, slot by slot."""
        (make,) = self._random.choices(list(self._kinds), list(self._kinds.values()))
        return make()

    def before_hello(self) -> ToldSlots:
        """Return frames for slots in which the board has no session."""
        names = [name for name in self._inputs.names if name not in _OPENS]
        return [
            [told for _ in range(_EARLY) for told in self._inputs.told(self._random.choice(names))]
            for _ in range(_EARLY_SLOTS)
        ]

    # --- kinds of scenes -----------------------------------------------------------------------

    def _renewals(self) -> ToldSlots:
        """Return leases of about a slot, each with a frame that renews it or does not."""
        found: ToldSlots = [told_as_made(self._states.lease())]
        for _ in range(_RENEWALS):
            (name,) = self._next("renewals", lambda: ((name,) for name in self._inputs.names))
            found += [self._inputs.told(name), [], told_as_made([self._requests.plain(Arm())])]
        found[-1] = told_as_made(self._requests.probe())
        return found

    def _timed_pair(self) -> ToldSlots:
        state, group = self._next(
            "states with timers", lambda: product(self._states.timed, self._inputs.groups)
        )
        told = self._random.choice(self._inputs.groups[group])
        silent: ToldSlots = [[] for _ in range(self._random.choice(_SILENT))]
        return [*self._pair(state, told), *silent, told_as_made(self._requests.probe())]

    def _watched(self) -> ToldSlots:
        """Return one field set in a state with a timer, at times again, and read-backs meanwhile.

        Neither ends the ramp of a hold.
        """
        names = [field.name for field in fields(Config)]
        ramps = [state for state in self._states.timed if "ramp" in state]
        likely = [*product(ramps, _OF_RAMPS)] * _LIKELY
        state, name = self._next(
            "changes with timers", lambda: [*product(self._states.timed, names), *likely]
        )
        found = [told_as_made(slot) for slot in self._states.slots(state)]
        for slot in range(_WATCHED):
            made = self._requests.read_backs()
            if slot == 0 or self._random.random() < _SET_AGAIN:
                config = self._makers.configs.changed(name)  # of the one that is in force
                made = [self._requests.plain(SetConfig(config)), *made]
            found.append(told_as_made(made))
        return [*found, told_as_made(self._requests.probe())]

    def _quick_pair(self) -> ToldSlots:
        state, group = self._next(
            "states", lambda: product(self._states.quick, self._inputs.groups)
        )
        found = self._pair(state, self._random.choice(self._inputs.groups[group]))
        if self._random.random() < 0.5:  # does all go on?
            arm, frames = self._requests.plain(Arm()), self._stream.row(_FRAMES, SLOT_US // 2)
            found.append(told_as_made([arm, *frames]))
        return [*found, told_as_made(self._requests.probe())]

    def _late_until_status(self) -> ToldSlots:
        """Return a late frame, and silence until a STATUS has told its margin."""
        late = [self._requests.plain(Arm()), self._stream.of("late")]
        return [told_as_made(late), *([] for _ in range(_STATUS_SLOTS))]

    def _long(self) -> ToldSlots:
        """Return more latches and events than 8 or 10 bits count, or more bytes than 16 bits."""
        (name,) = self._next("long", lambda: [("events",), ("records",), ("an upload",)])
        silent: ToldSlots = [[] for _ in range(_LONG_SLOTS)]
        if name == "an upload":
            steps = [*self._states.traced(TraceMode.CRC), *self._requests.uploads.long_upload()]
            steps.append(self._requests.short_play())
            edges = range(0, len(steps), _CHUNKS)
            return [*(told_as_made(steps[at : at + _CHUNKS]) for at in edges), *silent]
        mode = TraceMode.CRC if name == "events" else TraceMode.RING
        first = told_as_made([*self._states.traced(mode), self._requests.long_play(_LONG_LOOPS)])
        return [first, *silent, told_as_made(self._requests.probe())]

    def _defects(self) -> ToldSlots:
        """Return requests with a defect each."""
        found: ToldSlots = []
        for _ in range(_DEFECTS):
            name, *defects = self._next("defects", self._inputs.defects)
            found.append(told_as_made([self._inputs.defective(name, defects)]))
        return [*found, told_as_made(self._requests.probe())]

    def _pair(self, state: str, told: str) -> ToldSlots:
        return [*map(told_as_made, self._states.slots(state)), self._inputs.told(told)]
