"""Log of a board, one line per event."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from typing import Any, Final

from haptogram_protocol.state import MuteReason, OutputState

from .board import events

_LOG: Final = logging.getLogger(__name__)
#: Notices that a host can cause with its frames, without limit.
_FREQUENT: Final = (
    events.SessionOpened,
    events.StateChange,
    events.RampBegan,
    events.RampEnded,
    events.RadiatedAnew,
    events.PlaybackEnd,
    events.StreamDropped,
)
_SECOND_US: Final = 1_000_000
_ROOM_US: Final = 20 * _SECOND_US


class BoardNoticeLog:
    """A recorder that logs notices, and no latch.

    A host such as the conformance suite opens sessions and mutes a hundred times a second.  Where
    more than 20 such changes come within a few seconds, one a second is logged, with the number of
    those left out before it.  A fault of the hardware is always logged.

    Parameters
    ----------
    is_complete : bool
        Whether every notice is logged, however many there are.
    """

    def __init__(self, *, is_complete: bool) -> None:
        self._is_complete = is_complete
        self._room_us = _ROOM_US  # one notice takes a second of it, and time gives it back
        self._last_us = 0
        self._left_out = 0

    def latch(self, latch: events.AnyLatch) -> None:
        """Say nothing: there are a thousand a second."""

    def notice(self, notice: events.Notice) -> None:
        """Log a change of the output."""
        if self._is_optional(notice) and not self._is_within_rate(notice.t_us):
            self._left_out += 1
            return
        if self._left_out:
            _LOG.info("%d changes before this one are left out; -v logs all", self._left_out)
            self._left_out = 0
        _LOG.info("%s, at %d us", describe_board_notice(notice), notice.t_us)

    def _is_optional(self, notice: events.Notice) -> bool:
        """Return True for frequent notices, which a log that is not complete may omit."""
        is_fault = isinstance(notice, events.StateChange) and notice.state is OutputState.FAULT
        return isinstance(notice, _FREQUENT) and not is_fault and not self._is_complete

    def _is_within_rate(self, t_us: int) -> bool:
        """Return False if too many messages were logged lately; else count this one.

        Allowed is one a second, and 20 at once after a pause.
        """
        self._room_us = min(self._room_us + max(t_us - self._last_us, 0), _ROOM_US)
        self._last_us = t_us
        if self._room_us < _SECOND_US:
            return False
        self._room_us -= _SECOND_US
        return True


class BoardCountLog:
    """Logs the counters that have moved, every so often.

    Parameters
    ----------
    interval_ns : int
        Time between two lines.
    """

    def __init__(self, interval_ns: int) -> None:
        self._interval_ns = interval_ns
        self._next_ns = interval_ns
        self._last: dict[str, int] = {}

    def is_due(self, now_ns: int) -> bool:
        """Return True if the next line is due."""
        return now_ns >= self._next_ns

    def update(self, counters: Mapping[str, int], now_ns: int) -> None:
        """Log what has moved since the last line, if it is time."""
        if not self.is_due(now_ns):
            return
        self._next_ns = now_ns + self._interval_ns
        moved = [f"{name} {n}" for name, n in counters.items() if n != self._last.get(name, 0)]
        self._last = dict(counters)
        if moved:
            _LOG.info("counts: %s", ", ".join(moved))


def describe_board_notice(notice: events.Notice) -> str:
    """Return *notice* in words."""
    return _WORDS[type(notice)](notice)


def _logged_board_counts(notice: events.Counted) -> str:
    """Return counts as text for the log, such as "line faults: flip 3, drop 1"."""
    return f"{notice.what}: " + ", ".join(f"{name} {n}" for name, n in notice.counts.items())


def _logged_board_state(change: events.StateChange) -> str:
    """Return a state and its reason as text."""
    why = "" if change.reason is MuteReason.NONE else f": {_logged_board_reason(change)}"
    return change.state.name.lower() + why


def _logged_board_playback(ended: events.PlaybackEnd) -> str:
    """Return as text which sequence ended, after how many frames and loops."""
    played = f"{ended.frames} frames, {ended.loops} whole loops"
    return f"playback of sequence {ended.sequence} ended: {played}"


def _logged_board_reason(notice: events.StateChange | events.RampBegan) -> str:
    """Return the reason of a mute or ramp in words."""
    return notice.reason.name.lower().replace("_", " ")


_WORDS: Final[Mapping[type[events.Notice], Callable[[Any], str]]] = {
    events.SessionOpened: lambda notice: f"session {notice.session:#06x} opened",
    events.StateChange: _logged_board_state,
    events.RampBegan: lambda notice: f"ramp to silence began: {_logged_board_reason(notice)}",
    events.RadiatedAnew: lambda _: "another ceiling or correction",
    events.RampEnded: lambda n: "ramp undone: full output" if n.restored else "ramp ended: silence",
    events.PlaybackEnd: _logged_board_playback,
    events.PowerDown: lambda _: "told to end",
    events.Remark: lambda notice: notice.text,
    events.StreamDropped: lambda n: f"stream frame {n.index} dropped: {n.counter}",
    events.ClientLeft: lambda _: "the client left",
    events.WireCompared: lambda notice: (
        "the client speaks " + ("the board's wire" if notice.is_own else "an unknown wire")
    ),
    events.Counted: _logged_board_counts,
}
