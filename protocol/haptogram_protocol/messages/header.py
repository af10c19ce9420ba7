"""Common parts of all messages: header, types, flags, errors.  SPEC.md chapters 3 and 10."""

from __future__ import annotations

import enum
import re
from typing import ClassVar, Final, Self

from ..documented import DocumentedEnum, DocumentedFlag
from ..record import Record, record, wire
from ..state import OutputState

VERSION_MAJOR: Final = 2  # HG-4.2
VERSION_MINOR: Final = 0
MAX_TRANSDUCERS: Final = 1024  # HG-5.1
FIRST_STREAM_SEQ: Final = 0xFFF0  # HG-3.6: so that every run crosses the wrap
_WORD: Final = re.compile("(?<!^)(?=[A-Z])")  # where a word of a name begins
RESPONSE_OFFSET: Final = 0x40  # HG-3.3: type of a response = type of its request + 0x40


STREAM_RANGE: Final = range(0x00, 0x40)
REQUEST_RANGE: Final = range(0x40, 0x80)
RESPONSE_RANGE: Final = range(0x80, 0xC0)
EVENT_RANGE: Final = range(0xC0, 0x100)


class MessageType(enum.IntEnum):
    """Type byte.  HG-3.3: 00-3F stream, 40-7F request, 80-BF response, C0-FF event."""

    PHASES = 0x01
    DRIVES = 0x02
    POINTS = 0x03

    HELLO = 0x40
    ARM = 0x41
    MUTE = 0x42
    DISARM = 0x43
    PING = 0x44
    GET_STATUS = 0x45
    GET_CONFIG = 0x46
    SET_CONFIG = 0x47
    GET_GEOMETRY = 0x48
    READ_DRIVE = 0x49
    UPLOAD_BEGIN = 0x4A
    UPLOAD_CHUNK = 0x4B
    UPLOAD_COMMIT = 0x4C
    PLAY = 0x4D
    STOP = 0x4E
    READ_TRACE = 0x4F

    HELLO_REPLY = 0x80
    ARM_REPLY = 0x81
    MUTE_REPLY = 0x82
    DISARM_REPLY = 0x83
    PONG = 0x84
    STATUS_REPLY = 0x85
    CONFIG_REPLY = 0x86
    SET_CONFIG_REPLY = 0x87
    GEOMETRY_REPLY = 0x88
    DRIVE_REPLY = 0x89
    UPLOAD_BEGIN_REPLY = 0x8A
    UPLOAD_CHUNK_REPLY = 0x8B
    UPLOAD_COMMIT_REPLY = 0x8C
    PLAY_REPLY = 0x8D
    STOP_REPLY = 0x8E
    TRACE_REPLY = 0x8F
    ERROR = 0xBF

    STATUS = 0xC0
    TRACE = 0xC1
    TRACE_PLAYBACK = 0xC2
    TRACE_DRIVE = 0xC3
    STATE_CHANGED = 0xC4
    PLAYBACK_ENDED = 0xC5


class Flag(DocumentedFlag):
    """Header flags.  HG-3.4: a receiver must understand the high nibble, may ignore the low one."""

    LATE = 0x01, "trace: the frame was late, within the late window (HG-5.7/6)"
    IMMEDIATE = 0x10, "stream, PLAY: t_apply is not used, act as soon as the frame is complete"


MUST_UNDERSTAND: Final = 0xF0  # HG-3.4


class ErrorCode(DocumentedEnum):
    """Why a request was refused.  HG-10.2."""

    UNSUPPORTED = 1, "unknown request or must-understand flag; detail: the type or the flags"
    BAD_LENGTH = 2, "detail: the length that the type calls for (0: variable)"
    BAD_VALUE = 3, "detail: byte offset of the field in the payload"
    BAD_STATE = 4, "detail: the output state"
    STALE_SESSION = 5, "detail: the board's session (0: none)"
    SEQUENCE_REUSED = 6, "seq of an earlier request, other bytes; detail: seq"
    VERSION = 7, "HELLO of another major version; detail: the board's major version"
    BUSY = 8, "detail: milliseconds after which to ask again"
    TOO_LARGE = 9, "detail: the limit"
    INCOMPLETE = 10, "bytes of an upload are missing; detail: the first of them"
    CRC_MISMATCH = 11, "upload; detail: the CRC-32 that the board computed"
    FAULT = 12, "hardware fault; detail: board-specific"
    NOT_FOUND = 13, "no such sequence, no such transducer; detail: how many there are"


@record
class Header(Record):
    """The ten bytes before every payload.  HG-3.1."""

    type: int = wire("B", "message type")
    flags: int = wire("B", "high nibble: must be understood; low nibble: may be ignored")
    seq: int = wire("H", "sequence number, modulo 2^16; stream and control count apart")
    time_us: int = wire("I", "t_apply (host) or t_device (board), device clock, modulo 2^32")
    session: int = wire("H", "nonce of the session; 0: none (HG-3.7)")

    @classmethod
    def of_body(cls, body: bytes) -> Self:
        """Return the header that a body begins with.

        Raises
        ------
        RemoteProtocolError
            If the body is shorter.
        """
        if len(body) < cls.LAYOUT.size:
            return cls.unpack(body)
        return cls(*cls.LAYOUT.unpack_from(body))


class Message(Record):
    """Base of every payload.

    Attributes
    ----------
    TYPE : MessageType
        Type byte of the message: the one of its name, such as ``GET_CONFIG`` of ``GetConfig``.
    """

    __slots__ = ()
    TYPE: ClassVar[MessageType]

    def __init_subclass__(cls) -> None:
        name = _WORD.sub("_", cls.__name__).upper()
        if name in MessageType.__members__:
            cls.TYPE = MessageType[name]

    def serialize(self) -> bytes:
        """Return the payload.

        Raises
        ------
        LocalProtocolError
            If a value does not fit its field.
        """
        return self.pack()

    @classmethod
    def deserialize(cls, payload: bytes) -> Self:
        """Return the message whose payload is *payload*.

        Raises
        ------
        RemoteProtocolError
            With the reason ``bad_length``, or ``bad_value`` and the offset of the field.
        """
        return cls.unpack(payload)


@record
class Ack(Message):
    """Done; the output state after it."""

    state: OutputState = wire("B", "output state", enum=OutputState)


@record
class Error(Message):
    """The request was refused; this layout is frozen across major versions.  HG-10.1."""

    request: int = wire("B", "type of the request")
    code: int = wire("B", "error code")
    detail: int = wire("I", "number that belongs to the code")


def signed_difference(a: int, b: int, bits: int) -> int:
    """Return ``a - b`` modulo ``2**bits`` as a signed number: positive if *a* is ahead.  HG-3.6."""
    half = 1 << (bits - 1)
    return ((a - b + half) & ((1 << bits) - 1)) - half


def unwrap(value: int, near: int, bits: int) -> int:
    """Return the number closest to *near* that is *value* modulo ``2**bits``.  HG-3.6."""
    return near + signed_difference(value, near, bits)
