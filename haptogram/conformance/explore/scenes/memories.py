"""Scenes of memory: sessions that come back, numbers that wrap, a ring with holes."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from functools import partial
from itertools import product
from typing import Final

from haptogram_protocol.messages import Arm, Feature, Mute, ReadTrace, SetConfig, TraceMode

from ..actions import SLOT_US
from ..makers.conditions import Told, ToldSlots
from ..makers.requests import RandomRequests
from .inputs import SceneInputs

_NUMBERS: Final = 8
_STEPS: Final = 12  # of three sessions
_TOGETHER: Final = 0.3  # of the steps come with the one before
_SEGMENTS: Final = 5  # of a ring
_LATCHES: Final = (0, 1, 2, 3, 6)
_READS: Final = 4
#: Inputs that a session, or its memory of requests, may change.
_INPUTS: Final = (
    *("HELLO new", "HELLO last", "HELLO earlier", "HELLO open", "ARM", "MUTE", "foreign MUTE"),
    *("a foreign frame", "the remembered request again"),
)


class MemoryScenes:
    """Makes scenes of what a board remembers.

    Parameters
    ----------
    makers : RandomRequests
        Makes frames.
    inputs : SceneInputs
        Makes what a board is told.
    """

    def __init__(self, makers: RandomRequests, inputs: SceneInputs) -> None:
        self._makers, self._inputs, self._conditions = makers, inputs, makers.conditions
        self._steps: dict[str, Callable[[], Told]] = {
            "the same HELLO": partial(makers.again, "hello", 0),
            "the HELLO of a session before": partial(makers.again, "hello", 1),
            "the first request of this nonce": partial(makers.again, "first", 0),
            "the first request of a session before": partial(makers.again, "first", 1),
            "the last request of a session before": partial(makers.again, "last", 1),
            "a request": makers.keeping,
            "a frame": lambda: inputs.frame(None if self._conditions.exact else 0.5),
            **{name: partial(self._input, name) for name in _INPUTS},
        }

    @property
    def has_ring(self) -> bool:
        """True if the board keeps latches that a dialogue may choose."""
        needed = Feature.TRACE_RING | Feature.CONFIG
        return self._conditions.can & needed == needed

    def sessions(self) -> ToldSlots:
        """Return sessions that come back, with what was sent in them before."""
        makers = self._makers
        steps = [makers.greeting(), makers.keeping(), makers.hello("new")]
        names: list[str] = []
        while len(names) < _STEPS:
            names += self._conditions.next(
                "steps of sessions", lambda: product(self._steps, repeat=2)
            )
        steps += [self._steps[name]() for name in names]
        found: ToldSlots = []
        for told in steps:
            is_alone = told.name == Mute.TYPE.name or not self._conditions.exact
            if found and not is_alone and self._conditions.random.random() < _TOGETHER:
                found[-1].append(told)
            else:
                found.append([told])
        return found

    def numbers(self) -> ToldSlots:
        """Return requests around the wrap of their numbers, each of them twice."""
        makers = self._makers
        twice = [[makers.keeping(), makers.repeated()] for _ in range(_NUMBERS)]
        return [[makers.greeting()], *twice]

    def ring(self) -> ToldSlots:
        """Return latches of which the ring keeps some, and requests for parts of them."""
        makers, source = self._makers, self._conditions.random
        kept = makers.configs.traced_config(TraceMode.RING, 1)
        modes = [TraceMode.RING, TraceMode.RING, *makers.configs.modes()]
        found: ToldSlots = []
        total = 0
        for _ in range(_SEGMENTS):
            mode, divider = source.choice(modes), source.choice((1, 2, 7))
            mode = TraceMode.OFF if mode is TraceMode.DRIVE else mode
            config = dataclasses.replace(kept, trace_mode=mode, trace_divider=divider)
            latches = source.choice(_LATCHES)
            total += latches
            begun = [makers.frame(message) for message in (SetConfig(config), Arm())]
            found.append([*begun, *makers.row(latches, SLOT_US // 2)])
        reads = (
            ReadTrace(source.randrange(total + 3), source.choice((1, 2, 5, 0xFFFF)))
            for _ in range(_READS)
        )
        return [*found, [makers.frame(read) for read in reads]]

    def _input(self, name: str) -> Told:
        return self._inputs.told(name)[0]
