"""The output of a board: its state, the drive at the transducers, and the timers that silence it.

Everything here happens at ``now_us``, which :class:`~sim_device.board.board.Board` advances.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import TypeAlias

from haptogram.acoustics import Drive
from haptogram_protocol.errors import LocalProtocolError
from haptogram_protocol.messages import Config, ErrorCode, Feature, LatchKey, TraceMode
from haptogram_protocol.state import MuteReason, OutputInput, OutputState, next_output_state

from .configuration import initial_board_config
from .counters import BoardCounters
from .events import Latch, Notice, RadiatedAnew, RampBegan, RampEnded, StateChange
from .refusal import RefusalError
from .registers import radiated_drive_of_registers
from .settings import BoardSettings
from .timers import FULL_CODE, NEVER_US, BoardTimers

Due: TypeAlias = tuple[int, Callable[[], None]]  # when, and the action


class BoardOutput:
    """Output state, registers, trace ring and timers of one board.

    Parameters
    ----------
    settings : BoardSettings
        Hardware and limits of the board.
    stop_sources : callable
        Stops the board's queue and playback, whose latches would end the silence.
    timers : type, keyword-only
        The timers.

    Attributes
    ----------
    now_us : int
        Device time up to which everything has happened.
    config : Config
        Configuration in force.
    correction : (N,) bytes
        Codes added to the phases that are radiated.
    unattended_ms : int or None
        Replaces the host timeout while a sequence plays.
    state, reason
        Output state, and the reason for it.
    session : int
        Session that is open, 0: none.
    latched : Latch or None
        The last latch of this session.
    counters : BoardCounters
        Counts since power-up.
    """

    def __init__(
        self,
        settings: BoardSettings,
        stop_sources: Callable[[], None],
        *,
        timers: type[BoardTimers] = BoardTimers,
    ) -> None:
        self.settings = settings
        self.now_us = settings.boot_us
        self.config = initial_board_config(settings)
        self.correction = bytes(settings.count)
        self.state = OutputState.DISARMED
        self.reason = MuteReason.NEVER_ARMED
        self.session = 0
        self.latched: Latch | None = None
        self.counters = BoardCounters()
        self.unattended_ms: int | None = None
        self._stop_sources = stop_sources
        self._sounding = False
        self._ramping = False
        self._latches = 0
        self._last_boundary_us = settings.boot_us - settings.carrier_us
        self._silence = Drive.muted(settings.count)
        self._timers = timers(graded=bool(settings.features & Feature.AMPLITUDE))
        self._ring: deque[Latch] = deque(maxlen=settings.trace_ring)
        self._new_latches: list[Latch] = []
        self._new_notices: list[Notice] = []

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
        self.silence()

    def disarm(self) -> None:
        """Switch the output off and forbid it."""
        self._enter(OutputInput.DISARM, MuteReason.DISARM)
        self.silence()

    def raise_hardware_fault(self) -> None:
        """Behave as after a hardware fault: output off until DISARM."""
        self._enter(OutputInput.FAULT_FOUND, MuteReason.FAULT, requested=False)
        self.silence()

    def begin_session(self, nonce: int) -> None:
        """Begin a session: output off, trace empty; configuration and correction stay."""
        self._enter(OutputInput.NEW_SESSION, MuteReason.NEW_SESSION)
        self.silence()
        self.session, self.latched, self._latches = nonce, None, 0
        self._ring.clear()

    def configure(self, config: Config) -> None:
        """Put *config* in force, timers included."""
        ceiling, self.config = self.config.amplitude_ceiling, config
        if self.state is OutputState.ARMED:
            self._timers.reconfigure(self.now_us, self._last_boundary_us, config)
            self.renew_lease()
        if ceiling != config.amplitude_ceiling:
            self._note_radiated()

    def correct(self, codes: bytes) -> None:
        """Put a phase correction in force."""
        self.correction = codes
        self._note_radiated()

    def _note_radiated(self) -> None:
        """Note that the radiated drive has changed; nothing if none is radiated."""
        if not self._sounding or self.latched is None:
            return
        drive, ramp = self.latched.drive, self._timers.ramp
        ceiling = FULL_CODE if ramp is None else ramp.ceiling
        full = radiated_drive_of_registers(drive, self.correction, ceiling)
        radiated = self.sounded(self._radiate(drive, self.now_us))
        cut = self.config.amplitude_ceiling
        self._new_notices.append(RadiatedAnew(self.now_us, radiated, full, cut))

    @property
    def is_ramping(self) -> bool:
        """True while the output fades."""
        return self._ramping

    def renew_lease(self) -> None:
        """Restart the host timeout: a valid frame of the session came."""
        if self.state is OutputState.ARMED:
            self._timers.renew_lease(self.now_us, self.config, self.unattended_ms)
            if self._ramping:
                self._end_ramp_if_restored()

    def _enter(self, event: OutputInput, reason: MuteReason, *, requested: bool = True) -> None:
        """Change the output state by *event*, note it with *reason*; BAD_STATE if not allowed.

        *requested* False: the host has not asked for it, so it is told.
        """
        try:
            state = next_output_state(self.state, event)
        except LocalProtocolError as error:
            raise RefusalError(ErrorCode.BAD_STATE, int(self.state)) from error
        if state is not self.state:
            self.state, self.reason = state, reason
            self._new_notices.append(StateChange(self.now_us, state, reason, requested))
        elif event is OutputInput.MUTE and state is OutputState.MUTED:
            self.reason = reason  # somebody asked for it now: no host may take it for a pause

    def silence(self) -> None:
        """Stop the sources of drives, the timers and the output."""
        self._stop_sources()
        self._timers.disarm()
        self._sounding = False
        if self._ramping:
            self._ramping = False
            self._new_notices.append(RampEnded(self.now_us, restored=False))

    # --- timers --------------------------------------------------------------------------------

    def next_timer(self) -> Due | None:
        """Return the next action of the timers, if the board is armed."""
        if self.state is not OutputState.ARMED:
            return None
        if self._timers.ramp is not None:
            return self._timers.ramp.ends_us, self._time_out
        begin_us = self._timers.first().deadline_us
        return (begin_us, self._begin_ramp) if begin_us < NEVER_US else None

    def _begin_ramp(self) -> None:
        """Begin to fade because the first timer has expired, and note the ramp's reason and end."""
        self._ramping = True
        ramp, reason = self._timers.begin_ramp(self.config), self._timers.first().reason
        self._new_notices.append(RampBegan(self.now_us, reason, ramp.ends_us))

    def _end_ramp_if_restored(self) -> None:
        """If renewed timers have ended the ramp, note that the output is restored."""
        if self._timers.ramp is None:
            self._ramping = False
            self._new_notices.append(RampEnded(self.now_us, restored=True))

    def _time_out(self) -> None:
        """Mute the output because a timer expired."""
        self.counters.timeouts += 1
        self._enter(OutputInput.RAMP_ENDED, self._timers.first().reason, requested=False)
        self.silence()

    # --- latch ---------------------------------------------------------------------------------

    def boundary_us(self, t_us: int) -> int:
        """Return the first free carrier boundary at or after *t_us* and now."""
        carrier_us = self.settings.carrier_us
        boundary_us = -(-max(t_us, self.now_us) // carrier_us) * carrier_us
        return max(boundary_us, self._last_boundary_us + carrier_us)

    def latch(
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
        self._timers.latched(self.now_us, self.config)
        if self._ramping:
            self._end_ramp_if_restored()
        latch = Latch(
            key,
            self.session,
            self._latches,
            self.now_us,
            late,
            drive,
            bits,
            self.sounded(self._radiate(drive, self.now_us)),
            self._timers.ramp is not None,
            t_received_us,
        )
        self.latched = latch
        self._last_boundary_us = self.now_us
        self._latches += 1
        self.counters.latched += 1
        self._new_latches.append(latch)
        if self.config.trace_mode is TraceMode.RING:
            self._ring.append(latch)

    def count_latches(self, count: int) -> None:
        """Count *count* latches that are passed over: another one follows at once."""
        self._latches += count
        self.counters.latched += count

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
        """Return the drive that leaves the transducers at *t_us*, now or before the next event."""
        if not self._sounding or self.latched is None:
            return self._silence
        return self._radiate(self.latched.drive, t_us)

    def _radiate(self, drive: Drive, t_us: int) -> Drive:
        """Return the radiated drive: corrected, limited to the ceiling, and faded."""
        return radiated_drive_of_registers(
            drive, self.correction, self.config.amplitude_ceiling, self._timers.fade(t_us)
        )

    def sounded(self, radiated: Drive) -> Drive:
        """Return the drive that the transducers sound, which the board itself cannot know."""
        return radiated

    def take_latches(self) -> list[Latch]:
        """Return the latches since the last call, in order."""
        taken, self._new_latches = self._new_latches, []
        return taken

    def note(self, notice: Notice) -> None:
        """Add a change for :meth:`take_notices`."""
        self._new_notices.append(notice)

    def take_notices(self) -> list[Notice]:
        """Return changes of the output and ends of playback since the last call, in order."""
        taken, self._new_notices = self._new_notices, []
        return taken
