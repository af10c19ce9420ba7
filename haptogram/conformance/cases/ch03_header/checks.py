"""HG-3.8: the order in which a board checks frames, and MUTE among others in one burst."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from typing import Final, TypeAlias

from haptogram_protocol import messages as m
from haptogram_protocol.framing import DELIMITER, decode_frame
from haptogram_protocol.state import MuteReason, OutputState

from ...case import Depth, case
from ...client import latching, playback
from ...client.board_client import BoardClient
from ...client.request_client import flags_at_once
from ...client.stream_kinds import stream_kinds
from ...client.wire import ReceivedByClient
from ...outcome import SELF_REPORTED, check, check_equal, check_fields
from .every_frame_type import (
    judge_mute,
    judge_two_defects_of_requests,
    judge_two_defects_of_stream,
)

_STALE: Final = 0x0F0F
_LATEST_US: Final = 1 << 30  # behind the last in the queue: what is half a turn ahead has passed
_STEP_US: Final = 1000
_SEQUENCE: Final = 4
_AHEAD_US: Final = 60  # of a frame's t_apply: it would be latched between two MUTE
_LONGEST: Final = 4096
_STAGES: Final = (2, 1)  # frames between how many pairs of MUTE

#: Makes the frames between two MUTE of a burst.
_Between: TypeAlias = Callable[[], list[bytes]]


@case("HG-3.8/1")
def checks_requests_in_order(board: BoardClient) -> None:
    """requests with two defects are refused for the one that is checked first"""
    requests: list[m.Message] = [m.Ping(0)]
    if board.identity.features & (m.Feature.SEQUENCE_PHASES | m.Feature.CORRECTION):
        requests.append(m.UploadCommit(1))  # without an upload: BAD_STATE, were it right
    judge_two_defects_of_requests(board, requests)


@case("HG-3.8/1-stream", evidence=SELF_REPORTED)
def checks_stream_in_order(board: BoardClient) -> None:
    """stream frames with two defects are counted for the one that is checked first"""
    judge_two_defects_of_stream(board, stream_kinds(board)[:1])
    with board.counting(dropped_state=1):
        board.link.stream(board.flat_phases(), 0)


@case("HG-3.8/1-queue", evidence=SELF_REPORTED)
def checks_queue_in_order(board: BoardClient) -> None:
    """a full queue: order is checked before room, room before horizon, order before lateness"""
    depth = board.depth_to_fill()
    good = board.shortest_stream()
    board.hello()
    board.arm()
    times = board.times_in_queue(depth, others=4)
    with board.counting(dropped_order=2, dropped_full=2, flushed=depth):
        board.link.send(*(board.link.stream_wire(good, t_us) for t_us in times))
        beyond_us = times[-1] + min(2 * board.identity.max_horizon_us, _LATEST_US)
        for t_us in (times[-1], times[0] - 10 * 1_000_000, times[-1] + _STEP_US, beyond_us):
            board.link.stream(good, t_us)
        board.link.barrier()  # or MUTE may overtake them
        board.clock.end_exchange()
        board.mute()
        board.clock.require_before(times[0], "MUTE of frames that wait")


@case("HG-3.8/2")
def answers_in_arrival_order(board: BoardClient) -> None:
    """a PING of the new session right behind its HELLO is answered, after it"""
    nonce = board.new_nonce()
    hello, first = board.link.request_wire(board.hello_message(nonce))
    ping, second = board.link.request_wire(m.Ping(5), session=nonce)
    since = board.link.mark()
    greeting, pong = board.link.exchange(hello, ping)
    board.adopt(board.link.reply_in(greeting, m.HelloReply))
    board.link.reply_in(pong, m.Pong)
    numbers = [piece.frame_header.seq for piece in board.link.responses(since)]
    check_equal(numbers, [first, second], "numbers of the answers")


@case("HG-3.8/4", evidence=SELF_REPORTED)
def frames_before_mute(board: BoardClient) -> None:
    """ARM, a stream frame, PLAY, ARM and MUTE at once: off behind it, each frame done or refused"""
    ahead: list[m.Message] = [m.Ping(7), m.Arm()]
    if board.has(m.Feature.SEQUENCE_PHASES):
        playback.send_phases_that_fit(board, _SEQUENCE, frames=2)
        ahead.insert(1, playback.play_request(board, _SEQUENCE, loops=0, unattended_ms=1000))
    for _ in board.wire.ways_of_mute():
        for session, sounds in itertools.product((board.link.session, 0), (False, True)):
            board.arm()
            if not sounds:
                board.disarm()
            before = board.status().counters
            arm, *others = (_request_in_burst(board, message) for message in (m.Arm(), *ahead))
            frame = board.link.stream_wire(board.flat_phases())
            mute = _mute_in_burst(board, session)
            _judge_answers_in_burst(board, "MUTE behind others", arm, frame, *others, mute)
            board.clock.wait_latched()
            _judge_silence_behind_mute(board)
            due = ({"accepted": taken, "dropped_state": 1 - taken} for taken in (1, 0))
            board.check_counted(before, "a stream frame, ... and MUTE at once", *due)


def _judge_answers_in_burst(board: BoardClient, name: str, *wires: bytes) -> None:
    """Send *wires* back to back; FAILED unless each request among them gets its reply.

    ARM and PLAY may be refused, as a MUTE has overtaken them; *name* begins the finding.
    """
    answers = iter(board.link.exchange(*wires))
    for _, sent in (m.parse_body(decode_frame(wire.strip(DELIMITER))) for wire in wires):
        if sent.TYPE in m.REQUEST_RANGE:
            _judge_answer_in_burst(board, f"{name}: {sent.TYPE.name}", sent, next(answers))


def _judge_answer_in_burst(
    board: BoardClient, name: str, sent: m.Message, answer: ReceivedByClient
) -> None:
    """FAILED unless *answer* is the response to *sent*; *name* begins the finding.

    ARM and PLAY may be refused as MUTED; MUTE has to report MUTED, and HELLO its nonce.
    """
    got, text = answer.message, f"{name} is answered by {board.link.answer_text(answer)}"
    if isinstance(got, m.Error) and isinstance(sent, m.Arm | m.Play):
        check_fields(got, name, code=m.ErrorCode.BAD_STATE, detail=OutputState.MUTED)
        return
    check(got is not None and got.TYPE == sent.TYPE + m.RESPONSE_OFFSET, text)
    if isinstance(got, m.MuteReply):
        check_fields(got, name, state=OutputState.MUTED)
    elif isinstance(sent, m.Hello):
        check_fields(got, name, nonce=sent.nonce)


def _judge_silence_behind_mute(board: BoardClient) -> None:
    """FAILED unless the board, after a MUTE, is MUTED with no drive, and latches nothing soon.

    Soon is within 5 ms or, if longer, two playback periods.
    """
    muted: dict[str, object] = {"state": OutputState.MUTED, "reason": MuteReason.MUTE, "queued": 0}
    before = board.check_status("behind MUTE", **muted).counters
    latching.check_silent(board, "behind MUTE")
    playback.wait_for_no_latch(board, 5000)
    behind = board.check_status("a while behind MUTE", **muted).counters
    check_fields(behind, "what arrived before MUTE, behind it", latched=before.latched)


@case("HG-3.8/3")
def mute_passes_all_checks(board: BoardClient) -> None:
    """MUTE with any session, flags, payload and number is carried out"""
    for header in (
        {"session": 0},
        {"session": board.link.session ^ _STALE},
        {"flags": 0xFF},
        {"seq": board.link.seq - 1},
        {"seq": board.link.seq},
    ):
        judge_mute(board, 17, **header)


# --- MUTE in a burst ---------------------------------------------------------------------------


def _request_in_burst(board: BoardClient, message: m.Message) -> bytes:
    """Return the bytes of a request with the next number; a PLAY begins at once."""
    return board.link.request_wire(message, flags=flags_at_once(message))[0]


def _mute_in_burst(board: BoardClient, session: int | None) -> bytes:
    """Return the bytes of a MUTE of *session*; None: of the open one."""
    return board.link.request_wire(m.Mute(), session=session)[0]


def _hello_in_burst(board: BoardClient) -> bytes:
    """Return the frame of a HELLO that opens a session; later frames are of that session."""
    nonce = board.new_nonce()
    sent = _request_in_burst(board, board.hello_message(nonce))
    board.link.session, board.link.stream_next = nonce, m.FIRST_STREAM_SEQ
    return sent


def _enabling_requests(board: BoardClient) -> Iterator[tuple[str, _Between]]:
    """Yield requests that could enable the output after a MUTE: name, builder of their frames."""
    link = board.link

    def arm() -> bytes:
        return _request_in_burst(board, m.Arm())

    def at_a_time() -> bytes:
        t_us = board.clock.ready_us(board.clock.device_estimate_us()) + _AHEAD_US
        return link.stream_wire(board.flat_phases(), t_us)

    yield "ARM", lambda: [arm(), arm()]
    yield "ARM and a frame for soon", lambda: [arm(), at_a_time()]
    for kind in board.sample(stream_kinds(board)):
        yield (
            f"ARM and {kind.name}, IMMEDIATE",
            lambda make=kind.make: [arm(), link.stream_wire(make())],  # type: ignore[misc]
        )
    if board.has(m.Feature.SEQUENCE_PHASES):
        play = playback.play_request(board, _SEQUENCE, loops=0, unattended_ms=1000)
        yield "ARM and PLAY", lambda: [arm(), _request_in_burst(board, play)]
    yield (
        "HELLO, ARM and a frame",
        lambda: [_hello_in_burst(board), arm(), link.stream_wire(board.flat_phases())],
    )


@case("HG-3.8/4-burst", evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def every_burst_of_mutes(board: BoardClient) -> None:
    """MUTE, what may switch on, MUTE (and again) in one burst: nothing is on, ARM counts behind
    it
    """
    playback.send_phases_to_store_if_supported(board, _SEQUENCE, frames=2)
    for way in board.wire.ways_of_mute():
        for name, make in _enabling_requests(board):
            for stages, others in itertools.product(board.sample(_STAGES), (False, True)):
                text = f"{name}{' of no session' * others}, between {stages + 1} MUTE {way}"
                _judge_burst_of_mutes(board, text, make, stages, others=others)


def _judge_burst_of_mutes(
    board: BoardClient, name: str, make: _Between, stages: int, *, others: bool
) -> None:
    """Send a burst of MUTEs to a sounding board; FAILED unless it mutes and can rearm.

    Between them are *stages* times the frames of *make*; with *others*, no MUTE has the open
    session.
    """
    board.arm()
    latching.latch_now(board)
    sessions = itertools.cycle((0, board.link.session ^ _STALE) if others else (None,))
    before = board.status().counters
    at_one_moment = _is_line_time_zero(board)
    burst = [_mute_in_burst(board, next(sessions))]
    for _ in range(stages):
        burst += [*make(), _mute_in_burst(board, next(sessions))]
    _judge_answers_in_burst(board, name, *burst)
    board.clock.wait_computed(stages * board.most_points)
    board.clock.wait_latched()
    _judge_silence_behind_mute(board)
    if at_one_moment:
        board.check_counted(before, f"{name}, which came at one moment", {"latched": 0})
    board.arm()
    with board.counting(latched=1):
        latching.latch_now(board)


def _is_line_time_zero(board: BoardClient) -> bool:
    """Wait for mid carrier period and return True, if 4096 bytes come within one such period.

    Return False at once on a slower line and at a wall clock.
    """
    if not board.clock.is_one_moment(_LONGEST):
        return False
    carrier_us = board.clock.carrier_us
    board.wire.idle((carrier_us // 2 - board.clock.device_us()) % carrier_us)
    return True
