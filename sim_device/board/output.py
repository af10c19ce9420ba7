"""The output of a board: its state, the drive at the transducers, and the timers that silence it.

It happens at the time that :class:`~sim_device.board.board.Board` has come to; nothing here lets
time pass.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import TypeAlias

from haptogram.acoustics import Drive
from haptogram_protocol.errors import LocalProtocolError
from haptogram_protocol.messages import ErrorCode, Feature, LatchKey, TraceMode
from haptogram_protocol.state import MuteReason, OutputInput, OutputState, next_output_state

from .configuration import initial_config
from .counters import BoardCounters
from .events import Latch, Notice, RampBegan, RampEnded, StateChange
from .refusal import RefusalError
from .registers import radiated_drive
from .safety import NEVER_US, Safety
from .settings import BoardSettings

Due: TypeAlias = tuple[int, Callable[[], None]]  # when, and what happens then


class OutputStage:
    """What is common to everything that can be latched.

    Attributes
    ----------
    settings : BoardSettings
        What the board is.
    config : Config
        What the host set.
    correction : (N,) bytes
        Codes added to the phases that are radiated.
    state, reason
        Output state, and what led to it.
    session : int
        Session that is open, 0: none.
    latched : Latch or None
        The last latch of this session.
    counters : BoardCounters
        Counts since power-up.
    """

    def __init__(self, settings: BoardSettings) -> None:
        self.settings = settings
        self.config = initial_config(settings)
        self.correction = bytes(settings.count)
        self.state = OutputState.DISARMED
        self.reason = MuteReason.NEVER_ARMED
        self.session = 0
        self.latched: Latch | None = None
        self.counters = BoardCounters()
        self._now_us = settings.boot_us
        self._unattended_ms: int | None = None  # of the sequence that plays
        self._sounding = False
        self._ramping = False
        self._latches = 0
        self._last_boundary_us = settings.boot_us - settings.carrier_us
        self._silence = Drive.muted(settings.count)
        self._safety = Safety(graded=bool(settings.features & Feature.AMPLITUDE))
        self._ring: deque[Latch] = deque(maxlen=settings.trace_ring)
        self._new_latches: list[Latch] = []
        self._new_notices: list[Notice] = []

    @property
    def now_us(self) -> int:
        """Device time up to which everything has happened."""
        return self._now_us

    # --- state ---------------------------------------------------------------------------------

    def arm(self) -> None:
        """Allow output; it stays silent until the first latch.

        Raises
        ------
        RefusalError
            BAD_STATE in FAULT.
        """
        self._enter(OutputInput.ARM, MuteReason.NONE)
        self.renew_lease()

    def mute(self, *, requested: bool = True) -> None:
        """Switch the output off, whatever the state; *requested* by the host of the session."""
        self._enter(OutputInput.MUTE, MuteReason.MUTE, requested=requested)
        self._silence_output()

    def disarm(self) -> None:
        """Switch the output off and forbid it."""
        self._enter(OutputInput.DISARM, MuteReason.DISARM)
        self._silence_output()

    def find_fault(self) -> None:
        """Behave as after a hardware fault: output off until DISARM."""
        self._enter(OutputInput.FAULT_FOUND, MuteReason.FAULT, requested=False)
        self._silence_output()

    def renew_lease(self) -> None:
        """Take note that the host is there: a valid frame of its session came."""
        if self.state is OutputState.ARMED:
            self._safety.renew_lease(self._now_us, self.config, self._unattended_ms)
            self._end_ramp_if_restored()

    def _enter(self, event: OutputInput, reason: MuteReason, *, requested: bool = True) -> None:
        try:
            state = next_output_state(self.state, event)
        except LocalProtocolError as error:
            raise RefusalError(ErrorCode.BAD_STATE, int(self.state), str(error)) from error
        if state is not self.state:
            self.state, self.reason = state, reason
            self._new_notices.append(StateChange(self._now_us, state, reason, requested))
        elif event is OutputInput.MUTE:
            self.reason = reason  # somebody asked for it now: no host may take it for a pause

    def _silence_output(self) -> None:
        """Stop radiating, and forget the timers."""
        self._safety.disarm()
        self._sounding = False
        if self._ramping:
            self._ramping = False
            self._new_notices.append(RampEnded(self._now_us, restored=False))

    # --- timers --------------------------------------------------------------------------------

    def _timer(self) -> Due | None:
        """Return what the timers do next."""
        if not self._ramping and (begin_us := self._safety.first_deadline().deadline_us) < NEVER_US:
            return begin_us, self._begin_ramp
        end_us = self._safety.first_end().end_us
        return (end_us, self._time_out) if end_us < NEVER_US else None

    def _begin_ramp(self) -> None:
        self._ramping = True
        reason = self._safety.first_deadline().reason
        self._new_notices.append(RampBegan(self._now_us, reason))

    def _end_ramp_if_restored(self) -> None:
        if self._ramping and self._now_us < self._safety.first_deadline().deadline_us:
            self._ramping = False
            self._new_notices.append(RampEnded(self._now_us, restored=True))

    def _time_out(self) -> None:
        self.counters.timeouts += 1
        reason = self._safety.first_end().reason
        self._enter(OutputInput.RAMP_ENDED, reason, requested=False)
        self._silence_output()

    # --- latch ---------------------------------------------------------------------------------

    def _boundary_us(self, t_us: int) -> int:
        """Return the first free carrier boundary at or after *t_us* and now."""
        carrier_us = self.settings.carrier_us
        boundary_us = -(-max(t_us, self._now_us) // carrier_us) * carrier_us
        return max(boundary_us, self._last_boundary_us + carrier_us)

    def _latch(
        self,
        key: LatchKey,
        drive: Drive,
        bits: int,
        *,
        late: bool,
        t_received_us: int | None = None,
    ) -> None:
        """Swap the buffers: *drive* is at the transducers from now on."""
        self._enter(OutputInput.LATCH, MuteReason.NONE)
        self._sounding = True
        self._safety.latched(self._now_us, self.config)
        self._end_ramp_if_restored()
        latch = Latch(
            key=key,
            session=self.session,
            number=self._latches,
            t_latch_us=self._now_us,
            late=late,
            drive=drive,
            commanded_bits=bits,
            radiated=self._sound(self._radiate(drive, self._now_us)),
            ramping=self._safety.gain(self._now_us) < 1.0,
            t_received_us=t_received_us,
        )
        self.latched = latch
        self._last_boundary_us = self._now_us
        self._latches += 1
        self.counters.latched += 1
        self._new_latches.append(latch)
        if self.config.trace_mode is TraceMode.RING:
            self._ring.append(latch)

    # --- evidence ------------------------------------------------------------------------------

    @property
    def latches(self) -> int:
        """Latches in this session: the number that the next one will get."""
        return self._latches

    @property
    def ring(self) -> list[Latch]:
        """The latches that the trace ring holds, oldest first."""
        return list(self._ring)

    def radiated(self, t_us: int) -> Drive:
        """Return what leaves the transducers at *t_us*, now or before the next event."""
        if not self._sounding or self.latched is None:
            return self._silence
        return self._radiate(self.latched.drive, t_us)

    def _radiate(self, drive: Drive, t_us: int) -> Drive:
        gain = self._safety.gain(t_us)
        return radiated_drive(drive, self.correction, self.config.amplitude_ceiling, gain)

    def _sound(self, radiated: Drive) -> Drive:
        """Return what the transducers make of *radiated*; the board itself cannot know."""
        return radiated

    def take_latches(self) -> list[Latch]:
        """Return the latches since the last call, in order."""
        taken, self._new_latches = self._new_latches, []
        return taken

    def take_notices(self) -> list[Notice]:
        """Return changes of the output and ends of playback since the last call, in order."""
        taken, self._new_notices = self._new_notices, []
        return taken
