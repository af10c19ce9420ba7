"""Stream frames, their queue and their latch.  SPEC.md chapter 5."""

from __future__ import annotations

import zlib

from haptogram_protocol import messages as m

from .script import COUNT, Script, phases

_EIGHT = m.PhaseFormat.BITS_8
_FULL = b"\xff" * COUNT
# For a point on the axis all four transducers are r = sqrt(5^2 + 5^2 + 105^2) mm away, which is
# 12.2655 of the wavelength of 8.58 mm: -12.2655 turns are 188.04 steps of 256, far from rounding.
AXIAL_CODE = 188


def scripts() -> list[Script]:
    """Return every dialogue of this part."""
    return [
        _immediate(),
        _at_a_time(),
        _formats(),
        _drives(),
        _point(),
        _points_limits(),
        _gaps(),
        _number_wraps(),
        _time_wraps(),
        _late(),
        _late_window(),
        _order(),
        _same_period(),
        _full_queue(),
        _horizon(),
        _flushed(),
        _not_armed(),
        _sizes(),
    ]


def _traced(name: str, clauses: str, flags: str, comment: str) -> Script:
    """Begin a dialogue on an armed board that reports every latch by its CRC."""
    s = Script(name, clauses, flags, comment)
    s.configure(trace_mode=m.TraceMode.CRC, host_timeout_ms=10_000, hold_ms=10_000)
    s.arm()
    return s


def _trace(index: int, codes: bytes, amplitudes: bytes = _FULL) -> m.Trace:
    return m.Trace(index, zlib.crc32(codes + amplitudes))


def _immediate() -> Script:
    s = _traced(
        "immediate",
        "HG-5.9/1 HG-5.8/1 HG-8.3/1 HG-8.3/2 HG-3.6/5",
        "latch",
        "a frame without a time is latched on the carrier period of its arrival, or the next",
    )
    index = s.stream(phases(1, 2, 3, 4))  # at 1000 us after power-up, a boundary
    s.event(_trace(index, bytes([1, 2, 3, 4])), time_us=s.boundary_us())
    s.t_us += 7
    index = s.stream(phases(5, 6, 7, 8), time_us=0x12345678, flags=0x10)  # no look at the time
    latched_us = s.boundary_us()
    s.wait(1)
    s.look()
    s.event(_trace(index, bytes([5, 6, 7, 8])), time_us=latched_us)
    s.drive(bytes([5, 6, 7, 8]), _FULL)
    return s


def _at_a_time() -> Script:
    s = _traced(
        "at-a-time",
        "HG-5.8/1 HG-5.8/4 HG-8.3/1",
        "latch",
        "a frame is latched on the first carrier period at or after its time",
    )
    expected = []
    for after_us in (1000, 2001, 3024, 4025):
        index = s.stream(phases(after_us % 251, 0, 0, 0), time_us=s.wire_us(after_us))
        expected.append((index, after_us % 251, s.boundary_us(after_us)))
    s.status(queued=4, margins=4, margin_min_us=1000, margin_mean_us=2512)
    s.wait(5)
    s.look()
    for index, code, time_us in expected:
        s.event(_trace(index, bytes([code, 0, 0, 0])), time_us=time_us)
    s.counts(latched=4, late=0)
    return s


def _formats() -> Script:
    s = _traced(
        "phase-formats",
        "HG-5.2/1 HG-5.2/6 HG-5.2/7",
        "packing",
        "phases of 6 and 5 bits are latched as 4 c and 8 c, at full amplitude",
    )
    index = s.stream(phases(1, 2, 3, 63, bits=m.PhaseFormat.BITS_6))
    s.event(_trace(index, bytes([4, 8, 12, 252])))
    s.drive(bytes([4, 8, 12, 252]), _FULL)
    s.wait(1)
    index = s.stream(phases(1, 2, 3, 31, bits=m.PhaseFormat.BITS_5))
    s.event(_trace(index, bytes([8, 16, 24, 248])))
    s.drive(bytes([8, 16, 24, 248]), _FULL)
    return s


def _drives() -> Script:
    s = _traced("drives", "HG-5.3/1", "layout", "phases come first, then amplitudes")
    codes, amplitudes = bytes([10, 20, 30, 40]), bytes([0, 1, 128, 255])
    index = s.stream(m.Drives(_EIGHT, 0, codes + amplitudes))
    s.event(_trace(index, codes, amplitudes))
    s.drive(codes, amplitudes)
    return s


def _point() -> Script:
    s = _traced(
        "point",
        "HG-5.4/1 HG-5.4/2",
        "sign point",
        "a point on the axis: the conjugate phase, the same for all, its amplitude and phase in it",
    )
    s.stream(m.Points((m.FocalPoint(0, 0, 105_000, 65535, 0),)))
    s.event_with(m.MessageType.TRACE, {"index": m.FIRST_STREAM_SEQ})
    s.drive(bytes([AXIAL_CODE] * COUNT), _FULL)
    s.wait(1)
    s.stream(m.Points((m.FocalPoint(0, 0, 105_000, 128 * 257, 16384),)))
    s.event_with(m.MessageType.TRACE, {"index": m.FIRST_STREAM_SEQ + 1})
    s.drive(bytes([(AXIAL_CODE + 64) % 256] * COUNT), bytes([128] * COUNT))
    return s


def _points_limits() -> Script:
    s = Script("points-limits", "HG-5.4/4", "limits", "none, or more points than are allowed")
    s.arm()
    points = m.FocalPoint(0, 0, 150_000, 1000, 0)
    s.stream(m.Points((points,) * 8))
    s.stream(m.Points((points,) * 9))
    s.counts(latched=1, bad_value=1)
    return s


def _gaps() -> Script:
    s = _traced(
        "gaps-and-duplicates",
        "HG-5.5/1 HG-5.5/2",
        "sequence",
        "missing numbers are counted; a number seen before is dropped",
    )
    index = s.stream(phases(1, 1, 1, 1))
    s.event(_trace(index, bytes([1] * 4)))
    s.index += 3
    s.wait(1)
    index = s.stream(phases(2, 2, 2, 2))
    s.event(_trace(index, bytes([2] * 4)))
    s.raw(phases(3, 3, 3, 3), seq=index & 0xFFFF, flags=0x10)
    s.raw(phases(3, 3, 3, 3), seq=(index - 2) & 0xFFFF, flags=0x10)
    s.counts(gap=3, duplicate=2, latched=2)
    s.drive(bytes([2] * 4), _FULL)
    return s


def _number_wraps() -> Script:
    s = _traced("number-wraps", "HG-3.6/3 HG-3.6/5", "wrap", "the numbers of the stream wrap")
    for step in range(20):
        s.wait(1)
        index = s.stream(phases(step, 0, 0, 0))
        s.event(_trace(index, bytes([step, 0, 0, 0])))
    s.status(last_seq=m.FIRST_STREAM_SEQ + 19, counters={"gap": 0, "duplicate": 0})
    return s


def _time_wraps() -> Script:
    s = _traced(
        "time-wraps", "HG-3.6/1 HG-6.9/1", "wrap", "frames on both sides of the wrap of the clock"
    )
    s.t_us = 9_999_000
    latches = []
    for step in range(3):
        index = s.stream(phases(step, 0, 0, 0), time_us=s.wire_us(500 + 500 * step))
        latches.append((index, step, s.boundary_us(500 + 500 * step)))
    s.wait(2)
    s.look()
    for index, step, time_us in latches:
        s.event(_trace(index, bytes([step, 0, 0, 0])), time_us=time_us)
    s.counts(latched=3, dropped_late=0, dropped_future=0)
    return s


def _late() -> Script:
    s = _traced("late", "HG-5.7/5 HG-9.3/1", "latch", "a frame that comes too late is dropped")
    s.stream(phases(1, 1, 1, 1), time_us=s.wire_us(-1))
    s.status(queued=0, margins=1, margin_min_us=-1, margin_mean_us=-1, counters={"dropped_late": 1})
    s.status(margins=0, margin_min_us=0, margin_mean_us=0)
    index = s.stream(phases(1, 1, 1, 1), time_us=s.wire_us())  # exactly now is not late
    s.event(_trace(index, bytes([1] * 4)))
    s.counts(dropped_late=1, latched=1, late=0)
    return s


def _late_window() -> Script:
    s = _traced(
        "late-window",
        "HG-5.7/6 HG-5.7/5",
        "latch",
        "within the window a late frame is latched on the next carrier period and flagged",
    )
    s.configure(late_window_us=1000)
    index = s.stream(phases(1, 1, 1, 1), time_us=s.wire_us(-1000))
    s.event(_trace(index, bytes([1] * 4)), flags=m.Flag.LATE)
    s.stream(phases(2, 2, 2, 2), time_us=s.wire_us(-1001))
    s.counts(late=1, latched=1, dropped_late=1)
    return s


def _order() -> Script:
    s = _traced(
        "order", "HG-5.7/2", "queue", "a frame that is not after the last queued one is dropped"
    )
    s.stream(phases(1, 1, 1, 1), time_us=s.wire_us(5000))
    s.stream(phases(2, 2, 2, 2), time_us=s.wire_us(5000))
    s.stream(phases(3, 3, 3, 3), time_us=s.wire_us(4000))
    s.counts(dropped_order=2)
    s.wait(6)
    s.look()
    time_us = s.boundary_us(-1000)
    s.event(_trace(m.FIRST_STREAM_SEQ, bytes([1] * 4)), time_us=time_us)
    return s


def _same_period() -> Script:
    s = _traced(
        "same-period",
        "HG-5.8/3",
        "latch",
        "of two frames on one carrier period the later replaces the earlier",
    )
    s.stream(phases(1, 1, 1, 1), time_us=s.wire_us(5001))
    index = s.stream(phases(2, 2, 2, 2), time_us=s.wire_us(5002))
    time_us = s.boundary_us(5002)
    s.wait(6)
    s.look()
    s.event(_trace(index, bytes([2] * 4)), time_us=time_us)
    s.counts(latched=1, flushed=1)
    return s


def _full_queue() -> Script:
    s = Script(
        "full-queue",
        "HG-5.7/3",
        "queue",
        "one frame more than queue_depth (32 here) is dropped, the queued ones stay",
    )
    s.arm()
    for step in range(33):
        s.stream(phases(step, 0, 0, 0), time_us=s.wire_us(10_000 + 100 * step))
    s.status(queued=32, counters={"dropped_full": 1})
    s.wait(20)
    s.status(queued=0, last_seq=m.FIRST_STREAM_SEQ + 31, counters={"latched": 32})
    return s


def _horizon() -> Script:
    s = Script(
        "horizon", "HG-5.7/4", "limits", "beyond max_horizon_us (10 s here) a frame is dropped"
    )
    s.arm()
    s.stream(phases(1, 1, 1, 1), time_us=s.wire_us(10_000_001))
    s.stream(phases(1, 1, 1, 1), time_us=s.wire_us(10_000_000))
    s.status(queued=1, counters={"dropped_future": 1})
    return s


def _flushed() -> Script:
    s = _traced("flushed", "HG-5.9/1", "queue", "a frame without a time flushes the queue")
    for step in range(3):
        s.stream(phases(9, 9, 9, step), time_us=s.wire_us(5000 + 100 * step))
    index = s.stream(phases(1, 2, 3, 4))
    s.event(_trace(index, bytes([1, 2, 3, 4])))
    s.wait(10)
    s.status(queued=0, counters={"flushed": 3, "latched": 1})
    return s


def _not_armed() -> Script:
    s = Script(
        "not-armed",
        "HG-5.7/1 HG-5.6/1 HG-6.1/1",
        "safety state",
        "frames before ARM are dropped, use up their numbers, and nothing of them is latched",
    )
    s.stream(phases(1, 1, 1, 1))
    s.stream(phases(1, 1, 1, 1), time_us=s.wire_us(1000))
    s.arm()
    s.wait(5)
    s.drive(bytes(COUNT), bytes(COUNT))
    s.stream(phases(1, 1, 1, 1))
    s.counts(dropped_state=2, latched=1, gap=0, duplicate=0)
    return s


def _sizes() -> Script:
    s = Script(
        "array-sizes",
        "HG-5.2/2 HG-5.2/3 HG-5.2/4 HG-5.3/1",
        "length-trusted spare-bits",
        "frames for another number of transducers, another bank, set spare bits",
    )
    s.arm()
    for data in (bytes(3), bytes(5), b""):
        s.stream(m.Phases(_EIGHT, 0, data))
    s.stream(m.Drives(_EIGHT, 0, bytes(6)))
    s.stream(m.Phases(_EIGHT, 1, bytes(4)))
    s.stream(m.Phases(m.PhaseFormat.BITS_5, 0, b"\0\0\x10"))
    s.stream(m.Drives(m.PhaseFormat.BITS_6, 0, bytes(8)))
    s.counts(bad_length=4, bad_value=3, latched=0)
    return s
