"""The ramp at the end of a timer: what is radiated during it, and the straight line."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from haptogram_protocol import messages as m

from ..client import latching
from ..client.board_client import BoardClient
from .timers import judge_in_time

_MS: Final = 1000
_TIMER_MS: Final = 1  # HG-12.1/1
_STEP_MS: Final = 1  # HG-6.11/2
_TOLD: Final = 10  # codes of a ramp
_READINGS: Final = 40  # most readings of one ramp


@dataclass(frozen=True, slots=True)
class RampReading:
    """Radiated amplitudes at a moment between two, in milliseconds from the beginning of a ramp.

    Attributes
    ----------
    from_ms, to_ms : float
        The two moments.
    amplitudes : bytes
        One code per transducer.
    """

    from_ms: float
    to_ms: float
    amplitudes: bytes


def judged_ramp(board: BoardClient, *, hold_ms: int, ramp_ms: int) -> list[RampReading]:
    """Return the amplitudes from the last latch, over the hold's ramp, to after its end."""
    start_us = board.clock.unwrap(board.status().last_latch_us) + hold_ms * _MS
    found: list[RampReading] = []
    while not found or found[-1].from_ms < 1.1 * ramp_ms:
        found.append(judged_ramp_reading(board, start_us))
        board.wire.idle(ramp_ms * _MS // _READINGS)
    return found


def judged_ramp_reading(board: BoardClient, start_us: int) -> RampReading:
    """Read back what is radiated in a ramp that begins at *start_us*."""
    ping, first = board.link.request_wire(m.Ping(0))
    read, seq = board.link.request_wire(
        m.ReadDrive(m.DriveKind.RADIATED, 0, board.identity.transducers)
    )
    since = board.link.mark()
    board.link.send(ping, read)
    pong = board.link.reply_in(board.link.answer_to(m.Ping.TYPE, first, since), m.Pong, m.Ping.TYPE)
    answer = board.link.answer_to(m.ReadDrive.TYPE, seq, since)
    assert answer.header is not None  # answer_to
    reply = board.link.reply_in(answer, m.DriveReply, m.ReadDrive.TYPE)
    times_us = (board.clock.unwrap(t_us) for t_us in (pong.t_rx_us, answer.header.time_us))
    from_ms, to_ms = ((t_us - start_us) / _MS for t_us in times_us)
    return RampReading(from_ms, to_ms, latching.client_drive_of_reply(reply).amplitudes)


def judge_straight_ramp(
    board: BoardClient,
    ramp: Sequence[RampReading],
    ramp_ms: int,
    begins: bytes,
    name: str = "",
    *,
    cut: int = latching.FULL,
) -> None:
    """FAILED unless every amplitude goes from its code in *begins* straight to 0 in *ramp_ms*.

    The ceiling in force cuts the lines off at *cut*.
    """
    for reading in ramp:
        # One step, and 1 ms each for the timer and for the beginning of a step.
        low = _judged_ramp_left(reading.to_ms + _TIMER_MS, ramp_ms)
        high = _judged_ramp_left(reading.from_ms - _TIMER_MS - _STEP_MS, ramp_ms)
        for begin, got in zip(begins, reading.amplitudes, strict=True):
            least, most = min(begin * low - 1, cut), min(begin * high + 1, cut)
            if not least <= got <= most:
                as_ms = (1 - got / max(begin, 1)) * ramp_ms
                when = f"due at {as_ms:.1f} ms" if got <= begin else "more than at its beginning"
                judge_in_time(
                    board,
                    False,
                    f"{name}{reading.from_ms:.1f} ms after the hold ended, in a ramp of {ramp_ms} "
                    f"ms from amplitude {begin}, the amplitude in DRIVE_REPLY is {got}, {when}; "
                    f"the straight line allows {least:.1f} to {most:.1f}; {_ramp_text(ramp)}",
                )


def _ramp_text(ramp: Sequence[RampReading]) -> str:
    """Return the first transducer's amplitude codes in a ramp as text.

    Each code is there once, with the time in ms from the ramp's begin at which it was first read.
    """
    runs = itertools.groupby(ramp, lambda reading: reading.amplitudes[0])
    told = [f"{code} from {next(run).from_ms:.0f} ms" for code, run in runs]
    return f"read were {', '.join(told[:_TOLD])}{', ...' * (len(told) > _TOLD)}"


def _judged_ramp_left(t_ms: float, ramp_ms: int) -> float:
    """Return the share of the amplitude (1 to 0) that a straight ramp leaves after *t_ms*."""
    return min(1.0, max(0.0, 1 - t_ms / ramp_ms))
