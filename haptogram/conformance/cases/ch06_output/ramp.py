"""HG-6.7, HG-6.10, HG-6.11: lease, hold, and the ramp at their end."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Final

from haptogram_protocol.framing import encode_frame
from haptogram_protocol.messages import (
    DriveKind,
    DriveReply,
    Feature,
    Ping,
    PlaybackEnded,
    ReadDrive,
    StateChanged,
)
from haptogram_protocol.state import MuteReason

from ...case import Depth, case
from ...client.board_client import BoardClient
from ...client.latching import ShownDrive, latch_now, read_back_radiated, shown_drive_of_reply
from ...client.playback import play_now, store_phases
from ...judge.timers import check_mute_time, muted_by_timer
from ...outcome import SELF_REPORTED, check

_MS: Final = 1000
_RAMPS: Final = Feature.CONFIG | Feature.AMPLITUDE | Feature.READ_RADIATED


@case(
    "HG-6.7/1",
    "frames dropped for type, flags, length, number or time renew the lease; stale frames do not",
    needs=Feature.CONFIG,
    depth=Depth.DEFAULT,
)
def any_frame_renews(board: BoardClient) -> None:
    board.configure(host_timeout_ms=300)
    good = board.flat_phases()
    kinds: dict[str, Callable[[], bytes]] = {
        "an unknown event": lambda: encode_frame(board.link.body(0xEE, b"", seq=0)),
        "a stream frame seen before": lambda: board.link.stream_wire(good, seq=0xFF00),
        "a stream frame of a wrong length": lambda: board.link.stream_raw(1, b"\x08"),
        "a request with unknown flags": lambda: board.link.request_wire(Ping(0), flags=0x40)[0],
        "a stream frame for the past": lambda: board.link.stream_wire(
            good, board.clock.device_us() - 10**6
        ),
    }
    for name, make in kinds.items():
        board.arm()
        since = board.link.mark()
        for _ in range(6):
            board.link.send(make())
            board.wire.idle(100 * _MS)
        check(not board.link.events(StateChanged, since), f"{name} does not renew the lease")
    since = board.link.mark()
    stale = board.link.session ^ 0x00F0
    for _ in range(5):
        board.link.send(encode_frame(board.link.body(0xEE, b"", seq=0, session=stale)))
        board.wire.idle(100 * _MS)
    check(bool(board.link.events(StateChanged, since)), "frames of another session renew the lease")


@case("HG-6.10/1", "a sounding board whose stream stops is muted by the hold", needs=Feature.CONFIG)
def hold_mutes(board: BoardClient) -> None:
    board.configure(hold_ms=60)
    board.arm()
    since = board.link.mark()
    latch_now(board, board.flat_phases())
    muted_by_timer(board, since, 200 * _MS, MuteReason.HOLD_EXPIRED)
    check(board.status().reason is MuteReason.HOLD_EXPIRED, "STATUS does not say HOLD_EXPIRED")


def _ramp(board: BoardClient, *, hold_ms: int, ramp_ms: int) -> list[tuple[float, int]]:
    """Return (share of the ramp, amplitude) from before a ramp of the hold to behind its end."""
    board.configure(hold_ms=hold_ms, ramp_ms=ramp_ms)
    board.arm()
    latch_now(board, board.flat_phases())
    start_us = board.clock.unwrap(board.status().last_latch_us) + hold_ms * _MS
    end_us = start_us + ramp_ms * _MS
    found: list[tuple[float, int]] = []
    while not found or found[-1][0] < 1.1:
        t_us, shown = _read_at(board)
        found.append(((t_us - start_us) / (end_us - start_us), shown.loudest))
        board.wire.idle(ramp_ms * _MS // 40)
    return found


def _read_at(board: BoardClient) -> tuple[int, ShownDrive]:
    read = ReadDrive(DriveKind.RADIATED, 0, board.identity.transducers)
    answer = board.link.ask(read)
    assert answer.header is not None  # ask
    reply = board.link.reply_in(answer, DriveReply, ReadDrive.TYPE)
    return board.clock.unwrap(answer.header.time_us), shown_drive_of_reply(reply)


@case(
    "HG-6.11/1",
    "during a ramp the amplitude in read-backs never rises",
    needs=_RAMPS,
    evidence=SELF_REPORTED,
    depth=Depth.DEFAULT,
)
def ramps_do_not_rise(board: BoardClient) -> None:
    ramp = _ramp(board, hold_ms=100, ramp_ms=300)
    for (_, before), (share, after) in itertools.pairwise(ramp):
        check(after <= before, f"at {share:.0%} of the ramp the amplitude rises to {after}")


@case(
    "HG-6.11/2",
    "the amplitude is full before a ramp, falls in small steps and is 0 at its end",
    needs=_RAMPS,
    evidence=SELF_REPORTED,
    depth=Depth.DEFAULT,
)
def ramps_reach_silence(board: BoardClient) -> None:
    ramp = _ramp(board, hold_ms=100, ramp_ms=400)
    early = [level for share, level in ramp if share < -0.02]
    check(all(level == 255 for level in early), f"before the ramp: amplitudes {early[-3:]}")
    late = [level for share, level in ramp if share > 1.02]
    check(bool(late) and not any(late), f"after ramp_ms: amplitudes {late[:3]}")
    way = [(share, level) for share, level in ramp if 0.05 < share < 0.95]
    check(all(0 < level < 255 for _, level in way), f"the ramp is skipped: {way[:4]} ...")
    points = [(0.0, 255), *way, (1.0, 0)]
    for (before, high), (after, low) in itertools.pairwise(points):
        # At most 1/8 at a time: over a share d of the ramp it can drop by 255 (d + 1/8) at most.
        limit = 255 * (max(after - before, 0) + 1 / 8) + 2
        check(high - low <= limit, f"from {high} to {low} within {after - before:.1%} of a ramp")


@case("HG-6.11/3", "with ramp_ms = 0 the board is muted right at the end of the hold")
def hard_mute(board: BoardClient) -> None:
    board.configure(hold_ms=80, ramp_ms=0)
    board.arm()
    since = board.link.mark()
    latch_now(board, board.flat_phases())
    start_us = board.clock.unwrap(board.status().last_latch_us)
    header, _ = muted_by_timer(board, since, 200 * _MS, MuteReason.HOLD_EXPIRED)
    check_mute_time(board, start_us, header, 80, "hold_ms = 80, ramp_ms = 0")


@case(
    "HG-6.11/4",
    "a latch ends the ramp of the hold, a request does not; any frame ends the lease's ramp",
    needs=_RAMPS,
    evidence=SELF_REPORTED,
    depth=Depth.DEFAULT,
)
def ramps_are_renewed(board: BoardClient) -> None:
    board.configure(hold_ms=100, ramp_ms=600)
    board.arm()
    latch_now(board, board.flat_phases())
    board.wire.idle(300 * _MS)
    board.link.barrier()
    check(read_back_radiated(board).loudest < 255, "a request ends the ramp of the hold")
    latch_now(board, board.flat_phases())
    check(read_back_radiated(board).loudest == 255, "a latch does not end the ramp of the hold")
    board.configure(host_timeout_ms=100, ramp_ms=600)
    board.arm()
    latch_now(board, board.flat_phases())
    since = board.link.mark()
    board.wire.idle(400 * _MS)
    check(read_back_radiated(board).loudest == 255, "a frame does not end the ramp of the lease")
    check(
        not board.link.events(StateChanged, since),
        "the lease muted the board before its ramp ended",
    )


@case(
    "HG-6.11/5",
    "a ramp ends in MUTED with its reason; the queue is flushed, timeouts + 1",
    needs=Feature.CONFIG,
    evidence=SELF_REPORTED,
)
def ramps_end_muted(board: BoardClient) -> None:
    board.configure(hold_ms=60, ramp_ms=60)
    board.arm()
    with board.counting(timeouts=1, flushed=1, latched=1):
        since = board.link.mark()
        latch_now(board, board.flat_phases())
        start_us = board.clock.unwrap(board.status().last_latch_us)
        board.link.send(board.link.stream_wire(board.flat_phases(), start_us + 2_000_000))
        header, _ = muted_by_timer(board, since, 400 * _MS, MuteReason.HOLD_EXPIRED)
    ramp_ms = 60 if board.has(Feature.AMPLITUDE) else 0
    check_mute_time(board, start_us, header, 60 + ramp_ms, "hold_ms = 60 and the ramp")


@case(
    "HG-6.11/5",
    "at the end of a ramp a playback ends",
    variant="playback",
    needs=Feature.CONFIG | Feature.SEQUENCE_PHASES,
)
def ramps_end_playback(board: BoardClient) -> None:
    board.configure(hold_ms=50)
    store_phases(board, 1, frames=2)
    board.arm()
    since = board.link.mark()
    play_now(board, 1, loops=0, period_us=500_000)
    muted_by_timer(board, since, 300 * _MS, MuteReason.HOLD_EXPIRED)
    found = board.link.await_event(PlaybackEnded, since, 50 * _MS + board.wire.limits.slack_us)
    check(found is not None, "a timer has muted the board, but no PLAYBACK_ENDED came")
