"""HG-3.6: sequence numbers and times that wrap, and unwrapped numbers across each power of two."""

from __future__ import annotations

from typing import Final

from haptogram_protocol import messages as m
from haptogram_protocol.annotation.frames import annotated_frame_text

from ...case import Depth, case
from ...client import latching, playback
from ...client.board_client import BoardClient
from ...client.dialogue import full_client_dialogue
from ...judge.events import judge_event_numbers
from ...outcome import SELF_REPORTED, check, check_equal, require
from ..ch05_stream.queue import judge_gaps

_ACROSS: Final = 40  # frames from 0xFFF0 on: the wrap is the 17th
_PLAYED_TRACE: Final = m.Feature.TRACE | m.Feature.SEQUENCE_PHASES | m.Feature.CONFIG
_EVENTS: Final = 66_000
_LONGEST_US: Final = 3_600_000_000  # of a playback that tells so many
_PART: Final = 8_000  # events between two readings
_TRACE_BYTES: Final = 34  # of TRACE_PLAYBACK on the line
_SEQUENCE: Final = 2
_JUMP: Final = 0x7FFF  # the farthest that a number is ahead (HG-5.5/2)
_BATCH: Final = 400  # frames between two readings
_WRAP: Final = 1 << 32
_GAPS: Final = (1, 254, 255, 299, 19_999, 29_999, 31_999, 0x7FFF, 65_503)


@case("HG-3.6/1", evidence=SELF_REPORTED)
def stream_sequence_numbers_wrap(board: BoardClient) -> None:
    """40 stream frames across 0xFFFF are latched: no gap, no duplicate"""
    board.arm()
    with board.counting(latched=_ACROSS):
        latching.latch_random(board, _ACROSS)


@case("HG-3.6/1-requests")
def request_sequence_numbers_wrap(board: BoardClient) -> None:
    """requests across 0xFFFF are answered; old ones are refused"""
    board.link.seq = 0xFFFC
    board.hello()
    for _ in range(8):
        board.link.ping(board.link.seq)


@case(
    "HG-3.6/1-time",
    needs_reset=True,
    before_wrap_us=600_000,
    evidence=SELF_REPORTED,
    depth=Depth.DEFAULT,
)
def header_times_wrap(board: BoardClient) -> None:
    """frames for times on both sides of 2^32 µs are latched, each at its time"""
    board.prepare()
    board.configure(hold_ms=10_000)
    number = min(6, board.identity.queue_depth)  # 4 at least, on both sides of the wrap
    sent_us = board.wire.line_us(len(board.bytes_of_frames(number)))
    board.clock.wait_until(_WRAP - 4 * board.wire.limits.lead_us - 200_000 - sent_us)
    board.arm()
    start_us = board.clock.on_carrier(_WRAP - 20_000)
    times = [board.clock.on_carrier(start_us + 10_000 * place) for place in range(number)]
    board.clock.require_horizon(times[-1] - board.clock.device_estimate_us())
    with board.counting(latched=len(times)):
        board.link.send(*(board.link.stream_wire(board.flat_phases(), t_us) for t_us in times))
        board.clock.wait_until(times[-1] + 1000)
        board.check_status("across 2^32 µs", last_latch_us=times[-1] & 0xFFFFFFFF)


@case("HG-3.6/2")
def numbers_three_header_sequences(board: BoardClient) -> None:
    """events count up by 1; requests in between make no gap in the stream"""
    judge_event_numbers(board, full_client_dialogue(board))
    board.hello()
    with board.counting(dropped_state=8):
        for number in range(8):
            board.link.stream(board.flat_phases())
            board.link.ping(number)


@case("HG-3.6/2-wrap", needs=_PLAYED_TRACE, depth=Depth.DEFAULT, wall_depth=Depth.FULL)
def event_sequence_numbers_wrap(board: BoardClient) -> None:
    """66 000 events of a session: their numbers, and the loops that they tell, go on across 65
    535
    """
    traced_us = board.wire.period_us(2 * _TRACE_BYTES)
    period_us = board.clock.on_carrier(playback.shortest_period_to_play_us(board, traced_us))
    is_long = board.wire.is_virtual and period_us < traced_us + board.clock.carrier_us
    require(not is_long, "a simulated line takes long for so many events")
    text = f"{_EVENTS} frames of playback, one every {period_us} µs, take too long"
    require(_EVENTS * period_us <= _LONGEST_US, text)
    playback.send_phases_to_store(board, _SEQUENCE, frames=1)
    board.hello()
    board.arm(trace_mode=m.TraceMode.CRC)
    alone_ms = min(10_000, board.identity.max_unattended_ms)
    part_us = min(_PART * period_us, alone_ms * 500)
    last, count = -1, 0
    playback.play_now(board, _SEQUENCE, loops=0, period_us=period_us, unattended_ms=alone_ms)
    while count < _EVENTS:
        since = board.link.mark()
        board.wire.idle(part_us)
        board.link.barrier()
        for header, event in board.link.events(m.TracePlayback, since):
            count += 1
            loop = event.key.loop
            text = f"behind event {last & 0xFFFF} comes event {header.seq}, of loop {loop}"
            check(last < 0 or header.seq == (last + 1) & 0xFFFF, text)
            check(loop >= last, text)  # traces that were dropped had loops, not numbers
            last = last + 1 if last >= 0 else header.seq
        board.wire.forget_received()


@case("HG-3.6/3", evidence=SELF_REPORTED)
def first_number_of_stream(board: BoardClient) -> None:
    """a first stream frame 0xFFF0 is no gap, 0xFFF3 is a gap of 3"""
    with board.counting(dropped_state=1):
        board.link.stream(board.flat_phases())
    board.hello()
    with board.counting(dropped_state=1, gap=3):
        board.link.stream(board.flat_phases(), seq=m.FIRST_STREAM_SEQ + 3)


@case("HG-3.6/4", needs=m.Feature.CONFIG)
def first_number_of_events(board: BoardClient) -> None:
    """the first event of each of 3 sessions has the number 0"""
    period_ms = board.quick_status_ms
    board.configure(status_period_ms=period_ms)
    for _ in range(3):
        since = board.link.mark()
        board.hello()
        board.due_event(m.Status, since, 3000 * period_ms)
        events = (piece for piece in board.wire.received[since:] if piece.is_event)
        first = next(e for e in events if e.frame_header.session == board.link.session)
        text = f"first event of the session: {annotated_frame_text(first.piece)}"
        check_equal(first.frame_header.seq, 0, text)


@case("HG-3.6/5", evidence=SELF_REPORTED)
def sequence_numbers_are_unwrapped(board: BoardClient) -> None:
    """after gaps of up to 65 503 and several wraps STATUS reports the unwrapped number"""
    judge_gaps(board, (0, *_GAPS))


def _advance_to_number(board: BoardClient, number: int) -> None:
    """Send empty frames, numbered in steps of up to 32767, until *number* is the next one."""
    link = board.link
    while link.stream_next < number:
        wires: list[bytes] = []
        while link.stream_next < number and len(wires) < _BATCH:
            link.stream_next = min(link.stream_next + _JUMP, number - 1)
            wires.append(link.stream_raw(m.Phases.TYPE, b""))
        link.send(*wires)


def _wrong_latch_numbers(
    board: BoardClient, since: int, mode: m.TraceMode, index: int
) -> dict[str, int]:
    """Return each report, by name, that has another number of the last latch than *index* mod 2^32.

    Reports are STATUS, read-back and, unless *mode* is OFF, the trace from received frame *since*
    on (-1: it shows no latch).  Empty: all are right.
    """
    told = {"last_seq": board.status().last_seq}
    if board.has(m.Feature.READ_LATCHED):
        told["DRIVE_REPLY"] = latching.read_drive(board, m.DriveKind.LATCHED, 0, 1).key.index
    if mode is not m.TraceMode.OFF:
        latches = latching.latches_received_from_board(board, since, mode)
        told[f"trace {mode.name}"] = latches[-1].index if latches else -1
    return {name: number for name, number in told.items() if number != index % _WRAP}


def _judge_numbers_across(board: BoardClient, least_bits: int, most_bits: int) -> None:
    """FAILED unless STATUS, read-back and trace report frame numbers across 2^n unwrapped.

    n is *least_bits* to *most_bits*; the gap counter has to count the numbers left out.
    """
    mode = latching.ask_for_board_latches_if_supported(board)
    board.arm()
    latching.latch_now(board)
    first, before, sent = board.link.stream_next, board.status().counters, 0
    for bits in range(least_bits, most_bits + 1):
        _advance_to_number(board, (1 << bits) - 1)
        board.arm_anew()  # or a hold that nothing extends may end before the next latch
        for index in range((1 << bits) - 1, (1 << bits) + 2):
            since = board.link.mark()
            latching.latch_now(board)
            wrong = _wrong_latch_numbers(board, since, mode, index)
            check(not wrong, f"the unwrapped number is {index % _WRAP}, told is {wrong}")
        board.wire.forget_received()
        sent += 3
    counted = board.counted_since(before)
    used = counted["bad_length"] + sent
    due = (board.link.stream_next - first - used) % _WRAP
    check_equal(counted["gap"], due, "frames that gap counts")


@case("HG-3.6/5-widths", evidence=SELF_REPORTED)
def every_24_bit_number(board: BoardClient) -> None:
    """numbers around 2^16 to 2^24, behind jumps of 32767: told whole"""
    _judge_numbers_across(board, 16, 24)


@case("HG-3.6/5-wrap", evidence=SELF_REPORTED, depth=Depth.FULL)
def every_32_bit_number(board: BoardClient) -> None:
    """numbers around 2^25 to 2^32, behind jumps of 32767: told whole"""
    _judge_numbers_across(board, 25, 32)
