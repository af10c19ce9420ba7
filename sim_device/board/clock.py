"""The board's clock: device microseconds for nanoseconds since power-up, and back.

All in whole numbers, so that both ways agree to the microsecond.
"""

from __future__ import annotations

from typing import Final

from haptogram.settings.frozen import dataclass

_MILLION: Final = 1_000_000
NS_PER_US: Final = 1_000
_PER_US: Final = _MILLION * NS_PER_US  # parts of a microsecond in which it counts: exact at any ppm


def earliest_board_time(*times: int | None) -> int | None:
    """Return the first of *times*; None stands for never."""
    first = None
    for t in times:
        if t is not None and (first is None or t < first):
            first = t
    return first


def whole_board_us(t_ns: int) -> int:
    """Return *t_ns* rounded up to the microseconds that the board counts in."""
    return -(-t_ns // NS_PER_US) * NS_PER_US


@dataclass(frozen=True, slots=True)
class ClockChange:
    """Change of a clock at ``at_ns`` since power-up: of its rate, and a jump."""

    at_ns: int
    ppm: int = 0
    step_us: int = 0


@dataclass(frozen=True, slots=True)
class BoardClock:
    """A clock that is fast by ``ppm``, and changes on its way; it never runs backwards.

    Attributes
    ----------
    boot_us : int
        Unwrapped device time at power-up.
    ppm : int
        Error of its rate, above -1 000 000 with any changes that there are at a time.
    changes : tuple of ClockChange
        In order of time; no jump is backwards.
    """

    boot_us: int
    ppm: int = 0
    changes: tuple[ClockChange, ...] = ()

    def device_us(self, t_ns: int) -> int:
        """Return the unwrapped device time at *t_ns*: whole microseconds that have passed."""
        if not self.ppm and not self.changes:
            return self.boot_us + t_ns // NS_PER_US
        parts = t_ns * (_MILLION + self.ppm)
        for change in self.changes:
            if t_ns >= change.at_ns:
                parts += (t_ns - change.at_ns) * change.ppm + change.step_us * _PER_US
        return self.boot_us + parts // _PER_US

    def reached_ns(self, device_us: int) -> int:
        """Return the first time at which the clock shows *device_us* or more."""
        if not self.ppm and not self.changes:
            return (device_us - self.boot_us) * NS_PER_US
        due, rate = (device_us - self.boot_us) * _PER_US, _MILLION + self.ppm
        t_ns = -(-due // rate)
        for change in self.changes:
            if t_ns < change.at_ns:
                break
            due += change.at_ns * change.ppm - change.step_us * _PER_US
            rate += change.ppm
            t_ns = max(change.at_ns, -(-due // rate))
        return t_ns
