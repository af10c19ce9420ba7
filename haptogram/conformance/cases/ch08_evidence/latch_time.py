"""HG-8.3: the time of a latch is when the transducers took the drive, in every report."""

from __future__ import annotations

from typing import Final

from haptogram_protocol.messages import (
    DriveKind,
    DriveReply,
    Feature,
    Ping,
    Pong,
    ReadDrive,
    ReadTrace,
    TraceMode,
    TraceReply,
)

from ...case import Depth, case
from ...client.board_client import BoardClient
from ...client.latching import latch_now, latches_received_from_board, read_back
from ...outcome import SELF_REPORTED, check, check_equal

_OFFSETS_US: Final = (0, 3, 24)
_MOMENTS_US: Final = (-40, 0, 10, 30, 60, 100, 150, 250, 400)  # around the latch that is due


def _latch_at_time_of_trace(board: BoardClient, offset_us: int) -> int:
    """Latch a frame at its time; return its unwrapped number."""
    index = board.link.stream_next
    t_us = board.clock.soon_us(bytes(400), ahead_us=offset_us)
    board.link.stream(board.flat_phases(), t_us)
    board.clock.wait_until(board.clock.on_carrier(t_us) + 200)
    return index


@case("HG-8.3/3", needs=Feature.CONFIG, evidence=SELF_REPORTED)
def evidence_names_one_latch_time(board: BoardClient) -> None:
    """the time of a latch in TRACE or the ring, in a read-back and in STATUS is the same"""
    modes = ((Feature.TRACE, TraceMode.CRC), (Feature.TRACE_RING, TraceMode.RING))
    for _, mode in (pair for pair in modes if board.has(pair[0])):
        for offset_us in _OFFSETS_US:
            board.hello()
            board.configure(trace_mode=mode)
            board.arm()
            since = board.link.mark()
            index = _latch_at_time_of_trace(board, offset_us)
            times = {"STATUS": board.clock.unwrap(board.status().last_latch_us)}
            if board.has(Feature.READ_LATCHED):
                shown = read_back(board).reply
                check(shown.key.index == index, f"read back is {shown.key.index}, not {index}")
                times["DRIVE_REPLY"] = board.clock.unwrap(shown.t_latch_us)
            (latch,) = latches_received_from_board(board, since, mode)
            times[mode.name] = latch.t_us
            check_equal(len(set(times.values())), 1, f"one latch at different times: {times}")


@case("HG-8.3/3-before", needs=Feature.CONFIG | Feature.TRACE_RING, evidence=SELF_REPORTED)
def evidence_shows_no_latch_before_its_time(board: BoardClient) -> None:
    """while a frame waits for its time, neither STATUS nor trace nor read-back knows of its
    latch
    """
    board.configure(trace_mode=TraceMode.RING)
    board.arm()
    latch_now(board)
    before = board.status()
    t_us = board.clock.soon_us(bytes(2000), ahead_us=50_000)
    board.link.stream(board.flat_phases(), t_us)
    waiting = board.status()
    ring = board.link.call(ReadTrace(0, 0xFFFF), TraceReply)
    board.clock.end_exchange()
    for name in ("last_seq", "last_latch_us"):
        got, due = getattr(waiting, name), getattr(before, name)
        check(got == due, f"{name} is {got} before the latch, was {due}")
    check_equal(
        waiting.counters.latched, before.counters.latched, "latched counts a frame that waits"
    )
    check_equal(ring.next, 1, f"the ring says that latch {ring.next} is next, before latch 1")
    if board.has(Feature.READ_LATCHED):
        shown = read_back(board).reply
        check_equal(
            shown.key.index, before.last_seq, "a read-back shows the drive of a frame that waits"
        )
    board.clock.wait_until(t_us + 200)


@case(
    "HG-8.3/1-measured",
    needs=Feature.TRACE | Feature.READ_LATCHED | Feature.CONFIG,
    evidence=SELF_REPORTED,
    depth=Depth.DEFAULT,
)
def drives_are_there_at_their_latch_time(board: BoardClient) -> None:
    """read-backs right behind the time that the trace tells of a latch show its drive"""
    board.configure(trace_mode=TraceMode.CRC)
    board.arm()
    latch_now(board)
    size = len(board.link.request_wire(Ping(0))[0])
    for moment_us in _MOMENTS_US:
        index, since = board.link.stream_next, board.link.mark()
        t_us = board.clock.soon_us(bytes(1000), ahead_us=2000)
        board.link.stream(board.flat_phases(), t_us)
        board.clock.end_exchange()
        ping, first = board.link.request_wire(Ping(moment_us & 0xFFFF))
        read, seq = board.link.request_wire(
            ReadDrive(DriveKind.LATCHED, 0, board.identity.transducers)
        )
        sent_us = board.clock.device_estimate_us() + board.wire.period_us(2 * size)
        wait_us = t_us + moment_us - sent_us
        board.wire.idle(max(0, wait_us))
        board.link.send(ping, read)
        pong = board.link.reply_in(board.link.answer_to(Ping.TYPE, first, since), Pong, Ping.TYPE)
        answer = board.link.answer_to(ReadDrive.TYPE, seq, since)
        shown = board.link.reply_in(answer, DriveReply, ReadDrive.TYPE)
        board.clock.wait_until(t_us + 500)
        latches = latches_received_from_board(board, since, TraceMode.CRC)
        (latch,) = (latch for latch in latches if latch.index == index)
        asked_us = board.clock.unwrap(pong.t_rx_us)
        check(
            asked_us < latch.t_us or shown.key.index == index,
            f"frame {index} was latched at {latch.t_us} µs, says the trace; a read-back asked for "
            f"{asked_us - latch.t_us} µs later shows frame {shown.key.index}",
        )
