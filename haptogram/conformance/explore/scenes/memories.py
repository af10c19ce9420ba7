"""Scenes of memory: sessions that come back, numbers that wrap, a ring with holes."""

from __future__ import annotations

import dataclasses
from itertools import product
from typing import Final

from haptogram_protocol import messages as m

from ..actions import SLOT_US, ActionSlots
from .states import SceneMaker

_NUMBERS: Final = 8
_STEPS: Final = 12  # steps of three sessions
_TOGETHER: Final = 0.3  # share of the steps in the slot of the one before
_SEGMENTS: Final = 5  # segments of a ring
_LATCHES: Final = (0, 1, 2, 3, 6)
_READS: Final = 4
#: Inputs that a session, or its memory of requests, may change or meet.
_OF_SESSIONS: Final = (
    *("HELLO new", "HELLO last", "HELLO earlier", "HELLO open", "ARM", "MUTE", "foreign MUTE"),
    *("a foreign frame", "a keeping request", "the remembered request again"),
    *("the same HELLO", "the HELLO of a session before", "the first request of this nonce"),
    *("the first request of a session before", "the last request of a session before"),
)


class MemoryScenes(SceneMaker):
    """Makes scenes of what a board remembers."""

    def sessions(self) -> ActionSlots:
        """Return sessions that come back, with what was sent in them before."""
        exact = self._makers.conditions.exact
        steps = (*_OF_SESSIONS, "a frame at once" if exact else "a frame ahead")
        names: list[str] = []
        while len(names) < _STEPS:
            names += self._next("steps of sessions", lambda: product(steps, repeat=2))
        found = self._inputs.slots("HELLO wrapping | a keeping request | HELLO new")
        for action in (action for name in names for action in self._inputs.named(name)):
            is_alone = action.name == m.Mute.TYPE.name or not exact
            if not is_alone and self._random.random() < _TOGETHER:
                found[-1].append(action)
            else:
                found.append([action])
        return found

    def numbers(self) -> ActionSlots:
        """Return requests around the wrap of their numbers, each of them twice."""
        twice = " | a keeping request + the remembered request again"
        return self._inputs.slots("HELLO wrapping" + twice * _NUMBERS)

    def ring(self) -> ActionSlots:
        """Return more latches than the ring keeps, and requests for parts of them."""
        makers, source = self._makers, self._random
        kept = makers.configs.traced_config(m.TraceMode.RING, 1)
        modes = [m.TraceMode.RING, m.TraceMode.RING, *makers.configs.modes()]
        found: ActionSlots = []
        total = 0
        for _ in range(_SEGMENTS):
            mode, divider = source.choice(modes), source.choice((1, 2, 7))
            mode = m.TraceMode.OFF if mode is m.TraceMode.DRIVE else mode
            config = dataclasses.replace(kept, trace_mode=mode, trace_divider=divider)
            latches = source.choice(_LATCHES)
            total += latches
            begun = [makers.frame(message) for message in (m.SetConfig(config), m.Arm())]
            found.append([*begun, *makers.row(latches, SLOT_US // 2)])
        reads = (
            m.ReadTrace(source.randrange(total + 3), source.choice((1, 2, 5, 0xFFFF)))
            for _ in range(_READS)
        )
        return [*found, [makers.frame(read) for read in reads]]
