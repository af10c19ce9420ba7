"""Requests that a board refuses: every type for every reason, from the messages and the limits.

Each of them, carried out by mistake, would change something that a host can read.
"""

from __future__ import annotations

import dataclasses
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from haptogram_protocol import messages as m
from haptogram_protocol.rules import CONFIG_BOUNDS

from ..client import playback
from ..client.board_client import BoardClient
from ..client.capabilities import TRACE_MODES
from ..outcome import fail

#: Sequence that is stored, and the one whose upload is under way.
STORED: Final = 5
PENDING: Final = 6
_ABSENT: Final = 23
#: Fields of the configuration with values one beyond a bound, of those that the field can hold.
OUT_OF_BOUNDS: Final = tuple(
    (name, value)
    for name, (least, most) in CONFIG_BOUNDS.items()
    for value in (least - 1, most + 1)
    if 0 <= value < 1 << 8 * m.Config.WIRE[name].size
)
_FLAG: Final = 0x20
#: Bits in which the session of another host differs.
_FOREIGN: Final = 0x0300
_ALONE_MS: Final = 900
_FAR_US: Final = 60_000_000  # a slow line takes a while until this start is sent


@dataclass(frozen=True, slots=True)
class Refusal:
    """A request that a board has to refuse.

    Attributes
    ----------
    name : str
        Type of the request and reason of the refusal.
    kind : int
        Message type.
    payload : bytes
        Payload.
    code : ErrorCode
        Code of the refusal.
    header : dict
        Fields of the header; session and number follow from the code where these are wrong.
    """

    name: str
    kind: int
    payload: bytes
    code: m.ErrorCode
    header: Mapping[str, Any] = field(default_factory=dict)


def other_config_than_judged(board: BoardClient) -> m.Config:
    """Return a valid configuration in which every field that can be set is another one."""
    offered = [mode for feature, mode in TRACE_MODES if board.has(feature)]
    other = next((mode for mode in offered if mode is not board.config.trace_mode), m.TraceMode.OFF)
    beside = {
        name: value - 1 if value == CONFIG_BOUNDS[name][1] else value + 1
        for name in ("ramp_ms", "sound_speed_mm_s", "trace_divider")
        for value in [getattr(board.config, name)]
    }
    return dataclasses.replace(
        board.config,
        hold_ms=1,
        host_timeout_ms=20,
        status_period_ms=board.quick_status_ms,
        late_window_us=abs(board.config.late_window_us - 1),
        trace_mode=other,
        amplitude_ceiling=board.config.amplitude_ceiling ^ 1,
        **beside,
    )


def _commands_to_be_refused(board: BoardClient) -> Iterator[m.Message]:
    """Yield requests that would change something, of every type that does."""
    yield from (m.Arm(), m.Disarm(), m.GetStatus(), board.hello_message(board.new_nonce()))
    if board.has(m.Feature.CONFIG):
        yield m.SetConfig(other_config_than_judged(board))
    if board.has(m.Feature.SEQUENCE_PHASES):
        count = board.identity.transducers
        data = bytes(count)
        yield m.Stop()
        yield _accepted_play(board)
        yield m.UploadBegin(m.UploadKind.PHASES, 0, STORED, count, zlib.crc32(data))
        yield m.UploadChunk(0, data[: board.identity.max_chunk])
        yield m.UploadCommit(PENDING)


def requests_refused_by_link(board: BoardClient) -> Iterator[Refusal]:
    """Yield commands with a wrong flag, length, session or number (HG-3.8, steps 6 to 11)."""
    for message in _commands_to_be_refused(board):
        name, kind, payload = message.TYPE.name, int(message.TYPE), message.serialize()
        is_hello = isinstance(message, m.Hello)
        session = {"session": 0} if is_hello else {}
        plain = {"flags": int(m.Flag.IMMEDIATE)} if isinstance(message, m.Play) else {}
        flags = {"flags": _FLAG | plain.get("flags", 0)}
        yield Refusal(
            f"{name} with an unknown flag", kind, payload, m.ErrorCode.UNSUPPORTED, flags | session
        )
        wrong_length = m.ErrorCode.BAD_LENGTH
        if not isinstance(message, m.UploadChunk):  # whose length varies
            yield Refusal(
                f"{name}, a byte too long", kind, payload + b"\x00", wrong_length, plain | session
            )
        if payload:
            short = payload[: min(len(payload), message.LAYOUT.size) - 1]
            yield Refusal(f"{name}, cut short", kind, short, wrong_length, plain | session)
        if is_hello:
            continue
        stale = m.ErrorCode.STALE_SESSION
        yield Refusal(f"{name} of another session", kind, payload, stale, plain)
        if not isinstance(message, m.UploadChunk):
            yield Refusal(f"an old {name}", kind, payload, m.ErrorCode.SEQUENCE_REUSED, plain)


def requests_refused_by_value(board: BoardClient) -> Iterator[Refusal]:
    """Yield commands with a value that no table, bound or limit allows."""
    bad = m.ErrorCode.BAD_VALUE
    hello = board.hello_message(0)
    yield _request_to_be_refused("a nonce of 0", hello, bad, session=0)
    later = dataclasses.replace(board.hello_message(board.new_nonce()), major=m.VERSION_MAJOR + 1)
    yield _request_to_be_refused("another major version", later, m.ErrorCode.VERSION, session=0)
    count = board.identity.transducers
    yield _request_to_be_refused("from N on", m.GetGeometry(count, 1), m.ErrorCode.NOT_FOUND)
    if board.has(m.Feature.READ_LATCHED):
        yield _request_to_be_refused("from N on", m.ReadDrive(0, count, 1), m.ErrorCode.NOT_FOUND)  # type: ignore[arg-type]
    if board.has(m.Feature.CONFIG):
        other = other_config_than_judged(board)
        for name, value in OUT_OF_BOUNDS:
            changes: dict[str, Any] = {name: value}
            message = m.SetConfig(dataclasses.replace(other, **changes))
            yield _request_to_be_refused(f"{name} = {value}", message, bad)
        payload = bytearray(m.SetConfig(other).serialize())
        payload[m.Config.WIRE["trace_mode"].offset] = 0xFF
        yield Refusal("SET_CONFIG, trace_mode = 255", m.SetConfig.TYPE, bytes(payload), bad)
    if board.has(m.Feature.SEQUENCE_PHASES):
        yield from _uploads_to_be_refused(board)


def _uploads_to_be_refused(board: BoardClient) -> Iterator[Refusal]:
    """Yield UPLOAD_BEGIN requests with a wrong target, size or kind."""
    count, identity = board.identity.transducers, board.identity
    bad, length, large = m.ErrorCode.BAD_VALUE, m.ErrorCode.BAD_LENGTH, m.ErrorCode.TOO_LARGE
    wrong: list[tuple[str, m.UploadBegin, m.ErrorCode]] = [
        ("target 0", m.UploadBegin(m.UploadKind.PHASES, 0, 0, count, 0), bad),
        ("points in phases", m.UploadBegin(m.UploadKind.PHASES, 1, STORED, count, 0), bad),
        ("size 0", m.UploadBegin(m.UploadKind.PHASES, 0, STORED, 0, 0), length),
    ]
    if count > 1 and 2 * count - 1 <= identity.max_upload_bytes:
        broken = m.UploadBegin(m.UploadKind.PHASES, 0, STORED, 2 * count - 1, 0)
        wrong.append(("a size of no whole frames", broken, length))
    if board.has(m.Feature.CORRECTION) and 2 * count <= identity.max_upload_bytes:
        two = m.UploadBegin(m.UploadKind.CORRECTION, 0, 0, 2 * count, 0)
        wrong.append(("two corrections", two, length))
    beyond = identity.max_upload_bytes // count * count + count
    if beyond < 1 << 32:
        size = m.UploadBegin(m.UploadKind.PHASES, 0, STORED, beyond, 0)
        wrong.append(("a size beyond the limit", size, large))
    if board.has(m.Feature.SEQUENCE_POINTS):
        most = identity.max_points + 1
        if most < 1 << 8:
            points = m.UploadBegin(m.UploadKind.POINTS, most, STORED, 16 * most, 0)
            wrong.append(("too many points", points, bad))
        for number in {2, identity.max_points} - {1}:
            if number > identity.max_points or 16 * (number + 1) > identity.max_upload_bytes:
                continue
            parts = m.UploadBegin(m.UploadKind.POINTS, number, STORED, 16 * (number + 1), 0)
            wrong.append((f"no whole frames of {number} points", parts, length))
    for name, message, code in wrong:
        yield _request_to_be_refused(name, message, code)
    unknown = bytes([9]) + wrong[0][1].serialize()[1:]
    yield Refusal("UPLOAD_BEGIN, an unknown kind", m.UploadBegin.TYPE, unknown, bad)


def _plays_to_be_refused(board: BoardClient) -> Iterator[Refusal]:
    """Yield every PLAY that an ARMED board without a playback has to refuse."""
    identity, bad = board.identity, m.ErrorCode.BAD_VALUE
    now_us = board.clock.device_us()
    good, least_us = _accepted_play(board), playback.least_period_us(board)
    at_once = {"flags": int(m.Flag.IMMEDIATE)}
    absent = dataclasses.replace(good, sequence=_ABSENT)
    yield _request_to_be_refused("no such sequence", absent, m.ErrorCode.NOT_FOUND, **at_once)
    if least_us > 1:
        fast = dataclasses.replace(good, period_us=least_us - 1)
        yield _request_to_be_refused("a period too short", fast, bad, **at_once)
    for alone_ms in (0, identity.max_unattended_ms + 1):
        if alone_ms < 1 << 32:
            alone = dataclasses.replace(good, unattended_ms=alone_ms)
            yield _request_to_be_refused(f"unattended_ms = {alone_ms}", alone, bad, **at_once)
    yield _request_to_be_refused("a start that has passed", good, bad, time_us=now_us - 1000)
    beyond_us = board.clock.beyond_us(_FAR_US)
    if beyond_us is not None:
        at_us = now_us + beyond_us
        yield _request_to_be_refused("a start beyond the horizon", good, bad, time_us=at_us)


def requests_refused_while_armed(board: BoardClient) -> Iterator[Refusal]:
    """Yield every command that an ARMED board refuses, whatever it holds and latches."""
    yield from requests_refused_by_link(board)
    yield from requests_refused_by_value(board)
    if board.has(m.Feature.SEQUENCE_PHASES):
        yield from _plays_to_be_refused(board)


def requests_refused_now(board: BoardClient) -> Iterator[Refusal]:
    """Yield requests that this state of the output, or a playback, does not allow."""
    code, at_once = m.ErrorCode.BAD_STATE, {"flags": int(m.Flag.IMMEDIATE)}
    yield _request_to_be_refused("in this state", _accepted_play(board), code, **at_once)


def uploads_refused_for_playing(board: BoardClient) -> Iterator[Refusal]:
    """Yield uploads of the sequence that plays."""
    count = board.identity.transducers
    begin = m.UploadBegin(m.UploadKind.PHASES, 0, STORED, count, 0)
    yield _request_to_be_refused("of the sequence that plays", begin, m.ErrorCode.BAD_STATE)


def chunks_to_be_refused(board: BoardClient, size: int) -> Iterator[Refusal]:
    """Yield chunks and commits that an upload of *size* bytes, one of them there, refuses."""
    bad = m.ErrorCode.BAD_VALUE
    for offset, number in ((size, 1), (size - 1, 2), (0xFFFFFFFF, 2)):
        stray = m.UploadChunk(offset, b"\xaa" * number)
        yield _request_to_be_refused(f"{number} bytes at {offset} of {size}", stray, bad)
    behind = m.UploadChunk(2, b"\xaa")
    yield _request_to_be_refused("behind a gap", behind, m.ErrorCode.INCOMPLETE)
    longest = board.identity.max_chunk
    if longest < min(size, 4000):
        much = m.UploadChunk(0, b"\xaa" * (longest + 1))
        yield _request_to_be_refused("longer than max_chunk", much, m.ErrorCode.BAD_LENGTH)
    for target in (STORED, *(PENDING ^ 1 << bit for bit in (0, 8, 15)), 0):
        yield _request_to_be_refused(f"another target, {target:#06x}", m.UploadCommit(target), bad)
    yield _request_to_be_refused(
        "with bytes missing", m.UploadCommit(PENDING), m.ErrorCode.INCOMPLETE
    )


def judged_refusal(board: BoardClient, refusal: Refusal) -> m.Error:
    """Send a request that has to be refused; FAILED unless it is."""
    header = dict(refusal.header)
    if refusal.code is m.ErrorCode.SEQUENCE_REUSED:
        board.link.barrier()  # a refusal of the link before it used up no number
        header["seq"] = board.link.seq - 1
    if refusal.code is m.ErrorCode.STALE_SESSION:
        header["session"] = board.link.session ^ _FOREIGN
    answer = board.link.ask_raw(refusal.kind, refusal.payload, **header)
    if not isinstance(answer.message, m.Error):
        fail(f"{refusal.name} is answered by {board.link.answer_text(answer)}")
    return answer.message


def _accepted_play(board: BoardClient) -> m.Play:
    """Return a PLAY request that the board accepts."""
    return playback.play_request(board, STORED, loops=1, unattended_ms=_ALONE_MS)


def _request_to_be_refused(
    reason: str, message: m.Message, code: m.ErrorCode, **header: Any
) -> Refusal:
    """Return *message* as a request due to be refused with *code*, named by type and *reason*.

    *header*: its flags or time, where they are not the usual ones.
    """
    name = f"{message.TYPE.name}, {reason}"
    return Refusal(name, int(message.TYPE), message.serialize(), code, header)
