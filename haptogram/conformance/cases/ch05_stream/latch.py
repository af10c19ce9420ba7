"""HG-5.8, HG-5.9: when a frame is latched, and as a whole."""

from __future__ import annotations

import zlib
from typing import Final

from haptogram_protocol.messages import DriveKind, DriveReply, Feature, ReadDrive, TraceMode

from ...case import Depth, case
from ...client.board_client import BoardClient
from ...client.latching import (
    ask_for_board_latches_if_supported,
    client_drive_of_reply,
    full_client_drive,
    latch_now,
    latches_received_from_board,
    queue_frames,
)
from ...client.stream_kinds import stream_kinds
from ...judge.witness import JudgeWitness
from ...outcome import SELF_REPORTED, check, check_equal, fail
from .every_burst import replace_in_period

_OFFSETS_US: Final = (0, 1, 7, 12, 24, 25, 26, 49, 1000)
_BURST: Final = 48
_READS: Final = 12


@case("HG-5.8/1", evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def latches_on_carrier_boundaries(board: BoardClient) -> None:
    """frames for 0 to 49 µs past a carrier period are latched on the next one, none before"""
    for offset_us in _OFFSETS_US:
        board.arm_anew()
        t_us = board.clock.soon_us(bytes(400), ahead_us=offset_us)
        before = board.status().counters.latched
        board.link.stream(board.flat_phases(), t_us)
        early = board.status()
        if (
            board.clock.unwrap(early.last_latch_us) < t_us
            and board.clock.device_estimate_us() < t_us - 500
        ):
            check_equal(early.counters.latched, before, "a frame is latched before its t_apply")
        due_us = board.clock.on_carrier(t_us)
        board.clock.wait_until(due_us + 100)
        got_us = board.last_latch_us()
        check(
            got_us == due_us,
            f"t_apply {t_us} µs: latched at {got_us} µs, due is {due_us} µs "
            f"({got_us - due_us:+d} µs)",
        )


@case("HG-5.8/1-immediate", evidence=SELF_REPORTED)
def latches_immediate_frames_on_the_carrier(board: BoardClient) -> None:
    """frames latched as soon as complete lie on multiples of the carrier period"""
    board.arm()
    for _ in range(12):
        latch_now(board)
        t_us = board.last_latch_us()
        off_us = t_us % board.clock.carrier_us
        check_equal(off_us, 0, f"latched at {t_us} µs, {off_us} µs past a carrier period")


@case("HG-5.8/2", needs=Feature.READ_LATCHED, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def latches_all_elements_at_once(board: BoardClient) -> None:
    """two drives that alternate on every carrier period are never mixed in a read-back or a
    trace
    """
    count = board.identity.transducers
    mode = ask_for_board_latches_if_supported(board, Feature.TRACE)
    drives = (bytes([0x08]) * count, bytes([0xF0]) * count)
    since = board.link.mark()
    board.arm()
    for _ in range(3):
        _check_burst(board, drives)
    if mode is not TraceMode.OFF:
        known = {zlib.crc32(full_client_drive(drive)) for drive in drives}
        mixed = [
            latch
            for latch in latches_received_from_board(board, since, mode)
            if latch.crc not in known
        ]
        check(not mixed, f"a traced drive is neither of the two: {mixed[:1]}")


def _check_burst(board: BoardClient, drives: tuple[bytes, bytes]) -> None:
    """Read back again and again while every carrier period brings another drive."""
    rate = max(1, board.identity.max_frame_rate_hz)
    step_us = board.clock.on_carrier(-(-1_000_000 // rate))
    number = min(_BURST, board.identity.queue_depth)
    message = [board.phases(drive) for drive in drives]
    start_us = board.clock.soon_us(bytes(number * len(board.link.stream_wire(message[0], seq=0))))
    board.link.send(
        *(board.link.stream_wire(message[n % 2], start_us + n * step_us) for n in range(number))
    )
    board.clock.end_exchange()
    board.wire.idle(max(0, start_us - board.clock.device_estimate_us()))
    since = board.link.mark()
    reads = [
        board.link.request_wire(ReadDrive(DriveKind.LATCHED, 0, len(drives[0])))
        for _ in range(_READS)
    ]
    board.link.send(*(wire for wire, _ in reads))
    board.link.answer_to(ReadDrive.TYPE, reads[0][1], since)
    for _, seq in reads:
        answer = board.link.try_answer(seq, since)
        if answer is None:
            continue  # it found no room on the uplink: HG-9.6/1
        shown = client_drive_of_reply(board.link.reply_in(answer, DriveReply, ReadDrive.TYPE))
        if len(set(shown.phases)) > 1:
            share = shown.phases.count(drives[0][0]), shown.phases.count(drives[1][0])
            fail(f"non-atomic latch: one read-back shows two drives mixed, {share} transducers")
    board.clock.wait_until(start_us + number * step_us)


@case("HG-5.8/3", evidence=SELF_REPORTED)
def latches_once_a_period(board: BoardClient) -> None:
    """of two frames for the same carrier period the later is latched, the other flushed"""
    replace_in_period(board, [2 * (stream_kinds(board)[0],)], TraceMode.OFF)
    with board.counting(latched=1):
        latch_now(board)


@case("HG-5.8/4", evidence=SELF_REPORTED)
def counts_latches(board: BoardClient) -> None:
    """25 frames add 25 to latched"""
    board.arm()
    with board.counting(latched=25):
        for _ in range(25):
            latch_now(board)


@case("HG-5.8/5", evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def holds_the_last_latched_drive(board: BoardClient) -> None:
    """each of 8 drives stays in the registers until the next is latched"""
    witness = JudgeWitness.of(board)
    board.arm()
    before = board.random_registers()
    latch_now(board, board.phases(before))
    for _ in range(8):
        registers = board.random_registers()
        ahead_us = 10_000 + board.wire.limits.lead_us
        t_us = board.clock.soon_us(bytes(1000), ahead_us=ahead_us)
        since = board.link.mark()
        board.link.stream(board.phases(registers), t_us)
        if witness.mode is None:
            witness.expect(before)
        board.clock.wait_until(t_us + 100)
        witness.expect(registers, since=since)
        before = registers
    board.wire.idle(200_000)
    if witness.mode is None:
        witness.expect(before)


@case("HG-5.9/1", evidence=SELF_REPORTED)
def immediate_frames_flush_the_queue(board: BoardClient) -> None:
    """IMMEDIATE flushes 3 queued frames and is latched at once"""
    board.arm()
    t_us = board.clock.soon_us(board.bytes_of_frames(4), ahead_us=50_000)
    board.require_hold(t_us + 5000 - board.clock.device_us(), "a slow line")
    with board.counting(flushed=3, latched=1):
        queue_frames(board, t_us, 3)
        index = latch_now(board)
        got = board.status()
        check_equal(
            (got.last_seq, got.queued),
            (index, 0),
            f"frame {index} as soon as complete: last_seq {got.last_seq}, queued {got.queued}",
        )
        board.clock.wait_until(t_us + 5000)
