"""Sessions, requests and their repetition.  SPEC.md chapters 3 and 4."""

from __future__ import annotations

from haptogram_protocol import messages as m
from haptogram_protocol.state import OutputState

from ..tables import description_hash
from ..worked import EXCHANGE
from .script import Script
from .vector import SESSION, body_of, wire

_T = m.MessageType
_E = m.ErrorCode


def scripts() -> list[Script]:
    """Return every dialogue of this part."""
    return [
        _before_a_session(),
        _other_versions(),
        _nonce_zero(),
        _same_nonce(),
        _new_nonce(),
        _stale(),
        _repeated(),
        _reused(),
        _delayed_arm(),
        _unknown(),
        _must_understand(),
        _order_of_checks(),
        _bad_payloads(),
        _junk_between(),
        _control_wraps(),
        _in_one_chunk(),
        _any_number(),
        _first_latch(),
    ]


def _before_a_session() -> Script:
    s = Script(
        "before-a-session",
        "HG-4.1/1 HG-4.7/1 HG-4.12/1 HG-6.1/1 HG-6.4/1",
        "session",
        "no request but HELLO and MUTE without a session; no event either",
        session=None,
    )
    s.request(m.GetStatus(), session=0)
    s.refusal(_T.GET_STATUS, _E.STALE_SESSION, 0, session=0)
    s.request(m.Arm(), session=SESSION)
    s.refusal(_T.ARM, _E.STALE_SESSION, 0, session=0)
    s.request(m.Mute(), session=0)
    s.answer(m.MuteReply(OutputState.MUTED), session=0)
    s.wait(500)
    s.look()
    return s


def _other_versions() -> Script:
    s = Script(
        "other-versions",
        "HG-4.4/1 HG-11.2/2 HG-11.3/1",
        "version",
        "another major version is refused; another minor version and hash are not",
        session=None,
    )
    s.request(m.Hello(m.VERSION_MAJOR + 1, 0, SESSION, 0), session=0)
    s.refusal(_T.HELLO, _E.VERSION, m.VERSION_MAJOR, session=0)
    s.request(m.Hello(0, 0, SESSION, 0), session=0)
    s.refusal(_T.HELLO, _E.VERSION, m.VERSION_MAJOR, session=0)
    s.session = 0x0101
    s.request(m.Hello(m.VERSION_MAJOR, 99, 0x0101, 0xBADC0DE5), session=0)
    s.answer_with(_T.HELLO_REPLY, {"nonce": 0x0101, "state": OutputState.DISARMED})
    return s


def _nonce_zero() -> Script:
    s = Script("nonce-zero", "HG-4.1/3", "session", "nonce 0 opens nothing", session=None)
    s.request(m.Hello(m.VERSION_MAJOR, 0, 0, 0), session=0)
    s.refusal(_T.HELLO, _E.BAD_VALUE, m.Hello.WIRE["nonce"].offset, session=0)
    s.request(m.Ping(1), session=0)
    s.refusal(_T.PING, _E.STALE_SESSION, 0, session=0)
    return s


def _same_nonce() -> Script:
    s = Script(
        "same-nonce",
        "HG-4.6/1",
        "session repetition",
        "HELLO of the open session again: the same reply, the state as it was, nothing else",
    )
    s.arm()
    hello = m.Hello(m.VERSION_MAJOR, m.VERSION_MINOR, SESSION, description_hash())
    s.request(hello, session=0)
    s.answer_with(_T.HELLO_REPLY, {"nonce": SESSION, "state": OutputState.DISARMED})
    s.status(state=OutputState.ARMED, counters={"repeated": 1})
    return s


def _new_nonce() -> Script:
    s = Script(
        "new-nonce",
        "HG-4.6/2 HG-4.6/3 HG-4.6/4 HG-4.6/5",
        "session",
        "a new session disarms, flushes and starts the numbers anew; configuration stays",
    )
    s.configure(hold_ms=321)
    s.arm()
    s.stream(m.Phases(m.PhaseFormat.BITS_8, 0, bytes(4)), time_us=s.wire_us(50_000))
    s.hello(0x0202)
    s.status(state=OutputState.DISARMED, queued=0, last_seq=0, counters={"flushed": 1})
    s.request(m.GetConfig())
    s.answer_with(_T.CONFIG_REPLY, {"config": {"hold_ms": 321, "status_period_ms": 0}})
    return s


def _stale() -> Script:
    s = Script(
        "stale-session",
        "HG-3.7/2 HG-4.12/1 HG-6.7/1",
        "session",
        "frames of another session are refused, dropped and renew no lease",
    )
    s.arm()
    s.request(m.Ping(1), session=0x1234)
    s.refusal(_T.PING, _E.STALE_SESSION, SESSION, session=0)
    s.raw(m.Phases(m.PhaseFormat.BITS_8, 0, bytes(4)), seq=0xFFF0, session=0x1234, flags=0x10)
    s.counts(stale_session=2, latched=0, duplicate=0)
    return s


def _repeated() -> Script:
    s = Script(
        "repeated-request",
        "HG-4.9/1",
        "repetition",
        "the same request again: the same bytes again, the first time in their header",
    )
    s.request(m.Ping(99))
    first_us = s.wire_us()
    s.answer(m.Pong(99, first_us, first_us))
    s.wait(30)
    s.raw(m.Ping(99))
    s.answer(m.Pong(99, first_us, first_us), time_us=first_us)
    s.counts(repeated=1)
    return s


def _reused() -> Script:
    s = Script(
        "reused-number",
        "HG-4.9/2 HG-4.9/3 HG-4.9/4",
        "repetition",
        "another request with a used number is refused, and forgets nothing",
    )
    s.request(m.Ping(1))
    first_us = s.wire_us()
    s.answer(m.Pong(1, first_us, first_us))
    s.wait(5)
    s.raw(m.Ping(2))
    s.refusal(_T.PING, _E.SEQUENCE_REUSED, s.seq)
    s.raw(m.Ping(1))
    s.answer(m.Pong(1, first_us, first_us), time_us=first_us)
    s.counts(repeated=1, bad_value=1)
    return s


def _delayed_arm() -> Script:
    s = Script(
        "delayed-arm",
        "HG-4.9/3 HG-6.5/1",
        "repetition safety",
        "a delayed copy of ARM does not undo a later DISARM",
    )
    s.arm()
    armed = s.seq
    s.request(m.Disarm())
    s.answer(m.DisarmReply(OutputState.DISARMED))
    s.raw(m.Arm(), seq=armed)
    s.refusal(_T.ARM, _E.SEQUENCE_REUSED, armed, seq=armed)
    s.status(state=OutputState.DISARMED)
    return s


def _unknown() -> Script:
    s = Script(
        "unknown-types",
        "HG-3.3/2 HG-3.3/3 HG-10.1/2",
        "unknown-type",
        "unknown requests are answered, unknown stream frames, responses and events are not",
    )
    for kind in (0x04, 0x3F, 0x80, 0xC0, 0xFF):
        s.send(wire(bytes([kind]) + body_of(m.Arm(), seq=9)[1:]))
    s.seq += 1
    s.send(wire(b"\x7f" + body_of(m.Arm(), seq=s.seq)[1:]))
    s.refusal(0x7F, _E.UNSUPPORTED, 0x7F)
    s.counts(unknown_type=5, unsupported=1)
    return s


def _must_understand() -> Script:
    s = Script(
        "must-understand",
        "HG-3.4/1 HG-3.4/2 HG-3.5/1",
        "flags",
        "unknown bits of the high nibble refuse a frame, those of the low nibble do not",
    )
    s.request(m.Ping(1), flags=0x20)
    s.refusal(_T.PING, _E.UNSUPPORTED, 0x20)
    s.request(m.Ping(1), flags=0x10)
    s.refusal(_T.PING, _E.UNSUPPORTED, 0x10)
    s.request(m.Ping(1), flags=0x0F)
    s.answer(m.Pong(1, s.wire_us(), s.wire_us()))
    s.arm()
    s.stream(m.Phases(m.PhaseFormat.BITS_8, 0, bytes(4)), flags=0x80)
    s.counts(unsupported=3, latched=0)
    return s


def _order_of_checks() -> Script:
    s = Script(
        "order-of-checks",
        "HG-3.8/1 HG-3.9/1 HG-5.6/1",
        "order",
        "of several wrong things the first in the order of checks is counted, and only that",
    )
    eight = m.PhaseFormat.BITS_8
    s.stream(m.Phases(eight, 0, bytes(3)), session=0x4321, flags=0x20)  # session before flags
    s.index -= 1
    s.stream(m.Phases(eight, 0, bytes(3)), flags=0x20)  # flags before length
    s.stream(m.Phases(eight, 0, bytes(3)))  # length before state
    s.stream(m.Phases(eight, 1, bytes(4)))  # value before state
    s.raw(m.Phases(eight, 1, bytes(3)), seq=0xFFF0)  # duplicate before length
    s.request(m.Ping(1), session=0x4321, flags=0x20)
    s.refusal(_T.PING, _E.STALE_SESSION, SESSION, session=0)
    s.counts(stale_session=2, unsupported=1, bad_length=1, bad_value=1, duplicate=1, gap=0)
    return s


def _bad_payloads() -> Script:
    s = Script(
        "bad-payloads",
        "HG-3.2/4 HG-3.2/5 HG-4.9/4",
        "length-trusted value-not-checked",
        "a wrong length or value is answered and uses up no number",
    )
    number = s.seq + 1
    body = body_of(m.Ping(1), seq=number)
    s.seq = number
    s.send(wire(body[:-1]))
    s.refusal(_T.PING, _E.BAD_LENGTH, m.Ping.LAYOUT.size)
    chunk = body_of(m.UploadChunk(0, b""), seq=number)
    s.send(wire(chunk[:-1]))
    s.refusal(_T.UPLOAD_CHUNK, _E.BAD_LENGTH, 0)
    bad = body_of(m.ReadDrive(m.DriveKind.LATCHED, 0, 4), seq=number)
    s.send(wire(bad[:10] + b"\x07" + bad[11:]))
    s.refusal(_T.READ_DRIVE, _E.BAD_VALUE, 0)
    s.send(wire(body))
    s.answer(m.Pong(1, s.wire_us(), s.wire_us()))
    s.counts(bad_length=2, bad_value=1)
    return s


def _junk_between() -> Script:
    s = Script(
        "junk-between",
        "HG-2.1/3 HG-2.4/2 HG-3.9/1 HG-3.9/3",
        "resync",
        "junk between two frames is counted and disturbs neither",
    )
    damaged = bytearray(wire(body_of(m.Arm(), seq=99)))
    damaged[2] ^= 4
    s.seq += 1
    ping = wire(body_of(m.Ping(5), seq=s.seq))
    s.send(b"hello?" + bytes(damaged) + b"\x01" + ping)
    s.answer(m.Pong(5, s.wire_us(), s.wire_us()))
    s.send(b"\0" + b"\x99" * 5000 + b"\0")
    s.counts(crc=1, cobs=1, short=1, oversize=1)
    return s


def _control_wraps() -> Script:
    s = Script("control-wraps", "HG-3.6/1 HG-4.8/3", "wrap", "request numbers wrap at 2^16")
    for seq in (0x4000, 0x7FFF, 0xBFFF, 0xFFFE, 0xFFFF, 0, 1):
        s.seq = seq
        s.raw(m.Ping(seq))
        s.answer(m.Pong(seq, s.wire_us(), s.wire_us()))
    return s


def _in_one_chunk() -> Script:
    s = Script(
        "in-one-chunk",
        "HG-3.8/2 HG-2.1/2",
        "chunking session",
        "HELLO, and requests of the session that it opens, in one piece",
        session=None,
    )
    hello = m.Hello(m.VERSION_MAJOR, m.VERSION_MINOR, SESSION, description_hash())
    lines = [body_of(hello, seq=1, session=0), body_of(m.Arm(), seq=2), body_of(m.Mute(), seq=3)]
    s.session, s.seq = SESSION, 3
    s.send(b"\0" + b"\0".join(wire(line)[1:-1] for line in lines) + b"\0")
    s.answer_with(_T.HELLO_REPLY, {"nonce": SESSION}, seq=1)
    s.answer(m.ArmReply(OutputState.ARMED), seq=2)
    s.answer(m.MuteReply(OutputState.MUTED), seq=3)
    return s


def _any_number() -> Script:
    s = Script(
        "hello-of-any-number",
        "HG-4.6/6 HG-4.9/3",
        "session wrap",
        "a HELLO of any number opens a session; the next request has to be ahead of it",
        session=None,
    )
    for nonce, seq in ((1, 0), (2, 0x8000), (3, 0xFFFF), (4, 0x7FFF)):
        s.seq = seq - 1
        s.hello(nonce)
        s.raw(m.Ping(1))
        s.refusal(_T.PING, _E.SEQUENCE_REUSED, seq)
        s.request(m.Ping(2))
        s.answer(m.Pong(2, s.wire_us(), s.wire_us()))
    return s


def _first_latch() -> Script:
    s = Script(
        "first-latch",
        "HG-4.1/1 HG-4.8/4 HG-3.6/3 HG-3.6/4 HG-5.8/1 HG-8.3/1",
        "worked-exchange",
        "the exchange of chapter 13: HELLO, configuration, time, ARM, a frame, its latch, MUTE",
        session=None,
    )
    for step in EXCHANGE:
        s.t_us = step.t_us
        if step.from_host:
            s.send(wire(step.body))
        elif isinstance(step.message, m.HelloReply):  # the rest is the board's own
            s.answer_with(_T.HELLO_REPLY, {"nonce": SESSION}, **step.header)
        elif isinstance(step.message, m.Trace):
            s.look()
            s.answer(step.message, **step.header)
        else:
            s.answer(step.message, **step.header)
    return s
