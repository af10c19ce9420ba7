"""HG-3.2, HG-4.4: every value of a byte that no table, or no sentence beside one, allows."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Iterator
from typing import Final

from haptogram_protocol.messages import (
    VERSION_MAJOR,
    DriveKind,
    ErrorCode,
    Feature,
    FocalPoint,
    Message,
    ReadDrive,
    SetConfig,
    UploadBegin,
    UploadKind,
)
from haptogram_protocol.record import Record

from ...case import case
from ...client.board_client import BoardClient
from ...outcome import SELF_REPORTED, unimplemented

_ALL: Final = range(0x100)
_TARGET: Final = 9


@dataclasses.dataclass(frozen=True, slots=True)
class _ValueByte:
    """A byte of a payload that may have some values only."""

    name: str
    offset: int
    allowed: Collection[int]

    def wrong_values(self, *, thorough: bool) -> list[int]:
        """Return the values that are not allowed: all, or those a bit away from an allowed one."""
        near = {value ^ 1 << bit for value in self.allowed for bit in range(8)} | {0xFF}
        return sorted((set(_ALL) if thorough else near) - set(self.allowed))

    def put(self, payload: bytes, value: int) -> bytes:
        """Return *payload* with *value* in this byte."""
        return payload[: self.offset] + bytes([value]) + payload[self.offset + 1 :]


def _value_bytes(kind: type[Record], at: int = 0) -> Iterator[_ValueByte]:
    """Yield the bytes of a record that may have some values only, those of its records too."""
    for name, form in kind.WIRE.items():
        offset = at + form.offset
        if form.record is not None:
            yield from _value_bytes(form.record, offset)
        elif form.enumeration is not None:
            yield _ValueByte(name, offset, [int(value) for value in form.enumeration])


def _requests_with_values(board: BoardClient) -> Iterator[Message]:
    """Yield a request that the board takes of every type, and kind, with such a byte."""
    for feature, kind in (
        (Feature.READ_LATCHED, DriveKind.LATCHED),
        (Feature.READ_RADIATED, DriveKind.RADIATED),
    ):
        if board.has(feature):
            yield ReadDrive(kind, 0, 1)
    if board.has(Feature.CONFIG):
        yield SetConfig(board.config)
    yield from _uploads_with_values(board)


def _uploads_with_values(board: BoardClient) -> Iterator[UploadBegin]:
    count = board.identity.transducers
    if board.has(Feature.SEQUENCE_PHASES):
        yield UploadBegin(UploadKind.PHASES, 0, _TARGET, count, 0)
    if board.has(Feature.SEQUENCE_POINTS):
        yield UploadBegin(UploadKind.POINTS, 1, _TARGET, FocalPoint.LAYOUT.size, 0)
    if board.has(Feature.CORRECTION):
        yield UploadBegin(UploadKind.CORRECTION, 0, 0, count, 0)


@case("HG-3.2/5-bytes", evidence=SELF_REPORTED)
def every_value_of_no_table_is_refused(board: BoardClient) -> None:
    """each value that the table of a request's byte does not name: BAD_VALUE, and the byte's
    offset
    """
    for message in _requests_with_values(board):
        for byte in _value_bytes(type(message)):
            values = byte.wrong_values(thorough=board.thorough)
            with board.counting(requests=len(values)):
                for value in values:
                    payload = byte.put(message.serialize(), value)
                    board.link.refused_raw(message.TYPE, payload, ErrorCode.BAD_VALUE, byte.offset)


@case("HG-3.2/5-points")
def every_number_of_points_of_no_table_is_refused(board: BoardClient) -> None:
    """points_per_frame other than 0 without points, 0 with them, above max_points: BAD_VALUE"""
    begins = list(_uploads_with_values(board))
    if not begins:
        unimplemented("the board takes no uploads")
    offset, unit = UploadBegin.WIRE["points_per_frame"].offset, FocalPoint.LAYOUT.size
    for begin in begins:
        has_points = begin.kind is UploadKind.POINTS
        allowed = range(1, board.identity.max_points + 1) if has_points else (0,)
        byte = _ValueByte("points_per_frame", offset, allowed)
        for number in byte.wrong_values(thorough=board.thorough):
            size = max(1, number) * unit if has_points else begin.size  # whole frames
            if size <= board.identity.max_upload_bytes:
                wrong = dataclasses.replace(begin, points_per_frame=number, size=size)
                board.link.refused(wrong, ErrorCode.BAD_VALUE, offset)


@case("HG-4.4/1-majors")
def every_other_major_version_is_refused(board: BoardClient) -> None:
    """HELLO of each other major version: ERROR(VERSION), and the session goes on"""
    right = board.hello_message(board.new_nonce())
    byte = _ValueByte("major", right.WIRE["major"].offset, (VERSION_MAJOR,))
    for major in byte.wrong_values(thorough=board.thorough):
        wrong = dataclasses.replace(right, major=major)
        board.link.refused(wrong, ErrorCode.VERSION, VERSION_MAJOR, session=0)
    board.link.barrier()  # of the session that was open before
