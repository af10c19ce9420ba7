"""Oracle of the latches and silences that follow from the bytes that a board received.

It keeps no queue of its own.  A frame that comes in time is due on the first carrier period not
before its t_apply nor its arrival (HG-5.8/1); one that is too late is dropped (HG-5.7/5).
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Any, Final, Protocol

from haptogram_protocol.messages import Config, signed_difference

from .account.tally import SoakHit, SoakTally
from .drives import SoakDrives

_TOLERANCE_US: Final = 1000  # of every timer: HG-12.1/1


class SoakLatch(Protocol):
    """A latch, as the back door of a board shows it."""

    @property
    def session(self) -> int: ...  # noqa: D102  as in the board's own record
    @property
    def key(self) -> Any: ...  # noqa: D102
    @property
    def t_latch_us(self) -> int: ...  # noqa: D102
    @property
    def late(self) -> bool: ...  # noqa: D102
    @property
    def drive(self) -> Any: ...  # noqa: D102


@dataclass(frozen=True, slots=True)
class _Due:
    session: int
    index: int
    t_latch_us: int
    late: bool


class SoakOracle:
    """Follows one board.

    Parameters
    ----------
    show : Show
        Which drive each stream frame carries.
    carrier_us : int
        Carrier period.
    tally : SoakTally
        Where it takes down what is wrong.

    Attributes
    ----------
    config : Config
        The board's.
    is_sounding : bool
        Whether something was latched since the output was last off.
    last_latch_us, last_valid_us : int
        Device times of the last latch and of the last valid frame of the session.
    """

    def __init__(self, show: SoakDrives, carrier_us: int, tally: SoakTally) -> None:
        self.config = Config()
        self.is_sounding = False
        self.last_latch_us = self.last_valid_us = 0
        self._show, self._carrier_us, self._tally = show, carrier_us, tally
        self._due: deque[_Due] = deque()

    def came(
        self, session: int, index: int, t_apply_us: int, t_rx_us: int, cause: SoakHit | None
    ) -> None:
        """Take note that a stream frame came, undamaged and for the first time."""
        late_us = -signed_difference(t_apply_us, t_rx_us, 32)
        self._tally.latest_us = max(self._tally.latest_us, late_us)
        if late_us > 0 and cause is None:
            self._tally.violate("late without a cause", f"frame {index}, by {late_us} µs")
        if late_us > self.config.late_window_us:
            self._tally.totals["dropped_late"] += 1
            self._blame(cause, "dropped_late")
            return
        if late_us > 0:
            self._blame(cause, "late")
        first_us = t_rx_us - min(late_us, 0)
        boundary_us = -(-first_us // self._carrier_us) * self._carrier_us
        self._tally.totals["accepted"] += 1
        self._due.append(_Due(session, index, boundary_us, late_us > 0))

    def _blame(self, cause: SoakHit | None, name: str) -> None:
        if cause is not None:
            self._tally.find(cause, name)

    def latched(self, latch: SoakLatch) -> None:
        """Compare a latch with the next one that is due."""
        index = latch.key.index
        self.last_latch_us, self.is_sounding = latch.t_latch_us, True
        self._tally.totals["latched"] += 1
        self._tally.totals["late"] += latch.late
        if not self._due or (self._due[0].session, self._due[0].index) != (latch.session, index):
            wanted = f"frame {self._due[0].index} was due" if self._due else "none was due"
            self._tally.violate("wrong frame latched", f"frame {index}; {wanted}")
            return
        due = self._due.popleft()
        if (latch.t_latch_us, latch.late) != (due.t_latch_us, due.late):
            moved_us = latch.t_latch_us - due.t_latch_us
            self._tally.violate("latched at a wrong time", f"frame {index}, by {moved_us} µs")
        if not self._show.is_drive(index, latch.drive):
            self._tally.violate("torn latch", f"frame {index} is not the drive that was sent")

    def flush(self, now_us: int) -> None:
        """Take note that the output went off by request: what waits is gone.  HG-6.4, HG-4.6."""
        self._run_out(now_us)
        self._tally.totals["flushed"] += len(self._due)
        self._due.clear()
        self.is_sounding = False

    def check_overdue(self, now_us: int) -> None:
        """Take down a frame that should have been latched by now."""
        while self._due and self._due[0].t_latch_us < now_us:
            self._tally.violate("not latched", f"frame {self._due.popleft().index}")

    # --- silence (HG-12) -----------------------------------------------------------------------

    @property
    def fades_at_us(self) -> int:
        """When the first timer runs out, if nothing more comes."""
        hold_us = self.last_latch_us + self.config.hold_ms * 1000
        lease_us = self.last_valid_us + self.config.host_timeout_ms * 1000
        return min(hold_us, lease_us)

    @property
    def silent_at_us(self) -> int:
        """When the output is off then."""
        return self.fades_at_us + self.config.ramp_ms * 1000

    def heard(self, now_us: int) -> None:
        """Take note of a valid frame: the lease starts anew, unless it had run out for good."""
        self._run_out(now_us)
        self.last_valid_us = now_us

    def _run_out(self, now_us: int) -> None:
        """Take note of the mute by a timer that came before what comes now, and unseen."""
        if self.is_sounding and now_us >= self.silent_at_us:
            self._tally.totals["muted by a timer"] += 1
            self.is_sounding = False

    def check_output(self, now_us: int, *, silent: bool) -> None:
        """Compare what is heard at *now_us* with what the timers say."""
        if not self.is_sounding:
            if not silent:
                self._tally.violate("sounds when it is off", f"at {now_us} µs")
        elif silent and now_us < self.fades_at_us - _TOLERANCE_US:
            self._tally.violate("muted too early", f"{self.fades_at_us - now_us} µs before")
            self.is_sounding = False
        elif not silent and now_us > self.silent_at_us + _TOLERANCE_US:
            self._tally.violate("muted too late", f"{now_us - self.silent_at_us} µs after the end")
            self.is_sounding = False
        elif silent:
            self._run_out(now_us)
