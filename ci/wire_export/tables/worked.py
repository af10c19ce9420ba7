"""The frames and the exchange of chapter 13 of SPEC.md: examples, byte for byte."""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from haptogram_protocol import messages as m
from haptogram_protocol.framing import encode_frame
from haptogram_protocol.state import OutputState

# --- Frames ------------------------------------------------------------------------------------

_SESSION: Final = 0x5EED

# Title, message, header fields.  The arrays are small so that the bytes can be read.
WORKED_FRAMES: Final[Mapping[str, tuple[m.Message, dict[str, int]]]] = {
    "HELLO, nonce 0x5EED": (
        m.Hello(m.VERSION_MAJOR, m.VERSION_MINOR, _SESSION),
        {"seq": 0, "session": 0},
    ),
    "ARM, the request after it": (m.Arm(), {"seq": 1}),
    "MUTE without a session": (m.Mute(), {"seq": 7, "session": 0}),
    "PHASES, N = 4: 0, 64, 128, 192, t_apply 0xFFFFFF00, first of the session": (
        m.Phases(bytes([0, 64, 128, 192])),
        {"seq": m.FIRST_STREAM_SEQ, "time_us": 0xFFFFFF00},
    ),
    "DRIVES, N = 2: phases 10, 20, amplitudes 255, 128": (
        m.Drives(bytes([10, 20, 255, 128])),
        {"seq": 0xFFF3, "time_us": 1000},
    ),
    "POINTS, one: (-10, 0, 150) mm, full amplitude, phase a quarter of a turn": (
        m.Points((m.FocalPoint(-10_000, 0, 150_000, 65535, 16384),)),
        {"seq": 0, "time_us": 2000},
    ),
    "PHASES, N = 256, every phase 1: a run of more than 254 bytes without a zero": (
        m.Phases(bytes([1]) * 256),
        {"seq": 0x0101, "time_us": 0x01010101},
    ),
    "PLAY of sequence 3, 1000 µs a frame, twice, unattended 5000 ms": (
        m.Play(3, 1000, 2, 5000),
        {"seq": 2, "time_us": 0x00100000},
    ),
    "PONG": (m.Pong(0x1122334455667788, 500, 620), {"seq": 3, "time_us": 620}),
    "ERROR: ARM refused in FAULT (3)": (
        m.Error(m.MessageType.ARM, m.ErrorCode.BAD_STATE, 3),
        {"seq": 4, "time_us": 700},
    ),
    "TRACE of stream frame 65520, late": (
        m.Trace(65520, 0xDEADBEEF),
        {"flags": m.Flag.LATE, "seq": 0, "time_us": 0x0000000F},
    ),
}


def worked_spec_frame(title: str) -> tuple[bytes, bytes]:
    """Return body and wire bytes of one of :data:`WORKED_FRAMES`."""
    message, header = WORKED_FRAMES[title]
    fields = {"flags": 0, "time_us": 0, "session": _SESSION} | header
    body = m.build_body(message, **fields)
    return body, encode_frame(body)


# --- Exchange ----------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class WorkedStep:
    """A frame of the worked exchange.

    Attributes
    ----------
    t_us : int
        Microseconds since the board started: arrival of a frame of the host, first byte of a frame
        of the board.
    words : str
        Description of the frame.
    message : Message
        The frame.
    header : dict
        Fields of its header: ``seq`` ..., as for ``build_body``.
    """

    t_us: int
    words: str
    message: m.Message
    header: Mapping[str, int]

    @property
    def from_host(self) -> bool:
        """True if the host sends the frame."""
        return self.message.TYPE < m.MessageType.HELLO_REPLY

    @property
    def body(self) -> bytes:
        """Header and payload."""
        return m.build_body(self.message, **{"flags": 0, "time_us": 0} | dict(self.header))


_BOOT_US: Final = 2**32 - 10_000_000  # HG-6.9
_PITCH_UM: Final = 10_000
_PHASES: Final = bytes([0, 64, 128, 192])
_ELEMENTS: Final = tuple(
    m.Element(x, y, 0, 0, 0, 32767)
    for x in (-_PITCH_UM // 2, _PITCH_UM // 2)
    for y in (-_PITCH_UM // 2, _PITCH_UM // 2)
)
_DEFAULT: Final = m.Config()
_TRACED: Final = m.Config(status_period_ms=0, trace_mode=m.TraceMode.CRC)


def _worked_config_crc(config: m.Config) -> int:
    return zlib.crc32(config.pack() + bytes(len(_ELEMENTS)))  # HG-7.1/5


_IDENTITY: Final = m.HelloReply(
    major=m.VERSION_MAJOR,
    minor=m.VERSION_MINOR,
    nonce=_SESSION,
    reserved=0,
    features=int(m.Feature.AMPLITUDE | m.Feature.CONFIG | m.Feature.TRACE),
    clock_hz=1_000_000,
    clock_ppm=50,
    carrier_hz=40_000,
    transducers=len(_ELEMENTS),
    grid_nx=2,
    grid_ny=2,
    pitch_um=_PITCH_UM,
    geometry_hash=zlib.crc32(b"".join(element.pack() for element in _ELEMENTS)),
    sound_speed_mm_s=_DEFAULT.sound_speed_mm_s,
    max_points=0,
    state=OutputState.DISARMED,
    queue_depth=32,
    trace_ring=0,
    max_horizon_us=10_000_000,
    rx_window=8192,
    max_frame_rate_hz=1000,
    max_sequence_frames=0,
    max_upload_bytes=0,
    max_playback_rate_hz=0,
    max_unattended_ms=0,
    upload_window=0,
    max_chunk=0,
    latch_lead_us=0,
    point_time_us=0,
    boot_id=1,
    config_crc=_worked_config_crc(_DEFAULT),
    firmware="example 1",
)


def _worked_wire_us(t_us: int) -> int:
    """Return a time since the start as it stands on the wire."""
    return (_BOOT_US + t_us) & 0xFFFFFFFF


def _worked_host_step(
    t_us: int, words: str, message: m.Message, seq: int, session: int = _SESSION, time_us: int = 0
) -> WorkedStep:
    return WorkedStep(t_us, words, message, {"seq": seq, "session": session, "time_us": time_us})


def _worked_board_step(t_us: int, words: str, message: m.Message, seq: int) -> WorkedStep:
    header = {"seq": seq, "session": _SESSION, "time_us": _worked_wire_us(t_us)}
    return WorkedStep(t_us, words, message, header)


#: From HELLO to the first latch and MUTE: a board of 2 x 2 transducers that has just started.
EXCHANGE: Final[tuple[WorkedStep, ...]] = (
    _worked_host_step(
        1004,
        "HELLO: the host's first request, seq 0, no session yet",
        m.Hello(m.VERSION_MAJOR, m.VERSION_MINOR, _SESSION),
        seq=0,
        session=0,
    ),
    _worked_board_step(
        1004,
        "HELLO_REPLY: seq of the request, session open, DISARMED",
        _IDENTITY,
        seq=0,
    ),
    _worked_host_step(
        2004, "SET_CONFIG: TRACE for every latch, no STATUS by itself", m.SetConfig(_TRACED), seq=1
    ),
    _worked_board_step(
        2004,
        "SET_CONFIG_REPLY: what is in force",
        m.SetConfigReply(_worked_config_crc(_TRACED), _TRACED),
        seq=1,
    ),
    _worked_host_step(3004, "PING: what time is it", m.Ping(7), seq=2),
    _worked_board_step(
        3004, "PONG", m.Pong(7, _worked_wire_us(3004), _worked_wire_us(3004)), seq=2
    ),
    _worked_host_step(4004, "ARM", m.Arm(), seq=3),
    _worked_board_step(
        4004,
        "ARM_REPLY: ARMED, and silent until the first latch",
        m.ArmReply(OutputState.ARMED),
        seq=3,
    ),
    _worked_host_step(
        5004,
        "PHASES: the first stream frame, seq 0xFFF0, t_apply 10 ms after the start; no answer",
        m.Phases(_PHASES),
        seq=m.FIRST_STREAM_SEQ,
        time_us=_worked_wire_us(10_000),
    ),
    _worked_board_step(
        10_004,
        "TRACE: the first event, seq 0; latched at the next multiple of 25 µs of the clock",
        m.Trace(m.FIRST_STREAM_SEQ, zlib.crc32(_PHASES + b"\xff" * len(_PHASES))),
        seq=0,
    ),
    _worked_host_step(12_004, "MUTE", m.Mute(), seq=4),
    _worked_board_step(12_004, "MUTE_REPLY: MUTED", m.MuteReply(OutputState.MUTED), seq=4),
)
