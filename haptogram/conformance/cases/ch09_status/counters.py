"""HG-3.6, HG-8.5, HG-9.2, HG-9.3:
counters, numbers, the ring: nothing sets them back; arrival margins.
"""

from __future__ import annotations

import contextlib
import itertools
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Final

from haptogram_protocol import messages as m

from ...case import Depth, case
from ...client import latching, malformed_frames, playback
from ...client.board_client import BoardClient
from ...client.malformed_frames import malformed_by_counter
from ...client.stream_kinds import points_of_stream_kind, stream_kinds, valid_requests_to_send
from ...judge.events import judge_event_numbers
from ...judge.refused_requests import judged_refusal, requests_refused_by_link
from ...outcome import SELF_REPORTED, CaseEndedError, check, check_equal, check_fields, named
from ..ch05_stream.every_drop import DROPS, frames_to_drop

_BLOCK: Final = 256
_LONGEST: Final = 40  # bytes of such a frame on the line
_MS: Final = 1000
_SEQUENCE: Final = 4
_LEASE_MS: Final = 20
_GAP: Final = 7
_WINDOW_US: Final = 100_000
_TRACES: Final = m.Feature.TRACE | m.Feature.CONFIG
_RING: Final = m.Feature.TRACE_RING | m.Feature.CONFIG
_FLOODS: Final = m.Feature.TRACE_DRIVE | m.Feature.SEQUENCE_PHASES | m.Feature.CONFIG
_MANY_MARGINS: Final = 300  # margins of 9.9 s: their sum needs more than 31 bits
_STORED: Final = 5
_AHEAD_US: Final = 400_000
#: Counters of steps 13 to 16 of HG-3.8.
_WITH_MARGIN: Final = ("dropped_order", "dropped_full", "dropped_future", "dropped_late")


@case("HG-9.2/1", needs_reset=True, evidence=SELF_REPORTED)
def counters_begin_at_0(board: BoardClient) -> None:
    """after a reset all counters are 0; a session, MUTE and DISARM clear none"""
    board.hello()
    first = board.status().counters
    heard = first.repeated if board.link.knocks else 0  # a board that booted may have kept HELLOs
    due = {"frames": 2 + heard, "requests": 2, "repeated": heard}
    if board.link.knocks:  # and may have heard one from its middle on
        due |= {name: getattr(first, name) for name in ("crc", "cobs", "short")}
    values = {name: getattr(first, name) for name in m.Counters.WIRE}
    wrong = {name: value for name, value in values.items() if value != due.get(name, 0)}
    check(not wrong, f"after a reset, HELLO and GET_STATUS: {wrong}")
    _check_nothing_clears_counters(board)


@case("HG-9.2/1-kept", evidence=SELF_REPORTED)
def keeps_its_status_counters(board: BoardClient) -> None:
    """a session, MUTE, DISARM and ARM clear no counter"""
    _check_nothing_clears_counters(board)


def _check_nothing_clears_counters(board: BoardClient) -> None:
    """Count frames of every kind; FAILED if a request or a new session clears a counter."""
    board.arm()
    latching.latch_now(board)
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
    """Yield name of each counter and builder of a bad frame that increments it without a reply."""
    link, used = board.link, board.link.stream_next - 1
    damaged = malformed_by_counter(link)
    damaged["duplicate"] = link.stream_raw(m.Phases.TYPE, b"", seq=used)
    damaged["stale_session"] = link.stream_raw(
        m.Phases.TYPE, b"", seq=used, session=link.session ^ 1
    )
    for counter in ("crc", "cobs", "short", "duplicate", "stale_session", "unknown_type"):
        yield counter, partial(damaged.__getitem__, counter)
    yield "bad_length", partial(link.stream_raw, m.Phases.TYPE, b"")
    yield "unsupported", partial(link.stream_raw, m.Phases.TYPE, b"", flags=0x40)


def _count_much_junk(board: BoardClient, number: int) -> None:
    """FAILED unless each counter grows by *number* after that many bad frames."""
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
    playback.send_phases_to_store_if_supported(board, _SEQUENCE, frames=1)
    since, names = board.arm(trace_mode=m.TraceMode.CRC), ["ARM"]
    before = board.status().counters
    latching.latch_now(board)
    for name, send in _requests_at_events(board):
        send()
        names.append(name)
        board.arm()
        latching.latch_now(board)
    board.check_counted(before, "stream frames without a gap", {"gap": 0, "duplicate": 0})
    latches = [trace.index for _, trace in board.link.events(m.Trace, since)]
    for place, (one, two) in enumerate(itertools.pairwise(latches)):
        check_equal(two, one + 1, f"behind {names[place + 1]}: stream frames {one}, then {two}")
    judge_event_numbers(board, board.wire.received[since:])
    check_equal(len(latches), len(names), f"{len(latches)} traces of {len(names)} latches")


def _requests_at_events(board: BoardClient) -> Iterator[tuple[str, Callable[[], object]]]:
    """Yield functions that send each valid or refused request, and HELLO again, by name."""
    messages: list[m.Message] = [*valid_requests_to_send(board, _SEQUENCE), m.Mute()]
    for message in messages:
        if not isinstance(message, m.Play):
            yield message.TYPE.name, partial(board.link.ask, message)
        again = partial(board.hello, board.link.session)
        yield f"HELLO again, behind {message.TYPE.name}", again
    for refusal in requests_refused_by_link(board):
        yield refusal.name, partial(judged_refusal, board, refusal)


@case("HG-8.5/1-kept", needs=_RING, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def every_request_leaves_the_ring(board: BoardClient) -> None:
    """the ring keeps its latches over every request, MUTE, timer and HELLO again of the session"""
    playback.send_phases_to_store_if_supported(board, _SEQUENCE, frames=1)
    board.arm(trace_mode=m.TraceMode.RING)
    latching.latch_random(board, 3)
    before = latching.read_ring(board, 0, 3).records
    check_equal(len(before), 3, f"the ring holds {len(before)} of 3 latches")
    for name, happen in _counter_preserving_events(board):
        if not name.startswith("a new session"):
            happen()
            board.configure(trace_mode=m.TraceMode.RING)
            check_equal(latching.read_ring(board, 0, 3).records, before, f"the ring after {name}")


# --- Counters ----------------------------------------------------------------------------------


@case("HG-9.2/1-all", evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def every_counter_outlives_everything(board: BoardClient) -> None:
    """every counter that can be moved outlives every request, session, playback and timer"""
    _move_all_counters(board)
    playback.send_phases_to_store_if_supported(board, _SEQUENCE, frames=1)
    before = board.status().counters
    for name, happen in 2 * list(_counter_preserving_events(board)):
        happen()  # the second time behind a timer's mute
        before = board.check_counters_kept(before, name)


def _counter_preserving_events(board: BoardClient) -> Iterator[tuple[str, Callable[[], object]]]:
    """Yield functions that send each request, MUTE or HELLO, which clear no counter, by name."""
    yield "a new session", board.hello
    yield "HELLO again", lambda: board.hello(board.link.session)
    yield "ARM", board.arm
    for message in valid_requests_to_send(board, _SEQUENCE):
        yield message.TYPE.name, partial(board.link.ask_at_once, message)
    yield "MUTE", board.mute
    yield "MUTE without a session", partial(board.mute, session=0)
    yield "a new session while MUTED", board.hello
    yield "ARM while MUTED", board.arm
    if board.has(m.Feature.CONFIG):
        yield "the lease", partial(_run_out_lease, board)
    yield "a new session behind a timer", board.hello


def _move_all_counters(board: BoardClient) -> None:
    """Increment every counter that frames and timers can; FAILED if one goes back meanwhile."""
    kind = stream_kinds(board)[0]
    before = board.status().counters
    for drop in DROPS:
        with contextlib.suppress(CaseEndedError):  # a queue too deep to be filled
            board.link.send(*frames_to_drop(board, drop, kind)[1])
            board.link.barrier()
        board.mute()  # flushes what is queued
        before = board.check_counters_kept(before, f"a new session and frames {drop.summary}")
    board.link.send(*malformed_frames.malformed_by_counter(board.link).values())
    board.link.stream_next += _GAP
    board.link.send(board.link.stream_raw(m.Phases.TYPE, b""))
    board.hello(board.link.session)
    if board.has(m.Feature.CONFIG):
        board.arm(late_window_us=_WINDOW_US)
        board.link.stream(board.flat_phases(), board.late_time_us(_WINDOW_US // 2))
        board.clock.wait_latched()
        _run_out_lease(board)
    if board.has(_FLOODS):
        playback.flood_with_traces(board)


def _run_out_lease(board: BoardClient) -> None:
    """Arm the board with a lease of 20 ms, and wait until it has expired."""
    board.arm(host_timeout_ms=_LEASE_MS)
    board.link.await_event(m.StateChanged, board.link.mark(), (_LEASE_MS + 200) * _MS)
    board.configure()


def _send_ahead(board: BoardClient, good: m.Message, ahead_us: Sequence[int]) -> tuple[int, int]:
    """Send copies of *good* due *ahead_us* from now; return that time in µs, and how many are sent.

    The time is the device's; copies that come only when a timer may have ended are not sent.
    """
    base_us = board.clock.device_us()
    frames = (board.link.stream_wire(good, base_us + ahead) for ahead in ahead_us)
    wires = board.within_timers(frames)
    board.link.send(*wires)
    return base_us, len(wires)


def _check_margins(
    status: m.StatusReply, number: int, least_us: int, mean_us: int, later_us: int
) -> None:
    """FAILED unless STATUS_REPLY has number, least and mean, in µs, of the margins that are due.

    A margin is t_apply less the time at which a frame was ready.  Least and mean may be up to
    *later_us* less, by which the frames came later.
    """
    check_fields(status, "STATUS_REPLY", margins=number)
    for name, got, due in (
        ("margin_min_us", status.margin_min_us, least_us),
        ("margin_mean_us", status.margin_mean_us, mean_us),
    ):
        is_due = due - later_us - 1 <= got <= due + 1
        check(is_due, f"{name} is {got}, due is {due} less at most {later_us}")


def _judge_margins_of(board: BoardClient, good: m.Message, margins: Sequence[int]) -> None:
    """FAILED unless STATUS reports the margins of the frames sent, and the next STATUS none.

    A margin is t_apply less the time at which a frame was ready.  The frames are copies of *good*,
    due *margins* µs from now.
    """
    board.hello()
    board.arm()
    board.status()
    _check_margins(board.status(), 0, 0, 0, 0)
    base_us, number = _send_ahead(board, good, margins)
    board.link.stream(good)  # IMMEDIATE: no margin; flushes
    found = board.status()
    margins = margins[:number]
    sent_us = board.wire.period_us((number + 1) * len(board.link.stream_wire(good, 0, seq=0)))
    later_us = board.clock.device_us() - base_us + sent_us
    ready_us = board.clock.ready_us(0)
    mean_us = sum(margins) // number - ready_us
    _check_margins(found, number, min(margins) - ready_us, mean_us, later_us)
    _check_margins(board.status(), 0, 0, 0, 0)


@case("HG-9.3/1", evidence=SELF_REPORTED)
def status_tells_margins(board: BoardClient) -> None:
    """margins of 3 frames in time and one too late: number, least and mean; then they begin anew"""
    board.require_no_status()
    # The last one, in disorder, is dropped and counted.
    _judge_margins_of(board, board.flat_phases(), (200_000, 300_000, 400_000, -1_000_000))


@case("HG-9.3/1-widths", evidence=SELF_REPORTED)
def status_tells_wide_margins(board: BoardClient) -> None:
    """margins of up to 35 minutes, early, late and mixed, of 1 to 300 frames: sums of 32 bits
    fail
    """
    board.require_no_status()
    good = board.flat_phases() if board.identity.point_time_us else board.shortest_stream()
    most_us = 2**31 - 60_000_000
    early_us = board.identity.max_horizon_us - 100_000
    for margins in (
        [-most_us] * 3,
        [most_us] * 3,
        [most_us, -most_us, most_us],
        [-most_us, most_us, -1_000_000],
        [-70_000, -131_072, -32_768],
        [early_us] * _MANY_MARGINS,  # the first one is queued, the others are not after it
    ):
        _judge_margins_of(board, good, margins)


@case("HG-9.3/1-ready", evidence=SELF_REPORTED)
def margins_count_from_ready(board: BoardClient) -> None:
    """the margin of frames of each kind is t_apply less the time at which they are ready"""
    board.require_no_status()
    board.arm()
    for message in (kind.make() for kind in stream_kinds(board)):
        board.clock.wait_latched()
        t_us = board.clock.soon_us(bytes(2000), ahead_us=500 * _MS)
        board.status()
        from_us, to_us = latching.send_between_pings(board, message, t_us)
        due_us = t_us - from_us - board.clock.ready_us(0, points_of_stream_kind(message))
        _check_margins(board.status(), 1, due_us, due_us, to_us - from_us)
        board.mute()  # or the next frame would not be in order
        board.arm()


@case("HG-9.3/1-requests", evidence=SELF_REPORTED)
def every_request_keeps_margins(board: BoardClient) -> None:
    """margins outlive every request but GET_STATUS: a new session, MUTE, PLAY and all the others"""
    board.require_no_status()
    playback.send_phases_to_store_if_supported(board, _STORED, frames=2)
    messages = [
        one for one in valid_requests_to_send(board, _STORED) if not isinstance(one, m.GetStatus)
    ]
    every: list[m.Message] = [m.Mute(), m.Arm(), *messages, board.hello_message(board.new_nonce())]
    try:
        _check_margins_behind(board, every)
    except CaseEndedError:
        for message in every:  # which one was it?
            with named(f"behind {message.TYPE.name}"):
                _check_margins_behind(board, [message])
        raise


def _check_margins_behind(board: BoardClient, messages: list[m.Message]) -> None:
    """FAILED unless STATUS has the margins of three frames even after the requests *messages*."""
    board.hello()
    board.arm()
    board.status()
    # The last one is dropped.
    ahead_us = (_AHEAD_US, 3 * _AHEAD_US, 2 * _AHEAD_US)
    base_us, number = _send_ahead(board, board.flat_phases(), ahead_us)
    board.link.barrier()
    passed_us = board.clock.ready_us(board.clock.device_us() - base_us)
    for message in messages:
        if isinstance(message, m.Hello):
            board.hello()
        else:
            board.link.ask_at_once(message)
    mean_us = sum(ahead_us[:number]) // number - board.clock.ready_us(0)
    _check_margins(board.status(), number, _AHEAD_US - board.clock.ready_us(0), mean_us, passed_us)


@case("HG-9.3/1-drops", evidence=SELF_REPORTED)
def every_dropped_margin(board: BoardClient) -> None:
    """frames dropped for order, room, horizon or lateness have a margin, those before step 13
    none
    """
    board.require_no_status()
    kind = stream_kinds(board)[0]
    for drop in DROPS:
        _, wires = frames_to_drop(board, drop, kind)
        board.status()  # margins begin anew
        board.link.send(*wires)
        due = len(wires) if drop.counter in _WITH_MARGIN else 0
        board.check_status(f"{len(wires)} frames {drop.summary}", margins=due)
        board.mute()


@case("HG-9.3/1-status", needs=m.Feature.CONFIG, evidence=SELF_REPORTED)
def every_status_restarts_margins(board: BoardClient) -> None:
    """the margins begin anew with STATUS as with STATUS_REPLY: of frames before it nothing is
    left
    """
    board.arm(status_period_ms=board.quick_status_ms)
    board.status()
    since = board.link.mark()
    board.link.stream(board.flat_phases(), board.clock.ahead_us(_AHEAD_US))
    timeout_us = 3000 * board.quick_status_ms
    board.due_event(m.Status, since, timeout_us)
    board.due_event(m.Status, board.link.mark(), timeout_us)
    # The frame may have come behind the first one; it is told of once.
    told = [status.margins for _, status in board.link.events(m.Status, since)]
    told.append(board.status().margins)
    check(sum(told) == 1, f"one frame was sent; the margins of STATUS tell of {told} frames")
