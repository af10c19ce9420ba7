"""HG-3.2, HG-3.4, HG-3.7, HG-3.8, HG-5.5, HG-5.7, HG-9.1:
dropped stream frames, at every format.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any, Final, TypeAlias

from haptogram_protocol import messages as m
from haptogram_protocol.state import OutputState

from ...case import Case, Depth, case
from ...client import latching, playback
from ...client.board_client import BoardClient
from ...client.stream_kinds import StreamKind, points_of_stream_kind, stream_kinds
from ...judge.refused_requests import STORED
from ...judge.timers import judge_status_period
from ...outcome import SELF_REPORTED, check, named, require

_STALE: Final = 0x0F0F
_AHEAD_US: Final = 400_000
_LOW_FLAGS: Final = (1, 2, 4, 8, 15)
_LONGEST: Final = 4000
_LATEST_US: Final = 1 << 30  # behind the last in the queue: what is half a turn ahead has passed
_BEFORE_US: Final = 2  # a carrier boundary

#: Given board, kind and the t_apply of the last queued frame: the frames that have to be dropped.
Frames: TypeAlias = Callable[[BoardClient, StreamKind, int], Iterable[bytes]]
_MS: Final = 1000
_GAP: Final = 7
_FAR_US: Final = 8_000_000  # queued frames and a waiting playback are due then
QUEUED_FRAMES: Final = 3
OFF: Final = "while DISARMED"
MUTED: Final = "while MUTED"
SILENT: Final = "while ARMED and silent"
SOUNDS: Final = "while it sounds"
PLAYING: Final = "while a sequence plays"
PLAYING_SLOWLY: Final = "within a long period of a playback"
WAITS: Final = "while a playback waits for its start"
QUEUES: Final = "with frames queued"
#: Counters of steps 6 to 10 of HG-3.8, which come before the output state.
BEFORE_STATE: Final = ("stale_session", "duplicate", "unsupported", "bad_length", "bad_value")


@dataclass(frozen=True, slots=True)
class Drop:
    """One reason for which a board drops a stream frame.

    Attributes
    ----------
    clause, summary : str
        Of the case.
    counter : str
        Counter that counts the frames.
    frames : callable
        The frames.
    armed : bool
        Whether the board is ARMED when they come.
    queued : int
        Frames that wait before them: 0, 1, or -1 for a full queue.
    """

    clause: str
    summary: str
    counter: str
    frames: Frames
    armed: bool = True
    queued: int = 0


def _stale_drop(board: BoardClient, kind: StreamKind, _: int) -> Iterable[bytes]:
    """Yield frames of *kind* of other sessions and of none, with the next and the last number."""
    one_bit_off = (board.link.session ^ 1 << bit for bit in range(16))
    for session in (board.link.session ^ _STALE, 0, *one_bit_off):
        for seq in (board.link.stream_next, board.link.stream_next - 1):
            yield board.link.stream_wire(kind.make(), session=session, seq=seq)


def _old_drop(board: BoardClient, kind: StreamKind, _: int) -> Iterable[bytes]:
    """Yield frames of *kind* whose stream number is 1 to 32 before the next one."""
    for back in (1, 2, 3, 15, 16, 17, 31, 32):
        yield board.link.stream_wire(kind.make(), seq=board.link.stream_next - back)


def _flagged_drop(board: BoardClient, kind: StreamKind, _: int) -> Iterable[bytes]:
    """Yield frames of *kind* with unknown flags, of bits 5 to 7."""
    for flags in (0x20, 0x40, 0x80, 0xE0 | m.Flag.IMMEDIATE):
        yield board.link.stream_wire(kind.make(), flags=flags)


def _wrong_length_drop(board: BoardClient, kind: StreamKind, _: int) -> Iterable[bytes]:
    """Yield frames of *kind* whose payload is 1 or 256 bytes longer, 1 shorter, 1 byte or empty."""
    message = kind.make()
    payload = message.serialize()
    wrong = [payload + b"\x00", payload[:-1], payload[:1], b""]
    wrong = [one for one in wrong if one != payload]  # of one transducer one byte is right
    if not isinstance(message, m.Points) and len(payload) + 256 < _LONGEST:
        wrong.append(payload + bytes(256))  # the same low byte of the length
    for one in wrong:
        yield board.link.stream_raw(message.TYPE, one)


def _any_drop(board: BoardClient, kind: StreamKind, _: int) -> Iterable[bytes]:
    """Yield a valid frame due at once and one due in 0.4 s: a DISARMED board drops both."""
    yield board.link.stream_wire(kind.make())
    yield board.link.stream_wire(kind.make(), board.clock.device_us() + _AHEAD_US)


def _disordered_drop(board: BoardClient, kind: StreamKind, last_us: int) -> Iterable[bytes]:
    """Yield frames due 0 to 100 ms before *last_us*, the time of the last queued one."""
    for early_us in (0, 1, 1000, 100_000):
        yield board.link.stream_wire(kind.make(), last_us - early_us)


def _late_drop(board: BoardClient, kind: StreamKind, _: int) -> Iterable[bytes]:
    """Yield frames due 1 µs to 2^30 µs longer ago than the late window is."""
    now_us = board.clock.device_us() - board.config.late_window_us
    for late_us in (1, 1000, 70_000, 1_000_000, 2**30):
        yield board.link.stream_wire(kind.make(), now_us - late_us)


def _drop_beyond_window(board: BoardClient, kind: StreamKind, _: int) -> Iterable[bytes]:
    """Yield frames due 0.5 s or more beyond the horizon; none where that is 2^31 µs ahead."""
    horizon_us = board.identity.max_horizon_us
    now_us = board.clock.device_us()
    for ahead_us in (horizon_us + 500_000, 2 * horizon_us, 2**31 - 10_000_000):
        if horizon_us + 500_000 <= ahead_us < 2**31:
            yield board.link.stream_wire(kind.make(), now_us + ahead_us)


def _overflow_drop(board: BoardClient, kind: StreamKind, last_us: int) -> Iterable[bytes]:
    """Yield frames due after *last_us*, the last one in a full queue, which drops them."""
    horizon_us = board.identity.max_horizon_us
    yield board.link.stream_wire(kind.make(), last_us + 1)  # for the latch of the last one
    yield board.link.stream_wire(kind.make(), last_us + 1000)
    yield board.link.stream_wire(kind.make(), last_us + min(2 * horizon_us, _LATEST_US))


DROPS: Final = (
    Drop("HG-3.7/2", "of another session or none", "stale_session", _stale_drop),
    Drop("HG-5.5/1", "seen before", "duplicate", _old_drop),
    Drop("HG-3.4/1", "with unknown flags that must be understood", "unsupported", _flagged_drop),
    Drop("HG-3.2/4", "of a wrong length", "bad_length", _wrong_length_drop),
    Drop("HG-5.7/1", "while DISARMED", "dropped_state", _any_drop, armed=False),
    Drop("HG-5.7/2", "not after the last queued one", "dropped_order", _disordered_drop, queued=1),
    Drop("HG-5.7/3", "that meet a full queue", "dropped_full", _overflow_drop, queued=-1),
    Drop("HG-5.7/4", "beyond the horizon", "dropped_future", _drop_beyond_window),
    Drop("HG-5.7/5", "1 µs to 18 minutes beyond the late window", "dropped_late", _late_drop),
)


def fill_queue(board: BoardClient, number: int, ahead_us: int = 5 * _AHEAD_US) -> int:
    """Queue so many frames, a millisecond apart, from *ahead_us* on; return the last t_apply."""
    good = board.shortest_stream()
    times = [t_us - _BEFORE_US for t_us in board.times_in_queue(number, ahead_us=ahead_us)]
    board.link.send(*(board.link.stream_wire(good, t_us) for t_us in times))
    board.clock.wait_computed(points_of_stream_kind(good) * number)
    return times[-1]


def judge_drop(board: BoardClient, drop: Drop, kind: StreamKind) -> None:
    """FAILED unless every frame of one kind is dropped, counted once and not answered."""
    waiting, wires = frames_to_drop(board, drop, kind)
    require(bool(wires), f"no t_apply is {drop.summary}")
    with board.counting(**{drop.counter: len(wires)}, latched=0):
        board.link.unanswered(f"{kind.name} {drop.summary}", *wires)
        board.check_status(f"{waiting} frames wait, then others are dropped", queued=waiting)
    board.mute()


def judge_first_drop(board: BoardClient, clause: str) -> None:
    """Judge the drop of a clause by PHASES alone."""
    (drop,) = (drop for drop in DROPS if drop.clause == clause)
    judge_drop(board, drop, stream_kinds(board)[0])


def frames_to_drop(board: BoardClient, drop: Drop, kind: StreamKind) -> tuple[int, list[bytes]]:
    """Bring the board to where it has to drop frames; return how many wait, and these frames."""
    queued = board.depth_to_fill() if drop.queued < 0 else drop.queued
    board.hello()
    if drop.armed:
        board.arm()
    board.link.stream(board.flat_phases())  # the first number is used
    board.clock.wait_latched(points=0)
    last_us = fill_queue(board, queued) if queued else 0
    board.link.barrier()
    waiting = board.status().queued
    return waiting, board.within_timers(drop.frames(board, kind, last_us))


def _drop_case(drop: Drop) -> Case:
    """Return the case that sends frames to be dropped for the reason *drop*, in every format."""

    def body(board: BoardClient) -> None:
        for kind in stream_kinds(board):
            with named(kind.name):
                judge_drop(board, drop, kind)

    summary = f"frames {drop.summary}, of every message and format, are counted in {drop.counter}"
    return Case(drop.clause, summary, body, "types", evidence=SELF_REPORTED)


PRODUCT: Final = tuple(_drop_case(drop) for drop in DROPS)


@case("HG-3.4/2-stream", evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def low_flags_drop_no_stream_frame(board: BoardClient) -> None:
    """stream frames of every message and format with each bit of the low nibble: in time, at
    once
    """
    board.arm()
    lows = _LOW_FLAGS if board.thorough else _LOW_FLAGS[-1:]
    mode = latching.ask_for_board_latches_if_supported(board, m.Feature.TRACE)
    since = board.link.mark()
    for kind in stream_kinds(board):
        timed = lows[-board.identity.queue_depth :]
        with board.counting(latched=len(timed) + len(lows), late=0):
            first = kind.make()
            start_us = board.clock.soon_us(
                bytes(len(timed) * len(board.link.stream_wire(first, 0, seq=0))),
                points=len(timed) * points_of_stream_kind(first),
            )
            for place, low in enumerate(timed):
                t_us = start_us + 1000 * place
                board.link.stream(kind.make(), t_us, flags=low)
            board.clock.wait_until(start_us + 1000 * len(timed))
            for low in lows:
                past_us, flags = start_us - 1_000_000, m.Flag.IMMEDIATE | low
                board.link.stream(kind.make(), past_us, flags=flags)
                board.clock.wait_latched()
    late = sum(latch.late for latch in latching.latches_received_from_board(board, since, mode))
    check(late == 0, f"{late} traces say LATE; no frame was late, some had flags or a time past")


def _play_slowly(board: BoardClient) -> None:
    """Play a stored sequence at 9 s a frame, and wait for its first latch."""
    playback.play_now(board, STORED, loops=0, period_us=9_000_000, unattended_ms=9_999)
    board.clock.wait_latched()


#: What brings an ARMED board into each state of its output; :data:`STORED` is what plays.
OUTPUT_STATES: Final[dict[str, Callable[[BoardClient], Any]]] = {
    OFF: lambda board: board.bring_to(OutputState.DISARMED),
    MUTED: lambda board: board.bring_to(OutputState.MUTED),
    SILENT: BoardClient.arm_anew,
    SOUNDS: latching.latch_now,
    PLAYING: lambda board: playback.play_now(board, STORED, loops=0, unattended_ms=9_999),
    PLAYING_SLOWLY: _play_slowly,
    WAITS: lambda board: playback.play_later(board, STORED, _FAR_US, unattended_ms=9_999),
    QUEUES: lambda board: fill_queue(board, QUEUED_FRAMES, _FAR_US),
}


def output_states(
    board: BoardClient, *, queues: bool = True
) -> Iterator[tuple[str, Callable[[BoardClient], Any]]]:
    """Yield the states that a board can be in, each with what brings it there from ARMED.

    What plays has the usual period, which no hold ends; a long one if nothing *queues*: no frame
    of it is latched soon.
    """
    playback.send_phases_to_store_if_supported(board, STORED, frames=1)
    names, reached = [OFF, MUTED, SILENT, SOUNDS], board.clock.horizon_us > _FAR_US
    if board.has(m.Feature.SEQUENCE_PHASES):
        names += [PLAYING if queues else PLAYING_SLOWLY, *[WAITS] * reached]
    for name in names + [QUEUES] * (queues and reached):
        yield name, OUTPUT_STATES[name]


@case("HG-5.7/1-states", evidence=SELF_REPORTED)
def no_other_state_takes_stream_frames(board: BoardClient) -> None:
    """frames while DISARMED, MUTED, while a sequence plays or waits: dropped_state, none is
    latched
    """
    kinds = stream_kinds(board)
    for name, bring in output_states(board, queues=False):
        if name in (SILENT, SOUNDS):
            continue
        board.arm()
        bring(board)
        t_us = board.clock.soon_us(bytes(2000))
        messages = [kind.make() for kind in (kinds if board.thorough else kinds[:1])]
        with named(name), board.counting(dropped_state=2 * len(messages), latched=0):
            for message in messages:
                board.link.stream(message)
                board.link.stream(message, t_us)
            board.clock.wait_latched()
            board.check_status("frames dropped", queued=0)
        board.mute()


@case("HG-3.8/1-states", evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def every_state_checks_stream_frames_alike(board: BoardClient) -> None:
    """stale, old, flagged, wrong frames of every format count alike off, on, playing and waiting"""
    for name, bring in output_states(board, queues=False):
        board.hello()
        board.arm()
        latching.latch_now(board)  # a number is used
        for kind in stream_kinds(board):
            for drop in DROPS:
                if drop.counter not in BEFORE_STATE:
                    continue
                board.mute()
                board.arm()
                bring(board)  # anew: on a slow line its timers would end meanwhile
                wires = board.within_timers(drop.frames(board, kind, 0))
                counts = {drop.counter: len(wires), "latched": 0, "accepted": 0}
                with named(f"{name}, {kind.name} {drop.summary}"), board.counting(**counts):
                    board.link.unanswered(f"{kind.name} {drop.summary}", *wires)
        board.mute()


@case("HG-5.5/2-states", evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def every_state_counts_gaps_of_the_stream(board: BoardClient) -> None:
    """gaps before frames that are taken or dropped count alike off, on, playing and waiting"""
    for name, bring in output_states(board, queues=False):
        board.arm()
        bring(board)
        for kind in stream_kinds(board):
            for flags in ({}, {"flags": 0x40}):
                before = board.status().counters
                board.link.stream_next += _GAP
                board.link.stream(kind.make(), **flags)
                board.link.stream(kind.make(), **flags)
                text = f"{name}, a gap of {_GAP} before {kind.name}"
                board.check_counted(before, text, {"gap": _GAP})
        board.mute()


@case("HG-9.1/1-states", needs=m.Feature.CONFIG, depth=Depth.DEFAULT)
def every_state_of_the_stream_sends_status(board: BoardClient) -> None:
    """STATUS comes at its time off, on, playing and waiting"""
    period_ms = board.quick_status_ms
    for name, bring in output_states(board, queues=False):
        board.arm(status_period_ms=period_ms)
        bring(board)
        since = board.link.mark()
        board.wire.idle_beyond(7 * period_ms * _MS // 2)
        board.link.barrier()
        judge_status_period(board, since, period_ms, 3, f"{name}, 3.5 periods")
        board.mute()
