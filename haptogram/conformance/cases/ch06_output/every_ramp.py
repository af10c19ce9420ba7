"""HG-6.11: ramps of every amplitude under every ceiling, of stream and playback."""

from __future__ import annotations

from typing import Final

from haptogram_protocol.messages import Drives, Feature, PhaseFormat

from ...case import Depth, case
from ...client.board_client import BoardClient
from ...client.latching import FULL, latch_now
from ...client.playback import play_now, send_phases_to_store
from ...judge.ramps import judge_straight_ramp, judged_ramp
from ...outcome import SELF_REPORTED

_HOLD_MS: Final = 60
_RAMPS_MS: Final = (100, 300)
_SEQUENCE: Final = 4
_CEILINGS: Final = (255, 254, 128, 100, 1, 0)


def _amplitudes_in_ramps(ceiling: int, count: int) -> bytes:
    """Return amplitudes at and beside the ceiling, and the least and greatest, one after another.

    An array of fewer transducers has the first of them.
    """
    near = (FULL, ceiling + 1, ceiling, 0, ceiling - 1, FULL - 1, 2 * ceiling, 1, ceiling // 2, 2)
    codes = list(dict.fromkeys(code for code in near if 0 <= code <= FULL))
    return bytes(codes[n % len(codes)] for n in range(count))


@case(
    "HG-6.11/2",
    "ramps of amplitudes below, at and above each ceiling: straight from what was radiated",
    variant="ceilings",
    needs=Feature.CONFIG | Feature.AMPLITUDE | Feature.READ_RADIATED,
    evidence=SELF_REPORTED,
    depth=Depth.DEFAULT,
)
def output_ramps_begin_below_the_ceiling(board: BoardClient) -> None:
    count = board.identity.transducers
    played = board.has(Feature.SEQUENCE_PHASES)
    if played:
        send_phases_to_store(board, _SEQUENCE, frames=1)
    for number, ceiling in enumerate(_CEILINGS):
        amplitudes = _amplitudes_in_ramps(ceiling, count)
        drives = Drives(PhaseFormat.BITS_8, 0, bytes(count) + amplitudes)
        ramp_ms = _RAMPS_MS[number % len(_RAMPS_MS)]
        board.configure(hold_ms=_HOLD_MS, ramp_ms=ramp_ms, amplitude_ceiling=ceiling)
        board.arm()
        latch_now(board, drives)
        _judge_output_ramp(board, ramp_ms, amplitudes, "of a stream frame")
        if played and (number % 2 == 0 or not board.wire.limits.slack_us):
            board.arm()
            play_now(board, _SEQUENCE, loops=1)
            board.clock.wait_latched()
            _judge_output_ramp(board, ramp_ms, bytes([FULL]) * count, "of a played frame")


def _judge_output_ramp(board: BoardClient, ramp_ms: int, latched: bytes, name: str) -> None:
    ceiling = board.config.amplitude_ceiling
    begins = bytes(min(code, ceiling) for code in latched)
    ramp = judged_ramp(board, hold_ms=_HOLD_MS, ramp_ms=ramp_ms)
    judge_straight_ramp(board, ramp, ramp_ms, begins, f"ceiling {ceiling}, {name}: ")
