"""HG-4.1, HG-4.2, HG-4.3, HG-4.4, HG-4.5, HG-4.7, HG-4.11, HG-4.12:
a session opens; identity and capabilities; number, time, order, session of responses.
"""

from __future__ import annotations

import itertools
import zlib
from collections.abc import Sequence
from typing import Final

from haptogram_protocol import messages as m
from haptogram_protocol.annotation.frames import annotated_type_name
from haptogram_protocol.framing import HEADER_BYTES, MAX_BODY_BYTES, MAX_ENCODED_BYTES, encode_frame
from haptogram_protocol.rules import unsupported_types
from haptogram_protocol.state import OutputState

from ...case import case, case_about_host
from ...client import playback
from ...client.board_client import BoardClient
from ...client.malformed_frames import ValueByte
from ...client.stream_kinds import request_types_of_host
from ...client.wire import ReceivedByClient
from ...outcome import SELF_REPORTED, check, check_equal, check_fields

_PLAYS: Final = m.Feature.SEQUENCE_PHASES | m.Feature.SEQUENCE_POINTS
_UPLOADS: Final = _PLAYS | m.Feature.CORRECTION
_ALWAYS: Final = m.Feature(0)
#: Limits, their least values, and the capabilities of which one has to be advertised.  HG-4.3/8.
LEAST_LIMITS: Final = (
    ("queue_depth", 4, _ALWAYS),
    ("max_horizon_us", 100_000, _ALWAYS),
    ("max_frame_rate_hz", 100, _ALWAYS),
    ("rx_window", MAX_ENCODED_BYTES + 2, _ALWAYS),
    ("max_points", 1, m.Feature.POINTS | m.Feature.SEQUENCE_POINTS),
    ("trace_ring", 16, m.Feature.TRACE_RING),
    ("upload_window", 1, _UPLOADS),
    ("max_chunk", 64, _UPLOADS),
    ("max_upload_bytes", m.FocalPoint.LAYOUT.size, m.Feature.SEQUENCE_POINTS),
    ("max_sequence_frames", 16, _PLAYS),
    ("max_playback_rate_hz", 1, _PLAYS),
    ("max_unattended_ms", 1000, _PLAYS),
)
_LISTEN_US: Final = 300_000
_LONGEST_CHUNK: Final = MAX_BODY_BYTES - HEADER_BYTES - m.UploadChunk.LAYOUT.size
_PROMPT_US: Final = 10_000
_TRIES: Final = 8
_CLOCK_US: Final = 10
_EVENTS_US: Final = 10_000  # until the events that a request leads to have come
_UNKNOWN_REQUEST: Final = 0x7B
#: Counters of what a board does with frames of an open session.
_OF_A_SESSION: Final = ("accepted", "latched", "dropped_state", "duplicate", "gap", "bad_length")


OF_HOST: Final = tuple(
    map(case_about_host, ("HG-4.1/1", "HG-4.1/2", "HG-4.4/2", "HG-4.5/1", "HG-4.5/2", "HG-4.11/4"))
)


@case("HG-4.3/1")
def greets_in_every_state(board: BoardClient) -> None:
    """HELLO is answered while DISARMED, ARMED and MUTED"""
    board.hello()
    board.arm()
    board.hello()
    board.mute()
    check_fields(board.hello(), "HELLO_REPLY of a muted board", state=OutputState.MUTED)


@case("HG-4.3/2")
def carrier_divides_the_second(board: BoardClient) -> None:
    """carrier_hz divides 1000000"""
    carrier = board.identity.carrier_hz
    check(0 < carrier <= 1_000_000 and 1_000_000 % carrier == 0, f"carrier_hz is {carrier}")


@case("HG-4.3/3")
def clock_is_one_megahertz(board: BoardClient) -> None:
    """clock_hz is 1000000"""
    check_fields(board.identity, "HELLO_REPLY", clock_hz=1_000_000)


@case("HG-4.3/4")
def grid_holds_all_transducers(board: BoardClient) -> None:
    """grid_nx grid_ny is N, or both are 0"""
    nx, ny = board.identity.grid_nx, board.identity.grid_ny
    count = board.identity.transducers
    check((nx, ny) == (0, 0) or nx * ny == count, f"grid of {nx} x {ny}, {count} transducers")


@case("HG-4.3/5", needs_reset=True)
def boot_identity_differs(board: BoardClient) -> None:
    """boot_id after a reset is not the one before"""
    board.hello()
    now = board.identity.boot_id
    check(now != board.last_boot_id, f"boot_id is {now:#x} after a reset, as before")


@case("HG-4.3/6")
def hash_is_of_geometry(board: BoardClient) -> None:
    """geometry_hash is the CRC-32 of the geometry records of all transducers"""
    records = b"".join(element.pack() for element in board.read_geometry())
    check_fields(board.identity, "HELLO_REPLY", geometry_hash=zlib.crc32(records))


@case("HG-4.3/8")
def limits_are_large_enough(board: BoardClient) -> None:
    """every limit of what is advertised has the least value that a host may rely on"""
    identity = board.identity
    for name, least, features in LEAST_LIMITS:
        if not features or identity.features & features:
            got = getattr(identity, name)
            check(got >= least, f"{name} is {got}, must be {least} or more")
    if identity.features & (m.Feature.SEQUENCE_PHASES | m.Feature.CORRECTION):
        got, least = identity.max_upload_bytes, identity.transducers
        check(got >= least, f"max_upload_bytes is {got}, a frame has {least}")
    if identity.features & _UPLOADS:
        got = identity.max_chunk
        check(got <= _LONGEST_CHUNK, f"max_chunk is {got}; a frame holds {_LONGEST_CHUNK}")


@case("HG-4.3/9")
def window_fits_rx_window(board: BoardClient) -> None:
    """rx_window has room for upload_window of the longest chunks"""
    identity = board.identity
    board.need_any(_UPLOADS)
    longest = m.UploadChunk(0xFFFFFFFF, b"\xff" * min(identity.max_chunk, _LONGEST_CHUNK))
    window = identity.upload_window * len(board.link.request_wire(longest)[0])
    chunks = f"{identity.upload_window} chunks of {identity.max_chunk} bytes"
    text = f"rx_window is {identity.rx_window}; {chunks} are {window} on the line"
    check(identity.rx_window >= window, text)


@case("HG-4.1/3")
def refuses_nonce_0(board: BoardClient) -> None:
    """HELLO with the nonce 0 is refused with BAD_VALUE, detail 2; nothing changes"""
    board.link.refused(board.hello_message(0), m.ErrorCode.BAD_VALUE, 2)
    board.link.ping(1)


@case("HG-4.1/4")
def opens_one_session(board: BoardClient) -> None:
    """after a second HELLO the first session is stale, for requests and stream"""
    old = board.link.session
    board.hello()
    board.link.refused(m.Ping(0), m.ErrorCode.STALE_SESSION, board.link.session, session=old)
    with board.counting(stale_session=1):
        board.link.stream(board.flat_phases(), seq=0xFFF0, session=old)


@case("HG-4.1/4-reset", needs_reset=True)
def no_session_at_reset(board: BoardClient) -> None:
    """after a reset no session is open"""
    board.link.refused(m.Ping(0), m.ErrorCode.STALE_SESSION, 0, session=board.new_nonce())


@case("HG-4.2/1")
def hello_states_the_version(board: BoardClient) -> None:
    """HELLO_REPLY states the version that the board has"""
    reply = board.hello()
    check_fields(reply, "HELLO_REPLY", major=m.VERSION_MAJOR)
    for minor in (0, 1, 255):
        hello = m.Hello(m.VERSION_MAJOR, minor, board.new_nonce(), 0xFFFFFFFF)
        again = board.link.call(hello, m.HelloReply)
        board.adopt(again)
        check_fields(again, f"to HELLO of minor {minor}: HELLO_REPLY", minor=reply.minor)
    hello = m.Hello(m.VERSION_MAJOR + 1, 0, board.new_nonce(), 0)
    board.link.refused(hello, m.ErrorCode.VERSION, reply.major)


@case("HG-4.4/1-majors")
def every_other_major(board: BoardClient) -> None:
    """HELLO of each other major version: ERROR(VERSION), and the session goes on"""
    byte = ValueByte("major", m.Hello.WIRE["major"].offset, (m.VERSION_MAJOR,))
    _judge_majors(board, byte.wrong_values(thorough=board.thorough))


@case("HG-4.4/1")
def refuses_other_majors(board: BoardClient) -> None:
    """HELLO of other major versions is refused with VERSION; the session goes on"""
    _judge_majors(board, (0, m.VERSION_MAJOR + 1, 255))


def _judge_majors(board: BoardClient, majors: Sequence[int]) -> None:
    """FAILED unless HELLO with each major version is refused, and the board stays ARMED."""
    board.arm()
    with board.counting(requests=len(majors)):
        for major in majors:
            hello = m.Hello(major, 0, board.new_nonce(), 0)
            board.link.refused(hello, m.ErrorCode.VERSION, m.VERSION_MAJOR)
    board.check_status("a refused HELLO", state=OutputState.ARMED)


@case("HG-4.7/1", needs_reset=True)
def no_event_without_session(board: BoardClient) -> None:
    """for 0.3 s after a reset and a PING without a session no event comes"""
    board.link.refused(m.Ping(0), m.ErrorCode.STALE_SESSION, 0, session=77)
    board.mute()
    board.wire.idle(_LISTEN_US)
    events = [piece for piece in board.wire.received if piece.is_event]
    check(not events, f"{len(events)} events came before the first HELLO")


@case("HG-4.11/1")
def responses_have_their_session(board: BoardClient) -> None:
    """responses have the number of their request and the open session"""
    requests: tuple[m.Message, ...] = (m.Ping(1), m.GetStatus(), m.GetConfig(), m.Arm(), m.Disarm())
    for message in requests:
        board.link.seq += 77
        check_answer_session(board.link.ask(message), board.link.session)
    check_answer_session(board.link.ask(m.Ping(1), session=board.link.session ^ 0x0F0F), 0)


def check_answer_session(answer: ReceivedByClient, due: int, name: str = "") -> None:
    """FAILED unless an answer, to the request *name*, has the session that is open."""
    kind, session = annotated_type_name(answer.frame_header.type), answer.frame_header.session
    check_equal(session, due, f"{kind}{name and ' to '}{name} has session {session:#06x}")


@case("HG-4.11/2")
def responses_tell_the_time(board: BoardClient) -> None:
    """the header time is that of the first byte: t_tx of a PONG; it rises from reply to reply"""
    for _ in range(_TRIES):
        answers = [board.link.ask(message) for message in (m.Ping(1), m.GetStatus(), m.Ping(2))]
        times = [answer.frame_header.time_us for answer in answers]
        for answer in answers[::2]:
            t_tx_us = board.link.reply_in(answer, m.Pong).t_tx_us
            apart_us = abs(m.signed_difference(answer.frame_header.time_us, t_tx_us, 32))
            check(apart_us <= _CLOCK_US, f"header time and t_tx differ by {apart_us} µs")
        steps = [m.signed_difference(b, a, 32) for a, b in itertools.pairwise(times)]
        in_order = all(0 <= step < 5_000_000 for step in steps)
        check(in_order, f"times of three responses in a row: {times}")


@case("HG-4.11/2-exact")
def refusals_tell_the_time(board: BoardClient) -> None:
    """ERROR to unknown flags and a repeated HELLO_REPLY, behind a long reply: when they leave"""
    board.wire.require_exact_times()
    offset_us = _device_offset_us(board)
    greeting = board.hello_message(board.link.session)
    for message, flags in ((m.Ping(1), 0x40), (greeting, 0)):
        long, _ = board.link.request_wire(m.GetGeometry(0, 0xFFFF))
        short, _ = board.link.request_wire(message, flags=flags)
        _, answer = board.link.exchange(long, short)
        due_us = offset_us + board.wire.begun_us(answer)
        off_us = m.signed_difference(answer.frame_header.time_us, due_us & 0xFFFFFFFF, 32)
        name = annotated_type_name(answer.frame_header.type)
        check(abs(off_us) <= _CLOCK_US, f"the time of {name} is off by {off_us:+d} µs")


def _device_offset_us(board: BoardClient) -> int:
    """Return the device clock minus the transport's clock in µs, from the reply to one PING."""
    answer = board.link.ask(m.Ping(0))
    pong = board.link.reply_in(answer, m.Pong)
    return pong.t_tx_us - board.wire.begun_us(answer)


@case("HG-4.11/6")
def repetitions_keep_their_time(board: BoardClient) -> None:
    """a PING again, 20 ms later: the time in the header is that of the first PONG"""
    seq, times = board.link.next_seq(), []
    for _ in range(3):
        answer = board.link.ask(m.Ping(5), seq=seq)
        times.append((answer.frame_header.time_us, board.link.reply_in(answer, m.Pong).t_tx_us))
        board.wire.idle(20_000)
    check_equal(len(set(times)), 1, f"header time and t_tx of a PONG and its repetitions: {times}")


@case("HG-4.11/3")
def responses_come_promptly(board: BoardClient) -> None:
    """of 8 PINGs one is answered within 10 ms"""
    took = []
    for number in range(_TRIES):
        start_us = board.wire.now_us()
        board.link.ping(number)
        took.append(board.wire.now_us() - start_us)
    due_us = board.wire.period_us(2 * len(encode_frame(bytes(26)))) + _PROMPT_US
    check(min(took) <= due_us, f"the fastest of {_TRIES} answers took {min(took)} µs")


@case("HG-4.11/5")
def responses_precede_events(board: BoardClient) -> None:
    """MUTE without a session: MUTE_REPLY comes before STATE_CHANGED"""
    board.arm()
    _responses_in_order(board, m.Mute(), (m.MuteReply, m.StateChanged), session=0)


@case("HG-4.11/5-play", needs=m.Feature.SEQUENCE_PHASES)
def responses_precede_playback_ended(board: BoardClient) -> None:
    """STOP, MUTE, DISARM, HELLO during playback: reply, STATE_CHANGED, then PLAYBACK_ENDED"""
    playback.send_phases_that_fit(board, 1, frames=2)
    hello = board.hello_message(board.new_nonce())
    replies: tuple[tuple[m.Message, int | None, type[m.Message]], ...] = (
        (m.Stop(), None, m.StopReply),
        (m.Mute(), None, m.MuteReply),
        (m.Mute(), 0, m.MuteReply),
        (m.Disarm(), None, m.DisarmReply),
        (hello, None, m.HelloReply),
    )
    for message, session, reply in replies:
        board.arm()
        playback.play_now(board, 1, loops=0)
        told = (m.StateChanged,) if session == 0 else ()
        _responses_in_order(board, message, (reply, *told, m.PlaybackEnded), session=session)
    board.link.session = hello.nonce


def _responses_in_order(
    board: BoardClient, message: m.Message, due: tuple[type[m.Message], ...], *, session: int | None
) -> None:
    """Send *message*; FAILED if messages of the types *due* come in another order within 10 ms.

    *session* None: the open one.  One that does not come is no failure.
    """
    since = board.link.mark()
    board.link.ask(message, session=session)
    board.wire.idle_beyond(_EVENTS_US)
    came = [type(p.message) for p in board.wire.received[since:] if isinstance(p.message, due)]
    followed = ", ".join(kind.__name__ for kind in came)
    is_in_order = came == sorted(came, key=due.index)
    check(is_in_order, f"{message.TYPE.name} was followed by {followed}")


@case("HG-4.12/1-closed", needs_reset=True, evidence=SELF_REPORTED)
def every_frame_when_closed(board: BoardClient) -> None:
    """before the first HELLO frames of every type and session, 0 too, are stale: nothing is done"""
    streamed: list[int] = []
    answers = []
    for session in (0, 1, 0x8000, 0xFFFF, board.new_nonce()):
        for kind in request_types_of_host():
            name = f"{kind.TYPE.name} of session {session:#06x}"
            payload = bytes(kind.LAYOUT.size)
            if kind.TYPE in m.STREAM_RANGE:
                board.link.send(board.link.stream_raw(kind.TYPE, payload, session=session))
                streamed.append(kind.TYPE)
            elif kind.TYPE in m.REQUEST_RANGE and kind not in (m.Hello, m.Mute):
                answer = board.link.ask_raw(kind.TYPE, payload, session=session)
                answers.append((name, kind.TYPE, answer))
    identity = board.hello()
    check_fields(identity, "frames before the first HELLO", state=OutputState.DISARMED)
    lacking = unsupported_types(m.Feature(identity.features))  # these are refused in step 5
    for name, kind_of, answer in answers:
        unknown = kind_of in lacking
        code = m.ErrorCode.UNSUPPORTED if unknown else m.ErrorCode.STALE_SESSION
        board.link.error_in(answer, kind_of, code, kind_of if unknown else 0)
        check_answer_session(answer, 0, f"{name}, while none is open,")
    due = dict.fromkeys(_OF_A_SESSION, 0)
    due["stale_session"] = sum(kind not in lacking for kind in streamed)
    counters = board.status().counters
    check_fields(counters, f"{len(streamed)} frames before the first HELLO: counters", **due)
    asked = len(answers) + 2  # HELLO and GET_STATUS
    heard = board.link.knocks  # repetitions of the first one, to a board that boots
    text = f"{asked} requests from the reset on; requests is {counters.requests}"
    check(asked <= counters.requests <= asked + heard, text)


@case("HG-4.11/1-closed", needs_reset=True)
def every_answer_when_closed(board: BoardClient) -> None:
    """before the first HELLO every answer has session 0"""
    board.link.session = 0
    answers = {
        "MUTE": board.link.ask(m.Mute()),
        "MUTE of a session": board.link.ask(m.Mute(), session=0x1234),
        "PING": board.link.ask(m.Ping(1)),
        "PING of a session": board.link.ask(m.Ping(1), session=0x1234),
        "an unknown request": board.link.ask_raw(_UNKNOWN_REQUEST),
        "HELLO of another version": board.link.ask(m.Hello(m.VERSION_MAJOR + 1, 0, 1, 0)),
        "HELLO of nonce 0": board.link.ask(m.Hello(m.VERSION_MAJOR, 0, 0, 0)),
    }
    for name, answer in answers.items():
        check_answer_session(answer, 0, f"{name}, while none is open,")
