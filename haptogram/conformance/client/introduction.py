"""First contact: which board answers at a port, or why none does."""

from __future__ import annotations

from typing import Final

from haptogram.machine.terminal import printable_on_terminal
from haptogram_protocol import messages as m

from .board_client import BoardClient

_RUNS: Final = (300, 4000)  # bytes: enough on a slow line, enough on a fast one
_TRIPS: Final = 5  # the shortest of so many is taken
_CLEAR_US: Final = 10_000  # a shorter delay may be the host's own
_CLEARLY_LESS: Final = 0.8


def introduce_to_board(board: BoardClient) -> m.HelloReply | m.Error | None:
    """Say HELLO to a board of unknown state; None if nothing answers."""
    link = board.link
    hello = board.hello_message(board.new_nonce())
    wire, seq = link.request_wire(hello, seq=link.next_seq(), session=0)
    since = link.mark()
    link.send(wire)
    link.knock(wire, seq, since)
    answer = link.await_answer(seq, since)
    if answer is None or not isinstance(answer.message, m.HelloReply | m.Error):
        return None
    if isinstance(answer.message, m.HelloReply):
        board.adopt(answer.message)
    return answer.message


def is_introduced_version_error(reply: m.HelloReply | m.Error | None) -> bool:
    """Return True if a board refused HELLO because it speaks another major version."""
    return isinstance(reply, m.Error) and reply.code == m.ErrorCode.VERSION


def board_rate_at_introduction(board: BoardClient) -> int:
    """Return the rate of the line: the stated one, or the measured one if that is clearly less.

    A run of bytes in front of a PING delays its answer by the time of the run on the line.
    """
    stated = board.wire.baudrate
    for size in _RUNS:
        took_us = min(_introduction_answered_after_us(board, size) for _ in range(_TRIPS))
        took_us -= min(_introduction_answered_after_us(board, 0) for _ in range(_TRIPS))
        if took_us > _CLEAR_US:
            rate = size * 10_000_000 // took_us
            return rate if rate < _CLEARLY_LESS * stated else stated
    return stated


def _introduction_answered_after_us(board: BoardClient, size: int) -> int:
    """Return the time from sending *size* bytes of noise and a PING to the reply of the PING."""
    ping, seq = board.link.request_wire(m.Ping(0))
    since, sent_us = board.link.mark(), board.wire.now_us()
    board.link.send(b"\x00" + b"\x01" * size + b"\x00", ping)
    board.link.answer_to(m.Ping.TYPE, seq, since)
    return board.wire.now_us() - sent_us


def learn_clock_wraps_at_introduction(board: BoardClient) -> None:
    """Find out how often the clock of a board that runs already has wrapped.

    Latches lie on multiples of the carrier period of the unwrapped clock, so that the low 32 bits
    of the time of one latch give the number of wraps.
    """
    clock = board.clock
    if clock.booted:
        return
    board.link.ask(m.Arm())
    board.link.send(board.link.stream_wire(board.flat_phases()))
    answer = board.link.ask(m.GetStatus()).message
    board.link.ask(m.Disarm())
    if isinstance(answer, m.StatusReply) and answer.last_seq:
        wraps = range(clock.carrier_us)
        fits = (k for k in wraps if (answer.last_latch_us + (k << 32)) % clock.carrier_us == 0)
        clock.set_device_us(answer.last_latch_us + (next(fits, 0) << 32))


def explain_silent_board(board: BoardClient) -> str:
    """Return why HELLO was not answered, judged by the bytes that came instead."""
    wire = board.wire
    if not wire.heard:
        return (
            "the port is silent: nothing came back to HELLO; the board hangs at its start, needs "
            "longer for it (boot timeout), or its line has another rate (baud)"
        )
    if not any(piece.header is not None for piece in wire.received):
        return f"{wire.heard} bytes came, but no frame: not a board, or another line rate"
    if not any(piece.is_response or piece.is_event for piece in wire.received):
        return "the port sends back what is written to it; no board answers"
    return "frames came, but no answer to HELLO"


def describe_introduced_board(reply: m.HelloReply) -> dict[str, object]:
    """Return firmware, version, size and capabilities of a board, for reports."""
    known = m.Feature(reply.features & sum(m.Feature))
    return {
        "firmware": printable_on_terminal(reply.firmware),
        "protocol": f"{reply.major}.{reply.minor}",
        "boot_id": f"{reply.boot_id:#010x}",
        "transducers": reply.transducers,
        "carrier_hz": reply.carrier_hz,
        "features": [str(feature.name) for feature in known],
    }
