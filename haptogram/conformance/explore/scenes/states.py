"""States that a board is brought into, each by the frames of some slots."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from functools import partial
from typing import Final

from haptogram_protocol.messages import (
    Arm,
    Disarm,
    Feature,
    Mute,
    SetConfig,
    TraceMode,
)

from ..actions import SLOT_US
from ..makers.makers import DialogueMakers
from ..makers.stream import MadeAction
from ..tables.limit_requests import MANY_LOOPS

#: Frames of one slot after the other.
Slots = list[list[MadeAction]]

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
    makers : DialogueMakers
        Makers of the frames.
    """

    def __init__(self, makers: DialogueMakers) -> None:
        self._random = makers.conditions.random
        self._configs = makers.configs
        self._stream, self._requests = stream, requests = makers.stream, makers.requests
        self._is_configurable = bool(makers.conditions.can & Feature.CONFIG)
        self._quick: dict[str, Callable[[], Slots]] = {
            "disarmed": lambda: [[self._plain(Disarm())]],
            "armed": lambda: [[self._plain(Arm())]],
            "sounding": lambda: [[*self._begun(), self._frame()]],
            "with a frame in the queue": lambda: [[*self._begun(), stream.plain("far")]],
            "with a full queue": lambda: [self._begun(), stream.full_queue()],
            "muted": lambda: [[*self._begun(), self._frame()], [self._plain(Mute())]],
            "muted by another host": lambda: [[*self._begun(), self._frame()], [self._foreign()]],
        }
        if self._is_configurable:
            self._quick["with a ring that has a hole"] = self._hole
            self._quick["with latches of which some are traced"] = lambda: [self._traced()]
        self._timed: dict[str, Callable[[], Slots]] = {}
        if requests.plays:
            self._quick |= {
                "with a playback that waits": lambda: [[*self._begun(), self._play(100.0, _LOOPS)]],
                "in an upload": lambda: [requests.uploads.upload()[:2]],
            }
            self._timed |= {
                "in a playback": lambda: [[*self._begun(), self._play(0.5, 0)], []],
                "behind a playback": lambda: [[*self._begun(3), self._play(0.5, 1)], []],
                "in a playback, unattended": lambda: [*self._unattended(), []],
                "muted as unattended": lambda: [*self._unattended(), *[[]] * 5],
                "with a playback that soon begins": lambda: [[*self._begun(2), self._play(4.5, 1)]],
            }
        if self._is_configurable:
            if requests.plays:
                self._timed["in the hold, before a playback"] = lambda: [
                    [*self._begun(hold=4), self._play(7.5, 1), self._frame()],
                    [],
                ]
            for name, lengths in _TIMERS.items():
                self._timed[name] = partial(self._with_timers, *lengths)

    @property
    def quick(self) -> list[str]:
        """Names of the states in which no timer runs that ends soon."""
        return list(self._quick)

    @property
    def timed(self) -> list[str]:
        """Names of the states in which a timer runs, or has run."""
        return list(self._timed)

    def slots(self, state: str) -> Slots:
        """Return the frames that bring a board into *state*, slot by slot."""
        return (self._quick | self._timed)[state]()

    def lease(self) -> list[MadeAction]:
        """Return the requests that let a lease of little more than a slot run."""
        return self._begun(1)

    def traced(self, mode: TraceMode) -> list[MadeAction]:
        """Return requests after which each latch is traced, and no timer ends."""
        if not self._is_configurable:
            return self._begun()
        config = self._configs.traced_config(mode, 1)
        return [self._plain(Disarm()), self._plain(SetConfig(config)), self._plain(Arm())]

    def _with_timers(
        self, lease: int | None, hold: int | None, ramp_ms: int | None, sounds: bool, silent: int
    ) -> Slots:
        begun = self._begun(lease, hold=hold, ramp_ms=ramp_ms)
        return [[*begun, self._frame()] if sounds else begun, *[[]] * silent]

    # --- steps ---------------------------------------------------------------------------------

    def _begun(
        self, lease: int | None = None, *, hold: int | None = None, ramp_ms: int | None = None
    ) -> list[MadeAction]:
        """Return SET_CONFIG, if lengths in slots are given, and ARM."""
        if (lease is None and hold is None) or not self._is_configurable:
            return [self._plain(Arm())]
        config = self._configs.timed_config(lease, hold, ramp_ms)
        return [self._plain(Disarm()), self._plain(SetConfig(config)), self._plain(Arm())]

    def _traced(self) -> list[MadeAction]:
        """Return SET_CONFIG with a divider, and frames of which not all are traced."""
        config = self._configs.traced_config(None, self._random.choice((2, 3)))
        return [self._plain(SetConfig(config)), self._plain(Arm()), *self._latches()]

    def _hole(self) -> Slots:
        """Return latches of which the ring keeps the first and the last ones only."""
        ring = self._configs.traced_config(TraceMode.RING, 1)
        off = dataclasses.replace(ring, trace_mode=TraceMode.OFF)
        return [
            [self._plain(SetConfig(config)), self._plain(Arm()), *self._latches()]
            for config in (ring, off, ring)
        ]

    def _latches(self) -> list[MadeAction]:
        return self._stream.row(self._random.randint(1, 5), SLOT_US // 2)

    def _unattended(self) -> Slots:
        return [[*self._begun(3), self._play(0.5, _LOOPS, self._configs.short_unattended_ms)]]

    def _plain(self, message: Arm | Disarm | Mute | SetConfig) -> MadeAction:
        return self._requests.plain(message)

    def _foreign(self) -> MadeAction:
        return self._requests.defective(Mute(), ["another session"])

    def _frame(self) -> MadeAction:
        return self._stream.plain(None)

    def _play(
        self, later: float, loops: int | tuple[int, ...], unattended_ms: int | None = None
    ) -> MadeAction:
        if isinstance(loops, tuple):
            loops = self._random.choice(loops)
        return self._requests.start(later=later, loops=loops, unattended_ms=unattended_ms)
