"""Configuration, geometry, trace, read-back, status.  SPEC.md chapters 7 to 9."""

from __future__ import annotations

import zlib

from haptogram_protocol import messages as m
from haptogram_protocol.state import MuteReason, OutputState

from .script import COUNT, PITCH_UM, SIDE, Script, phases
from .vector import SESSION

_T = m.MessageType
_E = m.ErrorCode
_FULL = b"\xff" * COUNT


def scripts() -> list[Script]:
    """Return every dialogue of this part."""
    return [
        _config(),
        _config_bounds(),
        _geometry(),
        _nothing_latched(),
        _read_part(),
        _trace_off(),
        _trace_drive(),
        _trace_ring(),
        _status_by_itself(),
        _event_numbers(),
        _ping(),
    ]


def _config() -> Script:
    s = Script("config", "HG-7.1/3 HG-7.1/5", "config", "what is set is in force and comes back")
    s.configure(hold_ms=1, ramp_ms=0, host_timeout_ms=20, sound_speed_mm_s=300_000)
    s.configure(
        hold_ms=10_000,
        ramp_ms=2000,
        host_timeout_ms=10_000,
        late_window_us=100_000,
        sound_speed_mm_s=380_000,
        amplitude_ceiling=0,
        trace_divider=0xFFFF,
    )
    s.request(m.GetConfig())
    s.answer(m.ConfigReply(zlib.crc32(s.config.pack() + bytes(COUNT)), s.config))
    return s


def _config_bounds() -> Script:
    s = Script(
        "config-bounds",
        "HG-7.1/1",
        "config limits",
        "each value outside its bounds, and nothing changes",
    )
    wrong: tuple[tuple[str, int], ...] = (
        ("hold_ms", 0),
        ("hold_ms", 10_001),
        ("ramp_ms", 2001),
        ("host_timeout_ms", 19),
        ("host_timeout_ms", 10_001),
        ("status_period_ms", 1),
        ("status_period_ms", 9),
        ("late_window_us", 100_001),
        ("sound_speed_mm_s", 299_999),
        ("sound_speed_mm_s", 380_001),
        ("trace_divider", 0),
    )
    for name, value in wrong:
        s.request(m.SetConfig(s.with_changes({name: value})))
        s.refusal(_T.SET_CONFIG, _E.BAD_VALUE, m.Config.WIRE[name].offset)
    s.request(m.GetConfig())
    s.answer(m.ConfigReply(zlib.crc32(s.config.pack() + bytes(COUNT)), s.config))
    return s


def _elements() -> tuple[m.Element, ...]:
    half = PITCH_UM * (SIDE - 1) // 2
    return tuple(
        m.Element(ix * PITCH_UM - half, iy * PITCH_UM - half, 0, 0, 0, 32767)
        for ix in range(SIDE)
        for iy in range(SIDE)
    )


def _geometry() -> Script:
    s = Script(
        "geometry", "HG-7.5/1 HG-7.5/2 HG-4.3/6", "geometry", "element n = ix ny + iy, in pieces"
    )
    every = _elements()
    for first, count, shown in (
        (0, 0xFFFF, every),
        (1, 2, every[1:3]),
        (3, 9, every[3:]),
        (2, 0, ()),
    ):
        s.request(m.GetGeometry(first, count))
        s.answer(m.GeometryReply(COUNT, first, shown))
    for first in (COUNT, 0xFFFF):
        s.request(m.GetGeometry(first, 1))
        s.refusal(_T.GET_GEOMETRY, _E.NOT_FOUND, COUNT)
    s.hello(0x0505)
    return s


def _nothing_latched() -> Script:
    s = Script(
        "nothing-latched", "HG-8.6/4 HG-9.1/2", "read-back", "before the first latch all is 0"
    )
    for kind in m.DriveKind:
        s.request(m.ReadDrive(kind, 0, COUNT))
        key = m.LatchKey(0, 0, 0)
        s.answer(m.DriveReply(kind, 8, key, 0, 0, bytes(2 * COUNT)))
    s.status(last_seq=0, last_latch_us=0)
    s.arm()
    s.stream(phases(1, 2, 3, 4))
    s.hello(0x0606)
    s.drive(bytes(COUNT), bytes(COUNT))
    return s


def _read_part() -> Script:
    s = Script("read-part", "HG-8.6/1 HG-8.6/2 HG-8.6/3", "read-back", "a part of the drive")
    s.arm()
    index = s.stream(phases(1, 2, 3, 4))
    key, latched_us = m.LatchKey(0, 0, index), s.wire_us()
    for first, count, codes in ((1, 2, b"\2\3"), (3, 1000, b"\4"), (0, 0, b"")):
        s.request(m.ReadDrive(m.DriveKind.LATCHED, first, count))
        data = codes + b"\xff" * len(codes)
        s.answer(m.DriveReply(m.DriveKind.LATCHED, 8, key, latched_us, first, data))
    s.request(m.ReadDrive(m.DriveKind.LATCHED, COUNT, 1))
    s.refusal(_T.READ_DRIVE, _E.NOT_FOUND, COUNT)
    return s


def _trace_off() -> Script:
    s = Script("trace-off", "HG-8.1/1", "trace", "no trace unless it was asked for")
    s.arm()
    s.stream(phases(1, 2, 3, 4))
    s.wait(50)
    s.counts(latched=1, trace_dropped=0)
    return s


def _trace_drive() -> Script:
    s = Script(
        "trace-drive", "HG-8.4/1", "trace", "every second drive in full, nothing of the others"
    )
    s.configure(trace_mode=m.TraceMode.DRIVE, trace_divider=2)
    s.arm()
    for step in range(4):
        s.wait(1)
        index = s.stream(phases(step, 0, 0, 0))
        if step % 2 == 0:
            data = bytes([step, 0, 0, 0]) + _FULL
            s.event(m.TraceDrive(m.LatchKey(0, 0, index), 8, data))
    return s


def _trace_ring() -> Script:
    s = Script(
        "trace-ring", "HG-8.5/1 HG-8.5/2", "trace", "latches kept in the ring, read afterwards"
    )
    s.configure(trace_mode=m.TraceMode.RING)
    s.arm()
    records = []
    for step in range(5):
        s.wait(1)
        index = s.stream(phases(step, 0, 0, 0))
        crc = zlib.crc32(bytes([step, 0, 0, 0]) + _FULL)
        records.append(m.TraceRecord(step, m.LatchKey(0, 0, index), s.wire_us(), crc, 0))
    for first, count in ((0, 100), (2, 2), (4, 5), (5, 5), (0, 0), (0xFFFFFFFF, 0xFFFF)):
        s.request(m.ReadTrace(first, count))
        s.answer(m.TraceReply(0, 5, tuple(records[first : first + count])))
    s.hello(0x0707)
    s.request(m.ReadTrace(0, 100))
    s.answer(m.TraceReply(0, 0, ()))
    return s


def _status_by_itself() -> Script:
    s = Script("status-event", "HG-9.1/1", "status", "STATUS every status_period_ms")
    s.configure(status_period_ms=50)
    for _ in range(3):
        s.wait(50)
        s.look()
        fields = {"state": OutputState.DISARMED, "reason": MuteReason.NEVER_ARMED, "queued": 0}
        s.event_with(_T.STATUS, fields)
    return s


def _event_numbers() -> Script:
    s = Script(
        "event-numbers", "HG-3.6/2 HG-3.6/4 HG-4.6/4", "sequence", "events count apart, from 0 on"
    )
    for session in (SESSION, 0x0808):
        if session != SESSION:
            s.hello(session)
        s.configure(trace_mode=m.TraceMode.CRC)
        s.arm()
        for step in range(3):
            s.wait(1)
            index = s.stream(phases(step, 1, 1, 1))
            s.event(m.Trace(index, zlib.crc32(bytes([step, 1, 1, 1]) + _FULL)))
    return s


def _ping() -> Script:
    s = Script("ping", "HG-6.9/2 HG-4.11/1 HG-4.11/2", "clock", "PONG tells the time of arrival")
    for echo in (0, 1, 2**64 - 1, 0x0102030405060708):
        s.t_us += 12_345
        s.request(m.Ping(echo))
        s.answer(m.Pong(echo, s.wire_us(), s.wire_us()))
    s.t_us = 10_000_005
    s.request(m.Ping(5))
    s.answer(m.Pong(5, 5, 5), time_us=5)
    return s
