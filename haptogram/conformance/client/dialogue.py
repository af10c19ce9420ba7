"""A conversation in which a board says all that it can, for cases about what it sends."""

from __future__ import annotations

from typing import Final

from haptogram_protocol.framing import CRC_BYTES, HEADER_BYTES
from haptogram_protocol.messages import (
    Arm,
    Disarm,
    DriveKind,
    Feature,
    GetConfig,
    GetGeometry,
    GetStatus,
    Mute,
    Ping,
    Play,
    ReadDrive,
    ReadTrace,
    Stop,
    TraceMode,
    UploadKind,
)

from .board_client import Bench
from .latching import latch_now
from .wire import Received

_UNKNOWN_REQUEST: Final = 0x7F
_SEQUENCE: Final = 7
_FRAMES: Final = 4
_PERIOD_US: Final = 1000
_UNATTENDED_MS: Final = 1000
_TRACES: Final = (
    (Feature.TRACE, TraceMode.CRC),
    (Feature.TRACE_DRIVE, TraceMode.DRIVE),
    (Feature.TRACE_RING, TraceMode.RING),
)


def talk(bench: Bench) -> list[Received]:
    """Return every piece that the board sent in a conversation about everything."""
    bench.hello()
    since = bench.mark()
    bench.hello(bench.session)
    _ask_for_everything(bench)
    bench.ask(Arm())
    for feature, mode in _TRACES:
        if bench.has(feature | Feature.CONFIG):
            bench.configure(trace_mode=mode, status_period_ms=bench.quick_status_ms)
            _stream_some(bench)
    if bench.has(Feature.SEQUENCE_PHASES):
        _play_some(bench)
    _be_refused(bench)
    _run_out_of_time(bench)
    bench.ask(Disarm())
    bench.ask(Mute())
    return bench.wire.received[since:]


def _ask_for_everything(bench: Bench) -> None:
    bench.ask(Ping(0x0102030405060708))
    bench.ask(GetStatus())
    bench.ask(GetConfig())
    bench.ask(GetGeometry(0, 0xFFFF))


def _stream_some(bench: Bench) -> None:
    if not bench.has_phases:
        return
    # No zero in the registers, nor in the amplitudes: the longest runs that COBS has to cut.
    latch_now(bench, bench.flat_phases(0x88))
    latch_now(bench, bench.phases(bench.random_registers()))
    if bench.has(Feature.READ_LATCHED):
        bench.ask(ReadDrive(DriveKind.LATCHED, 0, 0xFFFF))
    if bench.has(Feature.READ_RADIATED):
        bench.ask(ReadDrive(DriveKind.RADIATED, 0, 0xFFFF))
    if bench.has(Feature.TRACE_RING):
        bench.ask(ReadTrace(0, 0xFFFF))
    bench.wire.idle(1200 * bench.quick_status_ms)  # for a STATUS


def _play_some(bench: Bench) -> None:
    data = b"".join(bench.random_registers() for _ in range(_FRAMES))
    bench.upload(UploadKind.PHASES, _SEQUENCE, data)
    if bench.has(Feature.CONFIG | Feature.TRACE):
        bench.configure(trace_mode=TraceMode.CRC)
    bench.ask(Play(_SEQUENCE, _PERIOD_US, 1, _UNATTENDED_MS), flags=0x10)
    bench.wire.idle(2 * _FRAMES * _PERIOD_US)
    bench.ask(Stop())


def _be_refused(bench: Bench) -> None:
    bench.ask_raw(_UNKNOWN_REQUEST)
    bench.ask_raw(GetGeometry.TYPE, b"\x00")
    bench.ask(Ping(1), session=bench.session ^ 0x5555)


def _run_out_of_time(bench: Bench) -> None:
    """Let the hold mute the board, so that it says STATE_CHANGED."""
    if not bench.has(Feature.CONFIG):
        return
    bench.configure(hold_ms=20)
    bench.ask(Arm())
    if bench.has_phases:
        latch_now(bench, bench.flat_phases())
    bench.wire.idle(40_000)


def frames_in(pieces: list[Received]) -> list[Received]:
    """Return the pieces that are undamaged frames."""
    return [piece for piece in pieces if piece.header is not None]


def unstuffed_crc(piece: Received) -> tuple[int, bytes]:
    """Return the CRC-32 that a piece carries, and its body; (-1, b"") if it is too short."""
    data = piece.unstuffed
    if len(data) < HEADER_BYTES + CRC_BYTES:
        return -1, b""
    return int.from_bytes(data[-CRC_BYTES:], "little"), data[:-CRC_BYTES]
