"""The board: registers, double buffer, timers.  No bytes, no wire, no clock.

Time is an argument: unwrapped device microseconds. What happens by itself happens in
:meth:`Board.advance_to`, at its own time and in order of time, so any partition of a span gives
the same result. What is asked of the board happens at the time it was last advanced to, after
everything that was due then.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

from haptogram.acoustics import Drive
from haptogram_protocol.errors import LocalProtocolError
from haptogram_protocol.messages import (
    Config,
    ErrorCode,
    Feature,
    LatchKey,
    Play,
    TraceMode,
    UploadBegin,
    UploadChunk,
    UploadCommit,
    UploadKind,
)
from haptogram_protocol.state import MuteReason, OutputInput, OutputState, next_output_state

from .configuration import check_config, config_crc, initial_config
from .counters import BoardCounters, Drop, Margins
from .drives import Content, PointFocuser, radiated_drive
from .latch import Latch, Notice, PlaybackEnd, RampBegan, RampEnded, SessionOpened, StateChange
from .playback import Playback
from .refusal import RefusalError
from .safety import Safety
from .settings import BoardSettings
from .stream_queue import Entry, StreamQueue
from .uploads import Upload, Uploads

_Due: TypeAlias = tuple[int, Callable[[], None]]


@dataclass(frozen=True, slots=True)
class StreamFrame:
    """A stream frame, its values checked.

    Attributes
    ----------
    index : int
        Unwrapped sequence number.
    t_apply_us : int or None
        Unwrapped device time; None: as soon as possible, before everything that is queued.
    content : Content
        A drive in the resolution it was commanded in, or focal points.
    """

    index: int
    t_apply_us: int | None
    content: Content


class Board:
    """One virtual board, from its power-up on.

    Attributes
    ----------
    settings : BoardSettings
        What it is.
    config : Config
        What the host set.
    state, reason
        Output state, and what led to it.
    session : int
        Session that is open, 0: none.
    latched : Latch or None
        The last latch of this session.
    counters : BoardCounters
        Counts since power-up.
    margins : Margins
        Arrival margin of stream frames.
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
        self.margins = Margins()
        self._now_us = settings.boot_us
        self._sounding = False
        self._ramping = False
        self._latches = 0
        self._last_boundary_us = settings.boot_us - settings.carrier_us
        self._last_stream_index = 0
        self._silence = Drive.muted(settings.count)
        self._queue = StreamQueue(settings.queue_depth)
        self._safety = Safety(graded=bool(settings.features & Feature.AMPLITUDE))
        self._focuser = PointFocuser(settings, self.config.sound_speed_mm_s)
        self._uploads = Uploads(settings)
        self._sequences: dict[int, Upload] = {}
        self._playback: Playback | None = None
        self._ring: deque[Latch] = deque(maxlen=settings.trace_ring)
        self._new_latches: list[Latch] = []
        self._new_notices: list[Notice] = []

    # --- time ----------------------------------------------------------------------------------

    @property
    def now_us(self) -> int:
        """Device time up to which everything has happened."""
        return self._now_us

    def next_event_us(self) -> int | None:
        """Return when something happens next by itself, or None."""
        due = self._next_due()
        return None if due is None else max(due[0], self._now_us)

    def advance_to(self, t_us: int) -> None:
        """Let everything happen that is due up to *t_us*, that moment included.

        Raises
        ------
        ValueError
            If time would run backwards.
        """
        if t_us < self._now_us:
            raise ValueError(f"board is at {self._now_us} us, cannot go back to {t_us} us")
        while (due := self._next_due()) is not None and due[0] <= t_us:
            self._now_us = max(self._now_us, due[0])
            due[1]()
        self._now_us = t_us

    def _next_due(self) -> _Due | None:
        """Return what happens next; at one time, latches come before timers."""
        due: list[_Due] = []
        if (head := self._queue.head) is not None:
            due.append((head.t_latch_us, self._latch_stream))
        if self._playback is not None:
            due.append((self._boundary_us(self._playback.due_us), self._latch_playback))
        if self.state is OutputState.ARMED:
            due += self._timers()
        return min(due, key=lambda event: event[0], default=None)

    def _timers(self) -> list[_Due]:
        due: list[_Due] = []
        first = self._safety.first_deadline()
        if first is not None and first.deadline_us is not None and not self._ramping:
            due.append((first.deadline_us, self._begin_ramp))
        first = self._safety.first_end()
        if first is not None and first.end_us is not None:
            due.append((first.end_us, self._time_out))
        return due

    def _boundary_us(self, t_us: int) -> int:
        """Return the first free carrier boundary at or after *t_us* and now."""
        carrier_us = self.settings.carrier_us
        boundary_us = -(-max(t_us, self._now_us) // carrier_us) * carrier_us
        return max(boundary_us, self._last_boundary_us + carrier_us)

    # --- session and output state --------------------------------------------------------------

    def open_session(self, nonce: int) -> None:
        """Begin a session: output off, queue and trace empty; sequences and settings stay."""
        self._enter(OutputInput.NEW_SESSION, MuteReason.NEW_SESSION)
        self._silence_output()
        self._uploads.abandon()
        self.session, self.latched = nonce, None
        self._latches = self._last_stream_index = 0
        self._ring.clear()
        self._new_notices.append(SessionOpened(self._now_us, nonce))

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
            unattended_ms = self._playback.unattended_ms if self._playback else None
            self._safety.renew_lease(self._now_us, self.config, unattended_ms)
            self._end_ramp_if_restored()

    def _enter(self, event: OutputInput, reason: MuteReason, *, requested: bool = True) -> None:
        try:
            state = next_output_state(self.state, event)
        except LocalProtocolError as error:
            raise RefusalError(ErrorCode.BAD_STATE, int(self.state), str(error)) from error
        if state is not self.state:
            self.state, self.reason = state, reason
            self._new_notices.append(StateChange(self._now_us, state, reason, requested))

    def _silence_output(self) -> None:
        """Empty both buffers and stop whatever could fill them."""
        self.counters.flushed += self._queue.flush()
        self._end_playback()
        self._safety.disarm()
        self._sounding = False
        if self._ramping:
            self._ramping = False
            self._new_notices.append(RampEnded(self._now_us, restored=False))

    # --- timers --------------------------------------------------------------------------------

    def _begin_ramp(self) -> None:
        first = self._safety.first_deadline()
        if first is not None:
            self._ramping = True
            self._new_notices.append(RampBegan(self._now_us, first.reason))

    def _end_ramp_if_restored(self) -> None:
        first = self._safety.first_deadline()
        burning = first is not None and (first.deadline_us or 0) <= self._now_us
        if self._ramping and not burning:
            self._ramping = False
            self._new_notices.append(RampEnded(self._now_us, restored=True))

    def _time_out(self) -> None:
        first = self._safety.first_end()
        if first is not None:
            self.counters.timeouts += 1
            self._enter(OutputInput.RAMP_ENDED, first.reason, requested=False)
            self._silence_output()

    # --- stream --------------------------------------------------------------------------------

    def submit(self, frame: StreamFrame) -> Drop | None:
        """Queue a stream frame; return why not, if it was dropped (and counted)."""
        dropped = self._refuse(frame)
        if dropped is not None:
            self.counters.drop(dropped)
            return dropped
        if frame.t_apply_us is None:
            self.counters.flushed += self._queue.flush()
        self.counters.flushed += self._queue.push(self._entry(frame))
        self.advance_to(self._now_us)  # its boundary may be this very moment
        return None

    @property
    def queued(self) -> int:
        """Stream frames that wait for their t_apply."""
        return len(self._queue)

    def _refuse(self, frame: StreamFrame) -> Drop | None:
        if self.state is not OutputState.ARMED or self._playback is not None:
            return Drop.STATE
        if frame.t_apply_us is None:
            return None
        margin_us = frame.t_apply_us - self._now_us
        self.margins.add(margin_us)
        if not self._queue.precedes(frame.t_apply_us):
            return Drop.ORDER
        if self._queue.is_full:
            return Drop.FULL
        if margin_us > self.settings.max_horizon_us:
            return Drop.FUTURE
        return Drop.LATE if -margin_us > self.config.late_window_us else None

    def _entry(self, frame: StreamFrame) -> Entry:
        drive, bits = self._focuser.registers(frame.content)
        t_apply_us = self._now_us if frame.t_apply_us is None else frame.t_apply_us
        return Entry(
            index=frame.index,
            t_apply_us=t_apply_us,
            t_latch_us=self._boundary_us(t_apply_us),
            late=t_apply_us < self._now_us,
            drive=drive,
            commanded_bits=bits,
        )

    def _latch_stream(self) -> None:
        entry = self._queue.pop()
        self._last_stream_index = entry.index
        self.counters.late += entry.late
        key = LatchKey(sequence=0, loop=0, index=entry.index)
        self._latch(key, entry.drive, entry.commanded_bits, late=entry.late)

    def _latch(self, key: LatchKey, drive: Drive, bits: int, *, late: bool) -> None:
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
            radiated=self._radiate(drive, self._now_us),
            ramping=self._safety.gain(self._now_us) < 1.0,
        )
        self.latched = latch
        self._last_boundary_us = self._now_us
        self._latches += 1
        self.counters.latched += 1
        self._new_latches.append(latch)
        if self.config.trace_mode is TraceMode.RING:
            self._ring.append(latch)

    # --- settings and sequences ----------------------------------------------------------------

    @property
    def config_crc(self) -> int:
        """CRC-32 of configuration and phase correction."""
        return config_crc(self.config, self.correction)

    def configure(self, config: Config) -> None:
        """Put *config* in force, timers included.

        Raises
        ------
        RefusalError
            BAD_VALUE with the offset of the first value out of its bounds.
        """
        check_config(config, self.settings)
        if config.sound_speed_mm_s != self.config.sound_speed_mm_s:
            self._focuser = PointFocuser(self.settings, config.sound_speed_mm_s)
        self.config = config
        if self.state is OutputState.ARMED:
            self._safety.reconfigure(self._now_us, self._last_boundary_us, config)
            self.renew_lease()
            self.advance_to(self._now_us)  # a shorter hold may have run out already

    def begin_upload(self, begin: UploadBegin) -> None:
        """Make room for an upload; see :meth:`Uploads.begin` for what is refused."""
        self._refuse_while_playing(begin.target)
        kept = sum(len(s.data) for n, s in self._sequences.items() if n != begin.target)
        self._uploads.begin(begin, self.settings.max_stored_bytes - kept)

    def store_chunk(self, chunk: UploadChunk) -> int:
        """Store a piece of an upload; return the bytes from its start without a gap."""
        return self._uploads.chunk(chunk)

    def commit_upload(self, commit: UploadCommit) -> int:
        """Take the upload, whole; return how many frames, or transducers, it holds."""
        self._refuse_while_playing(commit.target)
        upload = self._uploads.commit(commit)
        if upload.begin.kind is UploadKind.CORRECTION:
            self.correction = upload.data
        else:
            self._sequences[commit.target] = upload
        self._uploads.abandon()
        return len(upload.data) if upload.begin.kind is UploadKind.CORRECTION else len(upload)

    def _refuse_while_playing(self, sequence: int) -> None:
        if self._playback is not None and self._playback.sequence == sequence:
            text = f"sequence {sequence} is playing"
            raise RefusalError(ErrorCode.BAD_STATE, int(self.state), text)

    # --- playback ------------------------------------------------------------------------------

    def play(
        self,
        sequence: int,
        *,
        start_us: int | None,
        period_us: int,
        loops: int,
        unattended_ms: int,
    ) -> None:
        """Play a sequence from *start_us* on (None: now); the stream queue is flushed.

        Raises
        ------
        RefusalError
            BAD_STATE unless armed and idle, NOT_FOUND, or BAD_VALUE.
        """
        if self.state is not OutputState.ARMED or self._playback is not None:
            busy = "while a sequence plays" if self._playback else f"while {self.state.name}"
            raise RefusalError(ErrorCode.BAD_STATE, int(self.state), f"PLAY {busy}")
        frames = self._sequences.get(sequence)
        if frames is None:
            held = len(self._sequences)
            raise RefusalError(ErrorCode.NOT_FOUND, held, f"no sequence {sequence}")
        self._check_play(start_us, period_us, unattended_ms)
        start_us = self._now_us if start_us is None else start_us
        self.counters.flushed += self._queue.flush()
        self._playback = Playback(sequence, frames, start_us, period_us, loops, unattended_ms)
        self.renew_lease()
        self.advance_to(self._now_us)

    def _check_play(self, start_us: int | None, period_us: int, unattended_ms: int) -> None:
        limits = self.settings
        if not limits.max_playback_rate_hz * period_us >= 1_000_000:
            text = f"period of {period_us} us, limit {limits.max_playback_rate_hz} Hz"
            raise RefusalError(ErrorCode.BAD_VALUE, Play.WIRE["period_us"].offset, text)
        if not 1 <= unattended_ms <= limits.max_unattended_ms:
            text = f"unattended for {unattended_ms} ms, 1 to {limits.max_unattended_ms}"
            offset = Play.WIRE["unattended_ms"].offset
            raise RefusalError(ErrorCode.BAD_VALUE, offset, text)
        if start_us is not None and not 0 <= start_us - self._now_us <= limits.max_horizon_us:
            text = f"start in {start_us - self._now_us} us, 0 to {limits.max_horizon_us}"
            raise RefusalError(ErrorCode.BAD_VALUE, 0, text)

    def stop(self) -> None:
        """End playback, if any; the last drive is held for ``hold_ms``."""
        if self._playback is not None:
            self._end_playback()
            self.renew_lease()

    def _latch_playback(self) -> None:
        playback = self._playback
        if playback is None:
            return
        drive, bits = self._focuser.registers(playback.content)
        self._latch(playback.key, drive, bits, late=False)
        playback.played += 1
        if playback.is_over:
            self.stop()  # from here on the host timeout counts again

    def _end_playback(self) -> None:
        if (ended := self._playback) is not None:
            self._playback = None
            self._new_notices.append(
                PlaybackEnd(self._now_us, ended.sequence, ended.loops_done, ended.played)
            )

    # --- evidence ------------------------------------------------------------------------------

    @property
    def last_stream_index(self) -> int:
        """Unwrapped sequence number of the last latched stream frame, 0: none."""
        return self._last_stream_index

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

    def take_latches(self) -> list[Latch]:
        """Return the latches since the last call, in order."""
        taken, self._new_latches = self._new_latches, []
        return taken

    def take_notices(self) -> list[Notice]:
        """Return changes of the output and ends of playback since the last call, in order."""
        taken, self._new_notices = self._new_notices, []
        return taken
