"""HG-9.1: STATUS: when it comes, and what it tells of the last latch until the next one."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Final

from haptogram_protocol.messages import (
    Arm,
    Disarm,
    Feature,
    LatchKey,
    Mute,
    Play,
    Status,
    StatusReply,
    Stop,
    signed_difference,
)
from haptogram_protocol.state import MuteReason

from ...case import Depth, case
from ...client.board_client import PARTS_OF_FRAMES, BoardClient
from ...client.latching import latch_now, latch_random, read_back
from ...client.playback import (
    let_play,
    play_later,
    play_now,
    play_out,
    send_phases_that_fit,
    send_phases_to_store_if_supported,
)
from ...client.recording import counter_steps
from ...client.stream_kinds import valid_requests_to_send
from ...client.uploads import upload_correction
from ...judge.timers import judge_status_period, judged_mute_by_timer
from ...outcome import SELF_REPORTED, check, check_equal

_MS: Final = 1000
_ROUNDS: Final = 8
_SEQUENCE: Final = 7
_LATE_US: Final = 5_000_000

#: The last latch: key, time, phases and amplitudes; number of the last stream frame, time again.
LastLatch = tuple[LatchKey | None, int, bytes, int, int]


@case("HG-9.1/1", needs=Feature.CONFIG, depth=Depth.DEFAULT)
def sends_status(board: BoardClient) -> None:
    """in 8.4 periods eight STATUS come; with status_period_ms = 0 none comes"""
    period_ms = board.quick_status_ms
    board.configure(status_period_ms=period_ms)
    since = board.link.mark()
    board.wire.idle_beyond(int(8.4 * period_ms * _MS))
    board.link.barrier()
    judge_status_period(board, since, period_ms, 8, "8.4 periods")
    board.configure(status_period_ms=0)
    since = board.link.mark()
    board.wire.idle(200 * _MS)
    check(not board.link.events(Status, since), "STATUS comes although status_period_ms is 0")


@case("HG-9.1/3", needs=Feature.CONFIG, evidence=SELF_REPORTED)
def status_of_one_moment(board: BoardClient) -> None:
    """in STATUS and STATUS_REPLY amid a stream both sums hold: of frames, and of accepted"""
    board.arm(status_period_ms=board.quick_status_ms)
    good = board.shortest_stream()
    since = board.link.mark()
    found: list[StatusReply | Status] = [board.status()]
    for _ in range(_ROUNDS):
        t_us = board.clock.soon_us(bytes(1000), ahead_us=_MS)
        for number in range(3):
            board.link.stream(good, t_us + number * _MS)
            found.append(board.status())
        board.clock.wait_until(t_us + 2 * _MS)
    found += [event for _, event in board.link.events(Status, since)]
    for status in found:
        counted = counter_steps(found[0].counters, status.counters)
        parts = {name: counted[name] for name in PARTS_OF_FRAMES if counted[name]}
        is_whole = (counted["frames"] - sum(parts.values())) & 0xFFFFFFFF == 0
        check(is_whole, f"frames has grown by {counted['frames']}, its parts by {parts}")
        stream = counted["latched"] + counted["flushed"] + status.queued - found[0].queued
        check(
            (counted["accepted"] - stream) & 0xFFFFFFFF == 0,
            f"accepted {counted['accepted']}, latched {counted['latched']}, "
            f"flushed {counted['flushed']}, queued {status.queued}",
        )


# --- The last latch ----------------------------------------------------------------------------


@case("HG-9.1/2", evidence=SELF_REPORTED)
def status_begins_with_nothing(board: BoardClient) -> None:
    """last_seq and last_latch_us are 0 until a latch, and again in a new session"""
    board.arm()
    for _ in range(2):
        found = board.status()
        got = (found.last_seq, found.last_latch_us)
        check_equal(got, (0, 0), f"before the first latch (last_seq, last_latch_us) is {got}")
        index = latch_now(board)
        found = board.status()
        check(found.last_seq == index, f"last_seq is {found.last_seq}, due is {index}")
        check(found.last_latch_us != 0, "last_latch_us is 0 after a latch")
        board.hello()
        board.arm()


@case("HG-9.1/2-playback", needs=Feature.SEQUENCE_PHASES, evidence=SELF_REPORTED)
def every_playback_last_seq(board: BoardClient) -> None:
    """a playback moves last_latch_us and not last_seq, which is of the last stream frame"""
    send_phases_that_fit(board, _SEQUENCE, frames=3)
    board.arm()
    index = latch_now(board)
    first = board.status()
    play_out(board, _SEQUENCE, 3, loops=3)
    second = board.status()
    check(second.last_seq == index, f"after a playback last_seq is {second.last_seq}, not {index}")
    apart_us = signed_difference(second.last_latch_us, first.last_latch_us, 32)
    check(apart_us > 0, f"a playback of 9 frames moved last_latch_us by {apart_us} µs")
    latch_now(board)
    last_seq = board.status().last_seq
    check(last_seq == index + 1, f"last_seq is {last_seq}, not {index + 1}")


def _read_last_latch(board: BoardClient) -> LastLatch:
    status = board.status()
    if not board.has(Feature.READ_LATCHED):
        return None, 0, b"", status.last_seq, status.last_latch_us
    reply = read_back(board).reply
    return reply.key, reply.t_latch_us, reply.data, status.last_seq, status.last_latch_us


def _events_without_latch(board: BoardClient) -> Iterator[tuple[str, Callable[[], object]]]:
    """Yield what a host or a timer does that latches nothing; the board is ARMED and sounding."""
    ask, stream, frame = board.link.ask, board.link.stream, board.flat_phases(9)
    for message in valid_requests_to_send(board, _SEQUENCE):
        if not isinstance(message, Play | Disarm):
            yield message.TYPE.name, partial(ask, message)
    yield "a frame for later", lambda: stream(frame, board.clock.ahead_us(_LATE_US))
    yield "a late frame", lambda: stream(frame, board.clock.device_us() - _LATE_US)
    if board.has(Feature.SEQUENCE_PHASES):
        wait = partial(play_later, loops=1, unattended_ms=5000)
        yield "a playback that waits", partial(wait, board, _SEQUENCE, 3_000_000)
        yield "STOP before its start", partial(ask, Stop())
    if board.has(Feature.CORRECTION):
        yield "a correction", partial(upload_correction, board)
    if board.has(Feature.CONFIG):
        yield "the hold that mutes", partial(_run_out_hold, board)
    for last in (Mute(), Arm(), Disarm()):
        yield last.TYPE.name, partial(ask, last)


def _run_out_hold(board: BoardClient) -> None:
    since = board.link.mark()
    board.configure(hold_ms=1)
    judged_mute_by_timer(board, since, 300 * _MS, MuteReason.HOLD_EXPIRED)
    board.configure()


def _check_last_latch_stays(board: BoardClient, name: str) -> None:
    before = _read_last_latch(board)
    for what, do in _events_without_latch(board):
        do()
        board.link.barrier()
        now = _read_last_latch(board)
        names = ("key", "time", "codes", "last_seq", "last_latch_us")
        changed = [n for n, a, b in zip(names, before, now, strict=True) if a != b]
        check(not changed, f"after {name}, {what} changes {', '.join(changed)} of the last latch")


@case("HG-9.1/2-stays", evidence=SELF_REPORTED)
def every_latchless_event(board: BoardClient) -> None:
    """last_seq, last_latch_us, key and codes of the last latch stay until the next latch"""
    send_phases_to_store_if_supported(board, _SEQUENCE, frames=1)
    board.arm()
    index = board.link.stream_next
    latch_random(board, 1)
    _check_last_latch_stays(board, "a stream frame")
    if not board.has(Feature.SEQUENCE_PHASES):
        return
    for ended in ("by itself", "by STOP"):
        board.arm()
        if ended == "by itself":
            play_out(board, _SEQUENCE, 1, loops=3)
        else:
            play_now(board, _SEQUENCE, loops=0)
            let_play(board, 5)
            board.link.ask(Stop())
        key, _, _, last_seq, _ = _read_last_latch(board)
        check(last_seq == index, f"after a playback last_seq is {last_seq}, due is {index}")
        if key is not None:
            due = LatchKey(_SEQUENCE, 2 if ended == "by itself" else key.loop, 0)
            check_equal(key, due, f"after passes of 1 frame, ended {ended}, the key is {key}")
        _check_last_latch_stays(board, f"a playback that ended {ended}")
