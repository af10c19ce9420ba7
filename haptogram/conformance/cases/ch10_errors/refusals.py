"""HG-3.6, HG-7.1, HG-10.1, HG-10.2: ERROR changes nothing, and has the code of its case."""

from __future__ import annotations

import dataclasses
import zlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Final

from haptogram_protocol import messages as m
from haptogram_protocol.state import OutputState

from ...case import Depth, case, case_about_host
from ...client import latching, playback, uploads
from ...client.board_client import BoardClient
from ...client.capabilities import TRACED_PLAYS
from ...client.stream_kinds import stream_kinds, valid_requests_to_send
from ...judge.events import judge_event_numbers
from ...judge.held_state import Held, held_state_changes, judged_held_state
from ...judge.refused_requests import (
    PENDING,
    STORED,
    Refusal,
    chunks_to_be_refused,
    judged_refusal,
    other_config_than_judged,
    requests_refused_by_link,
    requests_refused_by_value,
    requests_refused_now,
    requests_refused_while_armed,
    uploads_refused_for_playing,
)
from ...judge.timers import LEASE, UNATTENDED, judge_within_hold
from ...outcome import SELF_REPORTED, check, check_equal, check_fields, fail
from ..ch05_stream.every_drop import (
    DROPS,
    MUTED,
    OFF,
    OUTPUT_STATES,
    PLAYING_SLOWLY,
    QUEUES,
    WAITS,
    frames_to_drop,
)

_FRAMES: Final = 3
_GAP_BYTES: Final = 5  # of the shortest upload with bytes behind a gap, in it and behind it
_FRESH_US: Final = 4_000_000  # a situation is brought about again after this time
_PERIOD_US: Final = 9_000_000
_GAP: Final = 40
_UNKNOWN_FLAG: Final = 0x40
_LEASE_MS: Final = 90
#: A configuration away from the default.
_AWAY: Final = {
    "hold_ms": 10_000,
    "host_timeout_ms": 9876,
    "late_window_us": 100_000,
    "sound_speed_mm_s": 355_555,
    "trace_divider": 5,
}
_ABSENT: Final = 51
_EVENTS: Final = 2200  # more than 11 bits of event numbers
_CHANGING: Final = (
    m.Arm,
    m.Disarm,
    m.Stop,
    m.Play,
    m.SetConfig,
    m.UploadBegin,
    m.UploadChunk,
    m.UploadCommit,
)
#: What a configuration itself changes, of what a board holds.
_BY_CONFIG: Final = ("config_crc", "the configuration", "the radiated drive")

unknown_codes = case_about_host("HG-10.1/3")


@case("HG-10.1/1")
def error_refusals_change_nothing(board: BoardClient) -> None:
    """refused requests leave state, configuration, queue and stream numbers alone"""
    board.arm()
    config = board.link.call(m.GetConfig(), m.ConfigReply)
    t_us = board.clock.soon_us(bytes(2000), ahead_us=10_000)
    with board.counting(latched=2):
        board.link.stream(board.flat_phases(), t_us)
        board.link.refused_raw(0x43, b"\x00", m.ErrorCode.BAD_LENGTH, 0)
        board.link.refused_raw(0x43, b"", m.ErrorCode.UNSUPPORTED, 0x20, flags=0x20)
        board.link.refused_raw(0x43, b"", m.ErrorCode.STALE_SESSION, session=board.link.session ^ 3)
        board.link.refused(m.GetGeometry(0xFFFF, 1), m.ErrorCode.NOT_FOUND)
        board.clock.wait_until(t_us + 100)
        latching.latch_now(board)
    board.check_status("a refusal", state=OutputState.ARMED)
    found = board.link.call(m.GetConfig(), m.ConfigReply)
    check_equal(found, config, "a refusal has changed the configuration")


@case("HG-10.1/2")
def stream_gets_no_error(board: BoardClient) -> None:
    """stream frames, good ones and bad ones of every kind, get no answer"""
    kind = stream_kinds(board)[0]
    for drop in DROPS:
        if drop.queued >= 0:
            _, wires = frames_to_drop(board, drop, kind)
            board.link.unanswered(f"a stream frame {drop.summary}", *wires)
    board.arm()
    others = board.link.stream_wire(kind.make()), board.link.stream_raw(0x3C, b"abc")
    board.link.unanswered("a stream frame that is latched, or of no known type", *others)


@case("HG-10.2/1")
def uses_the_right_error_codes(board: BoardClient) -> None:
    """each refusal of an ARMED board has the code that SPEC.md gives; none is BUSY"""
    playback.send_phases_to_store_if_supported(board, STORED, frames=1)
    board.arm()
    board.link.refused_raw(0x7B, b"", m.ErrorCode.UNSUPPORTED, 0x7B)
    _judge_error_codes(board, requests_refused_while_armed(board))


def _judge_error_codes(board: BoardClient, refusals: Iterable[Refusal]) -> None:
    """FAILED unless each request is refused with the code that is due."""
    for refusal in refusals:
        check_fields(judged_refusal(board, refusal), refusal.name, code=refusal.code)


@dataclass(frozen=True, slots=True)
class Situation:
    """A state of a board in which requests are refused."""

    name: str

    def bring(self, board: BoardClient) -> int:
        """Bring it about in a new session; return the t_apply of the last queued frame, 0: none."""
        _set_before_refusal(board)
        board.arm()
        if self.name != PLAYING_SLOWLY:
            latching.latch_now(board, stream_kinds(board)[-1].make())
        last_us = OUTPUT_STATES[self.name](board)
        return last_us if self.name == QUEUES else 0

    def refusals(self, board: BoardClient) -> Iterator[Refusal]:
        """Yield the requests that are refused in it."""
        stores = board.has(m.Feature.SEQUENCE_PHASES)
        if self.name == QUEUES:
            yield from requests_refused_while_armed(board)
        else:
            yield from requests_refused_now(board) if stores else ()
            yield from (
                uploads_refused_for_playing(board) if self.name in (PLAYING_SLOWLY, WAITS) else ()
            )
            yield from requests_refused_by_link(board)
            yield from requests_refused_by_value(board)
        if stores:
            yield from chunks_to_be_refused(board, len(pending_before_refusal(board)))


def _set_before_refusal(board: BoardClient) -> None:
    """Open a session with settings away from the default and an upload of which a byte is sent."""
    board.hello()
    board.link.stream_next += _GAP  # numbers of more than 16 bits
    board.link.stream(board.shortest_stream(), flags=_UNKNOWN_FLAG)
    if board.has(m.Feature.CORRECTION) and not any(board.correction or b""):
        uploads.upload_correction(board)
    if board.has(m.Feature.CONFIG):
        louder = {"ramp_ms": 33, "amplitude_ceiling": 77} if board.has(m.Feature.AMPLITUDE) else {}
        ring = {"trace_mode": m.TraceMode.RING} if board.has(m.Feature.TRACE_RING) else {}
        board.configure(**_AWAY, **louder, **ring)
    if board.has(m.Feature.SEQUENCE_PHASES):
        _begin_upload_before_refusal(board)


def pending_before_refusal(board: BoardClient) -> bytes:
    """Return the bytes of the upload that is under way in every situation."""
    count = board.identity.transducers
    frames = playback.phases_that_fit(board, _FRAMES) if count >= _GAP_BYTES else _FRAMES
    return bytes(number % 251 for number in range(frames * count))


def _begin_upload_before_refusal(board: BoardClient) -> bytes:
    """Begin the upload, send its first byte, and return all of its bytes."""
    data = pending_before_refusal(board)
    uploads.begin_upload(board, m.UploadKind.PHASES, PENDING, data)
    board.link.call(m.UploadChunk(0, data[:1]), m.UploadChunkReply)
    return data


def refusal_situations(board: BoardClient) -> Iterator[Situation]:
    """Yield the situations that a board can be brought into; in a quick run one."""
    plays = (PLAYING_SLOWLY, WAITS) if board.has(m.Feature.SEQUENCE_PHASES) else ()
    for name in (QUEUES, *plays, OFF, MUTED) if board.thorough else (QUEUES,):
        yield Situation(name)


# --- Cases -------------------------------------------------------------------------------------


@case("HG-10.1/1-types", evidence=SELF_REPORTED)
def every_refusal_changes_nothing(board: BoardClient) -> None:
    """queue, output, playback, upload, margins, settings, ring: no refused request changes them"""
    playback.send_phases_to_store_if_supported(board, STORED, frames=1)
    for situation in refusal_situations(board):
        _judge_refusals_in_situation(board, situation)
        if board.has(m.Feature.SEQUENCE_PHASES):
            _check_upload_resumes(board, situation.name)


def _judge_refusals_in_situation(board: BoardClient, situation: Situation) -> None:
    """Bring the board to *situation*; FAILED if a request refused in it changes the held state."""
    brought_us = board.wire.now_us()
    last_us, before = brought_to_refusal(board, situation)
    for refusal in list(situation.refusals(board)):
        if is_situation_old(board, brought_us):
            brought_us = board.wire.now_us()
            last_us, before = brought_to_refusal(board, situation)
        after = held_after_refusals(board, last_us, partial(judged_refusal, board, refusal))
        text = held_state_changes(before, after)
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


def _check_upload_resumes(board: BoardClient, name: str) -> None:
    """FAILED unless the pending upload can be completed, and it and the stored sequence play."""
    data = pending_before_refusal(board)
    uploads.send_upload_chunks(board, data)
    taken = board.link.ask(m.UploadCommit(PENDING)).message
    check(
        isinstance(taken, m.UploadCommitReply), f"{name}: the upload cannot be committed any more"
    )
    board.hello()
    for sequence, frames in ((STORED, 1), (PENDING, len(data) // board.identity.transducers)):
        board.arm()
        with board.counting(latched=frames):
            playback.play_now(board, sequence, loops=1)
            playback.let_play(board, frames + 1)
            board.wire.idle_beyond(0)


@case("HG-10.1/1-mismatch", needs=m.Feature.SEQUENCE_PHASES)
def every_mismatch_leaves_the_upload(board: BoardClient) -> None:
    """an upload outlives a commit that is refused with CRC_MISMATCH: the right bytes complete it"""
    data = _begin_upload_before_refusal(board)
    damaged = bytes([data[0] ^ 0x40]) + data[1:]
    uploads.send_upload_chunks(board, damaged)
    since = board.link.mark()
    before = judged_held_state(board, since)
    for _ in range(2):
        board.link.refused(m.UploadCommit(PENDING), m.ErrorCode.CRC_MISMATCH, zlib.crc32(damaged))
        text = held_state_changes(before, judged_held_state(board, since))
        check(not text, f"a commit refused with CRC_MISMATCH: {text}")
    board.link.call(m.UploadChunk(0, data[:1]), m.UploadChunkReply)
    answer = board.link.ask(m.UploadCommit(PENDING))
    board.link.reply_in(answer, m.UploadCommitReply, m.UploadCommit.TYPE)


@case("HG-10.1/1-timers", needs=m.Feature.CONFIG, depth=Depth.DEFAULT)
def every_refusal_leaves_the_timers(board: BoardClient) -> None:
    """behind a refusal of every kind lease and unattended time have their own lengths and
    reasons
    """
    playback.send_phases_to_store_if_supported(board, STORED, frames=1)
    for plays in (False, True) if board.has(m.Feature.SEQUENCE_PHASES) else (False,):
        playing = Situation(PLAYING_SLOWLY).refusals
        refusals = list(playing(board) if plays else requests_refused_while_armed(board))
        for group in [[r] for r in refusals] if board.wire.is_virtual else [refusals]:
            _judge_timer_behind_refusals(board, group, plays=plays)


def _judge_timer_behind_refusals(
    board: BoardClient, refusals: Sequence[Refusal], *, plays: bool
) -> None:
    """FAILED unless the lease or, if *plays*, the unattended time expires on time.

    It counts from a PING behind the refused requests.
    """
    lease_ms = board.clock.timer_ms(_LEASE_MS, 4 * board.identity.transducers)
    board.hello()
    since = board.arm(host_timeout_ms=2 * lease_ms if plays else lease_ms, hold_ms=10_000)
    if plays:
        playback.play_now(board, STORED, loops=0, period_us=_PERIOD_US, unattended_ms=lease_ms)
    else:
        latching.latch_now(board)
    for refusal in refusals:
        judged_refusal(board, refusal)
    start_us = board.clock.device_us()
    timer = UNATTENDED if plays else LEASE
    name = f"{timer.name}, behind {refusals[0].name if len(refusals) == 1 else 'refusals'}"
    timer.judge(board, since, start_us, lease_ms, name)


@case("HG-10.2/1-types")
def every_refusal_has_its_error_code(board: BoardClient) -> None:
    """a request of every type, refused for every reason, gets the code of that reason"""
    playback.send_phases_to_store_if_supported(board, STORED, frames=1)
    queued = Situation(QUEUES)
    queued.bring(board)
    _judge_error_codes(board, list(queued.refusals(board)))


def _allowed_readings(board: BoardClient) -> list[m.Message]:
    """Return every read-only request."""
    return [one for one in valid_requests_to_send(board, _ABSENT) if not isinstance(one, _CHANGING)]


@case("HG-10.2/1-moments", evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def every_reading_is_always_answered(board: BoardClient) -> None:
    """requests that only ask are answered while streaming, playing, waiting, DISARMED and MUTED"""
    playback.send_phases_to_store_if_supported(board, STORED, frames=1)
    for situation in refusal_situations(board):
        last_us, before = brought_to_refusal(board, situation)
        for message in _allowed_readings(board):
            answer = board.link.ask(message)
            name = f"{situation.name}, {message.TYPE.name}"
            if isinstance(answer.message, m.Error) or answer.message is None:
                fail(f"{name} is answered by {board.link.answer_text(answer)}")
        text = held_state_changes(before, held_after_refusals(board, last_us))
        check(not text, f"{situation.name}, requests that only ask: {text}")


@case("HG-7.1/3-alone", needs=m.Feature.CONFIG, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def every_setting_changes_only_itself(board: BoardClient) -> None:
    """a field set while frames wait, a sequence plays or an upload is under way changes only
    itself
    """
    playback.send_phases_to_store_if_supported(board, STORED, frames=1)
    for situation in refusal_situations(board):
        last_us, before = brought_to_refusal(board, situation)
        other = other_config_than_judged(board)
        changed: dict[str, Any] = {
            "ramp_ms": other.ramp_ms if board.has(m.Feature.AMPLITUDE) else 0,
            "late_window_us": other.late_window_us,
            "sound_speed_mm_s": other.sound_speed_mm_s,
            "amplitude_ceiling": other.amplitude_ceiling,
            "trace_divider": other.trace_divider,
            "host_timeout_ms": board.config.host_timeout_ms - 1,
            "hold_ms": board.config.hold_ms - 1,
        }
        usual = board.config
        for name, value in changed.items():
            wanted = m.SetConfig(dataclasses.replace(usual, **{name: value}))
            board.link.call(wanted, m.SetConfigReply)
            after = held_after_refusals(board, last_us)
            held = {key: value for key, value in before.items() if key not in _BY_CONFIG}
            text = held_state_changes(before, {key: after[key] for key in held})
            check(not text, f"{situation.name}, {name} is set: {text}")
        board.config = usual


@case("HG-7.1/3-hello", needs=m.Feature.CONFIG)
def every_speed_is_told_by_hello(board: BoardClient) -> None:
    """HELLO_REPLY tells the speed of sound that is set"""
    for speed in (300_000, 343_210, 380_000):
        board.configure(sound_speed_mm_s=speed)
        told = board.hello().sound_speed_mm_s
        check_equal(told, speed, f"sound_speed_mm_s {speed} is set, HELLO_REPLY says {told}")


@case("HG-3.6/2-events", needs=TRACED_PLAYS, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def every_event_of_many_is_numbered(board: BoardClient) -> None:
    """2200 events of one session count up by 1: more than 11 bits of their numbers are kept"""
    playback.send_phases_that_fit(board, STORED, frames=2)
    board.configure(trace_mode=m.TraceMode.CRC)
    board.hello()
    since, period_us = board.arm(), playback.shortest_period_to_play_us(board, 500)
    playback.play_out(board, STORED, 2, loops=_EVENTS // 2, period_us=period_us)
    judge_event_numbers(board, board.wire.received[since:])
    board.disarm()
