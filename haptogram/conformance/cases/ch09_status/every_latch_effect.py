"""HG-9.1, HG-12.3: all that a latch changes, on every path that leads to one."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Final

from haptogram_protocol.messages import Feature, LatchKey, Message, StatusReply, TraceMode
from haptogram_protocol.state import MuteReason

from ...case import Depth, case
from ...client.board_client import BoardClient
from ...client.capabilities import drive_kinds, trace_modes
from ...client.latching import (
    ClientLatch,
    full_client_drive,
    latch_in_time,
    latch_now,
    latches_received_from_board,
    read_back,
)
from ...client.playback import (
    await_playback_end,
    most_periods_to_play,
    period_to_play,
    play_at,
    play_now,
    send_phases_to_store,
)
from ...judge.timers import judge_mute_time, judged_mute_by_timer
from ...outcome import SELF_REPORTED, check, check_equal

_MS: Final = 1000
_SEQUENCE: Final = 4
_FRAMES: Final = 2
_LOOPS: Final = 2
_LATE_US: Final = 5 * _MS
_WINDOW_US: Final = 100_000
_HOLD_MS: Final = 300
_HEADERS_BYTES: Final = 100  # of a PING and two stream frames
_COUNTED: Final = ("accepted", "latched", "late", "flushed")


@dataclass(frozen=True, slots=True)
class _Path:
    """A path that leads to latches.

    Attributes
    ----------
    name : str
        For reports.
    latch : callable
        Takes client and a stream frame; latches that frame, or plays the stored sequence.  The
        board is ARMED.
    counted : tuple of int
        Growth of the counters named in ``_COUNTED``.
    plays : bool
        Whether the sequence is played.
    """

    name: str
    latch: Callable[[BoardClient, Message], object]
    counted: tuple[int, int, int, int] = (1, 1, 0, 0)
    plays: bool = False


@dataclass(frozen=True, slots=True)
class _LastLatch:
    """Key and phase codes of the last latch of a path; its amplitudes are 255."""

    key: LatchKey
    registers: bytes


def _latch_on_path(board: BoardClient, path: _Path, stored: bytes) -> _LastLatch:
    """Latch on a path; *stored* is the last frame of the sequence."""
    registers = board.random_registers()
    path.latch(board, board.phases(registers))
    if path.plays:
        return _LastLatch(LatchKey(_SEQUENCE, _LOOPS - 1, _FRAMES - 1), stored)
    return _LastLatch(LatchKey(0, 0, board.link.stream_next - 1), registers)


def _latch_late(board: BoardClient, frame: Message) -> None:
    board.link.stream(frame, board.late_time_us(_LATE_US))
    board.clock.wait_latched()


def _latch_and_replace(board: BoardClient, frame: Message) -> None:
    """Latch the later of two frames that fall on one carrier period."""
    period_us = board.clock.carrier_us
    t_us = board.clock.soon_us(bytes(_HEADERS_BYTES + 2 * len(frame.serialize())))
    board.link.stream(board.flat_phases(), t_us - period_us + 1)
    board.link.stream(frame, t_us)
    board.clock.wait_until(t_us + 2 * period_us)


def _latch_and_flush(board: BoardClient, frame: Message) -> None:
    """Latch at once a frame that flushes one for later."""
    board.link.stream(board.flat_phases(), board.clock.ahead_us(2_000_000))
    latch_now(board, frame)


def _play_at_once(board: BoardClient, _: Message) -> None:
    since = board.link.mark()
    play_now(board, _SEQUENCE, loops=_LOOPS)
    _await_end(board, since)


def _play_in_time(board: BoardClient, _: Message) -> None:
    since = board.link.mark()
    start_us = board.clock.soon_us(bytes(500), ahead_us=5 * _MS)
    play_at(board, _SEQUENCE, start_us, loops=_LOOPS)
    _await_end(board, since)


def _await_end(board: BoardClient, since: int) -> None:
    latches = _LOOPS * _FRAMES
    traces_us = board.wire.period_us(latches * (2 * board.identity.transducers + _HEADERS_BYTES))
    await_playback_end(board, since, latches * period_to_play(board) + traces_us)


def _paths_of_latches(board: BoardClient) -> Iterator[_Path]:
    """Yield every path to a latch that the board has."""
    yield _Path("a frame latched at once", latch_now)
    yield _Path("a frame latched in time", latch_in_time)
    if board.has(Feature.CONFIG):
        yield _Path("a late frame", _latch_late, (1, 1, 1, 0))
    if board.clock.carrier_us > 1:
        yield _Path("a frame that replaces another", _latch_and_replace, (2, 1, 0, 1))
    yield _Path("a frame that flushes another", _latch_and_flush, (2, 1, 0, 1))
    frames, most = _LOOPS * _FRAMES, most_periods_to_play(board, period_to_play(board))
    if board.has(Feature.SEQUENCE_PHASES) and most > frames:
        for name, play in (("at once", _play_at_once), ("in time", _play_in_time)):
            yield _Path(f"a sequence played {name}", play, (0, frames, 0, 0), plays=True)


def _last_stored_frame(board: BoardClient) -> bytes:
    """Store a sequence where the board takes any; return its last frame."""
    if not board.has(Feature.SEQUENCE_PHASES):
        return b""
    return send_phases_to_store(board, _SEQUENCE, frames=_FRAMES)[-1]


# --- Cases -------------------------------------------------------------------------------------


@case("HG-9.1/3-latches", evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def latch_changes_the_status(board: BoardClient) -> None:
    """a latch of every path, the first and later: counters, last_seq, time, key, codes, LATE"""
    stored = _last_stored_frame(board)
    can_configure = board.has(Feature.CONFIG)
    for mode in trace_modes(board, *TraceMode) if can_configure else [TraceMode.OFF]:
        if can_configure:
            board.configure(trace_mode=mode, late_window_us=_WINDOW_US)
        for order in ("the first of a session", "behind another latch"):
            for path in _paths_of_latches(board):
                if order == "the first of a session":
                    board.hello()
                board.arm()
                before, since = board.status(), board.link.mark()
                last = _latch_on_path(board, path, stored)
                text = f"{path.name}, {order}, trace {mode.name}"
                after = board.status()
                _check_status(before, after, path, last, text)
                _check_drives(board, after, last, text)
                if mode is not TraceMode.OFF:
                    latches = latches_received_from_board(board, since, mode)
                    last_us = board.clock.unwrap(after.last_latch_us)
                    _check_traces(latches, path, last, last_us, text)


def _check_status(
    before: StatusReply, after: StatusReply, path: _Path, last: _LastLatch, text: str
) -> None:
    index = before.last_seq if path.plays else last.key.index
    check(after.last_seq == index, f"{text}: last_seq is {after.last_seq}, due is {index}")
    moved = after.last_latch_us != before.last_latch_us
    check(moved, f"{text}: last_latch_us stays {after.last_latch_us}")
    for name, due in zip(_COUNTED, path.counted, strict=True):
        got = (getattr(after.counters, name) - getattr(before.counters, name)) & 0xFFFFFFFF
        check(got == due, f"{text}: {name} counts {got}, due is {due}")


def _check_drives(board: BoardClient, after: StatusReply, last: _LastLatch, text: str) -> None:
    for kind in drive_kinds(board):
        shown, name = read_back(board, kind), f"{text}: READ_DRIVE({kind.name})"
        told, due = (shown.reply.key, shown.reply.t_latch_us), (last.key, after.last_latch_us)
        check(told == due, f"{name} names {told}, due is {due}")
        same = shown.phases + shown.amplitudes == full_client_drive(last.registers)
        check(same, f"{name} shows other codes than were latched")


def _check_traces(
    latches: list[ClientLatch], path: _Path, last: _LastLatch, last_us: int, text: str
) -> None:
    _, latched, late, _ = path.counted
    new = latches[-latched:]
    check(len(new) == latched, f"{text}: {len(new)} latches are traced, due are {latched}")
    key, told_us = new[-1].key, new[-1].t_us
    check(key == last.key, f"{text}: the trace names {key}, due is {last.key}")
    check_equal(told_us, last_us, f"{text}: traced at {told_us} µs, latched at {last_us} µs")
    flags = [latch.late for latch in new]
    check_equal(flags, [bool(late)] * latched, f"{text}: the traces have LATE {flags}")


@case("HG-12.3/1-latches", needs=Feature.CONFIG, depth=Depth.DEFAULT)
def latch_restarts_the_hold(board: BoardClient) -> None:
    """a latch of every path begins the hold anew: it ends hold_ms behind the last latch"""
    stored = _last_stored_frame(board)
    # A path waits for two frames, twice as long as the line needs, behind a third of the hold.
    wait_us = 2 * period_to_play(board) + 4 * board.clock.lead_us  # two latches of a playback
    size = 8 * len(board.flat_phases().serialize())
    hold_ms = min(10_000, board.clock.timer_ms(_HOLD_MS + wait_us // _MS, size))
    board.configure(hold_ms=hold_ms, late_window_us=_WINDOW_US)
    for path in _paths_of_latches(board):
        since = board.arm()
        latch_now(board)
        begun_us = board.last_latch_us()
        board.wire.idle(hold_ms * _MS // 3)
        _latch_on_path(board, path, stored)
        start_us = board.last_latch_us()
        first_us = start_us - (path.counted[1] - 1) * period_to_play(board)
        last_us = begun_us + (hold_ms - 50) * _MS
        board.clock.require_before(last_us, "a latch within the hold", first_us)
        header, _ = judged_mute_by_timer(board, since, 3 * hold_ms * _MS, MuteReason.HOLD_EXPIRED)
        text = f"hold_ms = {hold_ms}, behind {path.name}"
        judge_mute_time(board, start_us, header, hold_ms, text)
