"""Boards that repeat an answer wrongly, or forget it, or its time.  SPEC.md HG-4.6 to HG-4.11."""

from __future__ import annotations

from typing import Any, Final

from haptogram.records.frame import Evidence
from haptogram_protocol.connection import BoardConnection
from haptogram_protocol.messages import Hello, HelloReply, Mute

from ..dialects.haptogram import VirtualHaptogramDialect
from .mutant import Mutant


class GreetingRepeated(BoardConnection):
    """Repeats the whole frame of HELLO_REPLY for a repeated HELLO, with the time of the first."""

    _first_us = 0

    def reply(self, request: Any, message: Any, now_us: int) -> None:
        """Answer, and remember when a HELLO was."""
        if isinstance(message, HelloReply):
            self._first_us = now_us
        super().reply(request, message, now_us)

    def _judge_hello(self, frame: Any, hello: Hello) -> Any:
        leaves, self.departure_us = self.departure_us, lambda _: self._first_us
        event = super()._judge_hello(frame, hello)
        self.departure_us = leaves
        return event


class RepetitionsOfNow(BoardConnection):
    """Builds a remembered reply anew when it is asked for again, with the time of then."""

    _last: tuple[Any, Any] | None = None

    def _answer(self, request: Any, message: Any, now_us: int) -> None:
        self._last = request, message
        super()._answer(request, message, now_us)

    def _judge_control_seq(self, frame: Any) -> Any:
        answered = self._answered
        if answered and (answered.seq, answered.crc) == (frame.header.seq, frame.crc):
            assert self._last is not None
            self._answer(*self._last, self.departure_us(frame.t_rx_us))
            return self._drop(frame, "repeated", "answered anew")
        return super()._judge_control_seq(frame)


class RefusalsOfArrival(VirtualHaptogramDialect):
    """Puts the time at which a request came into an ERROR that waits for the line."""

    def __init__(self, *parts: Any) -> None:
        super().__init__(*parts)
        self._link.departure_us = lambda t_rx_us: t_rx_us


class MuteForgetsTheReply(BoardConnection):
    """Forgets the reply that it remembers when MUTE comes."""

    def _request(self, frame: Any, message: Any, **how: Any) -> Any:
        if isinstance(message, Mute):
            self._answered = None
        return super()._request(frame, message, **how)


class LostRequestsDone(BoardConnection):
    """Carries out a request that is older than the MUTE before it, as if MUTE had no number."""

    def _request(self, frame: Any, message: Any, **how: Any) -> Any:
        newest = self._control_newest
        event = super()._request(frame, message, **how)
        if isinstance(message, Mute):
            self._control_newest = newest
        return event


_WIRE: Final = Evidence.WIRE

MUTANTS: Final = (
    Mutant.of(GreetingRepeated, "HG-4.6/1", _WIRE),
    Mutant.of(RepetitionsOfNow, "HG-4.11/6", _WIRE),
    Mutant.of(RefusalsOfArrival, "HG-4.11/2", _WIRE),
    Mutant.of(MuteForgetsTheReply, "HG-4.9/5", _WIRE),
    Mutant.of(LostRequestsDone, "HG-4.9/5", _WIRE),
)
