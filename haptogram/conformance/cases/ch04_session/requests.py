"""HG-4.8, HG-4.9, HG-4.10, HG-4.12: requests one at a time, remembered, never done twice.

A request of the session uses its number if it is carried out, or refused by the board itself, and
if that number is ahead of the newest one.  Nothing sets the newest number back.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

from haptogram_protocol import messages as m
from haptogram_protocol.errors import RemoteProtocolError
from haptogram_protocol.framing import HEADER_BYTES, encode_frame
from haptogram_protocol.rules import UPLOADS
from haptogram_protocol.state import OutputState

from ...case import case, case_about_host
from ...client import playback, uploads
from ...client.board_client import BoardClient
from ...client.capabilities import drive_kinds, requests_that_board_takes
from ...client.malformed_frames import value_bytes
from ...client.request_client import flags_at_once
from ...client.stream_kinds import refused_requests_to_send, valid_requests_to_send
from ...client.wire import ReceivedByClient
from ...judge.repetition import (
    CHUNKS_BETWEEN,
    MUTES_BETWEEN,
    REFUSALS_BETWEEN,
    Between,
    every_request_to_repeat,
    judge_repeated_reply,
    judge_same_answer,
    requests_to_repeat,
)
from ...outcome import SELF_REPORTED, check, check_fields, named
from .identity import check_answer_session

OF_HOST: Final = tuple(case_about_host(f"HG-4.8/{number}") for number in range(1, 6))
_SEQUENCE: Final = 4
_FILLED_US: Final = 1_000_000
_NUMBERS: Final = (0, 1, 0xFF, 0x100, 0x7FFF, 0x8000, 0xFFFE, 0xFFFF)
_OF_VALUES: Final = (m.ErrorCode.BAD_VALUE, m.ErrorCode.UNSUPPORTED)
_LOW_FLAGS: Final = (1, 2, 4, 8)
#: Bits of the echo of a PING that, inverted, leave the low, and the high, half of its CRC-32.
_SAME_HALF_OF_CRC: Final = {"low": 0x15E3E, "high": 0x8567}
_STALE: Final = 0x0F0F
_UNKNOWN_FLAG: Final = 0x40
_UNKNOWN_REQUEST: Final = 0x7B
_FARTHEST: Final = 32_767
#: How far a number is ahead of the newest one; negative: behind it.
_STEPS: Final = (1, 2, 300, _FARTHEST, 0, -1, -2, -300, -_FARTHEST)
_QUICK_STEPS: Final = (2, 0, -1, -300)


@case("HG-4.9/1")
def repeats_the_reply(board: BoardClient) -> None:
    """ARM again after a MUTE without a session: same reply to the byte, still MUTED; repeated +
    1
    """
    board.link.ask(m.Arm())
    board.mute(session=0, seq=board.link.seq + 1000)
    with board.counting(repeated=2):
        # GET_STATUS would be the last request: the repetitions come first.
        board.check_status("after MUTE without a session", state=OutputState.MUTED)
        first = board.link.ask(m.Ping(7))
        board.wire.idle(5000)
        for _ in range(2):
            judge_repeated_reply(board, m.Ping(7), first, "PING")
    first = board.link.ask(m.Arm())
    board.mute(session=0, seq=board.link.seq + 1000)
    judge_repeated_reply(board, m.Arm(), first, "ARM and a MUTE without a session")
    board.check_status("ARM sent again was carried out again", state=OutputState.MUTED)


@case("HG-4.9/2")
def refuses_reused_number(board: BoardClient) -> None:
    """the last request's number with other bytes is refused: SEQUENCE_REUSED, detail: the number"""
    board.arm()
    for message in (m.Disarm(), m.Ping(1)):
        board.link.refused_as_used(message)
    board.check_status("a refused DISARM", state=OutputState.ARMED)


@case("HG-4.9/3")
def refuses_delayed_copy(board: BoardClient) -> None:
    """a delayed copy of ARM does not undo a later DISARM: SEQUENCE_REUSED"""
    board.link.ask(m.Arm())
    board.disarm()
    board.link.refused_as_used(m.Arm(), board.link.seq - 1)
    for back in (2, 100, 30_000):
        board.link.refused_as_used(m.Ping(1), board.link.seq - back)
    board.check_status("a delayed ARM", state=OutputState.DISARMED)


@case("HG-4.9/4")
def refusals_use_no_number(board: BoardClient) -> None:
    """after refusals for flags, length and type the same number is still free"""
    _judge_remembered_reply(board, [m.Arm()], REFUSALS_BETWEEN)
    board.link.ping(2)


@case("HG-4.9/5")
def mute_passes_pending_request(board: BoardClient) -> None:
    """behind a MUTE a copy of a request: same reply if it was done, SEQUENCE_REUSED if it was
    lost
    """
    first = board.link.ask(m.Ping(9))
    board.mute()
    judge_repeated_reply(board, m.Ping(9), first, "PING and MUTE")
    for lost in (m.Arm(), m.Ping(1)):
        board.link.next_seq()
        board.mute()
        board.link.refused_as_used(lost, board.link.seq - 1)
    board.check_status("an ARM that was lost before MUTE", state=OutputState.MUTED)
    board.link.ping(2)


@case("HG-4.10/1")
def repeated_mute_is_done(board: BoardClient) -> None:
    """MUTE is carried out each time; its number in the session counts as used"""
    board.arm()
    board.mute()
    seq = board.link.seq
    board.link.refused_as_used(m.Ping(1))
    board.arm()
    board.mute(seq=seq)
    board.check_status("the same MUTE again", state=OutputState.MUTED)
    board.mute(session=0, seq=board.link.seq + 500)
    board.link.ping(1)  # the number of a MUTE of no session is not used up


@case("HG-4.10/1-behind")
def mute_uses_later_number(board: BoardClient) -> None:
    """PING and MUTE at once: PING is answered, although the number of MUTE is newer"""
    for number in range(8):
        wires = [board.link.request_wire(message)[0] for message in (m.Ping(number), m.Mute())]
        board.link.reply_in(board.link.exchange(*wires)[0], m.Pong)


@case("HG-4.10/1-chunk")
def repeated_chunks_are_done(board: BoardClient) -> None:
    """UPLOAD_CHUNK is carried out each time"""
    uploads.begin_any_upload(board, 1)
    chunk = m.UploadChunk(0, bytes(1))
    board.link.call(chunk, m.UploadChunkReply)
    seq = board.link.seq
    uploads.begin_any_upload(board, 1)
    again = board.link.call(chunk, m.UploadChunkReply, seq=seq)
    check_fields(again, "a chunk of 1 byte again", received=1)


@case("HG-4.12/1")
def refuses_stale_requests(board: BoardClient) -> None:
    """DISARM, PING, GET_STATUS of another session: STALE_SESSION, session 0; not done"""
    board.arm()
    requests: tuple[m.Message, ...] = (m.Disarm(), m.Ping(1), m.GetStatus())
    judge_stale_requests(board, requests, (0, board.link.session ^ 0x8001))
    board.check_status("a DISARM of another session", state=OutputState.ARMED)


def judge_stale_requests(
    board: BoardClient, messages: Iterable[m.Message], sessions: Sequence[int]
) -> None:
    """FAILED unless requests of these sessions are refused, by frames of no session."""
    number, code = len(sessions), m.ErrorCode.STALE_SESSION
    for message in messages:
        with board.counting(frames=number, requests=number):
            for session in sessions:
                answer = board.link.ask(message, session=session)
                board.link.error_in(answer, message.TYPE, code, board.link.session)
                check_answer_session(answer, 0, message.TYPE.name)


def _largest_remembered_requests(board: BoardClient) -> Iterator[m.Message]:
    """Yield the requests with the longest replies: geometry, drives and trace ring, whole."""
    yield m.GetGeometry(0, 0xFFFF)
    yield from (m.ReadDrive(kind, 0, 0xFFFF) for kind in drive_kinds(board))
    if board.has(m.Feature.TRACE_RING):
        yield m.ReadTrace(0, 0xFFFF)


def _fill_ring(board: BoardClient) -> None:
    """Fill the trace ring by a playback of 250 frames or 1 s; nothing without ring or playback."""
    if not board.has(m.Feature.TRACE_RING | m.Feature.CONFIG | m.Feature.SEQUENCE_PHASES):
        return
    board.arm(trace_mode=m.TraceMode.RING)
    period_us = playback.shortest_period_to_play_us(board, playback.PERIOD_US // 4)
    playback.play_now(board, _SEQUENCE, loops=100, period_us=period_us)
    board.wire.idle(min(250 * period_us, _FILLED_US))
    board.stop()


def _judge_remembered_reply(
    board: BoardClient, messages: Iterable[m.Message], betweens: dict[str, Between]
) -> None:
    """FAILED unless each of *messages*, repeated after each of *betweens*, has its cached reply.

    *betweens* are functions, by name, that send something between request and repetition.
    """
    for message in messages:
        board.arm()
        first = board.link.ask_at_once(message)
        for name, send in betweens.items():
            send(board)
            judge_repeated_reply(board, message, first, f"{message.TYPE.name} and {name}")


@case("HG-4.10/1-kept")
def every_mute_between(board: BoardClient) -> None:
    """a reply of every type, refusals too, is still remembered after MUTE and UPLOAD_CHUNK"""
    chunks = CHUNKS_BETWEEN if board.identity.features & UPLOADS else {}
    _judge_remembered_reply(board, every_request_to_repeat(board), MUTES_BETWEEN | chunks)


@case("HG-4.9/4-types")
def every_refusal_between(board: BoardClient) -> None:
    """a reply of every type, refusals too, is still remembered after each refusal of steps 5 to
    11
    """
    _judge_remembered_reply(board, every_request_to_repeat(board), REFUSALS_BETWEEN)


@case("HG-4.9/1-replies")
def every_reply_is_remembered(board: BoardClient) -> None:
    """refused requests, and those with the longest replies, get the same bytes again"""
    if board.has(m.Feature.SEQUENCE_PHASES):
        playback.send_phases_that_fit(board, _SEQUENCE, frames=2)
        _fill_ring(board)
    board.arm()
    for message in [*refused_requests_to_send(board), *_largest_remembered_requests(board)]:
        with board.counting(repeated=2, requests=1, frames=3):
            first = board.link.ask_at_once(message)
            for _ in range(2):
                judge_repeated_reply(board, message, first, message.TYPE.name)
        board.link.refused_as_used(message, first.frame_header.seq)


# --- Which numbers are taken, and which are used up ----------------------------------------------


@case("HG-4.10/1-used")
def every_idempotent_request_uses_its_number(board: BoardClient) -> None:
    """the number of a MUTE or UPLOAD_CHUNK of the session, refused or not, is used:
    SEQUENCE_REUSED
    """
    messages: list[m.Message] = [m.Mute()]
    if board.identity.features & UPLOADS:
        messages += [
            m.UploadChunk(0, b""),
            m.UploadChunk(0, b"\x01"),
            m.UploadChunk(0x7FFFFFFF, b"\x01"),
        ]
    for message in messages:
        board.link.ask(message)
        board.link.refused_as_used(m.Ping(1))


@case("HG-4.9/3-jumps")
def every_jump_of_numbers(board: BoardClient) -> None:
    """requests 1 to 32767 numbers ahead are carried out, those 1 to 32768 behind are refused"""
    for bits in range(16):
        for jump in {1 << bits, (1 << bits) - 1} - {0, 1 << 15}:
            board.link.seq += jump - 1
            board.link.ping(jump)
            board.link.refused_as_used(m.Ping(jump), board.link.seq - (1 << bits))


@case("HG-4.9/1-numbers")
def every_number_is_remembered(board: BoardClient) -> None:
    """requests numbered 0, 255, 0x7FFF, 0x8000, 0xFFFF and beside them get the same bytes again"""
    for number in _NUMBERS:
        board.hello(seq=number - 1 & 0xFFFF)
        board.link.seq = number - 1
        first = board.link.ask(m.Ping(number))
        board.link.reply_in(first, m.Pong)
        judge_repeated_reply(board, m.Ping(number), first, f"PING of number {number:#06x}")
        board.link.refused_as_used(m.Ping(~number & 0xFFFF))
        board.link.ping(1)


@case("HG-4.9/4-values")
def every_refusal_leaves_the_number(board: BoardClient) -> None:
    """a request of every type, refused for flags or length, uses no number; for a value it does"""
    board.arm()
    for kind in requests_that_board_takes(board):
        if kind is m.Hello:
            continue
        payload = bytes(kind.LAYOUT.size)
        refusals = {
            "an unknown flag": (payload, 0x40, m.ErrorCode.UNSUPPORTED),
            "a wrong length": (payload + b"\x00", 0, m.ErrorCode.BAD_LENGTH),
        }
        for byte in value_bytes(kind):
            refusals[f"{byte.name} = 0xee"] = byte.put(payload, 0xEE), 0, m.ErrorCode.BAD_VALUE
        for name, (wrong, flags, code) in refusals.items():
            seq = board.link.next_seq()
            board.link.refused_raw(kind.TYPE, wrong, code, seq=seq, flags=flags)
            with named(f"{kind.TYPE.name} with {name}, then PING of its number"):
                if code is m.ErrorCode.BAD_VALUE:
                    board.link.refused_as_used(m.Ping(seq), seq)
                else:
                    board.link.ping(seq, seq=seq)


# --- What is another request -------------------------------------------------------------------


def _requests_with_other_bytes(board: BoardClient, body: bytes) -> Iterator[tuple[str, bytes]]:
    """Yield valid bodies with the number of *body* that differ in one field: description, body."""
    for low in _LOW_FLAGS:
        yield f"flag {low:#x}", body[:1] + bytes([body[1] ^ low]) + body[2:]
    for at in range(4, 8):
        yield f"byte {at - 4} of time_us", _request_with_flipped_byte(body, at)
    for at in range(HEADER_BYTES, len(body)):
        changed = _request_with_flipped_byte(body, at)
        if _is_legal_request(board, changed):
            yield f"byte {at - HEADER_BYTES} of the payload", changed
    size = len(body) - HEADER_BYTES
    for kind in requests_that_board_takes(board):
        changed = bytes([kind.TYPE]) + body[1:]
        same = kind is m.Hello or body[0] == kind.TYPE or kind.LAYOUT.size != size
        if not same and _is_legal_request(board, changed):
            yield f"type {kind.TYPE.name}", changed


def _request_with_flipped_byte(body: bytes, at: int) -> bytes:
    """Return *body* with the lowest bit of the byte *at* inverted."""
    return body[:at] + bytes([body[at] ^ 1]) + body[at + 1 :]


def _is_legal_request(board: BoardClient, body: bytes) -> bool:
    """Return True if all values of a request are allowed; SET_CONFIG may change hold_ms alone."""
    try:
        message = m.MESSAGES[body[0]].deserialize(body[HEADER_BYTES:])
    except RemoteProtocolError:
        return False
    if not isinstance(message, m.SetConfig):
        return True
    config = dataclasses.replace(message.config, hold_ms=board.config.hold_ms)
    return config == board.config  # the bounds of hold_ms are far


@case("HG-4.9/2-bytes")
def every_changed_byte_is_refused(board: BoardClient) -> None:
    """the number of a request of every type with one byte changed, in header or payload, is
    refused
    """
    for message in requests_to_repeat(board):
        board.arm()
        seq, name = board.link.next_seq(), message.TYPE.name
        header = {"seq": seq, "flags": flags_at_once(message), "time_us": 0x01020304}
        body = board.link.body(message.TYPE, message.serialize(), **header)
        (first,) = board.link.exchange(encode_frame(body))
        for other, changed in _requests_with_other_bytes(board, body):
            (answer,) = board.link.exchange(encode_frame(changed))
            error, text = answer.message, f"{name}, then its number with another {other}"
            is_value = (
                "payload" in other and isinstance(error, m.Error) and error.code in _OF_VALUES
            )
            if not is_value:  # which is checked first
                with named(text):
                    board.link.error_in(answer, changed[0], m.ErrorCode.SEQUENCE_REUSED, seq)
        (again,) = board.link.exchange(encode_frame(body))
        judge_same_answer(again, first, f"after {name} and others like it")


@case("HG-4.9/2-halves")
def every_half_of_a_crc_is_refused(board: BoardClient) -> None:
    """a PING with the number of the last one, and half of its CRC-32, is refused"""
    for half, bits in _SAME_HALF_OF_CRC.items():
        echo = board.random.getrandbits(64)
        board.link.ping(echo)
        with named(f"a PING with the {half} half of the last one's CRC"):
            board.link.refused_as_used(m.Ping(echo ^ bits))


# --- What a request does to the numbers: a table ----------------------------------------------


@dataclass(frozen=True, slots=True)
class NumberUse:
    """A request, and what it does to the numbers of a session.

    Attributes
    ----------
    name : str
        For reports.
    kind, payload, header
        Its type, its payload, fields of its header.
    is_used : bool
        Whether a number that is ahead of the newest one is the newest one behind it.
    is_remembered : bool
        Whether its reply is the remembered one behind it; it is refused unless it is ahead.
    """

    name: str
    kind: int
    payload: bytes = b""
    header: Mapping[str, int] = field(default_factory=dict)
    is_used: bool = False
    is_remembered: bool = False

    def ask(self, board: BoardClient, seq: int) -> ReceivedByClient:
        """Send the request with a number and return its answer."""
        return board.link.ask_raw(self.kind, self.payload, seq=seq, **self.header)


def _uses_of_any_number(board: BoardClient) -> Iterator[NumberUse]:
    """Yield requests whose answer does not depend on their number: MUTE, chunks, HELLO, refused."""
    mute, ping, chunk = int(m.Mute.TYPE), int(m.Ping.TYPE), int(m.UploadChunk.TYPE)
    stale: dict[str, Any] = {"session": board.link.session ^ _STALE}
    closed, flagged = {"session": 0}, {"flags": _UNKNOWN_FLAG}
    yield NumberUse("MUTE", mute, is_used=True)
    yield NumberUse("MUTE with flags and payload", mute, b"more", flagged, is_used=True)
    yield NumberUse("MUTE without a session", mute, b"", closed)
    yield NumberUse("MUTE of another session", mute, b"", stale)
    if board.identity.features & UPLOADS:
        first = m.UploadChunk(0, b"\x01").serialize()
        far = m.UploadChunk(0x7FFFFFFF, b"far behind").serialize()
        yield NumberUse("UPLOAD_CHUNK", chunk, first, is_used=True)
        yield NumberUse("UPLOAD_CHUNK past the end", chunk, far, is_used=True)
        yield NumberUse("UPLOAD_CHUNK, flagged", chunk, first, flagged)
        yield NumberUse("UPLOAD_CHUNK too short", chunk, b"\x00")
        yield NumberUse("UPLOAD_CHUNK of another session", chunk, first, stale)
    for name, hello in (
        ("HELLO again", board.hello_message(board.link.session)),
        ("HELLO of another version", m.Hello(m.VERSION_MAJOR + 1, 0, 1, 0)),
        ("HELLO with the nonce 0", m.Hello(m.VERSION_MAJOR, 0, 0, 0)),
    ):
        yield NumberUse(name, m.Hello.TYPE, hello.serialize(), closed)
    yield NumberUse("an unknown request", _UNKNOWN_REQUEST)
    yield NumberUse("PING, flagged", ping, bytes(8), flagged)
    yield NumberUse("PING too short", ping, bytes(7))
    yield NumberUse("PING of another session", ping, bytes(8), stale)


def _uses_of_later_numbers(board: BoardClient) -> Iterator[NumberUse]:
    """Yield valid and refused requests of every type but UPLOAD_CHUNK: each uses its number up."""
    for message in (*valid_requests_to_send(board, _SEQUENCE), *refused_requests_to_send(board)):
        if not isinstance(message, m.UploadChunk):
            yield _remembered_use(message)


def _remembered_use(message: m.Message) -> NumberUse:
    """Return *message* as a request that uses its number and whose reply the board caches."""
    header = {"flags": flags_at_once(message)}
    name = message.TYPE.name
    return NumberUse(name, message.TYPE, message.serialize(), header, True, True)


@case("HG-4.9/3-steps", evidence=SELF_REPORTED)
def every_newest_number_stays(board: BoardClient) -> None:
    """requests of every type, ahead of the newest number and behind it: nothing sets it back"""
    steps = _STEPS if board.thorough else _QUICK_STEPS
    playback.send_phases_to_store_if_supported(board, _SEQUENCE, frames=2)
    if board.identity.features & (m.Feature.SEQUENCE_PHASES | m.Feature.CORRECTION):
        uploads.begin_any_upload(board, _SEQUENCE)  # whose chunks are taken then
    for use in _uses_of_any_number(board):
        for step in steps:
            _judge_step(board, use, step)
    for use in _uses_of_later_numbers(board) if board.thorough else ():
        for step in steps:
            if step > 0:
                _judge_step(board, use, step)


def _judge_step(board: BoardClient, use: NumberUse, step: int) -> None:
    """Send *use*, numbered *step* above the newest number; FAILED unless used numbers are refused.

    A negative *step* is below it.  First the request with the cached reply is repeated, and has to
    get the same reply: *use*, or the PING before if the reply to *use* is not cached.
    """
    board.link.ask(m.Arm())
    delayed = board.link.seq
    if not use.is_remembered:
        board.disarm()
    ping = m.Ping(step & 0xFFFF)
    first, before = board.link.ask(ping), board.link.seq
    number = before + step
    answer = use.ask(board, number)
    newest = number if use.is_used and step > 0 else before
    text = f"behind {use.name} of a number {step:+d} from the newest one"
    if use.is_remembered:
        judge_same_answer(use.ask(board, number), answer, text)
    else:
        judge_same_answer(board.link.ask(ping, seq=before), first, text)
    for old in sorted({newest, newest - 1, before, number, number + 1}):
        if newest - _FARTHEST <= old <= newest:
            with named(f"{text}, {old & 0xFFFF}"):
                board.link.refused_as_used(m.Ping(board.random.getrandbits(64)), old)
    if newest - before < _FARTHEST - 3 and not use.is_remembered:
        board.link.refused_as_used(m.Arm(), delayed)
        board.link.seq = newest
        state = board.status().state
        check(state is not OutputState.ARMED, f"{text} a delayed copy of ARM was carried out")
    board.link.seq = max(newest, board.link.seq)
    board.link.ping(1)  # the next number is not used
