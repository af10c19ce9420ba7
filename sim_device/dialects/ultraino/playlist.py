"""The patterns that an Arduino board of Ultraino runs along, each for its number of periods.

The firmware counts a pattern's periods and then takes the next pattern, or the first one after the
last duration that is not 0. A swap sets the pointer of the output back and not these two counters,
so that patterns and durations do not belong together until the list begins anew. A duration of 0 in
the first place, or one that is shortened below the periods that have passed, lasts until the
counter of 8 bits comes round. ``DriverMEGA.ino``, asiermarzo/Ultraino 3ad4bdf.
"""

from __future__ import annotations

from typing import Final

PERIOD_US: Final = 25
_COUNTER: Final = 256  # currentPeriods is a byte


class ArduinoPlaylist:
    """The pattern that is shown in each period of the carrier, counted from power-up.

    Parameters
    ----------
    patterns : int
        Patterns that there is room for.
    counts : bool
        True if the firmware counts periods; one that does not shows a pattern until it is told.

    Attributes
    ----------
    durations : bytes
        Periods of each pattern; the first 0 after the first pattern ends the list.
    pointer : int
        The pattern that is shown.
    """

    def __init__(self, patterns: int, *, counts: bool = True) -> None:
        self._counts = counts
        self.durations = bytes([1]) + bytes(patterns - 1)
        self.pointer = 0
        self._pattern = 0  # whose duration counts
        self._passed = 0  # of its periods, before the one at _at
        self._at = 0
        self._passes_to_tell = 0

    def next_change(self) -> int | None:
        """Return the period in which another pattern is shown next, or None.

        None also comes after the first whole pass: all others are the same.
        """
        if not (self._counts and self._passes_to_tell) or self._is_constant:
            return None
        return self._at + self._left

    def advance_to(self, period: int) -> bool:
        """Go on to the change at *period*; return whether the output changed."""
        before = self.pointer
        while self._at + self._left <= period:
            self._at += self._left
            self._complete()
            if not self._pattern:
                self._passes_to_tell = max(0, self._passes_to_tell - 1)
                break
        return self.pointer != before

    def skip_to(self, period: int) -> None:
        """Go on to *period* without reporting the changes on the way."""
        if not self._counts:
            return
        cycle = self._cycle()
        while (left := self._left) <= period - self._at:
            self._at += left
            self._complete()
            if not self._pattern:
                self._at += (period - self._at) // cycle * cycle
        self._passed += period - self._at
        self._at = period

    def commit(self, durations: bytes) -> None:
        """Take other durations from now on."""
        self.durations = durations
        self._passes_to_tell = 2

    def restart(self) -> None:
        """Show the first pattern; the counters go on."""
        self.pointer = 0
        self._passes_to_tell = 2

    def show(self, pattern: int) -> None:
        """Show *pattern*; this firmware counts no periods."""
        self.pointer = pattern

    @property
    def _left(self) -> int:
        """Periods until the pattern whose duration counts is complete, at least 1."""
        return (self.durations[self._pattern] - self._passed - 1) % _COUNTER + 1

    @property
    def _is_constant(self) -> bool:
        """True if only the first pattern is ever shown."""
        return not (self.pointer or self._pattern) and self._is_last(0)

    def _is_last(self, pattern: int) -> bool:
        return pattern + 1 == len(self.durations) or not self.durations[pattern + 1]

    def _complete(self) -> None:
        """Advance to the next pattern; return to the first one after the last."""
        self._passed = 0
        if self._is_last(self._pattern):
            self._pattern = self.pointer = 0
        else:
            self._pattern += 1
            self.pointer += 1

    def _cycle(self) -> int:
        """Return the length of the playlist in periods."""
        periods, pattern = self.durations[0] or _COUNTER, 0
        while not self._is_last(pattern):
            pattern += 1
            periods += self.durations[pattern]
        return periods
