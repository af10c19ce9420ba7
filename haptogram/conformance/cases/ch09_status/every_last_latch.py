"""HG-9.1: what a board tells of the last latch stays until the next one."""

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
    Stop,
    UploadKind,
)
from haptogram_protocol.state import MuteReason

from ...case import case
from ...client.board_client import BoardClient
from ...client.latching import latch_now, read_back
from ...client.playback import (
    let_play,
    play_later,
    play_now,
    play_out,
    send_phases_to_store_if_supported,
)
from ...client.stream_kinds import valid_requests_to_send
from ...client.uploads import upload_to_board
from ...judge.timers import judged_mute_by_timer
from ...outcome import SELF_REPORTED, check, check_equal

_MS: Final = 1000
_SEQUENCE: Final = 7

#: The last latch: key, time, phases and amplitudes; number of the last stream frame, time again.
LastLatch = tuple[LatchKey | None, int, bytes, int, int]


def _last_latch_in_status(board: BoardClient) -> LastLatch:
    status = board.status()
    if not board.has(Feature.READ_LATCHED):
        return None, 0, b"", status.last_seq, status.last_latch_us
    reply = read_back(board).reply
    return reply.key, reply.t_latch_us, reply.data, status.last_seq, status.last_latch_us


def _status_without_latch(board: BoardClient) -> Iterator[tuple[str, Callable[[], object]]]:
    """Yield what a host or a timer does that latches nothing; the board is ARMED and sounding."""
    for message in valid_requests_to_send(board, _SEQUENCE):
        if not isinstance(message, Play | Disarm):
            yield message.TYPE.name, partial(board.link.ask, message)
    yield (
        "a frame for later",
        lambda: board.link.stream(board.flat_phases(9), board.clock.ahead_us(5_000_000)),
    )
    yield (
        "a late frame",
        lambda: board.link.stream(board.flat_phases(9), board.clock.device_us() - 5_000_000),
    )
    if board.has(Feature.SEQUENCE_PHASES):
        yield "a playback that waits", lambda: _play_later_than_last_latch(board)
        yield "STOP before its start", lambda: board.link.ask(Stop())
    if board.has(Feature.CORRECTION):
        codes = bytes([3]) * board.identity.transducers
        yield "a correction", lambda: upload_to_board(board, UploadKind.CORRECTION, 0, codes)
    if board.has(Feature.CONFIG):
        yield "the hold that mutes", lambda: _time_out_after_last_latch(board)
    yield "MUTE", lambda: board.link.ask(Mute())
    yield "ARM", lambda: board.link.ask(Arm())
    yield "DISARM", lambda: board.link.ask(Disarm())


def _play_later_than_last_latch(board: BoardClient) -> None:
    play_later(board, _SEQUENCE, 3_000_000, loops=1, unattended_ms=5000)


def _time_out_after_last_latch(board: BoardClient) -> None:
    since = board.link.mark()
    board.configure(hold_ms=1)
    judged_mute_by_timer(board, since, 300 * _MS, MuteReason.HOLD_EXPIRED)
    board.configure()


def _last_latch_stays_in_status(board: BoardClient, name: str) -> None:
    before = _last_latch_in_status(board)
    for what, do in _status_without_latch(board):
        do()
        board.link.barrier()
        now = _last_latch_in_status(board)
        names = ("key", "time", "codes", "last_seq", "last_latch_us")
        changed = [n for n, a, b in zip(names, before, now, strict=True) if a != b]
        check(not changed, f"after {name}, {what} changes {', '.join(changed)} of the last latch")


@case("HG-9.1/2-stays", evidence=SELF_REPORTED)
def the_last_latch_stays_in_status(board: BoardClient) -> None:
    """last_seq, last_latch_us, key and codes of the last latch stay until the next latch"""
    send_phases_to_store_if_supported(board, _SEQUENCE, frames=1)
    board.arm()
    index = latch_now(board, board.phases(board.random_registers()))
    _last_latch_stays_in_status(board, "a stream frame")
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
        key, _, _, last_seq, _ = _last_latch_in_status(board)
        check(last_seq == index, f"after a playback last_seq is {last_seq}, due is {index}")
        if key is not None:
            check_equal(key.sequence, _SEQUENCE, f"after a playback the key of the latch is {key}")
            due = (2, 0) if ended == "by itself" else (key.loop, 0)
            check_equal((key.loop, key.index), due, f"after 3 passes of 1 frame the key is {key}")
        _last_latch_stays_in_status(board, f"a playback that ended {ended}")
