"""Drives sent to be latched, and the latches that the board reports: read-back, trace, ring."""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final

from haptogram_protocol import messages as m
from haptogram_protocol.rules import TRACE_CAPABILITIES

from ..outcome import check_equal, check_fields, unimplemented
from .board_client import BoardClient
from .capabilities import TRACES, trace_modes
from .playback import play_out
from .stream_kinds import points_of_stream_kind

FULL: Final = 255
_PING_BYTES: Final = 60  # size of a PING and its answer on the line
_FRAME_BYTES: Final = 20  # size of a frame on the line, without its payload


@dataclass(frozen=True, slots=True)
class ClientDrive:
    """A drive in a read-back: codes latched in the registers, or codes radiated.

    Attributes
    ----------
    phases, amplitudes : bytes
        One code per transducer.
    reply : DriveReply
        The read-back.
    """

    phases: bytes
    amplitudes: bytes
    reply: m.DriveReply

    @property
    def loudest(self) -> int:
        """The largest amplitude code."""
        return max(self.amplitudes, default=0)

    @property
    def crc(self) -> int:
        """CRC-32 of the drive, as in a trace."""
        return zlib.crc32(self.phases + self.amplitudes)


def client_drive_of_reply(reply: m.DriveReply) -> ClientDrive:
    """Return the drive in a read-back of all transducers."""
    half = len(reply.data) // 2
    return ClientDrive(reply.data[:half], reply.data[half:], reply)


def read_drive(
    board: BoardClient, kind: m.DriveKind, first: int = 0, count: int = 0xFFFF
) -> m.DriveReply:
    """Ask for the drive of *count* transducers."""
    return board.link.call(m.ReadDrive(kind, first, count), m.DriveReply)


def read_back(board: BoardClient, kind: m.DriveKind = m.DriveKind.LATCHED) -> ClientDrive:
    """Ask for the drive of all transducers; UNIMPLEMENTED without the capability."""
    latched = kind is m.DriveKind.LATCHED
    board.need(m.Feature.READ_LATCHED if latched else m.Feature.READ_RADIATED)
    count = board.identity.transducers
    shown = client_drive_of_reply(read_drive(board, kind, 0, count))
    check_equal(
        len(shown.phases),
        count,
        f"DRIVE_REPLY shows {len(shown.phases)} transducers; asked for were {count}",
    )
    return shown


def read_back_radiated(board: BoardClient) -> ClientDrive:
    """Ask for the radiated drive of all transducers."""
    return read_back(board, m.DriveKind.RADIATED)


def check_silent(board: BoardClient, text: str) -> None:
    """FAILED if a read-back shows that a transducer is driven; without one nothing is known."""
    if board.has(m.Feature.READ_RADIATED):
        check_fields(read_back_radiated(board), f"{text}: the radiated drive", loudest=0)


def latch_now(board: BoardClient, message: m.Message | None = None) -> int:
    """Send a stream frame that is latched as soon as complete; return its unwrapped number.

    None: a drive of equal phases.
    """
    index, message = board.link.stream_next, message or board.flat_phases()
    board.link.stream(message)
    board.clock.wait_latched(points_of_stream_kind(message))
    return index


def latch_timed(board: BoardClient, message: m.Message | None = None) -> int:
    """Latch a frame as soon as complete, see :func:`latch_now`; return the time of the latch."""
    latch_now(board, message)
    return board.last_latch_us()


def latch_random(board: BoardClient, number: int) -> list[bytes]:
    """Latch *number* random drives, each as soon as complete, and return their registers."""
    drives = [board.random_registers() for _ in range(number)]
    for registers in drives:
        latch_now(board, board.phases(registers))
    return drives


def latch_in_time(board: BoardClient, message: m.Message, ahead_us: int = 0) -> int:
    """Latch a stream frame *ahead_us* after a carrier boundary; return its time."""
    size = 2 * len(board.link.stream_wire(message, 0, seq=0)) + _PING_BYTES
    t_us = board.clock.soon_us(bytes(size), ahead_us=ahead_us)
    board.link.stream(message, t_us)
    board.clock.wait_until(t_us + 2 * board.clock.carrier_us)
    return t_us


def time_for_frames(board: BoardClient, messages: Sequence[m.Message], ahead_us: int = 0) -> int:
    """Return *ahead_us* after a carrier boundary by which all *messages* are certain to be ready.

    NOT-OBSERVED if that time is beyond the horizon.
    """
    size = sum(len(message.serialize()) + _FRAME_BYTES for message in messages)
    points = sum(map(points_of_stream_kind, messages))
    return board.clock.soon_us(bytes(size), points=points, ahead_us=ahead_us)


def queue_frames(board: BoardClient, t_us: int, number: int) -> None:
    """Send *number* frames of equal phases for *t_us* and every millisecond after it."""
    for place in range(number):
        board.link.stream(board.flat_phases(), t_us + 1000 * place)


def send_between_pings(
    board: BoardClient, message: m.Message, at_us: int | None = None
) -> list[int]:
    """Send a stream frame between two PINGs; return the device times around its arrival."""
    wires = [board.link.request_wire(m.Ping(n)) for n in range(2)]
    frame = board.link.stream_wire(message, at_us)
    since = board.link.mark()
    board.link.send(wires[0][0], frame, wires[1][0])
    times = []
    for _, seq in wires:
        answer = board.link.answer_to(m.Ping.TYPE, seq, since)
        times.append(board.clock.unwrap(board.link.reply_in(answer, m.Pong, m.Ping.TYPE).t_rx_us))
    return times


def send_to_arrive_at(board: BoardClient, t_us: int, wires: bytes) -> None:
    """Send bytes that arrive at a device time, as far as the host's clock tells it."""
    start_us = t_us - board.wire.line_us(len(wires))
    board.wire.idle(max(0, start_us - board.clock.device_estimate_us()))
    board.link.send(wires)
    board.clock.forget_exchange()


def drive_crc(registers: bytes) -> int:
    """Return the CRC-32 of a drive at full amplitude, as a trace tells it."""
    return zlib.crc32(full_client_drive(registers))


def streamed_crcs(board: BoardClient, frames: Iterable[m.Message]) -> list[int]:
    """Latch frames of the stream, each as soon as complete; return the CRC-32 that TRACE tells."""
    since = board.link.mark()
    for frame in frames:
        latch_now(board, frame)
    return [latch.crc for latch in latches_received_from_board(board, since, m.TraceMode.CRC)]


def played_crcs(
    board: BoardClient,
    sequence: int,
    frames: int,
    mode: m.TraceMode = m.TraceMode.CRC,
    period_us: int | None = None,
) -> list[int]:
    """Play a stored sequence to its end; return the CRC-32 of each latch that is traced."""
    since = board.arm()
    play_out(board, sequence, frames, period_us=period_us)
    return [latch.crc for latch in latches_received_from_board(board, since, mode)]


def full_client_drive(registers: bytes) -> bytes:
    """Return N phase codes and N amplitude codes of a drive at full amplitude."""
    return registers + bytes([FULL]) * len(registers)


def read_ring(board: BoardClient, first: int = 0, count: int = 0xFFFF) -> m.TraceReply:
    """Ask for *count* records of the trace ring."""
    return board.link.call(m.ReadTrace(first, count), m.TraceReply)


@dataclass(frozen=True, slots=True)
class ClientLatch:
    """One latch in a trace."""

    index: int
    t_us: int
    crc: int
    late: bool
    sequence: int = 0
    loop: int = 0

    @property
    def key(self) -> m.LatchKey:
        """The key of the latch, as a read-back or the ring shows it."""
        return m.LatchKey(self.sequence, self.loop, self.index)


def ask_for_board_latches(board: BoardClient, traces: m.Feature = TRACES) -> m.TraceMode:
    """Switch on one of *traces*, of every latch; UNIMPLEMENTED if the board has none of them."""
    mode = ask_for_board_latches_if_supported(board, traces)
    if mode is m.TraceMode.OFF:
        unimplemented("the board advertises no trace that can be switched on")
    return mode


def ask_for_board_latches_if_supported(
    board: BoardClient, traces: m.Feature = TRACES
) -> m.TraceMode:
    """Switch on one of *traces*, of every latch, and return its mode; OFF: the board has none."""
    asked = (m.TraceMode.CRC, m.TraceMode.RING, m.TraceMode.DRIVE)
    modes = trace_modes(board, *asked) if board.has(m.Feature.CONFIG) else []
    mode = next((one for one in modes if TRACE_CAPABILITIES[one] & traces), m.TraceMode.OFF)
    if mode is not m.TraceMode.OFF:
        board.configure(trace_mode=mode)
    return mode


def latches_received_from_board(
    board: BoardClient, since: int, mode: m.TraceMode
) -> list[ClientLatch]:
    """Return the latches in the events from piece *since* on, or in the trace ring."""
    board.link.barrier()
    if mode is m.TraceMode.RING:
        return _latches_received_from_ring(board)
    found = []
    for piece in board.wire.received[since:]:
        if piece.header is not None and piece.message is not None:
            latched = _latch_received_in_trace(board, piece.header, piece.message)
            found += [latched] if latched else []
    return found


def _latch_received_in_trace(
    board: BoardClient, header: m.Header, message: m.Message
) -> ClientLatch | None:
    """Return the latch that a trace event reports; None for other messages."""
    t_us, late = board.clock.unwrap(header.time_us), bool(header.flags & m.Flag.LATE)
    if isinstance(message, m.Trace):
        return ClientLatch(message.index, t_us, message.crc, late)
    if isinstance(message, m.TracePlayback):
        key = message.key
        return ClientLatch(key.index, t_us, message.crc, late, key.sequence, key.loop)
    if isinstance(message, m.TraceDrive):
        key, crc = message.key, zlib.crc32(message.data)
        return ClientLatch(key.index, t_us, crc, late, key.sequence, key.loop)
    return None


def _latches_received_from_ring(board: BoardClient) -> list[ClientLatch]:
    """Return all latches in the trace ring, where the board keeps the last ones; oldest first."""
    found: list[ClientLatch] = []
    first = 0
    while True:
        reply = read_ring(board, first)
        for item in reply.records:
            t_us, late = board.clock.unwrap(item.t_latch_us), bool(item.flags & m.Flag.LATE)
            key = item.key
            found.append(ClientLatch(key.index, t_us, item.crc, late, key.sequence, key.loop))
        if not reply.records or reply.records[-1].number + 1 >= reply.next:
            return found
        first = reply.records[-1].number + 1
