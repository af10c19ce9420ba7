"""HG-9.1, HG-12.3: STATUS: when it comes, and what each latch changes in it, and nothing else."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Final

from haptogram_protocol import messages as m
from haptogram_protocol.state import MuteReason

from ...case import Depth, case
from ...client import latching, playback, uploads
from ...client.board_client import PARTS_OF_FRAMES, BoardClient
from ...client.capabilities import drive_kinds, trace_modes
from ...client.recording import counter_steps
from ...client.stream_kinds import valid_requests_to_send
from ...judge.timers import HOLD, judge_status_period, judged_mute_by_timer
from ...outcome import SELF_REPORTED, check, check_equal, check_fields

_MS: Final = 1000
_ROUNDS: Final = 8
_SEQUENCE: Final = 7
_FAR_US: Final = 5_000_000
_FRAMES: Final = 2
_LOOPS: Final = 2
_LATE_US: Final = 5 * _MS
_WINDOW_US: Final = 100_000
_HOLD_MS: Final = 100
_HEADERS_BYTES: Final = 100  # of a PING and two stream frames
_COUNTED: Final = ("accepted", "latched", "late", "flushed")


@case("HG-9.1/1", needs=m.Feature.CONFIG, depth=Depth.DEFAULT)
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
    check(not board.link.events(m.Status, since), "STATUS comes although status_period_ms is 0")


@case("HG-9.1/3", needs=m.Feature.CONFIG, evidence=SELF_REPORTED)
def status_of_one_moment(board: BoardClient) -> None:
    """in STATUS and STATUS_REPLY amid a stream both sums hold: of frames, and of accepted"""
    board.arm(status_period_ms=board.quick_status_ms)
    good = board.shortest_stream()
    since = board.link.mark()
    found: list[m.StatusReply | m.Status] = [board.status()]
    for _ in range(_ROUNDS):
        t_us = board.clock.soon_us(bytes(1000), ahead_us=_MS)
        for number in range(3):
            board.link.stream(good, t_us + number * _MS)
            found.append(board.status())
        board.clock.wait_until(t_us + 2 * _MS)
    found += [event for _, event in board.link.events(m.Status, since)]
    for status in found:
        counted = counter_steps(found[0].counters, status.counters)
        parts = {name: counted[name] for name in PARTS_OF_FRAMES if counted[name]}
        is_whole = (counted["frames"] - sum(parts.values())) & 0xFFFFFFFF == 0
        check(is_whole, f"frames has grown by {counted['frames']}, its parts by {parts}")
        stream = counted["latched"] + counted["flushed"] + status.queued - found[0].queued
        text = f"latched, flushed and queued together grew by {stream}; counted {parts}"
        check((counted["accepted"] - stream) & 0xFFFFFFFF == 0, text)


# --- The last latch ----------------------------------------------------------------------------


@case("HG-9.1/2", evidence=SELF_REPORTED)
def status_begins_with_nothing(board: BoardClient) -> None:
    """last_seq and last_latch_us are 0 until a latch, and again in a new session"""
    board.arm()
    for _ in range(2):
        board.check_status("before the first latch", last_seq=0, last_latch_us=0)
        index = latching.latch_now(board)
        found = board.check_status("behind a latch", last_seq=index)
        check(found.last_latch_us != 0, "last_latch_us is 0 after a latch")
        board.hello()
        board.arm()


@case("HG-9.1/2-playback", needs=m.Feature.SEQUENCE_PHASES, evidence=SELF_REPORTED)
def every_playback_last_seq(board: BoardClient) -> None:
    """a playback moves last_latch_us and not last_seq, which is of the last stream frame"""
    stored = _last_stored_frame(board)
    paths = list(_paths_of_latches(board))
    board.arm()
    for path in (paths[0], *(path for path in paths if path.plays), paths[0]):
        _judge_latch_on_path(board, path, stored, m.TraceMode.OFF, path.name)


def _read_last_latch(board: BoardClient) -> dict[str, object]:
    """Return the last latch by STATUS and, where it can be read back, READ_DRIVE, by field name."""
    status = board.status()
    told: dict[str, object] = {"seq": status.last_seq, "latch_us": status.last_latch_us}
    return told | (
        {"read": latching.read_back(board).reply} if board.has(m.Feature.READ_LATCHED) else {}
    )


def _events_without_latch(board: BoardClient) -> Iterator[tuple[str, Callable[[], object]]]:
    """Yield actions of host or timers that latch nothing, by name."""
    ask, stream, frame = board.link.ask, board.link.stream, board.flat_phases(9)
    for message in valid_requests_to_send(board, _SEQUENCE):
        if not isinstance(message, m.Play | m.Disarm):
            yield message.TYPE.name, partial(ask, message)
    yield "a frame for later", lambda: stream(frame, board.clock.ahead_us(_FAR_US))
    yield "a late frame", lambda: stream(frame, board.clock.device_us() - _FAR_US)
    if board.has(m.Feature.SEQUENCE_PHASES):
        wait = partial(playback.play_later, loops=1, unattended_ms=5000)
        yield "a playback that waits", partial(wait, board, _SEQUENCE, 3_000_000)
        yield "STOP before its start", board.stop
    if board.has(m.Feature.CORRECTION):
        yield "a correction", partial(uploads.upload_correction, board)
    if board.has(m.Feature.CONFIG):
        yield "the hold that mutes", partial(_run_out_hold, board)
    for last in (m.Mute(), m.Arm(), m.Disarm()):
        yield last.TYPE.name, partial(ask, last)


def _run_out_hold(board: BoardClient) -> None:
    """Set a hold of 1 ms, and wait until it has muted the board."""
    since = board.link.mark()
    board.configure(hold_ms=1)
    judged_mute_by_timer(board, since, 300 * _MS, MuteReason.HOLD_EXPIRED)
    board.configure()


def _check_last_latch_stays(board: BoardClient, name: str) -> None:
    """FAILED if an event that latches nothing changes the last latch in STATUS or read-back.

    *name* says in a finding how that latch came about.
    """
    before = _read_last_latch(board)
    for what, do in _events_without_latch(board):
        do()
        board.link.barrier()
        check_equal(_read_last_latch(board), before, f"the last latch after {name}, behind {what}")


@case("HG-9.1/2-stays", evidence=SELF_REPORTED)
def every_latchless_event(board: BoardClient) -> None:
    """last_seq, last_latch_us, key and codes of the last latch stay until the next latch"""
    playback.send_phases_to_store_if_supported(board, _SEQUENCE, frames=1)
    board.arm()
    index = board.link.stream_next
    latching.latch_random(board, 1)
    _check_last_latch_stays(board, "a stream frame")
    if not board.has(m.Feature.SEQUENCE_PHASES):
        return
    for ended in ("by itself", "by STOP"):
        board.arm()
        if ended == "by itself":
            playback.play_out(board, _SEQUENCE, 1, loops=3)
        else:
            playback.play_now(board, _SEQUENCE, loops=0)
            playback.let_play(board, 5)
            board.stop()
        board.check_status("after a playback", last_seq=index)
        if board.has(m.Feature.READ_LATCHED):
            key = latching.read_back(board).reply.key
            due = m.LatchKey(_SEQUENCE, 2 if ended == "by itself" else key.loop, 0)
            check_equal(key, due, f"the key after passes of 1 frame, ended {ended}")
        _check_last_latch_stays(board, f"a playback that ended {ended}")


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
    latch: Callable[[BoardClient, m.Message], object]
    counted: tuple[int, int, int, int] = (1, 1, 0, 0)
    plays: bool = False


@dataclass(frozen=True, slots=True)
class _LastLatch:
    """Key and phase codes of the last latch of a path; its amplitudes are 255."""

    key: m.LatchKey
    registers: bytes


def _latch_on_path(board: BoardClient, path: _Path, stored: bytes) -> _LastLatch:
    """Latch by *path*; return key (sequence, loop, index) and phase codes of the last latch.

    *stored* are the codes if *path* plays the stored sequence.
    """
    registers = board.random_registers()
    path.latch(board, board.phases(registers))
    if path.plays:
        return _LastLatch(m.LatchKey(_SEQUENCE, _LOOPS - 1, _FRAMES - 1), stored)
    return _LastLatch(m.LatchKey(0, 0, board.link.stream_next - 1), registers)


def _latch_late(board: BoardClient, frame: m.Message) -> None:
    """Send a frame due 5 ms before it is ready, within the late window; wait for its latch."""
    board.link.stream(frame, board.late_time_us(_LATE_US))
    board.clock.wait_latched()


def _latch_and_replace(board: BoardClient, frame: m.Message) -> None:
    """Latch *frame*, the later of two that fall on one carrier period."""
    period_us = board.clock.carrier_us
    t_us = board.clock.soon_us(bytes(_HEADERS_BYTES + 2 * len(frame.serialize())))
    board.link.stream(board.flat_phases(), t_us - period_us + 1)
    board.link.stream(frame, t_us)
    board.clock.wait_until(t_us + 2 * period_us)


def _latch_and_flush(board: BoardClient, frame: m.Message) -> None:
    """Queue a frame due in 2 s, then latch *frame* at once, which flushes it."""
    board.link.stream(board.flat_phases(), board.clock.ahead_us(2_000_000))
    latching.latch_now(board, frame)


def _play_at_once(board: BoardClient, _: m.Message) -> None:
    """Play the stored sequence now, to its end."""
    since = board.link.mark()
    playback.play_now(board, _SEQUENCE, loops=_LOOPS)
    _await_end(board, since)


def _play_in_time(board: BoardClient, _: m.Message) -> None:
    """Play the stored sequence to its end, from a time on that is 5 ms or more ahead."""
    since = board.link.mark()
    start_us = board.clock.soon_us(bytes(500), ahead_us=5 * _MS)
    playback.play_at(board, _SEQUENCE, start_us, loops=_LOOPS)
    _await_end(board, since)


def _await_end(board: BoardClient, since: int) -> None:
    """Wait for PLAYBACK_ENDED from received frame *since* on; FAILED if it does not come."""
    latches = _LOOPS * _FRAMES
    traces_us = board.wire.period_us(latches * (2 * board.identity.transducers + _HEADERS_BYTES))
    playback.await_playback_end(board, since, latches * playback.period_to_play(board) + traces_us)


def _paths_of_latches(board: BoardClient) -> Iterator[_Path]:
    """Yield the ways to latch: at once, timed, late, replacing or flushing another, playing."""
    yield _Path("a frame latched at once", latching.latch_now)
    yield _Path("a frame latched in time", latching.latch_in_time)
    if board.has(m.Feature.CONFIG):
        yield _Path("a late frame", _latch_late, (1, 1, 1, 0))
    if board.clock.carrier_us > 1:
        yield _Path("a frame that replaces another", _latch_and_replace, (2, 1, 0, 1))
    yield _Path("a frame that flushes another", _latch_and_flush, (2, 1, 0, 1))
    frames, most = (
        _LOOPS * _FRAMES,
        playback.most_periods_to_play(board, playback.period_to_play(board)),
    )
    if board.has(m.Feature.SEQUENCE_PHASES) and most > frames:
        for name, play in (("at once", _play_at_once), ("in time", _play_in_time)):
            yield _Path(f"a sequence played {name}", play, (0, frames, 0, 0), plays=True)


def _last_stored_frame(board: BoardClient) -> bytes:
    """Store a sequence and return its last frame; empty if the board stores none."""
    if not board.has(m.Feature.SEQUENCE_PHASES):
        return b""
    return playback.send_phases_to_store(board, _SEQUENCE, frames=_FRAMES)[-1]


# --- Cases -------------------------------------------------------------------------------------


@case("HG-9.1/3-latches", evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def every_latch_changes_the_status(board: BoardClient) -> None:
    """a latch of every path, the first and later: counters, last_seq, time, key, codes, LATE"""
    stored = _last_stored_frame(board)
    can_configure = board.has(m.Feature.CONFIG)
    for mode in trace_modes(board, *m.TraceMode) if can_configure else [m.TraceMode.OFF]:
        if can_configure:
            board.configure(trace_mode=mode, late_window_us=_WINDOW_US)
        for order in ("the first of a session", "behind another latch"):
            for path in _paths_of_latches(board):
                if order == "the first of a session":
                    board.hello()
                board.arm()
                text = f"{path.name}, {order}, trace {mode.name}"
                _judge_latch_on_path(board, path, stored, mode, text)


def _judge_latch_on_path(
    board: BoardClient, path: _Path, stored: bytes, mode: m.TraceMode, text: str
) -> None:
    """FAILED unless STATUS, read-back and trace all report the latch that *path* brings.

    *stored* is the last frame of the sequence; *mode* OFF: there is no trace; *text* begins the
    finding.
    """
    before, since = board.status(), board.link.mark()
    last = _latch_on_path(board, path, stored)
    after = board.status()
    _check_status(before, after, path, last, text)
    _check_drives(board, after, last, text)
    if mode is not m.TraceMode.OFF:
        latches = latching.latches_received_from_board(board, since, mode)
        last_us = board.clock.unwrap(after.last_latch_us)
        _check_traces(latches, path, last, last_us, text)


def _check_status(
    before: m.StatusReply, after: m.StatusReply, path: _Path, last: _LastLatch, text: str
) -> None:
    """FAILED unless *after* reports the *last* latch, and counters grew as *path* says.

    *before* and *after* are STATUS before and after the latch; *text* begins the finding.
    """
    index = before.last_seq if path.plays else last.key.index
    check_fields(after, f"{text}: STATUS_REPLY", last_seq=index)
    moved = after.last_latch_us != before.last_latch_us
    check(moved, f"{text}: last_latch_us stays {after.last_latch_us}")
    steps = counter_steps(before.counters, after.counters)
    check_equal(tuple(steps[name] for name in _COUNTED), path.counted, f"{text}: {_COUNTED} count")


def _check_drives(board: BoardClient, after: m.StatusReply, last: _LastLatch, text: str) -> None:
    """FAILED unless READ_DRIVE has key and phase codes of *last*, and the latch time of *after*.

    *after* is STATUS behind the latch; *text* begins the finding.
    """
    for kind in drive_kinds(board):
        due = {"key": last.key, "t_latch_us": after.last_latch_us}
        due |= {"data": latching.full_client_drive(last.registers)}
        check_fields(
            latching.read_back(board, kind).reply, f"{text}: READ_DRIVE({kind.name})", **due
        )


def _check_traces(
    latches: list[latching.ClientLatch], path: _Path, last: _LastLatch, last_us: int, text: str
) -> None:
    """FAILED unless all latches of *path* are traced as LATE if it sends a late frame, else none.

    They are the newest of *latches*; the last has to have the key (sequence, loop, index) of *last*
    and the time *last_us*.  *text* begins the finding.
    """
    _, latched, late, _ = path.counted
    new = latches[-latched:]
    flags = [latch.late for latch in new]
    check_equal(flags, [bool(late)] * latched, f"{text}: LATE of {latched} traces")
    check_fields(new[-1], f"{text}: the last trace", key=last.key, t_us=last_us)


@case("HG-12.3/1-latches", needs=m.Feature.CONFIG, depth=Depth.DEFAULT)
def every_latch_restarts_the_hold(board: BoardClient) -> None:
    """a latch of every path begins the hold anew: it ends hold_ms behind the last latch"""
    stored = _last_stored_frame(board)
    # Behind a third of the hold a path waits for two frames, twice as long as the line needs, or
    # for two latches of a playback; each of its exchanges has a lead.
    wait_us = 2 * playback.period_to_play(board) + 4 * board.clock.lead_us
    size = 8 * len(board.flat_phases().serialize())
    wait_us += 5 * board.wire.limits.lead_us
    hold_ms = min(10_000, board.clock.timer_ms(_HOLD_MS + wait_us // _MS, size))
    board.configure(hold_ms=hold_ms, late_window_us=_WINDOW_US)
    for path in _paths_of_latches(board):
        since = board.arm()
        begun_us = latching.latch_timed(board)
        board.wire.idle(hold_ms * _MS // 3)
        _latch_on_path(board, path, stored)
        start_us = board.last_latch_us()
        first_us = start_us - (path.counted[1] - 1) * playback.period_to_play(board)
        last_us = begun_us + (hold_ms - 50) * _MS
        board.clock.require_before(last_us, "a latch within the hold", first_us)
        HOLD.judge(board, since, start_us, hold_ms, f"hold_ms = {hold_ms}, behind {path.name}")
