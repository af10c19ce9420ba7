"""HG-2.4, HG-4.6, HG-6.3, HG-6.7, HG-6.11, HG-7.6, HG-9.1, HG-12.2: what starts timers anew."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Collection, Iterator, Sequence
from functools import partial
from typing import Any, Final

from haptogram_protocol import messages as m
from haptogram_protocol.framing import MAX_ENCODED_BYTES, encode_frame
from haptogram_protocol.state import MuteReason

from ...case import Depth, case
from ...client import latching, malformed_frames, playback
from ...client.board_client import BoardClient
from ...client.capabilities import PLAYS
from ...client.stream_kinds import (
    StreamKind,
    refused_requests_to_send,
    stream_kinds,
    valid_requests_to_send,
)
from ...judge.refused_requests import (
    judged_refusal,
    requests_refused_while_armed,
)
from ...judge.timers import (
    HOLD,
    LEASE,
    RAMP,
    TIMED,
    UNATTENDED,
    TimerKind,
    judge_in_time,
    judge_status_period,
    judge_unmoved,
    judged_mute_by_timer,
    timer_kinds,
)
from ..ch05_stream.every_drop import DROPS, Drop

_MS: Final = 1000
#: Leases, and the times after which a frame renews them: at first short ones.
_LEASES_MS: Final = ((20, 10), (60, 20), (240, 100), (240, 100))
_OTHER_MS: Final = 200  # by which the lease is longer that an unattended time replaces
#: The same for lease and ramp together, of equal lengths, with the frame in the ramp.
_LEASES_IN_RAMPS_MS: Final = ((40, 30), (80, 60), (320, 240), (320, 240))
_UNKNOWN_FLAG: Final = 0x40
_STRANGE_TYPES: Final = {
    "an unknown stream frame": 0x3E,
    "an unknown request": 0x7B,
    "a PING of a wrong length": 0x44,
    "a response": 0x84,
    "an unknown response": 0xBE,
    "an event": 0xC1,
    "an unknown event": 0xEE,
}
STORED: Final = 2  # sequence that is played
TIMER_MS: Final = 200  # of a timer that nothing renews
SLOW_US: Final = 9_000_000  # period of a playback of which one frame is seen


# --- What renews nothing -----------------------------------------------------------------------
_LENGTH_MS: Final = 100  # of a timer, and what the frames take on the line
_RAMP_MS: Final = 80
_MOMENTS: Final = (0.4, 0.8, 1.3)  # of the length: the last one in the ramp
_STALE: Final = 0x0F0F


@case("HG-12.2/1-latches", needs=m.Feature.CONFIG, depth=Depth.DEFAULT)
def latches_renew_no_lease(board: BoardClient) -> None:
    """no latch, of queue or playback, and no HELLO again renews lease or unattended time"""
    ramp_ms = TIMER_MS if board.has(m.Feature.AMPLITUDE) else 0
    for timer in timer_kinds(board, LEASE, UNATTENDED):
        board.hello()
        since = board.link.mark()
        timer.start(board, TIMER_MS, ramp_ms=ramp_ms)
        if timer is LEASE:
            _queue_over_lease(board, TIMER_MS + ramp_ms)
        start_us = board.clock.device_us()
        again = board.hello_message(board.link.session)  # which has no effect but its reply
        for part in (1, 2, 3, 4, 5):  # the later ones during the ramp
            board.clock.idle_until(start_us + part * (TIMER_MS + ramp_ms) * _MS // 6)
            board.link.send(board.link.request_wire(again, session=0)[0])
        timer.judge(board, since, start_us, TIMER_MS + ramp_ms, f"{timer.name}, latches")


def _queue_over_lease(board: BoardClient, length_ms: int) -> None:
    """Latch a frame, queue others 50 ms apart for *length_ms*, as many as the queue takes."""
    latching.latch_now(board)
    first_us = board.clock.soon_us(bytes(4000))
    good, number = board.shortest_stream(), min(board.identity.queue_depth, length_ms // 50)
    times = [first_us + 50 * _MS * place for place in range(number)]
    board.link.send(*(board.link.stream_wire(good, t_us) for t_us in times))


# --- The lease, and the unattended time in its place -------------------------------------------


def play_later_than_timer(board: BoardClient, ahead_ms: int, alone_ms: int) -> None:
    """Let a playback of the stored sequence wait so long for its start, or until it is ready."""
    ahead_us = max(ahead_ms * _MS, board.clock.ready_us(20 * _MS))
    playback.play_later(board, STORED, ahead_us, period_us=SLOW_US, unattended_ms=alone_ms)


@case("HG-7.6/5-waiting", needs=PLAYS, depth=Depth.DEFAULT)
def waits_unattended(board: BoardClient) -> None:
    """from PLAY on, also before its start, unattended_ms stands for host_timeout_ms; STOP ends
    that
    """
    playback.send_phases_that_fit(board, STORED, frames=2)
    board.configure(host_timeout_ms=80, hold_ms=10_000)
    for name, ahead_ms, alone_ms in (
        ("its start comes", 120, 240),
        ("muted before its start", 400, 160),
    ):
        since = board.arm()
        play_later_than_timer(board, ahead_ms, alone_ms)
        start_us = board.clock.device_us()
        UNATTENDED.judge(board, since, start_us, alone_ms, f"unattended_ms, {name}")
    for ahead_ms in (0, 5000):
        since = board.arm()
        play_later_than_timer(board, ahead_ms + 60, 9000)
        board.wire.idle(150 * _MS)
        asked_us = board.clock.device_estimate_us()
        answer = board.stop()  # nothing behind it: that would renew the lease
        board.link.reply_in(answer, m.StopReply, m.Stop.TYPE)
        start_us = board.clock.unwrap(answer.frame_header.time_us)
        name = "host_timeout_ms behind STOP"
        LEASE.judge(board, since, start_us, 80, name, asked_us=asked_us)


@case("HG-6.7/1-types", needs=m.Feature.CONFIG, depth=Depth.DEFAULT)
def every_type_renews_the_lease(board: BoardClient) -> None:
    """frames of every type, good, bad and repeated, each renew the lease: it runs out behind
    them
    """
    judge_renewals(board, plays=False)


@case("HG-6.7/1-playing", needs=PLAYS, depth=Depth.DEFAULT)
def every_type_renews_the_unattended_time(board: BoardClient) -> None:
    """in a playback frames of every type, good, bad and repeated, each renew the unattended time"""
    judge_renewals(board, plays=True)


@case("HG-6.11/4-types", needs=m.Feature.CONFIG | m.Feature.AMPLITUDE, depth=Depth.DEFAULT)
def every_type_ends_the_ramp_of_a_lease(board: BoardClient) -> None:
    """during a ramp of the lease frames of every type, good and bad, each end it"""
    judge_renewals(board, plays=False, ramps=True)


def judge_renewals(
    board: BoardClient, *, plays: bool, ramps: bool = False, names: Collection[str] = ()
) -> None:
    """FAILED unless the timer, renewed by one frame, runs out its whole length behind it.

    With *names*: the frames named alone.
    If it *ramps*, the frame comes in the ramp, which makes up the second half of that length. A
    frame that seems to renew nothing is sent anew in longer times: host or board may have been
    late.
    """
    timer = "unattended time" if plays else "lease"
    playback.send_phases_to_store_if_supported(board, STORED, frames=2)
    size = 2 * 2 * 2 * board.identity.transducers
    repeated = _repeated_renewals(board, plays=plays)
    at_once = ((name, make, None) for name, make in _renewals(board, plays=plays))
    is_long = names or ((ramps or plays) and not board.wire.is_virtual)
    for name, make, first in itertools.chain(at_once, () if is_long else repeated):
        if names and name not in names:
            continue
        for least_ms, wait_ms in _LEASES_IN_RAMPS_MS if ramps else _LEASES_MS:
            lasts_ms = board.clock.timer_ms(least_ms, size)
            ramp_ms = least_ms // 2 if ramps else 0
            host_timeout_ms = lasts_ms - ramp_ms + (_OTHER_MS if plays else 0)
            if board.config.host_timeout_ms != host_timeout_ms:
                board.configure(host_timeout_ms=host_timeout_ms, hold_ms=10_000, ramp_ms=ramp_ms)
            took_ms = _muted_by_lease_after_ms(board, make, lasts_ms, wait_ms, first, plays=plays)
            off_ms = took_ms - lasts_ms
            if wait_ms / 2 < off_ms < wait_ms + _OTHER_MS / 2:
                break
        else:
            text = f"{timer} of {lasts_ms} ms, {name} after {wait_ms} ms: muted {took_ms:.1f} ms"
            due = f"due is {lasts_ms + wait_ms} ms: this frame begins it anew"
            judge_in_time(board, False, f"{text} after its start, {due}")


def _muted_by_lease_after_ms(
    board: BoardClient,
    make: Callable[[], bytes],
    lasts_ms: int,
    wait_ms: int,
    first: m.Message | None,
    *,
    plays: bool,
) -> float:
    """Return the ms from the start of the lease to its mute, when a frame arrives in between.

    If *plays*, it is the unattended timer.  It lasts *lasts_ms* and starts at ARM or PLAY, or at
    the request *first*, if given; *make* builds the frame, sent after *wait_ms*.
    """
    since = board.link.mark()
    answer = board.link.ask(m.Arm())
    if plays:
        alone_ms = min(lasts_ms, board.identity.max_unattended_ms)
        play = playback.play_request(
            board, STORED, loops=0, period_us=SLOW_US, unattended_ms=alone_ms
        )
        answer = board.link.ask_at_once(play)
    board.link.reply_in(
        answer, *((m.PlayReply, m.Play.TYPE) if plays else (m.ArmReply, m.Arm.TYPE))
    )
    answer = board.link.ask(first) if first else answer
    start_us = board.clock.unwrap(answer.frame_header.time_us)
    board.wire.idle(wait_ms * _MS)
    board.link.send(make())
    reason = MuteReason.UNATTENDED if plays else MuteReason.HOST_SILENT
    header, _ = judged_mute_by_timer(board, since, (lasts_ms + 1000) * _MS, reason)
    return (board.clock.unwrap(header.time_us) - start_us) / _MS


def _renewals(board: BoardClient, *, plays: bool) -> Iterator[tuple[str, Callable[[], bytes]]]:
    """Yield frames and requests, also refused ones, that renew the lease: name, builder.

    If *plays*, it is the unattended time that they renew.
    """
    kinds, make = stream_kinds(board), partial(_frame_that_renews, board)
    for stream_kind in kinds:
        frame = stream_kind.make()
        yield stream_kind.name, partial(make, frame.TYPE, frame.serialize())
    for drop in DROPS:
        is_sent = drop.armed and not drop.queued and drop.counter != "stale_session"
        if is_sent and any(drop.frames(board, kinds[0], 0)):
            dropped = partial(_dropped_frame_that_renews, board, drop, kinds[0])
            yield f"a frame {drop.summary}", dropped
    for name, kind in _STRANGE_TYPES.items():
        yield name, partial(make, kind, bytes(2))
    for message in _requests_that_renew(board, plays=plays):
        request = partial(make, message.TYPE, message.serialize())
        yield message.TYPE.name, request
        yield f"{message.TYPE.name} with an unknown flag", partial(request, flags=_UNKNOWN_FLAG)
    for refusal in board.sample(requests_refused_while_armed(board), 0):
        other = (m.ErrorCode.STALE_SESSION, m.ErrorCode.SEQUENCE_REUSED)
        if refusal.kind != m.Hello.TYPE and refusal.code not in other:  # HELLO is of no session
            yield refusal.name, partial(make, refusal.kind, refusal.payload, **refusal.header)


def _requests_that_renew(board: BoardClient, *, plays: bool) -> list[m.Message]:
    """Return the valid requests to send but DISARM, PLAY and, if *plays* (a sequence), STOP."""
    ends = (m.Disarm, m.Play, m.Stop) if plays else (m.Disarm, m.Play)
    valid = valid_requests_to_send(board, STORED + plays)
    return [message for message in valid if not isinstance(message, ends)]


def _repeated_renewals(
    board: BoardClient, *, plays: bool
) -> Iterator[tuple[str, Callable[[], bytes], m.Message]]:
    """Yield requests that repeat a used number: name, builder, the request made before.

    The same bytes are answered from memory, others are refused.
    """
    refused = [one for one in refused_requests_to_send(board) if not isinstance(one, m.Play)]
    for message in (*_requests_that_renew(board, plays=plays), *refused):
        wire = partial(_frame_that_renews, board, message.TYPE, message.serialize(), back=0)
        yield f"{message.TYPE.name}, and the same again", wire, message
    for name, back in (("its number in another PING", 0), ("an old number", 1)):
        other = partial(_frame_that_renews, board, m.Ping.TYPE, m.Ping(1).serialize(), back=back)
        yield f"PING, and {name}", other, m.Ping(0)


def _frame_that_renews(
    board: BoardClient, kind: int, payload: bytes, back: int | None = None, **header: Any
) -> bytes:
    """Return a frame of type *kind* with *payload*, the next number, and the given header fields.

    If *back* is given, a request has the number *back* before that of the last request.
    """
    if kind in m.STREAM_RANGE:
        return board.link.stream_raw(kind, payload, **header)
    seq = board.link.next_seq() if back is None else board.link.seq - back
    return encode_frame(board.link.body(kind, payload, seq=seq, **header))


def _dropped_frame_that_renews(board: BoardClient, drop: Drop, kind: StreamKind) -> bytes:
    """Return one stream frame of *kind* that the board drops for the reason *drop*."""
    return next(iter(drop.frames(board, kind, 0)))


# --- STATUS ------------------------------------------------------------------------------------


@case("HG-9.1/1-types", needs=m.Feature.CONFIG, depth=Depth.DEFAULT)
def nothing_else_restarts_the_status_timer(board: BoardClient) -> None:
    """STATUS comes at its time whatever is sent and refused meanwhile: only STATUS restarts it"""
    period_ms = board.quick_status_ms + 7
    board.configure(status_period_ms=period_ms)
    since, end_us = board.link.mark(), board.wire.now_us() + 6 * period_ms * _MS
    while board.wire.now_us() < end_us:
        board.arm()
        latching.latch_now(board)
        for message in valid_requests_to_send(board, STORED):
            if not isinstance(message, m.SetConfig):
                board.link.ask(message)
            board.wire.idle(period_ms * _MS // 40)
        board.arm()
        for refusal in requests_refused_while_armed(board):
            judged_refusal(board, refusal)
            board.wire.idle(period_ms * _MS // 40)
        board.hello(board.link.session)
    board.link.barrier()
    judge_status_period(board, since, period_ms, 5, "6 periods")


#: Names of frames, and the bytes of each.
Frames = dict[str, list[bytes]]


def _bodies_that_renew_no_lease(board: BoardClient) -> Iterator[tuple[m.Message, bytes]]:
    """Yield each type of message that a host sends, with a body that has the next number."""
    for kind in stream_kinds(board):
        message, seq = kind.make(), board.link.stream_next
        yield message, board.link.body(message.TYPE, message.serialize(), seq=seq, flags=0x10)
    for message in valid_requests_to_send(board, TIMED):
        seq = board.link.seq + 1
        yield message, board.link.body(message.TYPE, message.serialize(), seq=seq)


def _wrong_crc_renews_no_lease(board: BoardClient) -> Frames:
    """Return two frames of every type with a wrong CRC, by name."""
    return {
        f"{message.TYPE.name} with a wrong CRC": [
            malformed_frames.malformed_frame(malformed_frames.malformed_with_wrong_crc(body, flip))
            for flip in (1, 1 << 31)
        ]
        for message, body in _bodies_that_renew_no_lease(board)
    }


def damaged_pings(board: BoardClient) -> Frames:
    """Return a PING with a wrong CRC, by its name."""
    return {"PING with a wrong CRC": [malformed_frames.malformed_ping(board.link)]}


def stale_pings(board: BoardClient) -> Frames:
    """Return a PING of another session, by its name."""
    wire, _ = board.link.request_wire(m.Ping(0), session=board.link.session ^ _STALE)
    return {"PING of another session": [wire]}


def _defect_renews_no_lease(board: BoardClient) -> Frames:
    """Return bytes that are no frame, by their defect, and frames of other sessions."""
    ping = board.link.body(m.Ping.TYPE, bytes(8), seq=board.link.seq + 1)
    long = malformed_frames.malformed_noise(board.random, MAX_ENCODED_BYTES + 100)
    frames = {
        "bytes that are no COBS": [b"\x00\xff\x01\x02\x00"],
        "a short frame": [
            malformed_frames.malformed_frame(malformed_frames.malformed_with_crc(ping[:9]))
        ],
        "nothing between delimiters": [b"\x00\x00\x00\x00"],
        "a run of 4196 bytes": [b"\x00" + long + b"\x00"],
    }
    for message, body in _bodies_that_renew_no_lease(board):
        for session in (board.link.session ^ _STALE, 0):
            other = body[:8] + session.to_bytes(2, "little") + body[10:]
            data = malformed_frames.malformed_frame(malformed_frames.malformed_with_crc(other))
            name = f"{message.TYPE.name} of another session"
            frames.setdefault(name, []).append(data)
    return frames


def _lease_length_ms(board: BoardClient, frames: Frames) -> int:
    """Return a timer length in ms, 100 or more, in which the line carries *frames* three times."""
    size = sum(len(data) for some in frames.values() for data in some)
    return board.clock.timer_ms(_LENGTH_MS, 5 * size)


def _lease_late_us(
    board: BoardClient,
    timer: TimerKind,
    make: Callable[[BoardClient], Frames],
    names: Sequence[str],
) -> int:
    """Return by how many µs a timer mutes late (negative: early) when frames come meanwhile.

    They are the frames *names* of *make*, at 0.4, 0.8 and 1.3 of its length; the mute is due after
    length and ramp.
    """
    frames = make(board)
    wires = [data for name in names for data in frames[name]]
    length_ms = _lease_length_ms(board, {name: frames[name] for name in names})
    since = board.link.mark()
    ramp_ms = _RAMP_MS if board.has(m.Feature.AMPLITUDE) else 0
    start_us = timer.start(board, length_ms, ramp_ms=ramp_ms)
    for moment in _MOMENTS:
        board.clock.idle_until(start_us + round(moment * length_ms * _MS))
        if wires:
            board.link.send(*wires)
    header, _ = judged_mute_by_timer(board, since, 5 * length_ms * _MS, timer.reason)
    return board.clock.unwrap(header.time_us) - start_us - (length_ms + ramp_ms) * _MS


def judge_no_renewals(
    board: BoardClient, make: Callable[[BoardClient], Frames], *timers: TimerKind
) -> None:
    """FAILED if one of *timers*, or of all, ends late because of these frames."""
    playback.send_phases_to_store_if_supported(board, TIMED, frames=2)
    for timer in timer_kinds(board, *timers):
        frames = make(board)
        if timer is not RAMP and _lease_length_ms(board, frames) <= timer.most_ms(board):
            late_us = partial(_lease_late_us, board, timer, make)
            judge_unmoved(timer.name, late_us, list(frames))


@case("HG-2.4/2-timers", needs=m.Feature.CONFIG, depth=Depth.DEFAULT)
def damaged_frames_renew_no_timer(board: BoardClient) -> None:
    """frames of every type with a wrong CRC renew no hold, lease or unattended time, nor in a
    ramp
    """
    judge_no_renewals(board, _wrong_crc_renews_no_lease)


@case("HG-6.7/1-others", needs=m.Feature.CONFIG, depth=Depth.DEFAULT)
def frames_of_other_sessions_renew_no_timer(board: BoardClient) -> None:
    """other damage and frames of another session do not renew hold, lease or unattended time"""
    judge_no_renewals(board, _defect_renews_no_lease)


@case("HG-4.6/1-timers", needs=m.Feature.CONFIG, depth=Depth.DEFAULT)
def a_repeated_hello_renews_no_timer(board: BoardClient) -> None:
    """HELLO with the open nonce renews no hold, lease or unattended time, nor in a ramp"""
    judge_no_renewals(board, _repeated_hello_renews_no_lease)


def _repeated_hello_renews_no_lease(board: BoardClient) -> Frames:
    """Return two frames of HELLO with the open nonce, by name."""
    hello = board.hello_message(board.link.session)
    wires = [board.link.request_wire(hello, session=0)[0] for _ in range(2)]
    return {"HELLO with the open nonce": wires}


@case("HG-6.3/2-hold", needs=m.Feature.CONFIG, depth=Depth.DEFAULT)
def arm_while_armed_renews_no_hold(board: BoardClient) -> None:
    """ARM while ARMED, before the end of the hold and in its ramp, leaves the hold as it runs"""
    since = board.link.mark()
    ramp_ms = _RAMP_MS if board.has(m.Feature.AMPLITUDE) else 0
    start_us = HOLD.start(board, _LENGTH_MS, ramp_ms=ramp_ms)
    for moment in _MOMENTS:
        board.clock.idle_until(start_us + round(moment * _LENGTH_MS * _MS))
        if ramp_ms or moment < 1:
            board.arm()
    HOLD.judge(board, since, start_us, _LENGTH_MS + ramp_ms, "the hold, with ARM meanwhile")
