"""The second verdict: whether requests and stream are clean again after a case."""

from __future__ import annotations

import contextlib
from typing import Final

from haptogram_protocol.messages import (
    Arm,
    Disarm,
    GetStatus,
    HelloReply,
    Mute,
    Ping,
    Pong,
    StatusReply,
)

from ..client.board_client import Bench
from ..outcome import CaseEndedError
from ..verdict import Recovery

MAX_FRAMES: Final = 3  # a board has to be in step again after that many


def recover(bench: Bench) -> Recovery:
    """Say how many requests it takes until one is answered, and whether a frame is latched.

    A session is opened first if the case left none.
    """
    bench.wire.begin_case()
    try:
        for number in range(1, MAX_FRAMES + 1):
            if _answers(bench):
                return Recovery(number, _stream_fault(bench))
    except CaseEndedError as error:  # a flood
        return Recovery(None, str(error))
    return Recovery(None)


def farewell(bench: Bench) -> None:
    """Leave the board silent."""
    bench.wire.begin_case()
    bench.ask(Mute())


def _answers(bench: Bench) -> bool:
    """Tell whether the board answers, in the session that the case left or in a new one."""
    seq = bench.next_seq()
    wire, _ = bench.request_wire(Ping(bench.random.getrandbits(64)), seq=seq)
    since = bench.mark()
    bench.send(wire)
    answer = bench.try_answer(seq, since)
    if answer is not None and isinstance(answer.message, Pong):
        return True
    # Without a session, or in an old one, a PING is refused: a HELLO has the last word.
    return answer is not None and isinstance(bench.greet(), HelloReply)


def _stream_fault(bench: Bench) -> str:
    """Return what is wrong with the stream of a new session, empty if a frame is latched."""
    if not isinstance(bench.greet(), HelloReply):
        return "HELLO is not answered"
    if not bench.has_phases:
        return ""
    with contextlib.suppress(CaseEndedError):
        bench.ask(Arm())
        before = bench.ask(GetStatus()).message
        bench.send(bench.stream_wire(bench.flat_phases()))
        bench.rest()
        after = bench.ask(GetStatus()).message
        bench.ask(Disarm())
        if isinstance(before, StatusReply) and isinstance(after, StatusReply):
            latched = (after.counters.latched - before.counters.latched) & 0xFFFFFFFF
            return "" if latched == 1 else f"{latched} latches after one stream frame"
    return "a request in a new session is not answered"
