"""Typed dialogues for clauses that no conformance case judges: most of them bind the host.

All other dialogues are recorded; their file is not made here.
"""

from __future__ import annotations

from typing import Any

from haptogram_protocol import messages as m
from haptogram_protocol.state import OutputState

from ..tables.worked import EXCHANGE
from .script import DialogueScript
from .vector import SESSION, vector_wire

_T = m.MessageType
_E = m.ErrorCode


def dialogue_vectors() -> list[dict[str, Any]]:
    """Return every vector of ``dialogues-typed.json``."""
    scripts = (
        _vector_before_session(),
        _vector_of_other_versions(),
        _vector_of_control_wraps(),
        _vector_of_first_latch(),
        _vector_of_amplitude_zero(),
    )
    return [script.finish() for script in scripts]


def _vector_before_session() -> DialogueScript:
    s = DialogueScript(
        "before-a-session",
        "HG-4.1/1 HG-4.7/1 HG-4.12/1 HG-6.1/1 HG-6.4/1",
        "session",
        "without a session HELLO and MUTE are the only requests taken, and no event is sent",
    )
    s.request(m.GetStatus(), session=0)
    s.refusal(_T.GET_STATUS, _E.STALE_SESSION, 0, session=0)
    s.request(m.Arm(), session=SESSION)
    s.refusal(_T.ARM, _E.STALE_SESSION, 0, session=0)
    s.request(m.Mute(), session=0)
    s.answer(m.MuteReply(OutputState.MUTED), session=0)
    s.t_us += 500_000
    s.look()
    return s


def _vector_of_other_versions() -> DialogueScript:
    s = DialogueScript(
        "other-versions",
        "HG-4.4/1 HG-11.2/2 HG-11.3/1",
        "version",
        "another major version is refused; another minor version or hash is not",
    )
    s.request(m.Hello(m.VERSION_MAJOR + 1, 0, SESSION, 0), session=0)
    s.refusal(_T.HELLO, _E.VERSION, m.VERSION_MAJOR, session=0)
    s.request(m.Hello(0, 0, SESSION, 0), session=0)
    s.refusal(_T.HELLO, _E.VERSION, m.VERSION_MAJOR, session=0)
    s.session = 0x0101
    s.request(m.Hello(m.VERSION_MAJOR, 99, 0x0101, 0xBADC0DE5), session=0)
    s.answer_with(_T.HELLO_REPLY, {"nonce": 0x0101, "state": OutputState.DISARMED})
    return s


def _vector_of_control_wraps() -> DialogueScript:
    s = DialogueScript("control-wraps", "HG-3.6/1 HG-4.8/3", "wrap", "request numbers wrap at 2^16")
    s.open_session()
    for seq in (0x4000, 0x7FFF, 0xBFFF, 0xFFFE, 0xFFFF, 0, 1):
        s.seq = seq
        s.raw(m.Ping(seq))
        s.answer(m.Pong(seq, s.wire_us, s.wire_us))
    return s


def _vector_of_first_latch() -> DialogueScript:
    s = DialogueScript(
        "first-latch",
        "HG-4.1/1 HG-4.8/4 HG-3.6/3 HG-3.6/4 HG-5.8/1 HG-8.3/1",
        "worked-exchange",
        "the exchange of chapter 13: HELLO, configuration, time, ARM, a frame, its latch, MUTE",
    )
    for step in EXCHANGE:
        s.t_us = step.t_us
        if step.from_host:
            s.send(vector_wire(step.body))
        elif isinstance(step.message, m.HelloReply):  # its other fields are the board's own
            s.answer_with(_T.HELLO_REPLY, {"nonce": SESSION}, **step.header)
        else:
            if isinstance(step.message, m.Trace):
                s.look()
            s.answer(step.message, **step.header)
    return s


def _vector_of_amplitude_zero() -> DialogueScript:
    s = DialogueScript(
        "amplitude-zero", "HG-5.3/2", "layout", "a drive of amplitude 0 is latched as any other"
    )
    s.open_session()
    s.request(m.Arm())
    s.answer(m.ArmReply(OutputState.ARMED))
    drive = bytes([1, 2, 3, 4]) + bytes(4)
    header = {"seq": m.FIRST_STREAM_SEQ, "flags": m.Flag.IMMEDIATE}
    s.raw(m.Drives(drive), **header)
    s.request(m.ReadDrive(m.DriveKind.LATCHED, 0, 4))
    s.answer_with(_T.DRIVE_REPLY, {"kind": m.DriveKind.LATCHED, "data": drive})
    s.request(m.GetStatus())
    s.answer_with(_T.STATUS_REPLY, {"counters": {"latched": 1}})
    return s
