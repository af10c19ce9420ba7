"""HG-5.7: frames from a carrier period early to beyond the late window, by the microsecond.

The board names the margin of every frame; what becomes of the frame has to follow from it.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from haptogram_protocol.messages import Feature, Message, TraceMode

from ...case import Depth, case
from ...client.board_client import BoardClient
from ...client.capabilities import TRACE_MODES
from ...client.latching import ClientLatch, latches_received_from_board
from ...client.stream_kinds import points_of_stream_kind, stream_kinds
from ...outcome import SELF_REPORTED, check, check_equal, require

_WINDOWS_US: Final = (0, 1, 30, 5_000, 100_000)
_WALL_WINDOWS_US: Final = (5_000, 100_000)  # where no frame arrives to the microsecond
_AIMS: Final = 3  # frames sent for one margin, each with the error of the one before


def _margins_around_lateness_us(board: BoardClient, window_us: int) -> list[int]:
    """Return the margins at and beside every border: in time, a carrier period, the late window.

    At a wall clock, where no frame arrives to the microsecond, those at the borders.
    """
    carrier_us = board.clock.carrier_us
    steps = board.sample((0, -1, 1))
    borders = (0, carrier_us, -carrier_us, -window_us)
    return sorted({border + step for border in borders for step in steps})


def _settings_of_late_window(board: BoardClient) -> Iterator[tuple[int, TraceMode]]:
    """Yield late windows and trace modes: every window, and every mode in turn."""
    modes = [mode for feature, mode in TRACE_MODES if board.has(feature)] or [TraceMode.OFF]
    windows_us = _WINDOWS_US if board.wire.is_virtual else _WALL_WINDOWS_US
    for number, window_us in enumerate(windows_us):
        yield window_us, modes[number % len(modes)]


@case("HG-5.7/6-borders", needs=Feature.CONFIG, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def lateness_has_its_borders(board: BoardClient) -> None:
    """margins 1 µs around 0, a carrier period, the late window: in time, late and LATE, or
    dropped
    """
    delays_us: dict[str, int] = {}  # from the PING before a frame to the frame, by kind
    late = 0
    for window_us, mode in _settings_of_late_window(board):
        board.hello()
        board.arm(late_window_us=window_us, trace_mode=mode)
        for kind in stream_kinds(board):
            message = kind.make()  # one for all: another may be longer on the line
            points = points_of_stream_kind(message)
            if not board.clock.can_be_in_time(points):
                continue  # no such frame is ever in time
            for due_us in _margins_around_lateness_us(board, window_us):
                for _ in board.sample(range(_AIMS)):
                    got_us = _judge_lateness(board, kind.name, message, due_us, delays_us)
                    late += -window_us <= got_us < 0
                    if got_us == due_us:
                        break
    require(late > 0, "the host hit no late window with any frame")


def _judge_lateness(
    board: BoardClient, kind: str, message: Message, due_us: int, delays_us: dict[str, int]
) -> int:
    """Send a frame for a margin of *due_us*; FAILED unless it fares as the margin it had demands.

    Returns
    -------
    int
        The margin that it had.
    """
    window_us, mode = board.config.late_window_us, board.config.trace_mode
    points = points_of_stream_kind(message)
    board.clock.wait_latched()
    before, since = board.status().counters, board.link.mark()
    delay_us = delays_us.get(kind, board.wire.limits.lead_us // 8)
    t_us = board.clock.ready_us(board.clock.device_us(), points) + delay_us + due_us
    index = board.link.stream_next
    wire = board.link.stream_wire(message, t_us)
    board.link.send(wire)
    board.clock.wait_latched()
    board.clock.wait_until(t_us + board.clock.lead_us + 2 * board.clock.carrier_us)
    after = board.status()
    got_us = after.margin_min_us
    delays_us[kind] = delay_us + due_us - got_us
    ready_us = board.clock.ready_us(0, points)
    name = f"{kind}, margin {got_us} µs, ready {ready_us} µs after it came, window {window_us} µs"
    told = (after.margins, after.margin_mean_us)
    check_equal(told, (1, got_us), f"{name}: margins {told[0]}, margin_mean_us {told[1]}")
    dropped, is_late = got_us < -window_us, -window_us <= got_us < 0
    names = ("accepted", "latched", "late", "dropped_late")
    counted = [(getattr(after.counters, n) - getattr(before, n)) & 0xFFFFFFFF for n in names]
    due = [int(not dropped), int(not dropped), int(is_late), int(dropped)]
    check(counted == due, f"{name}: {', '.join(names)} count {counted}, due is {due}")
    if mode is not TraceMode.OFF:
        traced = [t for t in latches_received_from_board(board, since, mode) if t.index == index]
        _check_late_flag(traced, name, dropped=dropped, late=is_late)
    return got_us


def _check_late_flag(traced: list[ClientLatch], name: str, *, dropped: bool, late: bool) -> None:
    flags = [latch.late for latch in traced]
    check_equal(flags, [] if dropped else [late], f"{name}: the trace has LATE {flags}")
