"""Limits that both drivers set to the time of a hold and to the frames of a stream."""

from __future__ import annotations

from typing import Final

from haptogram.settings import arguments

_MOST_STREAMED: Final = 10_000_000  # frames in one call: each leaves 64 bytes in its report
_LONGEST_SPIN_US: Final = 1_000_000
_LONGEST_HOLD_S: Final = 1e7


def check_hold_duration(seconds: float) -> None:
    """Refuse to hold a focus for a time that is none, or too long."""
    arguments.check_number("seconds", seconds, 0.0, _LONGEST_HOLD_S)


def check_stream_timing(
    loops: int, spin_us: int, progress: arguments.Progress | None, *, realtime: bool
) -> tuple[int, int]:
    """Return *loops* and *spin_us*; refuse arguments of any stream before its frames are made."""
    loops = arguments.check_whole("loops", loops, 1, _MOST_STREAMED)
    spin_us = arguments.check_whole("spin_us", spin_us, 0, _LONGEST_SPIN_US)
    arguments.check_argument_kind("realtime", realtime, bool, "True or False")
    arguments.check_callable("progress", progress)
    return loops, spin_us


def check_streamed_frames(total: int) -> int:
    """Return *total*, the frames of all loops, or refuse it."""
    return arguments.check_whole("number of frames, all loops of them", total, 1, _MOST_STREAMED)
