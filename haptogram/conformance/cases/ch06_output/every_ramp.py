"""HG-6.11: ramps of every amplitude under every ceiling, and what is set during a ramp."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

from haptogram_protocol.messages import Drives, Feature
from haptogram_protocol.state import MuteReason

from ...case import Depth, case
from ...client.board_client import BoardClient
from ...client.latching import FULL, latch_now, read_back_radiated
from ...client.playback import play_now, send_phases_to_store, send_phases_to_store_if_supported
from ...judge.ramps import judge_straight_ramp, judged_ramp, judged_ramp_reading
from ...judge.timers import judge_in_time, judge_mute_time, judged_mute_by_timer
from ...outcome import SELF_REPORTED
from ..ch07_configuration.every_setting import every_other_setting

_MS: Final = 1000
_HOLD_MS: Final = 60
_LONG_MS: Final = 2000  # the longest ramp: counters of 16 bits wrap in it, whose ticks are short
_SEQUENCE: Final = 4
#: Ceilings, and the length of the ramp that begins below each.
_RAMPS_MS: Final = {255: _LONG_MS, 254: 100, 128: 300, 100: 100, 1: 100, 0: 100}
_PLAYED_RAMPS_MS: Final = {128: 300}  # at a wall clock
_RAMPS_NEED: Final = Feature.CONFIG | Feature.AMPLITUDE | Feature.READ_RADIATED
#: Ceilings at the beginning of a ramp, and set one after the other within it.
_CEILINGS_IN_RAMPS: Final = (
    (255, (200, 255, 199, 200, 60, 61, 255, 0, 1, 255)),
    (100, (100, 255, 101, 254)),
    (200, (255, 40, 255, 39, 200)),
    (0, (255, 1)),
    (1, (0, 255)),
)


def _amplitudes_in_ramps(ceiling: int, count: int) -> bytes:
    """Return amplitudes at and beside the ceiling, and the least and greatest, one after another.

    An array of fewer transducers has the first of them.
    """
    near = (FULL, ceiling + 1, ceiling, 0, ceiling - 1, FULL - 1, 2 * ceiling, 1, ceiling // 2, 2)
    codes = list(dict.fromkeys(code for code in near if 0 <= code <= FULL))
    return bytes(codes[n % len(codes)] for n in range(count))


@case("HG-6.11/2-ceilings", needs=_RAMPS_NEED, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def output_ramps_begin_below_the_ceiling(board: BoardClient) -> None:
    """ramps of amplitudes at and beside each ceiling, one of 2 s too: straight from begin to end"""
    played = board.has(Feature.SEQUENCE_PHASES)
    send_phases_to_store_if_supported(board, _SEQUENCE, frames=1)
    at_wall = not board.wire.is_virtual
    played_ms = (_PLAYED_RAMPS_MS if at_wall else _RAMPS_MS) if played else {}
    for ceiling, ramp_ms in _RAMPS_MS.items():
        _judge_output_ramp(board, ceiling, ramp_ms, plays=False)
    for ceiling, ramp_ms in played_ms.items():
        _judge_output_ramp(board, ceiling, ramp_ms, plays=True)


def _judge_output_ramp(board: BoardClient, ceiling: int, ramp_ms: int, *, plays: bool) -> None:
    """Read a ramp of the hold from its begin to its end, every 40th of it."""
    board.arm(hold_ms=_HOLD_MS, ramp_ms=ramp_ms, amplitude_ceiling=ceiling)
    begins = _below_ceiling(_latch_before_ramp(board, plays=plays), ceiling)
    ramp = judged_ramp(board, hold_ms=_HOLD_MS, ramp_ms=ramp_ms)
    name = f"ceiling {ceiling}, of a {'played' if plays else 'stream'} frame: "
    judge_straight_ramp(board, ramp, ramp_ms, begins, name)


def _latch_before_ramp(board: BoardClient, *, plays: bool) -> bytes:
    """Latch a stream frame, or play one; return its amplitudes."""
    count = board.identity.transducers
    if plays:
        play_now(board, _SEQUENCE, loops=1)
        board.clock.wait_latched()
        return bytes([FULL]) * count
    amplitudes = _amplitudes_in_ramps(board.config.amplitude_ceiling, count)
    latch_now(board, Drives(bytes(count) + amplitudes))
    return amplitudes


def _below_ceiling(amplitudes: bytes, ceiling: int) -> bytes:
    return bytes(min(code, ceiling) for code in amplitudes)


# --- What is set during the ramp of a hold -----------------------------------------------------


@case("HG-6.11/6-fields", needs=_RAMPS_NEED, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def output_ramps_keep_their_beginning(board: BoardClient) -> None:
    """a ramp keeps line and end, whichever field is set to its least and greatest value
    meanwhile
    """
    lengths: list[dict[str, Any]] = [
        {"hold_ms": 1},
        {"hold_ms": 10_000},
        {"ramp_ms": 0},
        {"ramp_ms": 2000},
        {"ramp_ms": 1},
        {"host_timeout_ms": 1000},
        {"hold_ms": 1, "ramp_ms": 0},
    ]
    ceilings = [{"amplitude_ceiling": ceiling} for ceiling in (FULL, 100, 101)]
    steps = [*every_other_setting(board), *ceilings, *lengths]
    for plays in _sources_of_drives(board):
        # Behind the last ones the ramp ends: at its own time, whatever is in force.
        for last in board.sample(lengths[::-1]):
            _judge_ramp_with_settings(board, 100, [*steps, last], plays=plays)


@case("HG-6.11/6-ceilings", needs=_RAMPS_NEED, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def output_ramps_are_cut_off(board: BoardClient) -> None:
    """of the ceilings that are set in a ramp the one in force cuts it off; its line goes on"""
    chains: list[tuple[int, tuple[int, ...]]] = list(_CEILINGS_IN_RAMPS)
    codes = (0, 1, 2, 77, 128, 253, 254, 255)
    chains += [(first, tuple(board.random.choices(codes, k=len(codes)))) for first in codes]
    for first, ceilings in board.sample(chains):
        steps = [{"amplitude_ceiling": ceiling} for ceiling in ceilings]
        for plays in _sources_of_drives(board):
            _judge_ramp_with_settings(board, first, steps, plays=plays)


def _sources_of_drives(board: BoardClient) -> Iterator[bool]:
    """Yield whether a drive is played; at a wall clock streamed ones alone."""
    yield False
    if board.has(Feature.SEQUENCE_PHASES) and board.wire.is_virtual:
        send_phases_to_store(board, _SEQUENCE, frames=1)
        yield True


def _judge_ramp_with_settings(
    board: BoardClient, ceiling: int, steps: Sequence[Mapping[str, Any]], *, plays: bool
) -> None:
    """Set the configuration again and again during a ramp of the hold, and judge what is left."""
    ramp_ms = _length_of_long_ramp_ms(board)
    before = {"hold_ms": _HOLD_MS, "ramp_ms": ramp_ms, "amplitude_ceiling": ceiling}
    since = board.arm(**before)
    begins = _below_ceiling(_latch_before_ramp(board, plays=plays), ceiling)
    latch_us = board.last_latch_us()
    start_us = latch_us + _HOLD_MS * _MS
    for place, changes in enumerate(steps, 1):
        at_us = start_us + ramp_ms * _MS * place // (len(steps) + 1)
        board.wire.idle(max(0, at_us - board.clock.device_estimate_us()))
        board.configure(**before | dict(changes))
        reading = judged_ramp_reading(board, start_us)
        name = f"ceiling {ceiling}, {dict(changes)} meanwhile: "
        cut = board.config.amplitude_ceiling
        judge_straight_ramp(board, [reading], ramp_ms, begins, name, cut=cut)
    header, _ = judged_mute_by_timer(board, since, 2 * _LONG_MS * _MS, MuteReason.HOLD_EXPIRED)
    name = f"a ramp of {_HOLD_MS} + {ramp_ms} ms, {dict(steps[-1])} meanwhile"
    judge_mute_time(board, latch_us, header, _HOLD_MS + ramp_ms, name)


def _length_of_long_ramp_ms(board: BoardClient) -> int:
    """Return a ramp in which many frames can be sent."""
    reads = 25 * (2 * board.identity.transducers + 150)
    return _LONG_MS // 2 if board.wire.carries(reads, _LONG_MS * _MS // 4) else _LONG_MS


# --- How a ramp ends ---------------------------------------------------------------------------


@case("HG-6.11/4-settings", needs=_RAMPS_NEED, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def undone_ramps_take_the_new_ceiling(board: BoardClient) -> None:
    """a ramp that is undone leads to full amplitude below the ceiling that was set in it"""
    send_phases_to_store_if_supported(board, _SEQUENCE, frames=1)
    timers = ["hold", "lease", "both", "both, the lease first"]
    timers += ["unattended"] if board.has(Feature.SEQUENCE_PHASES) else []
    for first, then in ((100, FULL), (FULL, 100)):
        for timer in timers if first < then or board.wire.is_virtual else timers[:1]:
            _undo_ramp_with_settings(board, timer, first, then)


def _undo_ramp_with_settings(board: BoardClient, timer: str, first: int, then: int) -> None:
    """Set another ceiling in a ramp, and judge what is radiated when the ramp is undone."""
    long = {"hold_ms": 5000, "host_timeout_ms": 10_000, "ramp_ms": _LONG_MS}
    short = {
        "hold": {"hold_ms": _HOLD_MS},
        "lease": {"host_timeout_ms": 2 * _HOLD_MS},
        "both": {"hold_ms": _HOLD_MS, "host_timeout_ms": 2 * _HOLD_MS},
        "both, the lease first": {"hold_ms": 3 * _HOLD_MS, "host_timeout_ms": 2 * _HOLD_MS},
        "unattended": {},
    }[timer]
    board.hello()  # ends a playback
    board.arm(**long | short | {"amplitude_ceiling": first})
    if timer == "unattended":
        play_now(board, _SEQUENCE, loops=0, period_us=9_000_000, unattended_ms=2 * _HOLD_MS)
        board.clock.wait_latched()
        latched = bytes([FULL]) * board.identity.transducers
    else:
        latched = _latch_before_ramp(board, plays=False)
    latch_us = board.last_latch_us()
    frame_us = board.clock.device_us()
    board.wire.idle(5 * _HOLD_MS * _MS)
    board.configure(**long | {"amplitude_ceiling": then})
    if timer == "hold":
        latch_now(board, Drives(bytes(len(latched)) + latched))
    if timer.startswith("both"):  # the hold has run out: the ramp goes on, as it began
        start_us = latch_us + short["hold_ms"] * _MS
        if "lease" in timer:
            start_us = frame_us + short["host_timeout_ms"] * _MS
        reading = judged_ramp_reading(board, start_us)
        begins = _below_ceiling(latched, first)
        name = f"a ramp of {timer}, ceiling {first}, then {then}: "
        judge_straight_ramp(board, [reading], _LONG_MS, begins, name, cut=then)
        return
    shown = read_back_radiated(board)
    board.clock.require_before(latch_us + _LONG_MS * _MS, "a read-back in a ramp")
    due = _below_ceiling(latched, then)
    wrong = [(n, got) for n, got in enumerate(shown.amplitudes) if got != due[n]]
    judge_in_time(
        board,
        not wrong,
        f"a ramp of {timer} under a ceiling of {first} is undone, {then} was set in it: "
        f"of transducers and amplitudes {wrong[:3]} are not min({list(latched[:3])}..., {then})",
    )
