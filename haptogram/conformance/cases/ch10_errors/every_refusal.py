"""HG-10.1, HG-10.2: a refused request of every type and for every reason changes nothing."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Final

from haptogram_protocol.messages import (
    ErrorCode,
    Feature,
    Mute,
    TraceMode,
    UploadChunk,
    UploadChunkReply,
    UploadCommit,
    UploadCommitReply,
    UploadKind,
)
from haptogram_protocol.state import MuteReason

from ...case import Depth, case
from ...client.board_client import BoardClient
from ...client.latching import latch_now
from ...client.playback import (
    let_play,
    phases_that_fit,
    play_later,
    play_now,
    send_phases_to_store_if_supported,
)
from ...client.stream_kinds import stream_kinds
from ...client.uploads import announce_upload, send_upload_chunks, upload_request, upload_to_board
from ...judge.held_state import Held, held_state_changes, judged_held_state
from ...judge.refused_requests import (
    PENDING,
    STORED,
    Refusal,
    chunks_to_be_refused,
    judged_refusal,
    requests_refused_by_link,
    requests_refused_by_value,
    requests_refused_now,
    requests_refused_while_armed,
    uploads_refused_for_playing,
)
from ...judge.timers import judge_mute_time, judge_within_hold, judged_mute_by_timer
from ...outcome import SELF_REPORTED, check, check_equal
from ..ch05_stream.every_drop import fill_queue

_FRAMES: Final = 3
_GAP_BYTES: Final = 5  # of the shortest upload with bytes behind a gap, in it and behind it
_AHEAD_US: Final = 8_000_000  # queued frames and a waiting playback are due then
_FRESH_US: Final = 4_000_000  # a situation is brought about again after this time
_PERIOD_US: Final = 9_000_000
_QUEUED: Final = 3
_GAP: Final = 40
_UNKNOWN_FLAG: Final = 0x40
_MS: Final = 1000
_LEASE_MS: Final = 90
#: Names of the situations.
QUEUED: Final = "with frames queued"
PLAYING: Final = "while a sequence plays"
WAITING: Final = "while a playback waits for its start"
OFF: Final = "while DISARMED"
MUTED: Final = "while MUTED"


@dataclass(frozen=True, slots=True)
class Situation:
    """A state of a board in which requests are refused.

    Attributes
    ----------
    name : str
        For reports.
    bring : callable
        Brings it about in a new session; returns the t_apply of the last queued frame, 0: none.
    refusals : callable
        Yields the requests that are refused in it.
    """

    name: str
    bring: Callable[[BoardClient], int]
    refusals: Callable[[BoardClient], Iterator[Refusal]]


# --- Situations --------------------------------------------------------------------------------


def _set_before_refusal(board: BoardClient) -> None:
    """Open a session, with settings away from the default, and an upload of one byte."""
    board.hello()
    board.link.stream_next += _GAP  # numbers of more than 16 bits
    board.link.stream(board.shortest_stream(), flags=_UNKNOWN_FLAG)
    if board.has(Feature.CORRECTION) and not any(board.correction or b""):
        codes = board.random.randbytes(board.identity.transducers)
        upload_to_board(board, UploadKind.CORRECTION, 0, codes)
    if board.has(Feature.CONFIG):
        ring = board.has(Feature.TRACE_RING)
        board.configure(
            hold_ms=10_000,
            ramp_ms=33 if board.has(Feature.AMPLITUDE) else 0,
            host_timeout_ms=9876,
            late_window_us=100_000,
            sound_speed_mm_s=355_555,
            trace_mode=TraceMode.RING if ring else TraceMode.OFF,
            amplitude_ceiling=77 if board.has(Feature.AMPLITUDE) else 255,
            trace_divider=5,
        )
    if board.has(Feature.SEQUENCE_PHASES):
        _begin_upload_before_refusal(
            board, pending_before_refusal(board), zlib.crc32(pending_before_refusal(board))
        )


def pending_before_refusal(board: BoardClient) -> bytes:
    """Return the bytes of the upload that is under way in every situation."""
    count = board.identity.transducers
    frames = phases_that_fit(board, _FRAMES) if count >= _GAP_BYTES else _FRAMES
    return bytes(number % 251 for number in range(frames * count))


def _begin_upload_before_refusal(board: BoardClient, data: bytes, crc: int) -> None:
    """Begin an upload, and send its first byte."""
    begin = upload_request(board, UploadKind.PHASES, PENDING, len(data), crc=crc)
    announce_upload(board, begin)
    board.link.call(UploadChunk(0, data[:1]), UploadChunkReply)


def _streaming_before_refusal(board: BoardClient) -> int:
    _set_before_refusal(board)
    board.arm()
    latch_now(board, stream_kinds(board)[-1].make())
    return fill_queue(board, _QUEUED, _AHEAD_US)


def _playing_before_refusal(board: BoardClient) -> int:
    _set_before_refusal(board)
    board.arm()
    play_now(board, STORED, loops=0, period_us=_PERIOD_US, unattended_ms=9_999)
    board.clock.wait_latched()
    return 0


def _waiting_before_refusal(board: BoardClient) -> int:
    _set_before_refusal(board)
    board.arm()
    latch_now(board, stream_kinds(board)[-1].make())
    play_later(board, STORED, _AHEAD_US, unattended_ms=9_999)
    return 0


def _disarmed_before_refusal(board: BoardClient) -> int:
    _set_before_refusal(board)
    board.arm()
    latch_now(board, stream_kinds(board)[-1].make())
    board.disarm()
    return 0


def _muted_before_refusal(board: BoardClient) -> int:
    _disarmed_before_refusal(board)
    board.link.ask(Mute())
    return 0


def _refusals_always(board: BoardClient) -> Iterator[Refusal]:
    yield from requests_refused_by_link(board)
    yield from requests_refused_by_value(board)
    if board.has(Feature.SEQUENCE_PHASES):
        yield from chunks_to_be_refused(board, len(pending_before_refusal(board)))


def _refusals_while_streaming(board: BoardClient) -> Iterator[Refusal]:
    yield from requests_refused_while_armed(board)
    if board.has(Feature.SEQUENCE_PHASES):
        yield from chunks_to_be_refused(board, len(pending_before_refusal(board)))


def _refusals_while_playing(board: BoardClient) -> Iterator[Refusal]:
    yield from requests_refused_now(board)
    yield from uploads_refused_for_playing(board)
    yield from _refusals_always(board)


def _refusals_while_off(board: BoardClient) -> Iterator[Refusal]:
    if board.has(Feature.SEQUENCE_PHASES):
        yield from requests_refused_now(board)
    yield from _refusals_always(board)


def refusal_situations(board: BoardClient) -> Iterator[Situation]:
    """Yield the situations that a board can be brought into; in a quick run one."""
    yield Situation(QUEUED, _streaming_before_refusal, _refusals_while_streaming)
    if not board.thorough:
        return
    if board.has(Feature.SEQUENCE_PHASES):
        yield Situation(PLAYING, _playing_before_refusal, _refusals_while_playing)
        yield Situation(WAITING, _waiting_before_refusal, _refusals_while_playing)
    yield Situation(OFF, _disarmed_before_refusal, _refusals_while_off)
    yield Situation(MUTED, _muted_before_refusal, _refusals_while_off)


# --- Cases -------------------------------------------------------------------------------------


@case("HG-10.1/1-types", evidence=SELF_REPORTED)
def every_refusal_changes_nothing(board: BoardClient) -> None:
    """queue, output, playback, upload, margins, settings, ring: no refused request changes them"""
    send_phases_to_store_if_supported(board, STORED, frames=1)
    for situation in refusal_situations(board):
        _judge_refusals_in_situation(board, situation)
        if board.has(Feature.SEQUENCE_PHASES):
            _goes_on_after_refusal(board, situation.name)


def _judge_refusals_in_situation(board: BoardClient, situation: Situation) -> None:
    """FAILED with the name of the first refusal in a situation that changes anything."""
    brought_us = board.wire.now_us()
    last_us, before = brought_to_refusal(board, situation)
    for refusal in list(situation.refusals(board)):
        if is_situation_old(board, brought_us):
            brought_us = board.wire.now_us()
            last_us, before = brought_to_refusal(board, situation)
        text = held_state_changes(
            before, held_after_refusals(board, last_us, partial(judged_refusal, board, refusal))
        )
        text = text and f"{situation.name}, refused {refusal.name}: {text}"
        judge_within_hold(board, brought_us, not text, text)


def brought_to_refusal(board: BoardClient, situation: Situation) -> tuple[int, Held]:
    """Bring a situation about; return the t_apply of its last frame, and what the board holds."""
    last_us = situation.bring(board)
    board.status()  # the margins start anew
    return last_us, held_after_refusals(board, last_us)


def is_situation_old(board: BoardClient, brought_us: int) -> bool:
    """Return True if a situation was brought about so long ago that its hold may end soon."""
    return board.wire.now_us() - brought_us > min(_FRESH_US, 300 * board.config.hold_ms)


def held_after_refusals(
    board: BoardClient, last_us: int, happen: Callable[[], object] = lambda: None
) -> Held:
    """Return the state after a frame that is dropped for its order, and what *happen* does."""
    since = board.link.mark()
    if last_us:
        board.link.stream(board.shortest_stream(), last_us)
    happen()
    return judged_held_state(board, since)


def _goes_on_after_refusal(board: BoardClient, name: str) -> None:
    """FAILED unless the upload under way can be completed, and both sequences are played."""
    data = pending_before_refusal(board)
    send_upload_chunks(board, data)
    taken = board.link.ask(UploadCommit(PENDING)).message
    check(isinstance(taken, UploadCommitReply), f"{name}: the upload cannot be committed any more")
    board.hello()
    for sequence, frames in ((STORED, 1), (PENDING, len(data) // board.identity.transducers)):
        board.arm()
        with board.counting(latched=frames):
            play_now(board, sequence, loops=1)
            let_play(board, frames + 1)
            board.wire.idle_beyond(0)


@case("HG-10.1/1-mismatch", needs=Feature.SEQUENCE_PHASES)
def a_refusal_of_a_mismatch_changes_nothing(board: BoardClient) -> None:
    """an upload outlives a commit that is refused with CRC_MISMATCH: the right bytes complete it"""
    data = pending_before_refusal(board)
    _begin_upload_before_refusal(board, data, zlib.crc32(data))
    damaged = bytes([data[0] ^ 0x40]) + data[1:]
    send_upload_chunks(board, damaged)
    since = board.link.mark()
    before = judged_held_state(board, since)
    for _ in range(2):
        board.link.refused(UploadCommit(PENDING), ErrorCode.CRC_MISMATCH, zlib.crc32(damaged))
        text = held_state_changes(before, judged_held_state(board, since))
        check(not text, f"a commit refused with CRC_MISMATCH: {text}")
    board.link.call(UploadChunk(0, data[:1]), UploadChunkReply)
    answer = board.link.ask(UploadCommit(PENDING))
    board.link.reply_in(answer, UploadCommitReply, UploadCommit.TYPE)


@case("HG-10.1/1-timers", needs=Feature.CONFIG, depth=Depth.DEFAULT)
def a_refusal_leaves_every_timer(board: BoardClient) -> None:
    """behind a refusal of every kind lease and unattended time have their own lengths and
    reasons
    """
    send_phases_to_store_if_supported(board, STORED, frames=1)
    for plays in (False, True) if board.has(Feature.SEQUENCE_PHASES) else (False,):
        source = _refusals_while_playing if plays else requests_refused_while_armed
        refusals = list(source(board))
        for group in [[r] for r in refusals] if board.wire.is_virtual else [refusals]:
            _judge_timer_behind_refusals(board, group, plays=plays)


def _judge_timer_behind_refusals(
    board: BoardClient, refusals: Sequence[Refusal], *, plays: bool
) -> None:
    """FAILED unless the timer of the host, renewed once more, runs out with its own length."""
    lease_ms = board.clock.timer_ms(_LEASE_MS, 4 * board.identity.transducers)
    board.hello()
    since = board.arm(host_timeout_ms=2 * lease_ms if plays else lease_ms, hold_ms=10_000)
    if plays:
        play_now(board, STORED, loops=0, period_us=_PERIOD_US, unattended_ms=lease_ms)
    else:
        latch_now(board)
    for refusal in refusals:
        judged_refusal(board, refusal)
    start_us = board.clock.device_us()
    reason = MuteReason.UNATTENDED if plays else MuteReason.HOST_SILENT
    header, _ = judged_mute_by_timer(board, since, 4 * lease_ms * _MS, reason)
    name = f"{reason.name}, behind {refusals[0].name if len(refusals) == 1 else 'refusals'}"
    judge_mute_time(board, start_us, header, lease_ms, name)


@case("HG-10.2/1-types")
def every_refusal_has_its_error_code(board: BoardClient) -> None:
    """a request of every type, refused for every reason, gets the code of that reason"""
    send_phases_to_store_if_supported(board, STORED, frames=1)
    _streaming_before_refusal(board)
    for refusal in list(_refusals_while_streaming(board)):
        code = judged_refusal(board, refusal).code
        names = ErrorCode._value2member_map_
        check_equal(code, refusal.code, f"{refusal.name}: {names.get(code, code)!r} instead")
