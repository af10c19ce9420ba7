"""HG-4.6: HELLO with the nonce of the session, and with a new one, at every moment."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable
from functools import partial
from typing import Final

from haptogram_protocol import messages as m
from haptogram_protocol.state import MuteReason, OutputState

from ...case import Depth, case
from ...client import latching, playback, uploads
from ...client.board_client import BoardClient
from ...client.capabilities import trace_modes
from ...judge.repetition import every_request_to_repeat, judge_repeated_reply
from ...judge.witness import judge_nothing_read_back
from ...outcome import SELF_REPORTED, check, check_equal, check_fields, named
from ..ch05_stream.every_drop import output_states
from ..ch06_output.mute import check_flushes
from ..ch07_configuration.playback import judge_ended_playback

_SEQUENCE: Final = 4
_FRAMES: Final = 4
_PLAYED: Final = 6
_EDGES: Final = (0x7FFF, 0x8000, 0x00FF, 0xFF00, 0xFFFF, 0x0100)
_UPLOADED: Final = 5
_LATCHES: Final = 3
_APART_US: Final = 500

#: The sessions that follow session A.
_PATHS: Final = {"B": "the next session", "BA": "A behind B", "BCA": "A behind B and C"}


@case("HG-4.6/1")
def same_nonce(board: BoardClient) -> None:
    """HELLO with the open nonce: same reply; ARMED, queue and numbers stay; repeated + 1"""
    first = board.hello()
    board.arm()
    t_us = board.clock.soon_us(bytes(2000))
    with board.counting(repeated=1, latched=2):
        board.link.stream(board.flat_phases(), t_us)
        again = board.hello(board.link.session)
        board.clock.wait_until(t_us)
        latching.latch_now(board)
    check_equal(again, first, "HELLO again has another reply than the first")
    board.check_status("HELLO of the open session", state=OutputState.ARMED)


@case("HG-4.6/1-time")
def same_nonce_keeps_time(board: BoardClient) -> None:
    """HELLO with the open nonce: its own number, and a time between those of two PONGs around it"""
    greeting = board.hello_message(board.link.session)
    first = board.link.ask(greeting)
    board.wire.idle(20_000)
    answers = [board.link.ask(message) for message in (m.Ping(1), greeting, m.Ping(2))]
    check_equal(answers[1].message, first.message, "a repeated HELLO has another reply")
    times = [answer.frame_header.time_us for answer in answers]
    steps = [m.signed_difference(b, a, 32) for a, b in itertools.pairwise(times)]
    check(min(steps) >= 0, f"times of PONG, HELLO_REPLY and PONG in a row: {times}")


@case("HG-4.6/1-fields")
def same_nonce_other_fields(board: BoardClient) -> None:
    """HELLO with the open nonce, another minor version, description or number: the same greeting"""
    first = board.hello()
    board.arm()
    index = latching.latch_now(board)
    same = board.hello_message(board.link.session)
    others = ({"minor": same.minor + 1}, {"minor": 255}, {"reserved": 0xFFFFFFFF}, {"reserved": 1})
    with board.counting(repeated=len(others)):
        for fields in others:
            again = board.link.call(dataclasses.replace(same, **fields), m.HelloReply)
            check_equal(again, first, f"HELLO with {fields}: another reply than the first")
    board.check_status("HELLO of the open session", state=OutputState.ARMED, last_seq=index)


@case("HG-4.6/2")
def new_nonce_and_state(board: BoardClient) -> None:
    """a new nonce: ARMED becomes DISARMED (NEW_SESSION), MUTED stays MUTED"""
    board.arm()
    latching.latch_now(board)
    board.hello()
    due: dict[str, object] = {"state": OutputState.DISARMED, "reason": MuteReason.NEW_SESSION}
    board.check_status("ARMED, then a new session", **due)
    board.mute()
    check_fields(board.hello(), "MUTED, then a new session: HELLO_REPLY", state=OutputState.MUTED)
    board.arm()


@case("HG-4.6/3", evidence=SELF_REPORTED)
def new_nonce_flushes(board: BoardClient) -> None:
    """a new nonce flushes the queue; no queued frame is latched"""
    check_flushes(board, board.hello)


@case("HG-4.6/3-playback", needs=m.Feature.SEQUENCE_PHASES)
def new_nonce_ends_playback(board: BoardClient) -> None:
    """a new nonce ends playback and abandons an upload"""
    judge_ended_playback(board, BoardClient.hello, "HELLO")
    _judge_possession(board, "B", _no_upload_in_session)


@case("HG-4.6/4")
def new_nonce_starts_anew(board: BoardClient) -> None:
    """a new nonce: requests and stream count anew, an old reply is forgotten"""
    board.arm()
    latching.latch_random(board, 20)
    board.link.seq = 500
    nonce = board.new_nonce()
    board.hello(nonce, seq=3)
    board.link.ping(1, seq=4)  # far behind 500
    board.arm_at(5)
    with board.counting(latched=1):
        index = latching.latch_now(board)
    board.check_status("the first frame of a session", last_seq=index)


@case("HG-4.6/4-ring", needs=m.Feature.TRACE_RING | m.Feature.CONFIG, evidence=SELF_REPORTED)
def new_nonce_empties_ring(board: BoardClient) -> None:
    """a new nonce empties the trace ring"""
    _judge_possession(board, "B", _no_ring_in_session)


@case("HG-4.6/5", needs=m.Feature.CONFIG)
def new_nonce_keeps_settings(board: BoardClient) -> None:
    """a new nonce keeps configuration and counters"""
    board.configure(hold_ms=4321, ramp_ms=77)
    _judge_kept_settings(board, "a new session")


def _judge_kept_settings(board: BoardClient, name: str) -> None:
    """Open a session; FAILED unless configuration, correction and counters stay as they were.

    The board must not be ARMED nor have frames queued; *name* begins the finding.
    """
    before, config = board.status(), board.config
    reply = board.hello()
    check_fields(reply, f"{name}: HELLO_REPLY", config_crc=before.config_crc)
    check(reply.state is not OutputState.ARMED, f"{name}: the board is ARMED in a new session")
    check_equal(board.read_config(), config, f"{name}: the configuration has changed")
    board.check_counters_kept(before.counters, name)
    board.check_status(name, queued=0)


@case("HG-4.6/5-sequences", needs=m.Feature.SEQUENCE_PHASES)
def new_nonce_keeps_sequences(board: BoardClient) -> None:
    """a new nonce keeps stored sequences"""
    playback.send_phases_to_store(board, 3, frames=2)
    board.hello()
    board.arm()
    with board.counting(latched=2):
        playback.play_out(board, 3, 2)


@case("HG-4.6/6")
def hello_of_any_number(board: BoardClient) -> None:
    """HELLO is accepted with number 0, 0x8000, 0xFFFF, ...; the next request counts from there"""
    for seq in (0, 0x8000, 0xFFFF, 0x7FFF, 1):
        board.hello(seq=seq)
        board.link.seq = seq
        board.link.refused_as_used(m.Ping(1))
        board.link.ping(2)


# --- A new session at every moment ---------------------------------------------------------------


def _session_with_everything_set(board: BoardClient) -> m.Config:
    """Set every field of the configuration away from its default and return it."""
    return board.configure(
        hold_ms=4321,
        ramp_ms=0 if not board.has(m.Feature.AMPLITUDE) else 33,
        host_timeout_ms=7654,
        status_period_ms=0,
        late_window_us=12_345,
        sound_speed_mm_s=355_555,
        trace_mode=m.TraceMode.OFF,
        amplitude_ceiling=77,
        trace_divider=515,
    )


def _uploading_session(board: BoardClient) -> None:
    """Begin an upload of a sequence, and send its first byte."""
    data = bytes(2 * board.identity.transducers)
    uploads.begin_upload(board, m.UploadKind.PHASES, _SEQUENCE, data)
    board.link.ask(m.UploadChunk(0, data[:1]))


@case(
    "HG-4.6/5-moments", needs=m.Feature.CONFIG | m.Feature.SEQUENCE_PHASES, evidence=SELF_REPORTED
)
def every_session_keeps_settings(board: BoardClient) -> None:
    """a new session, idle, muted, streaming, playing, uploading, leaves every setting as it is"""
    if board.has(m.Feature.CORRECTION):
        uploads.upload_correction(board)
    playback.send_phases_to_store(board, _SEQUENCE, frames=_FRAMES)
    _session_with_everything_set(board)
    for name, bring in (*output_states(board), ("during an upload", _uploading_session)):
        board.arm()
        bring(board)
        _judge_kept_settings(board, name)
        board.arm()
        text = f"{name}: the stored sequence in a new session"
        with named(text), board.counting(latched=_FRAMES):
            playback.play_out(board, _SEQUENCE, _FRAMES)
        board.disarm()


# --- A repeated HELLO --------------------------------------------------------------------------


@case("HG-4.6/2-nonces")
def every_nonce_opens_session(board: BoardClient) -> None:
    """nonces one bit from the open one, and the least and greatest, each open a session,
    DISARMED
    """
    for step in (*range(16), *_EDGES):
        board.arm()
        nonce = step if step in _EDGES else board.link.session ^ 1 << step
        if nonce and nonce != board.link.session:
            _check_hello_opens(board, nonce)
    nonces = [board.new_nonce()]
    for number in range(12):  # each of the two to four sessions before comes again
        if number < 4:
            board.hello()
            nonces.append(board.link.session)
        old = nonces[-2 - number % 3]
        if old == board.link.session:
            continue
        board.arm()
        _check_hello_opens(board, old)
        nonces.append(old)
        board.link.ping(number)


def _check_hello_opens(board: BoardClient, nonce: int) -> None:
    """FAILED unless HELLO with a new nonce opens a session in state DISARMED."""
    name = f"HELLO with {nonce:#06x}: HELLO_REPLY"
    check_fields(board.hello(nonce), name, nonce=nonce, state=OutputState.DISARMED)


@case("HG-4.6/1-effects")
def every_repeated_hello_does_nothing(board: BoardClient) -> None:
    """a HELLO of the open nonce of any number leaves numbers, remembered reply, playback, upload"""
    board.hello()
    board.arm()
    hello = board.hello_message(board.link.session)
    for ahead in (0, 1, 9, 20_000, 40_000, -1):
        ping = m.Ping(ahead & 0xFF)
        first = board.link.ask(ping)
        board.link.ask(hello, seq=board.link.seq + ahead)
        judge_repeated_reply(board, ping, first, f"HELLO of the open nonce {ahead} numbers on")
        board.link.ping(1)  # the next number, which is not used up
    if board.has(m.Feature.SEQUENCE_PHASES):
        _check_playback_goes_on(board, hello)


def _check_playback_goes_on(board: BoardClient, hello: m.Hello) -> None:
    """FAILED if *hello*, of the open session, ends a playback or a pending upload."""
    frames = playback.send_phases_to_store(board, _PLAYED, frames=2)
    since = board.link.mark()
    playback.play_now(board, _PLAYED, loops=0)
    data = b"".join(frames)
    uploads.begin_upload(board, m.UploadKind.PHASES, _PLAYED + 1, data)
    half = min(len(data) // 2, board.identity.max_chunk)
    board.link.ask(m.UploadChunk(0, data[:half]))
    board.link.ask(hello)
    board.check_status("HELLO of the open nonce", state=OutputState.ARMED)
    ended = board.link.events(m.PlaybackEnded, since)
    check(not ended, "HELLO of the open nonce has ended the playback")
    for start in range(half, len(data), max(1, half)):
        board.link.ask(m.UploadChunk(start, data[start : start + half]))
    reply = board.link.call(m.UploadCommit(_PLAYED + 1), m.UploadCommitReply)
    check_fields(reply, "an upload around HELLO of the open nonce", frames=len(frames))


@case("HG-4.6/1-reply", needs=m.Feature.CONFIG)
def every_repeated_hello_reply_stays(board: BoardClient) -> None:
    """a repeated HELLO gets the first reply, with the state and settings of then, after any
    change
    """
    happenings: dict[str, Callable[[], object]] = {
        "ARM": board.arm,
        "SET_CONFIG": lambda: _session_with_everything_set(board),
        "a latch": lambda: latching.latch_now(board, board.flat_phases(3)),
        "MUTE": board.mute,
    }
    if board.has(m.Feature.SEQUENCE_PHASES):
        happenings["an upload that begins"] = partial(_uploading_session, board)
    if board.has(m.Feature.CORRECTION):
        happenings["a new correction"] = partial(uploads.upload_correction, board)
    board.configure(sound_speed_mm_s=331_300)
    first = board.hello()
    for name, happen in happenings.items():
        happen()
        again = board.hello(board.link.session)
        check_equal(again, first, f"after {name}: another HELLO_REPLY than the first")
    last = board.hello()
    due = {"sound_speed_mm_s": board.config.sound_speed_mm_s, "state": OutputState.MUTED}
    check_fields(last, "HELLO_REPLY", config_crc=board.status().config_crc, **due)
    changed = {"sound_speed_mm_s": 0, "config_crc": 0, "state": OutputState.MUTED, "nonce": 1}
    same = [dataclasses.replace(reply, **changed) for reply in (first, last)]  # type: ignore[arg-type]
    check_equal(same[1], same[0], "the identity has changed with settings")


# --- What belongs to a session, and does not come back with it -----------------------------------


def _paths_of_sessions(board: BoardClient) -> dict[str, str]:
    """Return the orders in which to open sessions after A, each with a title: "BA" is B, then A.

    At a wall clock that is the only one.
    """
    return _PATHS if board.wire.is_virtual else {"BA": _PATHS["BA"]}


def _open_sessions_in_turn(board: BoardClient, path: str, number: int) -> None:
    """Open the sessions *path*, a letter each (A: the open one), by HELLOs with number *number*."""
    nonces = {"A": board.link.session}
    for name in path:
        if name not in nonces:
            nonces[name] = board.new_nonce()
        board.hello(nonces[name], seq=number & 0xFFFF)
    board.link.seq = number


@case("HG-4.6/4-replies", evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def every_reply_ends_with_session(board: BoardClient) -> None:
    """a reply of every type, refusals too, is forgotten in the next session, and in A behind B"""
    for path, name in _paths_of_sessions(board).items():
        for message in every_request_to_repeat(board):
            board.arm()
            text = f"{message.TYPE.name}, and again in {name}"
            with named(text), board.counting(requests=len(path) + 2, repeated=0):
                first = board.link.ask_at_once(message)
                _open_sessions_in_turn(board, path, board.link.seq - 1)
                board.wire.idle(_APART_US)
                again = board.link.ask_at_once(message)  # the same bytes, if the session is A
            is_new = again.frame_header.time_us != first.frame_header.time_us
            check(is_new, f"{text}: the time is the first's")


# --- Everything else that a session owns -------------------------------------------------------


def _no_drive_in_session(board: BoardClient) -> None:
    """FAILED if the board reads back a drive of the session before; no read-back: do nothing."""
    if board.has(m.Feature.READ_LATCHED):
        judge_nothing_read_back(board, m.DriveKind.LATCHED, "behind another session")


def _no_latch_in_session(board: BoardClient) -> None:
    """FAILED if STATUS reports latches or queued frames of the session before."""
    board.check_status("another session", last_seq=0, last_latch_us=0, queued=0)


def _no_ring_in_session(board: BoardClient) -> None:
    """FAILED if the trace ring has records of the session before; no ring: do nothing."""
    if board.has(m.Feature.TRACE_RING):
        check_fields(latching.read_ring(board), "the ring", oldest=0, next=0, records=())


def _no_upload_in_session(board: BoardClient) -> None:
    """FAILED if an upload of the session before can be continued or committed."""
    if board.has(m.Feature.SEQUENCE_PHASES):
        board.link.refused(m.UploadChunk(0, b"\x00"), m.ErrorCode.BAD_STATE)
        board.link.refused(m.UploadCommit(_UPLOADED), m.ErrorCode.BAD_STATE)


def _check_numbers_restart(board: BoardClient) -> None:
    """FAILED unless a new session's first frame is latched, and its trace, if any, is event 0."""
    can_trace = board.has(m.Feature.CONFIG)
    modes = trace_modes(board, m.TraceMode.DRIVE, m.TraceMode.CRC)[:1] if can_trace else []
    since = board.arm(trace_mode=modes[0]) if modes else board.arm()
    with board.counting(latched=1):
        latching.latch_now(board)
    traces = [
        p for p in board.wire.received[since:] if isinstance(p.message, m.Trace | m.TraceDrive)
    ]
    numbers = [piece.frame_header.seq for piece in traces]
    text = f"the first events of the session have the numbers {numbers}"
    check_equal(numbers, [0] * len(modes), text)


#: What belongs to a session: each judges that it is gone.
_OWNED: Final = (
    _no_drive_in_session,
    _no_latch_in_session,
    _no_ring_in_session,
    _no_upload_in_session,
    _check_numbers_restart,
)


@case("HG-4.6/4-owned", evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def every_possession_ends_with_session(board: BoardClient) -> None:
    """drive, latches, ring, upload and numbers of a session are gone in the next, and in A
    behind B
    """
    for path, judge in itertools.product(_paths_of_sessions(board), _OWNED):
        _judge_possession(board, path, judge, ahead_us=5_000_000)


def _judge_possession(
    board: BoardClient, path: str, judge: Callable[[BoardClient], None], ahead_us: int = 0
) -> None:
    """In a session latch, queue, trace and upload; open the sessions of *path*, then call *judge*.

    *path* has a letter for each session.  The queued frame is due *ahead_us* after the earliest
    time that the line allows.
    """
    if board.has(m.Feature.TRACE_RING | m.Feature.CONFIG):
        board.configure(trace_mode=m.TraceMode.RING)
    if board.has(m.Feature.SEQUENCE_PHASES):
        uploads.begin_upload(
            board, m.UploadKind.PHASES, _UPLOADED, bytes(board.identity.transducers)
        )
    board.arm()
    latching.latch_random(board, _LATCHES)
    waiting_us = board.clock.soon_us(bytes(2000), ahead_us=ahead_us)
    board.link.stream(board.flat_phases(), waiting_us)
    _open_sessions_in_turn(board, path, board.link.seq - 20)
    judge(board)
