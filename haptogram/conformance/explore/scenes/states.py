"""States that a board is brought into, each by the frames of some slots."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from functools import partial
from typing import Final

from haptogram_protocol.messages import Arm, Disarm, Feature, Message, Mute, SetConfig, TraceMode

from ..actions import SLOT_US
from ..makers.conditions import Told, ToldSlots
from ..makers.limit_requests import MANY_LOOPS
from ..makers.requests import RandomRequests

#: Of a playback that goes on: 0 for ever; 2 or 3 frames wrap a product of 32 bits.
_LOOPS: Final = (0, 0, *MANY_LOOPS)
_RAMP_MS: Final = 178  # ends some slots later, at the same part of one as other ramps
#: States in which timers run, or have run: lease and hold in slots (None: it never ends), ramp,
#: whether a frame sounds, and the silent slots that lead there.
_TIMERS: Final[dict[str, tuple[int | None, int | None, int | None, bool, int]]] = {
    "with a lease that runs": (1, None, None, False, 0),
    "in the hold": (None, 4, None, True, 1),
    "in the ramp of the hold": (None, 2, _RAMP_MS, True, 3),
    "in the ramp of the lease": (1, None, _RAMP_MS, True, 2),
    "in the ramp of the hold, the lease out too": (3, 2, _RAMP_MS, True, 4),
    "in the ramp of the lease, the hold out too": (1, 2, _RAMP_MS, True, 3),
    "muted by the hold": (None, 2, 0, True, 3),
    "muted by the lease": (1, None, 0, True, 2),
}


class SceneStates:
    """Brings a board into a state.

    Parameters
    ----------
    makers : RandomRequests
        Makes frames.

    Attributes
    ----------
    quick, timed : dict of str to callable
        Make the frames that bring a board into a state, slot by slot: states in which no timer
        runs that ends soon, and in which one runs or has run.
    """

    def __init__(self, makers: RandomRequests) -> None:
        self._makers, self._random = makers, makers.conditions.random
        self._is_configurable = bool(makers.conditions.can & Feature.CONFIG)
        self.quick: dict[str, Callable[[], ToldSlots]] = {
            "disarmed": lambda: [[makers.frame(Disarm())]],
            "armed": lambda: [self.begun()],
            "sounding": lambda: [[*self.begun(), self._frame()]],
            "with a frame in the queue": lambda: [[*self.begun(), self._frame("far")]],
            "with a full queue": lambda: [self.begun(), makers.full_queue()],
            "muted": lambda: [[*self.begun(), self._frame()], [makers.frame(Mute())]],
            "muted by another host": lambda: [
                [*self.begun(), self._frame()],
                [makers.defective(Mute(), "another session")],
            ],
        }
        self.timed: dict[str, Callable[[], ToldSlots]] = {}
        if makers.plays:
            self._add_playbacks()
        if self._is_configurable:
            self.quick["with a ring that has a hole"] = self._hole
            self.quick["with latches of which some are traced"] = lambda: [
                [*self.traced(None, self._random.choice((2, 3))), *self._latches()]
            ]
            for name, lengths in _TIMERS.items():
                self.timed[name] = partial(self._with_timers, *lengths)

    def _add_playbacks(self) -> None:
        def play(at: float, loops: int | None = None) -> Told:
            return self._makers.start(at, self._random.choice(_LOOPS) if loops is None else loops)

        self.quick |= {
            "with a playback that waits": lambda: [[*self.begun(), play(100.0)]],
            "in an upload": lambda: [self._makers.upload()[:2]],
        }
        self.timed |= {
            "in a playback": lambda: [[*self.begun(), play(0.5, 0)], []],
            "behind a playback": lambda: [[*self.begun(3), play(0.5, 1)], []],
            "in a playback, unattended": lambda: [*self._unattended(), []],
            "muted as unattended": lambda: [*self._unattended(), *[[]] * 5],
            "with a playback that soon begins": lambda: [[*self.begun(2), play(4.5, 1)]],
            "in the hold, before a playback": lambda: [
                [*self.begun(hold=4), play(7.5, 1), self._frame()],
                [],
            ],
        }

    def begun(
        self, lease: int | None = None, hold: int | None = None, ramp_ms: int | None = None
    ) -> list[Told]:
        """Return ARM, behind SET_CONFIG if lengths in slots are given."""
        if (lease is None and hold is None) or not self._is_configurable:
            return [self._makers.frame(Arm())]
        config = self._makers.configs.timed_config(lease, hold, ramp_ms)
        return self._frames(Disarm(), SetConfig(config), Arm())

    def traced(self, mode: TraceMode | None, divider: int = 1) -> list[Told]:
        """Return requests after which latches are traced, and no timer ends."""
        if not self._is_configurable:
            return self.begun()
        config = self._makers.configs.traced_config(mode, divider)
        return self._frames(Disarm(), SetConfig(config), Arm())

    def _with_timers(
        self, lease: int | None, hold: int | None, ramp_ms: int | None, sounds: bool, silent: int
    ) -> ToldSlots:
        frame = [self._frame()] * sounds
        return [[*self.begun(lease, hold, ramp_ms), *frame], *([] for _ in range(silent))]

    def _hole(self) -> ToldSlots:
        """Return latches of which the ring keeps the first and the last ones only."""
        ring = self._makers.configs.traced_config(TraceMode.RING, 1)
        off = dataclasses.replace(ring, trace_mode=TraceMode.OFF)
        return [
            [*self._frames(SetConfig(config), Arm()), *self._latches()]
            for config in (ring, off, ring)
        ]

    def _latches(self) -> list[Told]:
        return self._makers.row(self._random.randint(1, 5), SLOT_US // 2)

    def _unattended(self) -> ToldSlots:
        loops, length_ms = self._random.choice(_LOOPS), self._makers.configs.short_unattended_ms
        return [[*self.begun(3), self._makers.start(0.5, loops, length_ms)]]

    def _frame(self, at: str | None = None) -> Told:
        return self._makers.frame(self._makers.any(), at)

    def _frames(self, *messages: Message) -> list[Told]:
        return [self._makers.frame(message) for message in messages]
