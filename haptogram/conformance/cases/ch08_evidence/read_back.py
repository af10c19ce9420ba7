"""HG-8.5, HG-8.6: the trace ring and the read-back of a drive, whole and every span of them."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from typing import Final

from haptogram_protocol import messages as m
from haptogram_protocol.framing import HEADER_BYTES, MAX_BODY_BYTES
from haptogram_protocol.rules import READ_BACKS

from ...case import Depth, case
from ...client import latching, playback, uploads
from ...client.board_client import BoardClient
from ...client.capabilities import drive_kinds, trace_modes
from ...client.stream_kinds import stream_kinds
from ...judge.events import played_keys
from ...judge.refused_requests import STORED
from ...judge.witness import expect_witnessed_drive, judge_nothing_read_back
from ...outcome import SELF_REPORTED, check, check_equal, check_fields
from ..ch05_stream.every_drop import output_states
from ..ch07_configuration.configuration import spans_of_elements

_RING_TRIED: Final = 6000  # latches: a longer ring is not filled
_FILLED_US: Final = 60_000_000  # nor one that takes longer
_SEQUENCE: Final = 7
_FRAMES: Final = 3
_LATCHES: Final = 402
_LAST: Final = 0xFFFFFFFF
_FIT: Final = (
    MAX_BODY_BYTES - HEADER_BYTES - m.TraceReply.LAYOUT.size
) // m.TraceRecord.LAYOUT.size
#: What happens between two trace modes.
_BETWEEN: Final = ("nothing", "a playback", "MUTE", "an upload", "DISARM")
_RING: Final = m.Feature.TRACE_RING | m.Feature.CONFIG
_PLAYED_RING: Final = _RING | m.Feature.SEQUENCE_PHASES
_CEILING: Final = 77
_AHEAD_US: Final = 2_000_000
_HOUR_US: Final = 3_600_000_000
_Bring = Callable[[BoardClient], object]


class _TraceRing:
    """The records that the trace ring has to hold of the latches of a session.

    Whether it keeps, over other trace modes between, what it held before is the board's own choice.
    """

    def __init__(self, board: BoardClient) -> None:
        self.board = board
        self.due: list[tuple[m.LatchKey, int]] = []  # key and CRC of each latch of the session
        self.stored: list[bytes] = []

    def store(self) -> None:
        """Store a sequence of random drives."""
        self.stored = playback.send_phases_to_store(self.board, _SEQUENCE, frames=_FRAMES)

    def latch(self, number: int = 1) -> None:
        """Latch so many random drives of the stream."""
        first = self.board.link.stream_next
        for place, codes in enumerate(latching.latch_random(self.board, number)):
            self.due.append((m.LatchKey(0, 0, first + place), latching.drive_crc(codes)))

    def play(self, loops: int = 1, least_us: int = 1000) -> None:
        """Play the stored sequence to its end."""
        period_us = playback.shortest_period_to_play_us(self.board, least_us)
        playback.play_out(self.board, _SEQUENCE, _FRAMES, loops=loops, period_us=period_us)
        crcs = itertools.cycle(map(latching.drive_crc, self.stored))
        self.due += zip(played_keys(_SEQUENCE, _FRAMES, loops), crcs, strict=False)

    def go_through(self, event: str) -> None:
        """Let something happen between two trace modes."""
        board = self.board
        if event == "MUTE":
            board.mute()
        elif event == "DISARM":
            board.disarm()
        elif event == "an upload":
            self.store()
        elif event == "a playback":
            self.play()
            board.stop()  # what plays no longer
        board.arm()

    def kept(self) -> list[int]:
        """Return the numbers of the last latches, as many as the ring keeps."""
        total = len(self.due)
        return list(range(max(0, total - self.board.identity.trace_ring), total))

    def judge(self, first: int, count: int, held: Sequence[int], name: str = "") -> None:
        """FAILED unless READ_TRACE shows those of the latches *held* by the ring that it names."""
        reply = latching.read_ring(self.board, first, count)
        name = f"{name}READ_TRACE of {count} from {first}"
        check_fields(reply, name, oldest=held[0], next=len(self.due))
        numbers = [number for number in held if first <= number < first + count][:_FIT]
        got = [(record.number, record.key, record.crc) for record in reply.records]
        due = [(number, *self.due[number]) for number in numbers]
        check_equal(got, due, f"{name}: (number, key, crc) of its records")

    def judge_holes(self, name: str, least: int) -> None:
        """FAILED unless each READ_TRACE shows what the ring holds: the latches from *least* on."""
        total = len(self.due)
        held = [record.number for record in latching.read_ring(self.board).records]
        is_due = held == sorted(set(held)) and held[least - total :] == list(range(least, total))
        text = f"{name}: the ring holds the latches {held}"
        check(is_due, f"{text}, due are {least} to {total - 1}, each once")
        spans = itertools.product(range(total + 2), (1, 2, total - least, total))
        for first, count in [(0, 0xFFFF), *spans]:
            self.judge(first, count, held, f"{name}: ")


@case("HG-8.5/1", needs=_RING, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def ring_keeps_the_last(board: BoardClient) -> None:
    """the ring keeps the last trace_ring latches, numbered from 0, and forgets the oldest"""
    size = board.identity.trace_ring
    check(size > 0, "TRACE_RING is advertised, trace_ring is 0")
    board.arm(trace_mode=m.TraceMode.RING)
    ring, loops = _TraceRing(board), size // _FRAMES + 3
    lasts_us = loops * _FRAMES * playback.shortest_period_to_play_us(board, 100)
    is_long = size > _RING_TRIED or lasts_us > _FILLED_US
    if is_long or not board.has(m.Feature.SEQUENCE_PHASES):
        ring.latch(20)
    else:
        ring.store()
        ring.play(loops, 100)
    ring.judge(0, 0xFFFF, ring.kept())


@case("HG-8.5/1-modes", needs=_RING, evidence=SELF_REPORTED)
def ring_counts_every_mode(board: BoardClient) -> None:
    """latches while trace_mode is another one have their numbers: the ring goes on behind them"""
    modes = trace_modes(board, *m.TraceMode)
    board.hello()
    total = 0
    for mode in [*modes, *reversed(modes)]:
        board.arm(trace_mode=mode)
        latching.latch_now(board, board.flat_phases(total))
        index = latching.latch_now(board, board.flat_phases(total + 1))
        total += 2
        reply = latching.read_ring(board)
        check_fields(reply, f"{mode.name}: TRACE_REPLY", next=total)
        if mode is m.TraceMode.RING:
            last = [(record.number, record.key.index) for record in reply.records[-2:]]
            due = [(total - 2, index - 1), (total - 1, index)]
            check_equal(last, due, "(number, index) of the last records")


# --- Spans -------------------------------------------------------------------------------------


@case("HG-8.5/2", needs=_RING, evidence=SELF_REPORTED)
def trace_ring_is_read(board: BoardClient) -> None:
    """READ_TRACE of some, none and all records shows numbers, keys and CRCs, oldest first"""
    board.arm(trace_mode=m.TraceMode.RING)
    ring = _TraceRing(board)
    ring.latch(9)
    for first, count in ((0, 9), (2, 3), (8, 100), (9, 5), (0, 0), (4, 1)):
        ring.judge(first, count, range(9))


@case("HG-8.5/2-spans", needs=_PLAYED_RING, evidence=SELF_REPORTED)
def every_ring_span(board: BoardClient) -> None:
    """READ_TRACE of spans at every edge of a ring that has turned over: those, as many as fit"""
    size, ring = board.identity.trace_ring, _TraceRing(board)
    ring.store()
    board.arm(trace_mode=m.TraceMode.RING)
    ring.latch()
    turns_over = board.thorough and size < _RING_TRIED
    ring.play(-(-(max(_LATCHES, size + 7) if turns_over else _LATCHES) // _FRAMES), 200)
    held, total = ring.kept(), len(ring.due)
    edges = {0, 1, held[0] - 1, held[0], held[0] + 1, (held[0] + total) // 2}
    edges |= {total - 1, total, total + 1, 0x7FFFFFFF, 0x80000000, _LAST - 1, _LAST}
    for first in sorted(edge for edge in edges if edge >= 0):
        for count in (0, 1, 2, _FIT - 1, _FIT, _FIT + 1, 300, 0xFFFF):
            ring.judge(first, count, held)


@case("HG-8.5/2-holes", needs=_PLAYED_RING, evidence=SELF_REPORTED)
def every_span_with_holes(board: BoardClient) -> None:
    """READ_TRACE before, in, over and behind latches of other modes, MUTE, DISARM, playback,
    upload
    """
    others = trace_modes(board, m.TraceMode.OFF, m.TraceMode.CRC, m.TraceMode.DRIVE)
    for turn in range(len(_BETWEEN) if board.thorough else 1):
        board.hello()
        ring, name = _TraceRing(board), "RING"
        ring.store()
        board.arm(trace_mode=m.TraceMode.RING)
        ring.latch(2)
        for number, mode in enumerate(others):
            event = _BETWEEN[(turn + number) % len(_BETWEEN)]
            board.configure(trace_mode=mode)
            ring.latch()
            ring.go_through(event)
            least = len(ring.due)
            board.configure(trace_mode=m.TraceMode.RING)
            ring.latch()
            if number % 2 == 0:
                ring.go_through(_BETWEEN[turn - number])
                ring.latch()
            name += f", {mode.name} with {event}, RING"
            ring.judge_holes(name, least)


@case("HG-8.6/1", evidence=SELF_REPORTED)
def reads_back_a_span(board: BoardClient) -> None:
    """READ_DRIVE of one, some and too many transducers shows those from first on"""
    board.need_any(READ_BACKS)
    registers = board.random_registers()
    due = latching.full_client_drive(registers)
    judge_spans(board, drive_kinds(board)[0], board.phases(registers), due)


@case("HG-8.6/1-spans", needs=m.Feature.READ_LATCHED, evidence=SELF_REPORTED)
def every_span_of_drive_and_geometry(board: BoardClient) -> None:
    """READ_DRIVE of spans at and around every edge shows the codes that the whole shows"""
    frame = stream_kinds(board)[-1].make()  # with amplitudes that differ, where it can
    for kind in drive_kinds(board):
        judge_spans(board, kind, frame)


def judge_spans(
    board: BoardClient, kind: m.DriveKind, frame: m.Message, due: bytes | None = None
) -> None:
    """FAILED unless READ_DRIVE shows of every span what the whole shows, and of that *due*."""
    latched_us, total = -_HOUR_US, board.identity.transducers
    for first, count in spans_of_elements(total):
        if board.wire.now_us() - latched_us > 250 * board.config.hold_ms:
            board.arm_anew()
            latched_us = board.wire.now_us()
            latching.latch_now(board, frame)
            whole = latching.read_back(board, kind)
            same = due in (None, whole.phases + whole.amplitudes)
            check(same, f"READ_DRIVE({kind.name}) shows other codes than were sent")
        reply = latching.read_drive(board, kind, first, count)
        end = min(first + count, total)
        codes = whole.phases[first:end] + whole.amplitudes[first:end]
        text = f"READ_DRIVE({kind.name}) of {count} from {first}"
        check_fields(reply, text, first=first, data=codes, key=whole.reply.key)


@case("HG-8.6/2")
def reads_back_no_more(board: BoardClient) -> None:
    """READ_DRIVE from N on is refused with NOT_FOUND, detail N"""
    board.need_any(READ_BACKS)
    count = board.identity.transducers
    for kind in drive_kinds(board):
        for first in (count, 0xFFFF):
            board.link.refused(m.ReadDrive(kind, first, 1), m.ErrorCode.NOT_FOUND, count)


@case("HG-8.6/3", needs=m.Feature.READ_LATCHED, evidence=SELF_REPORTED)
def reads_back_one_latch(board: BoardClient) -> None:
    """codes, key and time of a read-back belong to one latch, as in trace and STATUS"""
    mode = latching.ask_for_board_latches_if_supported(board, m.Feature.TRACE)
    board.arm()
    for _ in range(8):
        index, since = board.link.stream_next, board.link.mark()
        (registers,) = latching.latch_random(board, 1)
        shown = latching.read_back(board)
        expect_witnessed_drive(board, shown, registers, b"\xff" * len(registers))
        last = {"key": m.LatchKey(0, 0, index), "t_latch_us": board.status().last_latch_us}
        check_fields(shown.reply, "DRIVE_REPLY", **last)
        if mode is not m.TraceMode.OFF:
            seen = latching.latches_received_from_board(board, since, mode)[-1:]
            check_equal([latch.crc for latch in seen], [shown.crc], "CRC-32 in trace and read-back")


# --- Before the first latch --------------------------------------------------------------------


@case("HG-8.6/4", needs=m.Feature.READ_LATCHED, evidence=SELF_REPORTED)
def reads_back_nothing_first(board: BoardClient) -> None:
    """before the first latch of a session codes, key and time are 0"""
    board.arm()
    latching.latch_random(board, 1)
    board.hello()
    judge_nothing_read_back(board, m.DriveKind.LATCHED, "behind the session before")


def _wait_with_a_frame(board: BoardClient) -> None:
    """Arm the board and queue a frame that is due in 2 s."""
    board.arm()
    board.link.stream(board.phases(board.random_registers()), board.clock.ahead_us(_AHEAD_US))


def _wait_with_a_playback(board: BoardClient) -> None:
    """Arm the board and schedule a playback that starts in 2 s."""
    board.arm()
    playback.play_later(board, STORED, _AHEAD_US, loops=1, unattended_ms=2000)


def _states_without_a_latch(board: BoardClient) -> Iterator[tuple[str, _Bring]]:
    """Yield the states of a board before its first latch, in succession: name, function."""
    yield "as the session begins", BoardClient.status
    yield "a frame dropped while DISARMED", lambda board: board.link.stream(board.flat_phases(9))
    yield "ARMED", BoardClient.arm
    yield "with a frame that waits", _wait_with_a_frame
    yield "MUTED", lambda board: board.mute()
    if board.has(m.Feature.CORRECTION):
        yield "with another correction", uploads.upload_correction
    if board.has(m.Feature.SEQUENCE_PHASES):
        yield "with a playback that waits", _wait_with_a_playback
    yield "DISARMED", BoardClient.disarm


@case("HG-8.6/4-kinds", evidence=SELF_REPORTED)
def every_empty_read_back(board: BoardClient) -> None:
    """before a session's first latch both kinds show 0, armed, muted, waiting, under a
    correction
    """
    board.need_any(READ_BACKS)
    if board.has(m.Feature.CONFIG | m.Feature.AMPLITUDE):
        board.configure(amplitude_ceiling=_CEILING)
    if board.has(m.Feature.CORRECTION):
        uploads.upload_correction(board)
    for before, leave in output_states(board):
        board.arm()
        leave(board)
        board.hello()
        for name, bring in _states_without_a_latch(board):
            bring(board)
            for kind in drive_kinds(board):
                judge_nothing_read_back(board, kind, f"behind {before}, {name}")
