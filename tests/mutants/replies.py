"""Boards that say of themselves what is not so, or answer what they should not.  SPEC.md 3 to 9."""

from __future__ import annotations

import dataclasses
from typing import Any, Final

from haptogram.records.frame import Evidence
from haptogram_protocol.connection import BoardConnection
from haptogram_protocol.messages import (
    Config,
    ErrorCode,
    GeometryReply,
    GetGeometry,
    Hello,
    HelloReply,
    ReadDrive,
    UploadBegin,
    UploadBeginReply,
    UploadChunk,
    UploadCommit,
)
from sim_device.board.board import Board
from sim_device.board.refusal import RefusalError
from sim_device.dialects.haptogram import VirtualHaptogramDialect
from sim_device.mutants import Mutant


class LyingMutant(BoardConnection):
    """Answers with other words than the board's."""

    of: Any = HelloReply

    def lie(self, message: Any) -> dict[str, Any]:
        """Return the fields that are not so."""
        raise NotImplementedError

    def reply(self, request: Any, message: Any, now_us: int) -> None:
        """Answer, with a lie where there is one to tell."""
        if isinstance(message, self.of):
            message = dataclasses.replace(message, **self.lie(message))
        super().reply(request, message, now_us)


class WindowOfOneMore(LyingMutant):
    """Offers a window of one chunk more than it advertises."""

    of = UploadBeginReply

    def lie(self, message: Any) -> dict[str, Any]:
        """Return another window."""
        return {"window": message.window + 1}


class GeometryHashWrong(LyingMutant):
    """Advertises the CRC of another geometry."""

    def lie(self, message: Any) -> dict[str, Any]:
        """Return another hash."""
        return {"geometry_hash": message.geometry_hash ^ 1}


class GridOfAnother(LyingMutant):
    """Advertises a grid of one row more than it has transducers for."""

    def lie(self, message: Any) -> dict[str, Any]:
        """Return another grid."""
        return {"grid_ny": message.grid_ny + 1}


class ClockInMilliseconds(LyingMutant):
    """Advertises a clock of 1000 ticks a second."""

    def lie(self, _: Any) -> dict[str, Any]:
        """Return another rate."""
        return {"clock_hz": 1000}


class CarrierOfNoWholePeriod(LyingMutant):
    """Advertises a carrier of 40 500 Hz, whose period is no whole number of microseconds."""

    def lie(self, _: Any) -> dict[str, Any]:
        """Return another carrier."""
        return {"carrier_hz": 40_500}


class HorizonBehindTheWrap(LyingMutant):
    """Advertises a horizon of 2^31 µs, at which before and after cannot be told apart."""

    def lie(self, _: Any) -> dict[str, Any]:
        """Return another horizon."""
        return {"max_horizon_us": 1 << 31}


class NameBehindZero(LyingMutant):
    """Has something behind the zero that ends its name."""

    def lie(self, _: Any) -> dict[str, Any]:
        """Return another name."""
        return {"firmware": "sim\x00left over"}


class GeometryFromZero(LyingMutant):
    """Calls the first transducer of every GEOMETRY_REPLY number 0."""

    of = GeometryReply

    def lie(self, _: Any) -> dict[str, Any]:
        """Return another place."""
        return {"first": 0}


class _OtherCode(BoardConnection):
    """Refuses one request with another code than it is due."""

    kind: type = GetGeometry
    due, instead = ErrorCode.NOT_FOUND, ErrorCode.BAD_VALUE

    def refuse(self, request: Any, code: ErrorCode, detail: int, now_us: int) -> None:
        """Refuse, with the other code where it is that request."""
        wrong = isinstance(request.message, self.kind) and code is self.due
        super().refuse(request, self.instead if wrong else code, detail, now_us)


class GeometryBeyondIsBadValue(_OtherCode):
    """Refuses GET_GEOMETRY from N on with BAD_VALUE."""


class ReadBackBeyondIsBadValue(_OtherCode):
    """Refuses READ_DRIVE from N on with BAD_VALUE."""

    kind = ReadDrive


class UploadSizeIsBadValue(_OtherCode):
    """Refuses an upload that is no whole number of frames with BAD_VALUE."""

    kind, due = UploadBegin, ErrorCode.BAD_LENGTH


class UploadTargetIsNotFound(_OtherCode):
    """Refuses an upload to a wrong target with NOT_FOUND."""

    kind, due, instead = UploadBegin, ErrorCode.BAD_VALUE, ErrorCode.NOT_FOUND


class CommitTargetIsNotFound(_OtherCode):
    """Refuses the commit of another target with NOT_FOUND."""

    kind, due, instead = UploadCommit, ErrorCode.BAD_VALUE, ErrorCode.NOT_FOUND


class NonceZeroTaken(BoardConnection):
    """Opens session 1 for a HELLO with the nonce 0."""

    def _judge_hello(self, frame: Any, hello: Hello) -> Any:
        return super()._judge_hello(frame, dataclasses.replace(hello, nonce=hello.nonce or 1))


class RepliesOfNoSession(BoardConnection):
    """Sends every response with session 0."""

    def _response(self, message: Any, seq: int, now_us: int, _: int | None = None) -> bytes:
        return super()._response(message, seq, now_us, 0)


class RepliesWithoutTime(BoardConnection):
    """Sends every response with the time 0."""

    def _response(self, message: Any, seq: int, _: int, session: int | None = None) -> bytes:
        return super()._response(message, seq, 0, session)


class LastSeqNotCleared(VirtualHaptogramDialect):
    """Says in a new session, before its first latch, that one was latched."""

    def _status(self) -> Any:
        fields = super()._status()
        return (*fields[:4], fields[4] or 65_520, *fields[5:])


class BoundsIgnored(Board):
    """Takes a configuration whatever its values are."""

    def configure(self, config: Config) -> None:
        """Put *config* in force."""
        try:
            super().configure(config)
        except RefusalError:
            self.output.config = config


class StopWantsPlayback(Board):
    """Refuses STOP when nothing plays."""

    def stop(self) -> None:
        """Stop what plays."""
        if self._playback is None:
            raise RefusalError(ErrorCode.BAD_STATE, int(self.output.state))
        super().stop()


class ChunksOnceOnly(Board):
    """Takes no chunk of an upload a second time."""

    _next = 0

    def begin_upload(self, begin: UploadBegin) -> None:
        """Begin."""
        super().begin_upload(begin)
        self._next = 0

    def store_chunk(self, chunk: UploadChunk) -> int:
        """Store the chunk that is due."""
        if chunk.offset != self._next:
            raise RefusalError(ErrorCode.BAD_VALUE, 0)
        self._next += len(chunk.data)
        return super().store_chunk(chunk)


_WIRE, _SELF = Evidence.WIRE, Evidence.SELF_REPORTED

MUTANTS: Final = (
    Mutant.of(GeometryHashWrong, "HG-4.3/6", _WIRE),
    Mutant.of(GridOfAnother, "HG-4.3/4", _WIRE),
    Mutant.of(ClockInMilliseconds, "HG-4.3/3", _WIRE),
    Mutant.of(CarrierOfNoWholePeriod, "HG-4.3/2", _WIRE),
    Mutant.of(HorizonBehindTheWrap, "HG-5.7/7", _WIRE),
    Mutant.of(NameBehindZero, "HG-3.2/2", _WIRE),
    Mutant.of(GeometryFromZero, "HG-7.5/1", _WIRE),
    Mutant.of(GeometryBeyondIsBadValue, "HG-7.5/2", _WIRE),
    Mutant.of(ReadBackBeyondIsBadValue, "HG-8.6/2", _WIRE),
    Mutant.of(UploadSizeIsBadValue, "HG-7.2/2", _WIRE),
    Mutant.of(UploadTargetIsNotFound, "HG-7.2/3", _WIRE),
    Mutant.of(WindowOfOneMore, "HG-7.2/6", _WIRE),
    Mutant.of(CommitTargetIsNotFound, "HG-7.4/4", _WIRE),
    Mutant.of(NonceZeroTaken, "HG-4.1/3", _WIRE),
    Mutant.of(RepliesOfNoSession, "HG-4.11/1", _WIRE),
    Mutant.of(RepliesWithoutTime, "HG-4.11/2", _WIRE),
    Mutant.of(LastSeqNotCleared, "HG-9.1/2", _SELF),
    Mutant.of(BoundsIgnored, "HG-7.1/1", _WIRE),
    Mutant.of(StopWantsPlayback, "HG-7.7/2", _WIRE),
    Mutant.of(ChunksOnceOnly, "HG-7.3/1", _WIRE),
)
