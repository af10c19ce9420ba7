"""Boards that repeat an answer wrongly, or forget it, or its time.  SPEC.md HG-4.6 to HG-4.11."""

# ruff: noqa: SLF001 -- a mutant differs from the healthy board inside

from __future__ import annotations

import dataclasses
from typing import Any, ClassVar, Final

from haptogram.records.frame import Evidence
from haptogram_protocol.connection import BoardConnection
from haptogram_protocol.messages import Hello, HelloReply, Mute, MuteReply, UploadCommit
from sim_device.dialects.haptogram import VirtualHaptogramDialect
from sim_device.mutants import Mutant


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
            return self._drop(frame, "repeated")
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


class RepetitionByHalfCrc(BoardConnection):
    """Keeps 16 bits of the CRC by which it knows a repetition."""

    def _judge_control_seq(self, frame: Any) -> Any:
        answered = self._answered
        if answered and not (answered.crc ^ frame.crc) & 0xFFFF:
            frame = dataclasses.replace(frame, crc=answered.crc)
        return super()._judge_control_seq(frame)


class MuteAnsweredTwice(BoardConnection):
    """Answers MUTE where it is found and once more in its turn, if it is of another session."""

    def reply(self, request: Any, message: Any, now_us: int) -> None:
        """Answer, twice."""
        super().reply(request, message, now_us)
        if isinstance(message, MuteReply) and request.session != self.session:
            super().reply(request, message, now_us)


class MuteSetsNumbersBack(BoardConnection):
    """Takes the number of a MUTE of the session for the newest one, also where it is behind."""

    def _request(self, frame: Any, message: Any, **how: Any) -> Any:
        event = super()._request(frame, message, **how)
        if isinstance(message, Mute) and frame.in_session:
            self._control_newest = frame.header.seq
        return event


class LostRequestsDone(BoardConnection):
    """Carries out a request that is older than the MUTE before it, as if MUTE had no number."""

    def _request(self, frame: Any, message: Any, **how: Any) -> Any:
        newest = self._control_newest
        event = super()._request(frame, message, **how)
        if isinstance(message, Mute):
            self._control_newest = newest
        return event


class HelloAgainRestartsEvents(BoardConnection):
    """Numbers events from 0 again when a HELLO is repeated."""

    def _judge_hello(self, frame: Any, hello: Hello) -> Any:
        event = super()._judge_hello(frame, hello)
        if hello.nonce == self.session:
            self._event_seq = 0
        return event


class GreetingOfNow(VirtualHaptogramDialect):
    """Repeats HELLO_REPLY with the speed of sound and the config_crc of now."""

    def _set_config(self, message: Any, request: Any) -> Any:
        reply = super()._set_config(message, request)
        if (first := self._link._greeting) is not None:
            speed = self.board.output.config.sound_speed_mm_s
            now = dataclasses.replace(
                first, sound_speed_mm_s=speed, config_crc=self.board.config_crc
            )
            self._link._greeting = now
        return reply


class SessionZeroIsOpen(BoardConnection):
    """Takes session 0 for the open one before the first HELLO."""

    def _judge_stream(self, frame: Any) -> Any:
        return super()._judge_stream(self._taken(frame))

    def _judge_request(self, frame: Any) -> Any:
        return super()._judge_request(self._taken(frame))

    def _taken(self, frame: Any) -> Any:
        return dataclasses.replace(frame, in_session=frame.header.session == self.session)


class MinorEchoed(VirtualHaptogramDialect):
    """States the minor version of the host in HELLO_REPLY."""

    def _greet(self, hello: Hello, request: Any) -> None:
        answer = self._link.reply

        def reply(request: Any, message: Any, now_us: int) -> None:
            answer(request, dataclasses.replace(message, minor=hello.minor), now_us)

        self._link.reply = reply  # type: ignore[method-assign]
        super()._greet(hello, request)
        self._link.reply = answer  # type: ignore[method-assign]


class RepliesReturn(BoardConnection):
    """Keeps the remembered reply over a new session, until its own session is opened again."""

    def open_session(self, nonce: int) -> None:
        """Open a session, and leave the reply of the one before."""
        answered = self._answered
        super().open_session(nonce)
        self._answered = answered

    def reply(self, request: Any, message: Any, now_us: int) -> None:
        """Answer, and leave it as it is for a HELLO."""
        answered = self._answered
        super().reply(request, message, now_us)
        if isinstance(message, HelloReply):
            self._answered = answered


class RepetitionsRenewNothing(BoardConnection):
    """Answers a repeated request from memory without renewing the lease."""

    def _drop(self, frame: Any, reason: str) -> Any:
        event = super()._drop(frame, reason)
        return dataclasses.replace(event, renews_lease=False) if reason == "repeated" else event


class _RemembersOverAReset(VirtualHaptogramDialect):
    """Has a memory that outlives a reset, behind which a board has the next seed."""

    _memory: ClassVar[tuple[int, Any]] = (-1, None)  # seed of the board that wrote it, contents

    def __init__(self, *parts: Any) -> None:
        super().__init__(*parts)
        seed, left = type(self)._memory
        self._remember(left if seed == self.board.settings.seed - 1 else None)

    def _remember(self, left: Any) -> None:
        type(self)._memory = self.board.settings.seed, left


class ConfigurationLeftInMemory(_RemembersOverAReset):
    """Finds ceiling and speed of sound of before a reset, which start-up leaves in its memory."""

    def __init__(self, *parts: Any) -> None:
        super().__init__(*parts)
        _, left = self._memory
        if left is not None:
            speed, ceiling = left.sound_speed_mm_s, left.amplitude_ceiling
            config = dataclasses.replace(
                self.board.output.config, sound_speed_mm_s=speed, amplitude_ceiling=ceiling
            )
            self.board.configure(config)

    def _set_config(self, message: Any, request: Any) -> Any:
        reply = super()._set_config(message, request)
        self._remember(message.config)
        return reply


class SequencesOutliveAReset(_RemembersOverAReset):
    """Finds the sequences of before a reset in its memory."""

    def __init__(self, *parts: Any) -> None:
        super().__init__(*parts)
        _, left = self._memory
        self.board._sequences.update(left or {})

    def _reply_to(self, message: Any, request: Any) -> Any:
        reply = super()._reply_to(message, request)
        if isinstance(message, UploadCommit):
            self._remember(dict(self.board._sequences))
        return reply


_WIRE: Final = Evidence.WIRE

MUTANTS: Final = (
    Mutant.of(GreetingRepeated, "HG-4.6/1", _WIRE),
    Mutant.of(RepetitionsOfNow, "HG-4.11/6", _WIRE),
    Mutant.of(RefusalsOfArrival, "HG-4.11/2", _WIRE),
    Mutant.of(MuteForgetsTheReply, "HG-4.9/5", _WIRE),
    Mutant.of(MuteSetsNumbersBack, "HG-4.9/3", _WIRE),
    Mutant.of(RepetitionByHalfCrc, "HG-4.9/2", _WIRE),
    Mutant.of(MuteAnsweredTwice, "HG-4.11/1", _WIRE),
    Mutant.of(LostRequestsDone, "HG-4.9/5", _WIRE),
    Mutant.of(HelloAgainRestartsEvents, "HG-3.6/2", _WIRE),
    Mutant.of(GreetingOfNow, "HG-4.6/1", _WIRE),
    Mutant.of(SessionZeroIsOpen, "HG-4.12/1", _WIRE),
    Mutant.of(MinorEchoed, "HG-4.2/1", _WIRE),
    Mutant.of(RepliesReturn, "HG-4.6/4", Evidence.SELF_REPORTED),
    Mutant.of(RepetitionsRenewNothing, "HG-6.7/1", _WIRE),
    Mutant.of(ConfigurationLeftInMemory, "HG-7.1/4", Evidence.SELF_REPORTED),
    Mutant.of(SequencesOutliveAReset, "HG-7.4/5", _WIRE),
)
