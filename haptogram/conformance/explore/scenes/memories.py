"""Scenes of memory: sessions that come back, numbers that wrap, a ring with holes."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from itertools import product
from typing import Final

from haptogram_protocol.messages import Arm, Feature, Mute, ReadTrace, SetConfig, TraceMode

from ..actions import SLOT_US
from ..makers.makers import DialogueMakers
from ..makers.stream import MadeAction
from .told import Told, ToldSlots, told_as_made

_NUMBERS: Final = 8
_STEPS: Final = 12  # of three sessions
_TOGETHER: Final = 0.3  # of the steps come with the one before
_SEGMENTS: Final = 5  # of a ring
_LATCHES: Final = (0, 1, 2, 3, 6)
_READS: Final = 4


class MemoryScenes:
    """Makes scenes of what a board remembers.

    Parameters
    ----------
    makers : DialogueMakers
        Makers of the frames.
    """

    def __init__(self, makers: DialogueMakers) -> None:
        self._conditions, self._makers = makers.conditions, makers
        self._requests, self._sessions = makers.requests, makers.sessions
        self._pick, self._next = makers.conditions.random.choice, makers.conditions.next
        stream, requests = makers.stream, makers.requests
        hello, again = makers.sessions.hello, makers.sessions.again
        self._steps: dict[str, Callable[[], MadeAction]] = {
            "HELLO new": lambda: hello("new"),
            "HELLO last": lambda: hello("last"),
            "HELLO earlier": lambda: hello("earlier"),
            "HELLO open": lambda: hello("open"),
            "the same HELLO": lambda: again("hello", 0),
            "the HELLO of a session before": lambda: again("hello", 1),
            "a request": requests.keeping,
            "ARM": lambda: requests.plain(Arm()),
            "the same request": requests.repeated,
            "the first request of this nonce": lambda: again("first", 0),
            "the first request of a session before": lambda: again("first", 1),
            "the last request of a session before": lambda: again("last", 1),
            "a frame": lambda: stream.of(None if self._conditions.exact else 0.5),
            "a foreign frame": stream.foreign,
            "MUTE": lambda: requests.plain(Mute()),
            "a foreign MUTE": lambda: requests.defective(Mute(), ["another session"]),
        }

    @property
    def has_ring(self) -> bool:
        """True if the board keeps latches that a dialogue may choose."""
        needed = Feature.TRACE_RING | Feature.CONFIG
        return self._conditions.can & needed == needed

    def sessions(self) -> ToldSlots:
        """Return sessions that come back, with what was sent in them before."""
        steps = [self._sessions.greeting(), self._requests.keeping(), self._sessions.hello("new")]
        pairs: list[str] = []
        while len(pairs) < _STEPS:
            pairs += self._next("steps of sessions", lambda: product(self._steps, repeat=2))
        steps += [self._steps[name]() for name in pairs]
        found: ToldSlots = []
        for made in steps:
            is_alone = made[0] == Mute.TYPE.name or not self._conditions.exact
            if found and not is_alone and self._conditions.random.random() < _TOGETHER:
                found[-1].append(Told(made))
            else:
                found.append([Told(made)])
        return [*found, told_as_made(self._requests.probe())]

    def numbers(self) -> ToldSlots:
        """Return requests around the wrap of their numbers, each of them twice."""
        requests = self._requests
        found = [told_as_made([self._sessions.greeting()])]
        found += [told_as_made([requests.keeping(), requests.repeated()]) for _ in range(_NUMBERS)]
        return found

    def ring(self) -> ToldSlots:
        """Return latches of which the ring keeps some, and requests for parts of them."""
        requests, source = self._requests, self._conditions.random
        kept = self._makers.configs.traced_config(TraceMode.RING, 1)
        found: ToldSlots = []
        total = 0
        for _ in range(_SEGMENTS):
            mode = self._pick((TraceMode.RING, TraceMode.RING, *self._makers.configs.modes()))
            if mode is TraceMode.DRIVE:
                mode = TraceMode.OFF
            config = dataclasses.replace(kept, trace_mode=mode, trace_divider=self._pick((1, 2, 7)))
            latches = self._pick(_LATCHES)
            total += latches
            made = [requests.plain(SetConfig(config)), requests.plain(Arm())]
            found.append(told_as_made([*made, *self._makers.stream.row(latches, SLOT_US // 2)]))
        reads = (
            ReadTrace(source.randrange(total + 3), self._pick((1, 2, 5, 0xFFFF)))
            for _ in range(_READS)
        )
        found.append(told_as_made(requests.plain(read) for read in reads))
        return [*found, told_as_made(requests.probe())]
