"""HG-6.7, HG-7.6, HG-9.1, HG-12.2: what starts lease, unattended time and STATUS anew."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from haptogram_protocol.framing import encode_frame
from haptogram_protocol.messages import (
    Feature,
    Hello,
    Play,
    PlayReply,
    SetConfig,
    StateChanged,
    Status,
    Stop,
    StopReply,
)
from haptogram_protocol.state import MuteReason, OutputState

from ....case import Depth, case
from ....client.board_client import BoardClient
from ....client.latching import latch_now
from ....client.playback import play_now, store_phases
from ....client.stream_kinds import stream_kinds, valid_requests
from ....judge.timers import check_mute_time, check_status_steps, muted_by_timer
from ....outcome import check, fail, inconclusive
from ..stream_types import DROPS

_MS: Final = 1000
_LEASE_MS: Final = 240
_STEP_MS: Final = 170  # between frames that each have to renew that lease
_TRIES: Final = 3
STORED: Final = 2  # sequence that is played
TIMER_MS: Final = 300  # of a timer that nothing renews
SLOW_US: Final = 9_000_000  # period of a playback of which one frame is seen


# --- What renews nothing -----------------------------------------------------------------------


def hello_again(board: BoardClient) -> bytes:
    """Return the HELLO of the open session once more, which has no effect but its reply."""
    again = board.hello_message(board.link.session).serialize()
    body = board.link.body(Hello.TYPE, again, seq=board.link.next_seq(), session=0)
    return encode_frame(body)


@case(
    "HG-12.2/1",
    "no latch, of queue or playback, and no HELLO again renews lease or unattended time",
    variant="latches",
    needs=Feature.CONFIG,
    depth=Depth.DEFAULT,
)
def latches_renew_no_lease(board: BoardClient) -> None:
    ramp_ms = TIMER_MS if board.has(Feature.AMPLITUDE) else 0
    if board.has(Feature.SEQUENCE_PHASES):
        store_phases(board, STORED, frames=2)
    for plays in (False, True) if board.has(Feature.SEQUENCE_PHASES) else (False,):
        reason = MuteReason.UNATTENDED if plays else MuteReason.HOST_SILENT
        board.hello()
        board.configure(host_timeout_ms=50 if plays else TIMER_MS, ramp_ms=ramp_ms)
        board.arm()
        since = board.link.mark()
        if plays:
            play_now(board, STORED, loops=0, unattended_ms=TIMER_MS, period_us=50 * _MS)
        else:
            _queue_over(board, TIMER_MS + ramp_ms)
        start_us = board.clock.device_us()
        for part in (1, 2, 3, 4, 5):  # the later ones during the ramp
            wait_for(board, start_us + part * (TIMER_MS + ramp_ms) * _MS // 6)
            board.wire.send(hello_again(board))
        header, _ = muted_by_timer(board, since, 3 * (TIMER_MS + ramp_ms) * _MS, reason)
        check_mute_time(board, start_us, header, TIMER_MS + ramp_ms, f"{reason.name}, latches")


def _queue_over(board: BoardClient, length_ms: int) -> None:
    """Latch a frame, and queue frames for every 50 ms of a time."""
    latch_now(board, board.flat_phases())
    first_us = board.clock.soon_us(bytes(4000))
    good, number = board.shortest_stream(), min(board.identity.queue_depth, length_ms // 50)
    times = [first_us + 50 * _MS * place for place in range(number)]
    board.link.send(*(board.link.stream_wire(good, t_us) for t_us in times))


def wait_for(board: BoardClient, t_us: int) -> None:
    """Wait until a device time, by the host's estimate, or go on if it has passed."""
    board.wire.idle(max(0, t_us - board.clock.device_estimate_us()))


# --- The lease, and the unattended time in its place -------------------------------------------


def play_later(board: BoardClient, ahead_ms: int, alone_ms: int) -> None:
    """Let a playback of the stored sequence wait for its start so far ahead."""
    now_us = board.clock.device_us()
    play = Play(STORED, SLOW_US, 0, min(alone_ms, board.identity.max_unattended_ms))
    board.link.call(play, PlayReply, time_us=now_us + ahead_ms * _MS)


@case(
    "HG-7.6/5",
    "from PLAY on, also before its start, unattended_ms stands for host_timeout_ms; STOP ends that",
    variant="waiting",
    needs=Feature.CONFIG | Feature.SEQUENCE_PHASES,
    depth=Depth.DEFAULT,
)
def waits_unattended(board: BoardClient) -> None:
    store_phases(board, STORED, frames=2)
    board.configure(host_timeout_ms=80, hold_ms=10_000)
    for name, ahead_ms, alone_ms in (
        ("its start comes", 250, 400),
        ("muted before its start", 700, 250),
    ):
        board.arm()
        since = board.link.mark()
        play_later(board, ahead_ms, alone_ms)
        start_us = board.clock.device_us()
        header, _ = muted_by_timer(board, since, 3 * alone_ms * _MS, MuteReason.UNATTENDED)
        check_mute_time(board, start_us, header, alone_ms, f"unattended_ms, {name}")
    for ahead_ms in (0, 5000):
        board.arm()
        since = board.link.mark()
        play_later(board, ahead_ms + 60, 9000)
        board.wire.idle(150 * _MS)
        answer = board.link.ask(Stop())  # nothing behind it: that would renew the lease
        board.link.reply_in(answer, StopReply, Stop.TYPE)
        assert answer.header is not None  # reply_in
        start_us = board.clock.unwrap(answer.header.time_us)
        header, _ = muted_by_timer(board, since, 300 * _MS, MuteReason.HOST_SILENT)
        check_mute_time(board, start_us, header, 80, "host_timeout_ms behind STOP")


@case(
    "HG-6.7/1",
    "frames of every type, good and bad, each renew the lease: a chain of them keeps the board on",
    variant="types",
    needs=Feature.CONFIG,
    depth=Depth.DEFAULT,
)
def every_type_renews(board: BoardClient) -> None:
    _renewed_by_each(board, plays=False)


@case(
    "HG-6.7/1",
    "during a playback frames of every type, good and bad, each renew the unattended time",
    variant="playing",
    needs=Feature.CONFIG | Feature.SEQUENCE_PHASES,
    depth=Depth.DEFAULT,
    wall_depth=Depth.FULL,
)
def every_type_renews_a_playback(board: BoardClient) -> None:
    _renewed_by_each(board, plays=True)


def _renewed_by_each(board: BoardClient, *, plays: bool) -> None:
    """FAILED if one frame, sent well before the timer's end, twice does not renew it."""
    found: list[str] = []
    for _ in range(_TRIES):
        failed = _failed_to_renew(board, plays=plays)
        if failed == "":
            return
        if failed in found:
            fail(f"{failed} did not renew the {'unattended time' if plays else 'lease'}")
        found += [failed] if failed is not None else []
    inconclusive(f"the host was late {_TRIES} times in sending a frame every {_STEP_MS} ms")


def _renewals(board: BoardClient, *, plays: bool) -> Iterator[tuple[str, bytes]]:
    """Yield frames of the session that renew the lease, with their names."""
    for kind in stream_kinds(board):
        yield kind.name, board.link.stream_wire(kind.make())
    kind = stream_kinds(board)[0]
    for drop in DROPS:
        if drop.armed and not drop.queued and drop.counter != "stale_session":
            yield f"a frame {drop.summary}", next(iter(drop.frames(board, kind, 0)))
    for message in valid_requests(board, STORED + plays):
        if message.TYPE.name not in ("DISARM", "PLAY", *(["STOP"] if plays else [])):
            yield message.TYPE.name, board.link.request_wire(message)[0]
            wire, _ = board.link.request_wire(message, flags=0x40)
            yield f"{message.TYPE.name} with an unknown flag", wire


def _failed_to_renew(board: BoardClient, *, plays: bool) -> str | None:
    """Send a frame of each kind, each in time; return the name of the first that renews nothing.

    Empty: each one renewed the timer; None: the host was late with one.
    """
    if board.has(Feature.SEQUENCE_PHASES):
        store_phases(board, STORED, frames=2)
    board.configure(host_timeout_ms=50 if plays else _LEASE_MS, hold_ms=10_000)
    board.arm()
    names: list[str] = []
    since, sent_us = board.link.mark(), board.wire.now_us()
    if plays:
        play_now(board, STORED, loops=0, unattended_ms=_LEASE_MS, period_us=SLOW_US)
        sent_us = board.wire.now_us()
    for name, wire in _renewals(board, plays=plays):
        board.wire.idle(max(0, sent_us + _STEP_MS * _MS - board.wire.now_us()))
        if board.wire.now_us() - sent_us > (_LEASE_MS - 20) * _MS:
            return None
        if board.link.events(StateChanged, since):
            return names[-1] if names else "ARM"
        sent_us = board.wire.now_us()
        board.link.send(wire)
        names.append(name)
    board.wire.idle((_STEP_MS - 20) * _MS)
    return "" if board.status().state is OutputState.ARMED else names[-1]


# --- STATUS ------------------------------------------------------------------------------------


@case(
    "HG-9.1/1",
    "while everything is sent that a host sends, STATUS comes at its time: only STATUS restarts it",
    variant="types",
    needs=Feature.CONFIG,
    depth=Depth.DEFAULT,
)
def nothing_else_restarts_status(board: BoardClient) -> None:
    period_ms = board.quick_status_ms + 7
    board.configure(status_period_ms=period_ms)
    since, end_us = board.link.mark(), board.wire.now_us() + 6 * period_ms * _MS
    while board.wire.now_us() < end_us:
        board.arm()
        latch_now(board, board.flat_phases())
        for message in valid_requests(board, STORED):
            if not isinstance(message, SetConfig):
                board.link.ask(message)
            board.wire.idle(period_ms * _MS // 40)
        board.hello(board.link.session)
    board.link.barrier()
    times = [board.clock.unwrap(header.time_us) for header, _ in board.link.events(Status, since)]
    check(len(times) > 4, f"{len(times)} STATUS in 6 periods")
    check_status_steps(board, times, period_ms)
