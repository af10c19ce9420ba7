"""The course of a soak: counts of each interval of its virtual time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import astuple, dataclass
from typing import Final

_NS_PER_S: Final = 1_000_000_000


@dataclass(slots=True)
class SoakCourseInterval:
    """Counts of one interval of virtual time.

    Attributes
    ----------
    frames : int
        Stream frames that were sent.
    damaged, lost, late : int
        Damaged frames that either end found; stream frames that never came to the board; those
        that came after their time.
    latest_us : int
        By which the latest of them came after its time.
    violations : int
        Events that must not happen.
    """

    frames: int = 0
    damaged: int = 0
    lost: int = 0
    late: int = 0
    latest_us: int = 0
    violations: int = 0

    def plus(self, other: SoakCourseInterval) -> SoakCourseInterval:
        """Return the counts of both."""
        both = SoakCourseInterval(*map(sum, zip(astuple(self), astuple(other), strict=True)))
        both.latest_us = max(self.latest_us, other.latest_us)
        return both


#: Intervals of which something was counted, by number.
SoakCourse = dict[int, SoakCourseInterval]


def joined_course(one: SoakCourse, other: SoakCourse) -> SoakCourse:
    """Return the course of both; an interval that two segments share has the counts of both."""
    nothing = SoakCourseInterval()
    numbers = sorted(one.keys() | other.keys())
    return {n: one.get(n, nothing).plus(other.get(n, nothing)) for n in numbers}


class CourseTaker:
    """Divides counts that only grow among the intervals in which they grew.

    Parameters
    ----------
    course : SoakCourse
        Takes the intervals.
    count : callable
        Returns the counts until now.
    start_s : float
        Virtual time before the segment.
    interval_s : float
        Length of an interval.
    """

    def __init__(
        self,
        course: SoakCourse,
        count: Callable[[], SoakCourseInterval],
        start_s: float,
        interval_s: float,
    ) -> None:
        self._course, self._count = course, count
        self._start_ns, self._interval_ns = round(start_s * _NS_PER_S), interval_s * _NS_PER_S
        self._before = SoakCourseInterval()
        self._open(0)

    def advance_to(self, now_ns: int) -> None:
        """Take note that the segment has come to *now_ns* after its begin."""
        if now_ns >= self._end_ns:
            self.close()
            self._open(now_ns)

    def close(self) -> None:
        """Count for the open interval what came since the last one."""
        now, before = self._count(), self._before
        grown = SoakCourseInterval(
            *(a - b for a, b in zip(astuple(now), astuple(before), strict=True))
        )
        grown.latest_us, now.latest_us = now.latest_us, 0
        if grown != SoakCourseInterval():
            self._course.update(joined_course(self._course, {self._number: grown}))
        self._before = now

    def _open(self, now_ns: int) -> None:
        self._number = int((self._start_ns + now_ns) // self._interval_ns)
        self._end_ns = (self._number + 1) * self._interval_ns - self._start_ns
