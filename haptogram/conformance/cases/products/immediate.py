"""HG-5.7, HG-5.9: late frames and IMMEDIATE, at every format."""

from __future__ import annotations

from typing import Final

from haptogram_protocol.messages import Feature, Flag, TraceMode

from ...case import case
from ...client.board_client import BoardClient
from ...client.latching import board_latches
from ...client.stream_kinds import stream_kinds
from ...outcome import SELF_REPORTED, check

_WINDOW_US: Final = 100_000
_WAITING: Final = 3
_TRACES: Final = (
    (Feature.TRACE, TraceMode.CRC),
    (Feature.TRACE_DRIVE, TraceMode.DRIVE),
    (Feature.TRACE_RING, TraceMode.RING),
)


@case(
    "HG-5.9/1",
    "IMMEDIATE frames of every message and format flush the queue, whatever their time_us",
    variant="types",
    evidence=SELF_REPORTED,
)
def every_type_at_once(board: BoardClient) -> None:
    good = board.flat_phases()
    for kind in stream_kinds(board):
        board.hello()
        board.arm()
        t_us = board.clock.soon_us(bytes(4000)) + 1_000_000
        for number in range(_WAITING):
            board.link.send(board.link.stream_wire(good, t_us + 1000 * number))
        for past_us in (0, 1, 2**30, -(2**30)):
            waiting = board.status().queued
            with board.counting(flushed=waiting, latched=1):
                board.link.send(
                    board.link.stream_wire(kind.make(), t_us - past_us, flags=Flag.IMMEDIATE)
                )
                board.clock.wait_latched(4000)
        check(board.status().queued == 0, f"{kind.name}: frames wait behind IMMEDIATE")


@case(
    "HG-5.7/6",
    "late frames of every message and format, in every trace: LATE, and only of these",
    variant="types",
    needs=Feature.CONFIG,
    evidence=SELF_REPORTED,
)
def every_type_late(board: BoardClient) -> None:
    modes = [mode for feature, mode in _TRACES if board.has(feature)] or [TraceMode.OFF]
    modes = modes if board.thorough else modes[:1]
    for mode in modes:
        board.configure(late_window_us=_WINDOW_US, trace_mode=mode)
        for kind in stream_kinds(board):
            board.arm()
            since, first = board.link.mark(), board.link.stream_next
            with board.counting(late=1, latched=3):
                for late_us in (None, _WINDOW_US // 2, None):
                    at_us = None if late_us is None else board.clock.device_us() - late_us
                    board.link.send(board.link.stream_wire(kind.make(), at_us))
                    board.clock.wait_latched(4000)
            if mode is TraceMode.OFF:
                continue
            seen = [
                latch.late for latch in board_latches(board, since, mode) if latch.index >= first
            ]
            check(
                seen[-3:] == [False, True, False],
                f"{kind.name}, trace {mode.name}: a frame at once, a late one, one at once: "
                f"LATE is {seen}",
            )


@case(
    "HG-5.7/5",
    "windows of 20, 66 and 100 ms: frames within are latched, frames at 1.5 times are dropped",
    variant="windows",
    needs=Feature.CONFIG,
    evidence=SELF_REPORTED,
)
def every_window(board: BoardClient) -> None:
    for window_us in (20_000, 66_000, _WINDOW_US):
        board.configure(late_window_us=window_us)
        board.arm()
        for share in (0.4, 1.5):
            before = board.status().counters
            t_us = board.clock.device_us() - round(share * window_us)
            board.link.send(board.link.stream_wire(board.flat_phases(), t_us))
            board.clock.wait_latched(4000)
            found = board.status()
            counted = {
                name: (getattr(found.counters, name) - getattr(before, name)) & 0xFFFFFFFF
                for name in ("latched", "late", "dropped_late")
            }
            late_us = -found.margin_min_us  # as it arrived: the host may have been held up
            within = late_us <= window_us
            due = {"latched": within, "late": within, "dropped_late": not within}
            check(
                counted == due,
                f"window {window_us} us, a frame {late_us} us late: counted {counted}",
            )
