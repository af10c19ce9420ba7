"""HG-3.6, HG-8.5, HG-9.2: counters, numbers and the ring: nothing sets them back."""

from __future__ import annotations

import contextlib
import itertools
from collections.abc import Callable, Iterator
from functools import partial
from typing import Final

from haptogram_protocol.messages import (
    Counters,
    Feature,
    Message,
    Mute,
    Phases,
    Play,
    StateChanged,
    Trace,
    TraceMode,
)

from ...case import Depth, case
from ...client import malformed_frames
from ...client.board_client import BoardClient
from ...client.latching import latch_now, latch_random, read_ring
from ...client.malformed_frames import malformed_by_counter
from ...client.playback import flood_with_traces, send_phases_to_store_if_supported
from ...client.stream_kinds import stream_kinds, valid_requests_to_send
from ...judge.events import judge_event_numbers
from ...judge.refused_requests import judged_refusal, requests_refused_by_link
from ...outcome import SELF_REPORTED, CaseEndedError, check, check_equal
from ..ch05_stream.every_drop import DROPS, frames_to_drop

_BLOCK: Final = 256
_LONGEST: Final = 40  # bytes of such a frame on the line
_MS: Final = 1000
_SEQUENCE: Final = 4
_LEASE_MS: Final = 20
_GAP: Final = 7
_WINDOW_US: Final = 100_000
_TRACES: Final = Feature.TRACE | Feature.CONFIG
_RING: Final = Feature.TRACE_RING | Feature.CONFIG
_FLOODS: Final = Feature.TRACE_DRIVE | Feature.SEQUENCE_PHASES | Feature.CONFIG


@case("HG-9.2/1", needs_reset=True, evidence=SELF_REPORTED)
def counters_begin_at_0(board: BoardClient) -> None:
    """after a reset all counters are 0; a session, MUTE and DISARM clear none"""
    board.hello()
    first = board.status().counters
    heard = first.repeated if board.link.knocks else 0  # a board that booted may have kept HELLOs
    due = {"frames": 2 + heard, "requests": 2, "repeated": heard}
    if board.link.knocks:  # and may have heard one from its middle on
        due |= {name: getattr(first, name) for name in ("crc", "cobs", "short")}
    values = {name: getattr(first, name) for name in Counters.WIRE}
    wrong = {name: value for name, value in values.items() if value != due.get(name, 0)}
    check(not wrong, f"after a reset, HELLO and GET_STATUS: {wrong}")
    _check_nothing_clears_counters(board)


@case("HG-9.2/1-kept", evidence=SELF_REPORTED)
def keeps_its_status_counters(board: BoardClient) -> None:
    """a session, MUTE, DISARM and ARM clear no counter"""
    _check_nothing_clears_counters(board)


def _check_nothing_clears_counters(board: BoardClient) -> None:
    board.arm()
    latch_now(board)
    board.link.stream(board.flat_phases(), seq=board.link.stream_next - 1)
    board.link.send(*malformed_by_counter(board.link).values())
    before = board.status().counters
    board.link.ask_raw(0x42)
    board.arm()
    board.disarm()
    board.hello()
    board.check_counters_kept(before, "a session, MUTE, DISARM and ARM")


# --- Beyond 8 and 16 bits ----------------------------------------------------------------------


def _counts_of_junk(board: BoardClient) -> Iterator[tuple[str, Callable[[], bytes]]]:
    """Yield counters with a short frame that each counts and no answer tells of."""
    link, used = board.link, board.link.stream_next - 1
    damaged = malformed_by_counter(link)
    damaged["duplicate"] = link.stream_raw(Phases.TYPE, b"", seq=used)
    damaged["stale_session"] = link.stream_raw(Phases.TYPE, b"", seq=used, session=link.session ^ 1)
    for counter in ("crc", "cobs", "short", "duplicate", "stale_session", "unknown_type"):
        yield counter, partial(damaged.__getitem__, counter)
    yield "bad_length", partial(link.stream_raw, Phases.TYPE, b"")
    yield "unsupported", partial(link.stream_raw, Phases.TYPE, b"", flags=0x40)


def _count_much_junk(board: BoardClient, number: int) -> None:
    """FAILED unless each counter grows by *number* with so many frames."""
    board.wire.require_carried(2 * 8 * number * _LONGEST, board.wire.limits.case_us)
    board.link.stream(board.flat_phases())  # the first number is used
    board.link.barrier()
    for counter, make in _counts_of_junk(board):
        with board.counting(**{counter: number}):
            for left in range(number, 0, -_BLOCK):
                board.link.send(*(make() for _ in range(min(left, _BLOCK))))


@case("HG-9.2/1-hundreds", evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def every_counter_of_300(board: BoardClient) -> None:
    """300 frames of each defect that has no answer: each counter grows by 300, beyond 8 bits"""
    _count_much_junk(board, 300)


@case("HG-9.2/1-thousands", evidence=SELF_REPORTED, depth=Depth.FULL)
def every_counter_of_66000(board: BoardClient) -> None:
    """66 000 frames of each defect that has no answer: each counter grows by 66 000"""
    _count_much_junk(board, 66_000)


@case("HG-3.6/2-requests", needs=_TRACES, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def every_request_leaves_event_numbers(board: BoardClient) -> None:
    """behind every request, refusal and repeated HELLO events and stream frames go on by 1"""
    send_phases_to_store_if_supported(board, _SEQUENCE, frames=1)
    since, names = board.arm(trace_mode=TraceMode.CRC), ["ARM"]
    before = board.status().counters
    latch_now(board)
    for name, send in _requests_at_events(board):
        send()
        names.append(name)
        board.arm()
        latch_now(board)
    board.check_counted(before, "stream frames without a gap", {"gap": 0, "duplicate": 0})
    latches = [trace.index for _, trace in board.link.events(Trace, since)]
    for place, (one, two) in enumerate(itertools.pairwise(latches)):
        check_equal(two, one + 1, f"behind {names[place + 1]}: stream frames {one}, then {two}")
    judge_event_numbers(board, board.wire.received[since:])
    check_equal(len(latches), len(names), f"{len(latches)} traces of {len(names)} latches")


def _requests_at_events(board: BoardClient) -> Iterator[tuple[str, Callable[[], object]]]:
    """Yield what sends each request that is carried out or refused, and HELLO again, by name."""
    messages: list[Message] = [*valid_requests_to_send(board, _SEQUENCE), Mute()]
    for message in messages:
        if not isinstance(message, Play):
            yield message.TYPE.name, partial(board.link.ask, message)
        again = partial(board.hello, board.link.session)
        yield f"HELLO again, behind {message.TYPE.name}", again
    for refusal in requests_refused_by_link(board):
        yield refusal.name, partial(judged_refusal, board, refusal)


@case("HG-8.5/1-kept", needs=_RING, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def every_request_leaves_the_ring(board: BoardClient) -> None:
    """the ring keeps its latches over every request, MUTE, timer and HELLO again of the session"""
    send_phases_to_store_if_supported(board, _SEQUENCE, frames=1)
    board.arm(trace_mode=TraceMode.RING)
    latch_random(board, 3)
    before = read_ring(board, 0, 3).records
    check_equal(len(before), 3, f"the ring holds {len(before)} of 3 latches")
    for name, happen in _counter_preserving_events(board):
        if not name.startswith("a new session"):
            happen()
            board.configure(trace_mode=TraceMode.RING)
            check_equal(read_ring(board, 0, 3).records, before, f"the ring after {name}")


# --- Counters ----------------------------------------------------------------------------------


@case("HG-9.2/1-all", evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def every_counter_outlives_everything(board: BoardClient) -> None:
    """every counter that can be moved outlives every request, session, playback and timer"""
    _move_all_counters(board)
    send_phases_to_store_if_supported(board, _SEQUENCE, frames=1)
    before = board.status().counters
    for name, happen in 2 * list(_counter_preserving_events(board)):
        happen()  # the second time behind a timer's mute
        before = board.check_counters_kept(before, name)


def _counter_preserving_events(board: BoardClient) -> Iterator[tuple[str, Callable[[], object]]]:
    yield "a new session", board.hello
    yield "HELLO again", lambda: board.hello(board.link.session)
    yield "ARM", board.arm
    for message in valid_requests_to_send(board, _SEQUENCE):
        yield message.TYPE.name, partial(board.link.ask_at_once, message)
    yield "MUTE", partial(board.link.ask, Mute())
    yield "MUTE without a session", partial(board.link.ask, Mute(), session=0)
    yield "a new session while MUTED", board.hello
    yield "ARM while MUTED", board.arm
    if board.has(Feature.CONFIG):
        yield "the lease", partial(_run_out_lease, board)
    yield "a new session behind a timer", board.hello


def _move_all_counters(board: BoardClient) -> None:
    """Move every counter that frames and timers can move."""
    kind = stream_kinds(board)[0]
    before = board.status().counters
    for drop in DROPS:
        with contextlib.suppress(CaseEndedError):  # a queue too deep to be filled
            board.link.send(*frames_to_drop(board, drop, kind)[1])
            board.link.barrier()
        board.link.ask(Mute())  # flushes what is queued
        before = board.check_counters_kept(before, f"a new session and frames {drop.summary}")
    board.link.send(*malformed_frames.malformed_by_counter(board.link).values())
    board.link.stream_next += _GAP
    board.link.send(board.link.stream_raw(Phases.TYPE, b""))
    board.hello(board.link.session)
    if board.has(Feature.CONFIG):
        board.arm(late_window_us=_WINDOW_US)
        board.link.stream(board.flat_phases(), board.late_time_us(_WINDOW_US // 2))
        board.clock.wait_latched()
        _run_out_lease(board)
    if board.has(_FLOODS):
        flood_with_traces(board)


def _run_out_lease(board: BoardClient) -> None:
    board.arm(host_timeout_ms=_LEASE_MS)
    board.link.await_event(StateChanged, board.link.mark(), (_LEASE_MS + 200) * _MS)
    board.configure()
