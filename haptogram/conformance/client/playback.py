"""Sequences: stored and played."""

from __future__ import annotations

from typing import Final

from haptogram_protocol.messages import Flag, Play, PlayReply, UploadKind

from .board_client import Bench

PERIOD_US: Final = 1000
UNATTENDED_MS: Final = 2000


def store_phases(bench: Bench, sequence: int, *, frames: int) -> list[bytes]:
    """Upload a sequence of random drives and return the registers that each leads to."""
    registers = [bench.random.randbytes(bench.identity.transducers) for _ in range(frames)]
    bench.upload(UploadKind.PHASES, sequence, b"".join(registers))
    return registers


def play_now(
    bench: Bench,
    sequence: int,
    *,
    loops: int,
    period_us: int = PERIOD_US,
    unattended_ms: int = UNATTENDED_MS,
) -> PlayReply:
    """Play a sequence from now on."""
    play = Play(sequence, period_us, loops, min(unattended_ms, bench.identity.max_unattended_ms))
    return bench.call(play, PlayReply, flags=Flag.IMMEDIATE)


def play_at(
    bench: Bench, sequence: int, start_us: int, *, loops: int, period_us: int = PERIOD_US
) -> PlayReply:
    """Play a sequence from *start_us* on."""
    play = Play(sequence, period_us, loops, min(UNATTENDED_MS, bench.identity.max_unattended_ms))
    return bench.call(play, PlayReply, time_us=start_us)
