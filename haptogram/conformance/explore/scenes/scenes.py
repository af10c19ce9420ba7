"""Scenes: a state, what the board is told in it, and what timers do with both."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields
from functools import partial
from itertools import product
from typing import Final

from haptogram_protocol.messages import Arm, Config, Feature, SetConfig, Stop, TraceMode

from ..actions import SLOT_US
from ..makers.conditions import Told, ToldSlots
from ..makers.requests import RandomRequests
from .inputs import SceneInputs
from .memories import MemoryScenes
from .moments import MomentScenes
from .states import SceneStates

_SILENT: Final = (3, 3, 6)  # slots, until timers have ended
_FILLED: Final = (5, 6, 6, 8)  # slots in which timers run
#: What comes in each of them: nothing, what renews no lease, or (empty) a request that does.
_FILLERS: Final = ("nothing", "nothing", "damage 1", "damage 2", "damage 5", "a foreign frame", "")
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
_BYTE_SLOTS: Final = 3
_BYTE_FRAMES: Final = {True: 24, False: 5}  # where bytes take no time, and where they do
_BYTES: Final = 8000  # of a slot, at most


class RandomScenes:
    """Makes scenes, each of which no scene of the run was like.

    Parameters
    ----------
    makers : RandomRequests
        Makes frames.
    inputs : SceneInputs
        Makes what a board is told.
    """

    def __init__(self, makers: RandomRequests, inputs: SceneInputs) -> None:
        self._makers, self._inputs, self._states = makers, inputs, SceneStates(makers)
        self._random, self._next = makers.conditions.random, makers.conditions.next
        self._kinds = self._shares()

    def _shares(self) -> dict[Callable[[], ToldSlots], float]:
        """Return how often scenes of each kind are played."""
        makers, conditions = self._makers, self._makers.conditions
        moments = MomentScenes(makers, self._states, self._inputs)
        if makers.configs.with_timers and conditions.can & Feature.CONFIG:
            timed: dict[Callable[[], ToldSlots], float] = {
                self._renewals: 0.15,
                self._timed_pair: 0.4,
                self._watched: 0.1,
                self._filled: 0.3,
            }
            return timed | {partial(moments.pause, timed=True): 0.1 * conditions.exact}
        memories = MemoryScenes(makers, self._inputs)
        return {
            memories.sessions: 0.07,
            memories.numbers: 0.05,
            memories.ring: 0.04 * memories.has_ring,
            moments.trios: 0.08,
            moments.turns: 0.1 * conditions.exact,
            partial(moments.pause, timed=False): 0.05 * conditions.exact,
            self._byte_values: 0.08,
            self._defects: 0.14,
            self._quick_pair: 0.5,
            self._long: 0.07 * (makers.plays and conditions.fast),
            self._late_until_status: 0.2 * makers.configs.with_status,
        }

    def scene(self) -> ToldSlots:
        """Return the frames of a scene, slot by slot, and requests that show what it changed."""
        (make,) = self._random.choices(list(self._kinds), list(self._kinds.values()))
        return [*make(), self._makers.probe()]

    def before_hello(self) -> ToldSlots:
        """Return frames for slots in which the board has no session."""
        names = [name for name in self._inputs.names if name not in _OPENS]
        return [
            [told for _ in range(_EARLY) for told in self._inputs.told(self._random.choice(names))]
            for _ in range(_EARLY_SLOTS)
        ]

    # --- with timers that end ------------------------------------------------------------------

    def _renewals(self) -> ToldSlots:
        """Return leases of about a slot, each with a frame that renews it or does not."""
        found: ToldSlots = [self._states.begun(1)]
        for _ in range(_RENEWALS):
            (name,) = self._next("renewals", lambda: ((name,) for name in self._inputs.names))
            found += [self._inputs.told(name), [], [self._makers.frame(Arm())]]
        return found[:-1]

    def _timed_pair(self) -> ToldSlots:
        timed, groups = self._states.timed, self._inputs.groups
        state, group = self._next("states with timers", lambda: product(timed, groups))
        told = self._inputs.told(self._random.choice(groups[group]))
        return [*timed[state](), told, *self._silent(self._random.choice(_SILENT))]

    def _watched(self) -> ToldSlots:
        """Return one field set in a state with a timer, at times again, and read-backs meanwhile.

        Neither ends the ramp of a hold.
        """
        timed, names = self._states.timed, [field.name for field in fields(Config)]
        ramps = [state for state in timed if "ramp" in state]
        likely = [*product(ramps, _OF_RAMPS)] * _LIKELY
        state, name = self._next("changes with timers", lambda: [*product(timed, names), *likely])
        found = timed[state]()
        for slot in range(_WATCHED):
            told = self._makers.read_backs()
            if slot == 0 or self._random.random() < _SET_AGAIN:
                config = self._makers.configs.changed(name)  # of the one that is in force
                told = [self._makers.frame(SetConfig(config)), *told]
            found.append(told)
        return found

    def _filled(self) -> ToldSlots:
        """Return a state and the same input in each slot behind it, but for one."""
        states = self._states.quick | self._states.timed
        state, filler = self._next("fillers", lambda: product(states, _FILLERS))
        keeping = [self._makers.keeping()]
        slots = [
            self._inputs.told(filler) if filler else list(keeping)
            for _ in range(self._random.choice(_FILLED))
        ]
        if self._random.random() < 0.5:
            name = self._random.choice(self._inputs.names)
            slots[self._random.randrange(len(slots))] = self._inputs.told(name)
        return [*states[state](), [], *slots]

    # --- without ---------------------------------------------------------------------------------

    def _quick_pair(self) -> ToldSlots:
        quick, groups = self._states.quick, self._inputs.groups
        state, group = self._next("states", lambda: product(quick, groups))
        found = [*quick[state](), self._inputs.told(self._random.choice(groups[group]))]
        if self._random.random() < 0.5:  # does all go on?
            found.append([*self._states.begun(), *self._makers.row(_FRAMES, SLOT_US // 2)])
        return found

    def _late_until_status(self) -> ToldSlots:
        """Return a late frame, and silence until a STATUS has told its margin."""
        return [[*self._states.begun(), self._inputs.frame("late")], *self._silent(_STATUS_SLOTS)]

    def _long(self) -> ToldSlots:
        """Return more latches and events than 8 or 10 bits count, or more bytes than 16 bits."""
        names = [("events",), ("records",), *[("an upload",)] * self._makers.conditions.exact]
        (name,) = self._next("long", lambda: names)
        if name == "an upload":
            steps = [*self._states.traced(TraceMode.CRC), *self._makers.long_upload()]
            steps.append(self._makers.short_play())
            slots = [steps[at : at + _CHUNKS] for at in range(0, len(steps), _CHUNKS)]
        else:
            mode = TraceMode.CRC if name == "events" else TraceMode.RING
            slots = [[*self._states.traced(mode), self._makers.long_play(_LONG_LOOPS)]]
        return [*slots, *self._silent(_LONG_SLOTS)]

    def _defects(self) -> ToldSlots:
        """Return requests with a defect each."""
        names = (self._next("defects", self._inputs.defects) for _ in range(_DEFECTS))
        return [[self._inputs.defective(*name)] for name in names]

    def _byte_values(self) -> ToldSlots:
        """Return slots of frames with one byte that has any value, and a probe behind each."""
        conditions = self._makers.conditions
        most = _BYTES // (64 + 2 * conditions.identity.transducers)
        number = max(1, min(_BYTE_FRAMES[conditions.exact], most))
        found: ToldSlots = []
        for _ in range(_BYTE_SLOTS):
            found.append([self._inputs.with_any_byte() for _ in range(number)])
            found.append([self._makers.frame(Stop()), *self._makers.probe()])
        return found

    def _silent(self, slots: int) -> ToldSlots:
        return [list[Told]() for _ in range(slots)]
