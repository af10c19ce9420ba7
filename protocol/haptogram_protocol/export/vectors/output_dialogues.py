"""Output state, timers and what is radiated.  SPEC.md chapters 6 and 12."""

from __future__ import annotations

from typing import Any

from haptogram_protocol import messages as m
from haptogram_protocol.state import MuteReason, OutputState

from .script import COUNT, Script, phases
from .vector import body_of, wire

_T = m.MessageType
_R = m.DriveKind.RADIATED
_FULL = b"\xff" * COUNT
_OFF = bytes(COUNT)


def scripts() -> list[Script]:
    """Return every dialogue of this part."""
    return [
        _silent_until_latch(),
        _states(),
        _foreign_mute(),
        _mute_flushes(),
        _muted_new_session(),
        _lease(),
        _lease_renewed(),
        _foreign_frames_renew_nothing(),
        _hold(),
        _never_latched(),
        _latch_in_ramp(),
        _frame_in_ramp(),
        _hard_mute(),
        _after_a_timer(),
        _ceiling(),
        _amplitude_zero(),
    ]


def _armed(name: str, clauses: str, flags: str, comment: str, **config: Any) -> Script:
    s = Script(name, clauses, flags, comment)
    s.configure(**{"host_timeout_ms": 10_000, "hold_ms": 10_000} | config)
    s.arm()
    return s


def _muted(s: Script, reason: MuteReason, after_ms: float) -> None:
    """Expect the board to mute *after_ms* from here on, and not a millisecond earlier."""
    due_us = s.wire_us(round(after_ms * 1000))
    s.wait(after_ms - 1)
    s.look()
    s.wait(2)
    s.look()
    s.event(m.StateChanged(OutputState.MUTED, reason), time_us=due_us)


def _silent_until_latch() -> Script:
    s = _armed("silent-until-latch", "HG-6.3/1", "safety", "after ARM nothing sounds until a latch")
    s.drive(_OFF, _OFF, _R)
    s.stream(phases(1, 2, 3, 4))
    s.drive(bytes([1, 2, 3, 4]), _FULL, _R)
    return s


def _states() -> Script:
    s = Script(
        "states", "HG-6.2/1 HG-6.3/2 HG-6.5/2 HG-6.6/2", "state safety", "the table of states"
    )
    reply = {m.Arm: m.ArmReply, m.Mute: m.MuteReply, m.Disarm: m.DisarmReply}
    for kind, state in (
        (m.Disarm, OutputState.DISARMED),
        (m.Arm, OutputState.ARMED),
        (m.Arm, OutputState.ARMED),
        (m.Disarm, OutputState.DISARMED),
        (m.Mute, OutputState.MUTED),
        (m.Disarm, OutputState.MUTED),
        (m.Mute, OutputState.MUTED),
        (m.Arm, OutputState.ARMED),
        (m.Mute, OutputState.MUTED),
    ):
        s.request(kind())
        s.answer(reply[kind](state))
    s.status(state=OutputState.MUTED, reason=MuteReason.MUTE)
    return s


def _foreign_mute() -> Script:
    s = _armed(
        "foreign-mute",
        "HG-6.4/1 HG-6.8/2 HG-6.6/1",
        "safety session",
        "MUTE of another session, with unknown flags and a payload, mutes all the same",
    )
    s.stream(phases(1, 1, 1, 1))
    body = body_of(m.Mute(), flags=0xF0, seq=3, session=0x7777) + b"\x01\x02\x03"
    s.send(wire(body))
    s.answer(m.MuteReply(OutputState.MUTED), seq=3)
    s.event(m.StateChanged(OutputState.MUTED, MuteReason.MUTE))
    s.may_miss()
    s.drive(bytes([1] * COUNT), _FULL)
    s.drive(_OFF, _OFF, _R)
    return s


def _mute_flushes() -> Script:
    s = _armed(
        "mute-flushes", "HG-6.4/2 HG-6.5/1", "safety queue", "MUTE and DISARM flush the queue"
    )
    s.stream(phases(1, 1, 1, 1), time_us=s.wire_us(5000))
    s.stream(phases(1, 1, 1, 1), time_us=s.wire_us(6000))
    s.request(m.Mute())
    s.answer(m.MuteReply(OutputState.MUTED))
    s.arm()
    s.stream(phases(1, 1, 1, 1), time_us=s.wire_us(5000))
    s.request(m.Disarm())
    s.answer(m.DisarmReply(OutputState.DISARMED))
    s.wait(10)
    s.counts(flushed=3, latched=0)
    return s


def _muted_new_session() -> Script:
    s = _armed(
        "muted-new-session", "HG-6.2/1 HG-4.6/2", "safety session", "a new session stays MUTED"
    )
    s.request(m.Mute())
    s.answer(m.MuteReply(OutputState.MUTED))
    s.hello(0x0303, state=OutputState.MUTED)
    s.stream(phases(1, 1, 1, 1))
    s.status(state=OutputState.MUTED, reason=MuteReason.MUTE, counters={"dropped_state": 1})
    return s


def _lease() -> Script:
    s = _armed(
        "lease",
        "HG-6.7/1 HG-6.8/1 HG-6.11/5",
        "safety timer",
        "a silent host: ramp after host_timeout_ms, muted ramp_ms later",
        host_timeout_ms=100,
        ramp_ms=50,
    )
    s.stream(phases(1, 1, 1, 1))
    _muted(s, MuteReason.HOST_SILENT, 150)
    s.status(state=OutputState.MUTED, reason=MuteReason.HOST_SILENT, counters={"timeouts": 1})
    return s


def _lease_renewed() -> Script:
    s = _armed(
        "lease-renewed",
        "HG-6.7/1",
        "safety timer",
        "every frame of the session renews the lease, dropped ones and unknown types too",
        host_timeout_ms=100,
        ramp_ms=0,
    )
    index = s.stream(phases(1, 1, 1, 1))
    s.wait(90)
    s.raw(phases(1, 1, 1, 1), seq=index & 0xFFFF, flags=0x10)  # a duplicate
    s.wait(90)
    s.send(wire(b"\x3f" + body_of(m.Arm(), seq=index & 0xFFFF)[1:]))  # unknown
    s.wait(90)
    s.raw(m.Arm())  # a repetition
    s.answer(m.ArmReply(OutputState.ARMED), time_us=s.wire_us(-270_000))
    _muted(s, MuteReason.HOST_SILENT, 100)
    return s


def _foreign_frames_renew_nothing() -> Script:
    s = _armed(
        "foreign-frames",
        "HG-6.7/1 HG-2.4/2",
        "safety timer session",
        "frames of another session, and damaged ones, renew no lease",
        host_timeout_ms=100,
        ramp_ms=0,
    )
    damaged = bytearray(wire(body_of(m.Ping(1), seq=s.seq + 1)))
    damaged[2] ^= 1
    s.wait(50)
    s.send(bytes(damaged))
    s.raw(m.Ping(1), seq=9, session=0x0909)
    s.refusal(_T.PING, m.ErrorCode.STALE_SESSION, s.session, seq=9, session=0)
    _muted(s, MuteReason.HOST_SILENT, 50)
    return s


def _hold() -> Script:
    s = _armed(
        "hold",
        "HG-6.10/1 HG-6.11/5",
        "safety timer",
        "no new latch for hold_ms: ramp, then muted, however often the host speaks",
        hold_ms=60,
        ramp_ms=20,
    )
    s.stream(phases(1, 1, 1, 1))
    s.wait(50)
    s.request(m.Ping(1))
    s.answer(m.Pong(1, s.wire_us(), s.wire_us()))
    _muted(s, MuteReason.HOLD_EXPIRED, 30)
    return s


def _never_latched() -> Script:
    s = _armed(
        "never-latched",
        "HG-6.10/1",
        "timer",
        "an armed board that never latched has no hold to expire",
        hold_ms=20,
        ramp_ms=0,
    )
    s.wait(300)
    s.status(state=OutputState.ARMED)
    return s


def _latch_in_ramp() -> Script:
    s = _armed(
        "latch-in-ramp",
        "HG-6.11/4",
        "timer",
        "a latch during the ramp of the hold restores full amplitude and starts the hold anew",
        hold_ms=50,
        ramp_ms=50,
    )
    s.stream(phases(1, 1, 1, 1))
    s.wait(75)
    s.stream(phases(2, 2, 2, 2))
    s.drive(bytes([2] * COUNT), _FULL, _R)
    _muted(s, MuteReason.HOLD_EXPIRED, 100)
    return s


def _frame_in_ramp() -> Script:
    s = _armed(
        "frame-in-ramp",
        "HG-6.11/4",
        "timer",
        "a frame of the session during the ramp of the lease restores full amplitude",
        host_timeout_ms=50,
        ramp_ms=50,
    )
    s.stream(phases(1, 1, 1, 1))
    s.wait(75)
    s.drive(bytes([1] * COUNT), _FULL, _R)  # READ_DRIVE itself is such a frame
    _muted(s, MuteReason.HOST_SILENT, 100)
    return s


def _hard_mute() -> Script:
    s = _armed(
        "hard-mute",
        "HG-6.11/3",
        "safety timer",
        "with ramp_ms = 0 the timer mutes at once",
        hold_ms=40,
        ramp_ms=0,
    )
    s.stream(phases(1, 1, 1, 1))
    _muted(s, MuteReason.HOLD_EXPIRED, 40)
    s.drive(_OFF, _OFF, _R)
    return s


def _after_a_timer() -> Script:
    s = _armed(
        "after-a-timer",
        "HG-6.2/1 HG-6.11/5 HG-5.7/1",
        "safety timer state",
        "only ARM leads out of MUTED; the queue was flushed",
        hold_ms=40,
        ramp_ms=0,
    )
    s.stream(phases(1, 1, 1, 1))
    s.stream(phases(2, 2, 2, 2), time_us=s.wire_us(200_000))
    _muted(s, MuteReason.HOLD_EXPIRED, 40)
    s.stream(phases(3, 3, 3, 3))
    s.counts(flushed=1, dropped_state=1, timeouts=1, latched=1)
    s.arm()
    s.stream(phases(4, 4, 4, 4))
    s.counts(latched=2)
    return s


def _ceiling() -> Script:
    s = _armed(
        "ceiling",
        "HG-7.9/2",
        "safety",
        "amplitude_ceiling caps what is radiated, not what is latched",
        amplitude_ceiling=100,
    )
    amplitudes = bytes([255, 101, 100, 7])
    s.stream(m.Drives(m.PhaseFormat.BITS_8, 0, bytes([1, 2, 3, 4]) + amplitudes))
    s.drive(bytes([1, 2, 3, 4]), amplitudes)
    s.drive(bytes([1, 2, 3, 4]), bytes([100, 100, 100, 7]), _R)
    return s


def _amplitude_zero() -> Script:
    s = _armed(
        "amplitude-zero", "HG-5.3/2", "layout", "a drive of amplitude 0 is latched as any other"
    )
    s.stream(m.Drives(m.PhaseFormat.BITS_8, 0, bytes([1, 2, 3, 4]) + _OFF))
    s.drive(bytes([1, 2, 3, 4]), _OFF)
    s.counts(latched=1)
    return s
