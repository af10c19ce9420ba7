"""Scenes: a state, the inputs in it, and timers that run out during both."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields
from functools import partial
from itertools import product
from typing import Final

from haptogram_protocol import messages as m

from ..actions import ActionSlots, DialogueAction
from ..makers.frames import HELLOS
from .inputs import SceneInputs
from .memories import MemoryScenes
from .moments import MomentScenes
from .states import SceneMaker

_SILENT: Final = (3, 3, 6)  # slots, until timers have ended
_FILLED: Final = (4, 5, 5, 7)  # slots in which timers run
#: States with a running output.
_RUNNING: Final = (
    *("ARM", "ARM + a frame ahead", "ARM + frames of some slots", "ARM + PLAY in half a slot"),
    *("another configuration + ARM + a frame at once", "timers - 4 - + a frame at once"),
    *("another configuration + ARM + a frame ahead", "timers 3 4 - + a frame ahead"),
    "another configuration + ARM + PLAY in half a slot",
)
#: Inputs of each slot: nothing, one that renews no lease, or (empty) a request that does.
_FILLERS: Final = ("nothing", "nothing", "damage 1", "damage 2", "damage 5", "a foreign frame", "")
_RENEWALS: Final = 4  # renewals in a scene
_DEFECTS: Final = 6  # malformed requests in a scene
_WATCHED: Final = 8  # slots, of a ramp that lasts for four
_SET_AGAIN: Final = 0.3  # share of the slots that set the field again
_OF_RAMPS: Final = ("amplitude_ceiling", "ramp_ms")  # what a ramp keeps: set in each of them
_LIKELY: Final = 6  # times as often as other fields
_STATUS_SLOTS: Final = 7  # slots until the next STATUS
_LONG_SLOTS: Final = 14  # slots until hundreds of frames were played
_CHUNKS: Final = 16  # chunks in a slot
_EARLY_SLOTS: Final = 6  # slots before the first HELLO
_EARLY: Final = 3  # inputs in each of them
_OPENS: Final = {f"HELLO {which}" for which in HELLOS} - {"HELLO 0", "HELLO next major"}
_VALUE_SLOTS: Final = 3
_VALUE_FRAMES: Final = {True: 24, False: 5}  # frames where bytes take no time, and where they do
_BYTES: Final = 8000  # most bytes of a slot
_DISTURBED: Final = 0.5  # share of the scenes with one different input
_GOES_ON: Final = 0.5  # share of the scenes that test whether a stream goes on


class RandomScenes(SceneMaker):
    """Makes scenes, each different from all earlier ones of the run."""

    def __init__(self, inputs: SceneInputs) -> None:
        super().__init__(inputs)
        self._kinds = self._shares()

    def _shares(self) -> dict[Callable[[], ActionSlots], float]:
        """Return the functions that make scenes, each with its probability weight.

        They are others where timers may end.
        """
        makers, conditions = self._makers, self._makers.conditions
        moments, memories = MomentScenes(self._inputs), MemoryScenes(self._inputs)
        if makers.configs.with_timers:
            return {
                self._renewals: 0.13,
                self._timed_pair: 0.37,
                self._watched: 0.1,
                self._filled: 0.35,
                partial(moments.pause, timed=True): 0.1 * conditions.exact,
            }
        return {
            memories.sessions: 0.07,
            memories.numbers: 0.05,
            memories.ring: 0.04 * (m.Feature.TRACE_RING in conditions.can),
            moments.trios: 0.08,
            moments.turns: 0.1 * conditions.exact,
            partial(moments.pause, timed=False): 0.05 * conditions.exact,
            self._values: 0.08,
            self._defects: 0.14,
            self._quick_pair: 0.5,
            self._long: 0.07 * (makers.plays and conditions.fast),
            self._late_until_status: 0.2 * makers.configs.with_status,
            self._filled: 0.6 * makers.configs.with_status,
        }

    def scene(self) -> ActionSlots:
        """Return the frames of a scene, slot by slot, and requests that show what it changed."""
        (make,) = self._random.choices(list(self._kinds), list(self._kinds.values()))
        return [*make(), self._makers.probe()]

    def before_hello(self) -> ActionSlots:
        """Return frames for slots in which the board has no session."""
        names = [name for name in self._inputs.names if name not in _OPENS]
        return [
            [
                action
                for _ in range(_EARLY)
                for action in self._inputs.named(self._random.choice(names))
            ]
            for _ in range(_EARLY_SLOTS)
        ]

    # --- with timers that end ------------------------------------------------------------------

    def _renewals(self) -> ActionSlots:
        """Return slots of 40 ms that show which inputs renew a short lease.

        4 times an input, then an empty slot; ARM is in the slot between two of them.
        """
        found = self._inputs.slots("timers 1 - -")
        for _ in range(_RENEWALS):
            (name,) = self._next("renewals", lambda: ((name,) for name in self._inputs.names))
            found += self._inputs.slots(f"{name} | | ARM")
        return found[:-1]

    def _timed_pair(self) -> ActionSlots:
        """Return slots of 40 ms: a state in which timers run, one input, 3 or 6 silent ones."""
        return [
            *self._pair("states with timers", self.timed),
            *self._silent(self._random.choice(_SILENT)),
        ]

    def _watched(self) -> ActionSlots:
        """Return a timed state, then 8 slots of 40 ms that set and read back the configuration.

        Every slot reads all that can be read; the first one and some others first set one field
        anew. Neither setting nor reading may end the ramp of a hold.
        """
        names = [field.name for field in fields(m.Config)]
        ramps = [state for state in self.timed if "ramp" in state]
        likely = [*product(ramps, _OF_RAMPS)] * _LIKELY
        state, name = self._next(
            "changes with timers", lambda: [*product(self.timed, names), *likely]
        )
        found = self._state(state)
        for slot in range(_WATCHED):
            actions = self._makers.read_backs()
            if slot == 0 or self._random.random() < _SET_AGAIN:  # of the one that is in force
                actions = [*self._inputs.named(f"another {name}"), *actions]
            found.append(actions)
        return found

    def _filled(self) -> ActionSlots:
        """Return slots of 40 ms: a running output, then the same input in 4 to 7 of them.

        In half of the scenes one of them has another input.
        """
        rows = [row for row in _RUNNING if self._inputs.knows(row)]
        row, filler = self._next("fillers", lambda: product(rows, _FILLERS))
        keeping = self._makers.keeping()
        slots = [
            self._inputs.named(filler) if filler else [keeping]
            for _ in range(self._random.choice(_FILLED))
        ]
        if self._random.random() < _DISTURBED:
            kind = self._random.choice(list(self._inputs.kinds.values()))
            place = self._random.randrange(len(slots))
            slots[place] = self._inputs.named(self._random.choice(kind))
        return [*self._inputs.slots(row), [], *slots]

    # --- without ---------------------------------------------------------------------------------

    def _quick_pair(self) -> ActionSlots:
        """Return slots of 40 ms: a state without timers, then one input.

        Half of the scenes end with ARM and stream frames, to show whether the stream goes on.
        """
        found = self._pair("states", self.quick)
        if self._random.random() < _GOES_ON:
            found += self._inputs.slots("ARM + frames")
        return found

    def _pair(self, kind: str, states: list[str]) -> ActionSlots:
        """Return slots of 40 ms that bring the board into a state of *states*, then one input.

        Over time every state meets every group of inputs; a group is inputs that a state likely
        treats alike. *kind* is the name of the list of these pairs, which is worked off.
        """
        groups = self._inputs.groups
        state, group = self._next(kind, lambda: product(states, groups))
        return [*self._state(state), self._inputs.named(self._random.choice(groups[group]))]

    def _late_until_status(self) -> ActionSlots:
        """Return slots of 40 ms: a late frame, then 7 silent ones, for a STATUS with its margin."""
        return self._inputs.slots("ARM + a late frame" + " |" * _STATUS_SLOTS)

    def _long(self) -> ActionSlots:
        """Return a scene of one long PLAY or a long upload.

        It overflows counters of 8 and 10 bits, or a 16-bit byte count.
        """
        rows = ["traces + a long PLAY", "a ring + a long PLAY"]
        rows += ["traces + a long upload + a short PLAY"] * self._makers.conditions.exact
        (row,) = self._next("long", lambda: ((row,) for row in rows))
        (actions,) = self._inputs.slots(row)
        slots = [actions[at : at + _CHUNKS] for at in range(0, len(actions), _CHUNKS)]
        return [*slots, *self._silent(_LONG_SLOTS)]

    def _defects(self) -> ActionSlots:
        """Return 6 slots of 40 ms with one malformed request each."""
        names = (self._next("defects", self._inputs.defects) for _ in range(_DEFECTS))
        return [[self._inputs.defective(*name)] for name in names]

    def _values(self) -> ActionSlots:
        """Return slots of 40 ms with random field values, in 3 pairs.

        The first of a pair has stream frames or requests with any values; the second has STOP and
        requests that read what they changed.
        """
        conditions = self._makers.conditions
        most = _BYTES // (64 + 2 * conditions.identity.transducers)
        number = max(1, min(_VALUE_FRAMES[conditions.exact], most))
        found: ActionSlots = []
        for _ in range(_VALUE_SLOTS):
            found.append([self._inputs.with_any_value() for _ in range(number)])
            found.append([self._makers.frame(m.Stop()), *self._makers.probe()])
        return found

    def _silent(self, slots: int) -> ActionSlots:
        """Return so many *slots* of 40 ms without any action."""
        return [list[DialogueAction]() for _ in range(slots)]
