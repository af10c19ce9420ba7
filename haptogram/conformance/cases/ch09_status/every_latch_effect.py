"""HG-9.1, HG-12.3: all that a latch changes, on every path that leads to one."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Final, TypeAlias

from haptogram_protocol.messages import (
    DriveKind,
    Feature,
    LatchKey,
    Message,
    StatusReply,
    TraceMode,
)
from haptogram_protocol.state import MuteReason

from ...case import Depth, case
from ...client.board_client import BoardClient
from ...client.capabilities import ALL_MODES
from ...client.latching import (
    ClientLatch,
    full_client_drive,
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
class _LatchEffectInStatus:
    """What the latches of one path have to leave behind.

    Attributes
    ----------
    key : LatchKey
        Of the last latch.
    registers : bytes
        Phase codes of the last latch; its amplitudes are 255.
    counted : tuple of int
        Growth of the counters named in ``_COUNTED``.
    """

    key: LatchKey
    registers: bytes
    counted: tuple[int, int, int, int]

    @property
    def of_stream(self) -> bool:
        """True if a stream frame was latched, not a frame of a sequence."""
        return self.key.sequence == 0


#: Latches something; the board is ARMED and the sequence stored, its last frame given.
_Path: TypeAlias = Callable[[BoardClient, bytes], _LatchEffectInStatus]


def _stream_key_in_status(board: BoardClient) -> LatchKey:
    return LatchKey(0, 0, board.link.stream_next)


def _new_frame_for_status(board: BoardClient) -> tuple[bytes, Message]:
    registers = board.random_registers()
    return registers, board.phases(registers)


def _latch_at_once_for_status(board: BoardClient, _: bytes) -> _LatchEffectInStatus:
    key, (registers, frame) = _stream_key_in_status(board), _new_frame_for_status(board)
    latch_now(board, frame)
    return _LatchEffectInStatus(key, registers, (1, 1, 0, 0))


def _latch_in_time_for_status(board: BoardClient, _: bytes) -> _LatchEffectInStatus:
    key, (registers, frame) = _stream_key_in_status(board), _new_frame_for_status(board)
    _send_latch_for_status(
        board, frame, board.clock.soon_us(bytes(_HEADERS_BYTES + len(frame.serialize())))
    )
    return _LatchEffectInStatus(key, registers, (1, 1, 0, 0))


def _late_latch_for_status(board: BoardClient, _: bytes) -> _LatchEffectInStatus:
    key, (registers, frame) = _stream_key_in_status(board), _new_frame_for_status(board)
    t_us = board.late_time_us(_LATE_US)
    wire = board.link.stream_wire(frame, t_us)
    board.link.send(wire)
    board.clock.wait_latched()
    return _LatchEffectInStatus(key, registers, (1, 1, 1, 0))


def _replacing_latch_for_status(board: BoardClient, _: bytes) -> _LatchEffectInStatus:
    """Latch the later of two frames that fall on one carrier period."""
    (_, first), (registers, second) = _new_frame_for_status(board), _new_frame_for_status(board)
    period_us = board.clock.carrier_us
    t_us = board.clock.soon_us(bytes(_HEADERS_BYTES + 2 * len(first.serialize())))
    board.link.stream(first, t_us - period_us + 1)
    key = _stream_key_in_status(board)
    _send_latch_for_status(board, second, t_us)
    return _LatchEffectInStatus(key, registers, (2, 1, 0, 1))


def _flushing_latch_for_status(board: BoardClient, _: bytes) -> _LatchEffectInStatus:
    """Latch at once a frame that flushes one for later."""
    (_, first), (registers, second) = _new_frame_for_status(board), _new_frame_for_status(board)
    board.link.stream(first, board.clock.ahead_us(2_000_000))
    key = _stream_key_in_status(board)
    latch_now(board, second)
    return _LatchEffectInStatus(key, registers, (2, 1, 0, 1))


def _send_latch_for_status(board: BoardClient, frame: Message, t_us: int) -> None:
    """Send a frame for *t_us* and wait for its latch; INCONCLUSIVE if it is sent too late."""
    board.link.stream(frame, t_us)
    board.clock.wait_until(t_us + 2 * board.clock.carrier_us)


def _played_latch_for_status(board: BoardClient, last: bytes) -> _LatchEffectInStatus:
    since = board.link.mark()
    play_now(board, _SEQUENCE, loops=_LOOPS)
    return _playback_end_for_status(board, since, last)


def _played_in_time_for_status(board: BoardClient, last: bytes) -> _LatchEffectInStatus:
    since = board.link.mark()
    start_us = board.clock.soon_us(bytes(500), ahead_us=5 * _MS)
    play_at(board, _SEQUENCE, start_us, loops=_LOOPS)
    return _playback_end_for_status(board, since, last)


def _playback_end_for_status(board: BoardClient, since: int, last: bytes) -> _LatchEffectInStatus:
    latches = _LOOPS * _FRAMES
    traces_us = board.wire.period_us(latches * (2 * board.identity.transducers + _HEADERS_BYTES))
    await_playback_end(board, since, latches * period_to_play(board) + traces_us)
    return _LatchEffectInStatus(
        LatchKey(_SEQUENCE, _LOOPS - 1, _FRAMES - 1), last, (0, latches, 0, 0)
    )


def _latch_paths_for_status(board: BoardClient) -> Iterator[tuple[str, _Path]]:
    """Yield every path to a latch that the board has, by its name."""
    yield "a frame latched at once", _latch_at_once_for_status
    yield "a frame latched in time", _latch_in_time_for_status
    if board.has(Feature.CONFIG):
        yield "a late frame", _late_latch_for_status
    if board.clock.carrier_us > 1:
        yield "a frame that replaces another", _replacing_latch_for_status
    yield "a frame that flushes another", _flushing_latch_for_status
    frames = _LOOPS * _FRAMES
    if (
        board.has(Feature.SEQUENCE_PHASES)
        and most_periods_to_play(board, period_to_play(board)) > frames
    ):
        yield "a sequence played at once", _played_latch_for_status
        yield "a sequence played in time", _played_in_time_for_status


def _stored_for_status(board: BoardClient) -> bytes:
    """Store a sequence where the board takes any; return its last frame."""
    if not board.has(Feature.SEQUENCE_PHASES):
        return b""
    return send_phases_to_store(board, _SEQUENCE, frames=_FRAMES)[-1]


# --- Cases -------------------------------------------------------------------------------------


@case("HG-9.1/3-latches", evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def a_latch_changes_all_of_the_status(board: BoardClient) -> None:
    """a latch of every path, the first and later: counters, last_seq, time, key, codes, LATE"""
    last = _stored_for_status(board)
    modes = [mode for feature, mode in ALL_MODES if board.has(feature)]
    for mode in modes if board.has(Feature.CONFIG) else [TraceMode.OFF]:
        if board.has(Feature.CONFIG):
            board.configure(trace_mode=mode, late_window_us=_WINDOW_US)
        for first in (True, False):
            for name, path in _latch_paths_for_status(board):
                if first:
                    board.hello()
                board.arm()
                before, since = board.status(), board.link.mark()
                effect = path(board, last)
                order = "the first of a session" if first else "behind another latch"
                text = f"{name}, {order}, trace {mode.name}"
                after = board.status()
                _check_latch_in_status(before, after, effect, text)
                _check_status_against_drives(board, after, effect, text)
                if mode is not TraceMode.OFF:
                    latches = latches_received_from_board(board, since, mode)
                    _check_status_against_traces(board, latches, after, effect, text)


def _check_latch_in_status(
    before: StatusReply, after: StatusReply, effect: _LatchEffectInStatus, text: str
) -> None:
    index = effect.key.index if effect.of_stream else before.last_seq
    check(after.last_seq == index, f"{text}: last_seq is {after.last_seq}, due is {index}")
    moved = after.last_latch_us != before.last_latch_us
    check(moved, f"{text}: last_latch_us stays {after.last_latch_us}")
    for name, due in zip(_COUNTED, effect.counted, strict=True):
        got = (getattr(after.counters, name) - getattr(before.counters, name)) & 0xFFFFFFFF
        check(got == due, f"{text}: {name} counts {got}, due is {due}")


def _check_status_against_drives(
    board: BoardClient, after: StatusReply, effect: _LatchEffectInStatus, text: str
) -> None:
    for feature, kind in (
        (Feature.READ_LATCHED, DriveKind.LATCHED),
        (Feature.READ_RADIATED, DriveKind.RADIATED),
    ):
        if not board.has(feature):
            continue
        shown = read_back(board, kind)
        told, due = (shown.reply.key, shown.reply.t_latch_us), (effect.key, after.last_latch_us)
        check(told == due, f"{text}: READ_DRIVE({kind.name}) names {told}, due is {due}")
        same = shown.phases + shown.amplitudes == full_client_drive(effect.registers)
        check(same, f"{text}: READ_DRIVE({kind.name}) shows other codes than were latched")


def _check_status_against_traces(
    board: BoardClient,
    latches: list[ClientLatch],
    after: StatusReply,
    effect: _LatchEffectInStatus,
    text: str,
) -> None:
    _, latched, late, _ = effect.counted
    new = latches[-latched:]
    check(len(new) == latched, f"{text}: {len(new)} latches are traced, due are {latched}")
    key = LatchKey(new[-1].sequence, new[-1].loop, new[-1].index)
    check(key == effect.key, f"{text}: the trace names {key}, due is {effect.key}")
    due_us = board.clock.unwrap(after.last_latch_us)
    check_equal(
        new[-1].t_us, due_us, f"{text}: traced at {new[-1].t_us} µs, latched at {due_us} µs"
    )
    flags = [latch.late for latch in new]
    check_equal(flags, [bool(late)] * latched, f"{text}: the traces have LATE {flags}")


@case("HG-12.3/1-latches", needs=Feature.CONFIG, depth=Depth.DEFAULT)
def a_latch_in_status_begins_the_hold_anew(board: BoardClient) -> None:
    """a latch of every path begins the hold anew: it ends hold_ms behind the last latch"""
    last = _stored_for_status(board)
    # A path waits for two frames, twice as long as the line needs, behind a third of the hold.
    wait_us = 2 * period_to_play(board) + 4 * board.clock.lead_us  # two latches of a playback
    size = 8 * len(board.flat_phases().serialize())
    hold_ms = min(10_000, board.clock.timer_ms(_HOLD_MS + wait_us // _MS, size))
    board.configure(hold_ms=hold_ms, late_window_us=_WINDOW_US)
    for name, path in _latch_paths_for_status(board):
        board.arm()
        since = board.link.mark()
        latch_now(board)
        begun_us = board.clock.unwrap(board.status().last_latch_us)
        board.wire.idle(hold_ms * _MS // 3)
        _, latches, _, _ = path(board, last).counted
        start_us = board.clock.unwrap(board.status().last_latch_us)
        first_us = start_us - (latches - 1) * period_to_play(board)
        last_us = begun_us + (hold_ms - 50) * _MS
        board.clock.require_before(last_us, "a latch within the hold", first_us)
        header, _ = judged_mute_by_timer(board, since, 3 * hold_ms * _MS, MuteReason.HOLD_EXPIRED)
        judge_mute_time(board, start_us, header, hold_ms, f"hold_ms = {hold_ms}, behind {name}")
