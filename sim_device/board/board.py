"""The board: registers, double buffer, timers.  No bytes, no wire, no clock.

Time is an argument: unwrapped device microseconds. What happens by itself happens in
:meth:`Board.advance_to`, at its own time and in order of time, so any partition of a span gives
the same result. A request to the board takes effect at the time it was last advanced to, after
everything that was due then.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from haptogram.acoustics import Drive
from haptogram.settings.frozen import dataclass
from haptogram_protocol import messages as m
from haptogram_protocol.state import OutputState

from .configuration import board_config_crc, check_board_config
from .counters import BoardArrivalMargins, Drop
from .events import PlaybackEnd, SessionOpened
from .output import BoardOutput, Due
from .playback import BoardPlayback
from .refusal import RefusalError
from .registers import BoardFocuser, Content
from .settings import BoardSettings
from .stream_queue import BoardQueue, QueueEntry, StreamFrame
from .timers import BoardTimers
from .uploads import BoardUploads, Upload


@dataclass(frozen=True, slots=True)
class BoardParts:
    """The parts of a board; each is the healthy one unless another is given."""

    output: type[BoardOutput] = BoardOutput
    timers: type[BoardTimers] = BoardTimers
    queue: type[BoardQueue] = BoardQueue
    uploads: type[BoardUploads] = BoardUploads
    focuser: type[BoardFocuser] = BoardFocuser


_HEALTHY: Final = BoardParts()


class Board:
    """One virtual board, from its power-up on.

    Parameters
    ----------
    settings : BoardSettings
        Hardware and limits.
    parts : BoardParts
        Its parts.

    Attributes
    ----------
    output : BoardOutput
        Output state, registers and timers.
    margins : Margins
        Arrival margin of stream frames.
    last_stream_index : int
        Unwrapped sequence number of the last latched stream frame, 0: none in this session.
    """

    def __init__(self, settings: BoardSettings, parts: BoardParts = _HEALTHY) -> None:
        self.settings = settings
        self.output = parts.output(settings, self._stop_sources, timers=parts.timers)
        self.margins = BoardArrivalMargins()
        self.last_stream_index = 0
        self._queue = parts.queue(settings.queue_depth)
        self._focuser_of = parts.focuser
        self._focuser = self._focuser_of(settings, self.output.config.sound_speed_mm_s)
        self._uploads = parts.uploads(settings)
        self._sequences: dict[int, Upload] = {}
        self._playback: BoardPlayback | None = None
        self._computed_us = settings.boot_us

    # --- output --------------------------------------------------------------------------------

    def arm(self) -> None:
        """Allow output; see :meth:`BoardOutput.arm`."""
        self.output.arm()

    def mute(self, *, requested: bool = True) -> None:
        """Switch the output off; see :meth:`BoardOutput.mute`."""
        self.output.mute(requested=requested)

    def disarm(self) -> None:
        """Switch the output off and forbid it."""
        self.output.disarm()

    # --- time ----------------------------------------------------------------------------------

    def next_event_us(self) -> int | None:
        """Return when something happens next by itself, or None."""
        due = self._next_due()
        return None if due is None else max(due[0], self.output.now_us)

    def advance_to(self, t_us: int) -> int | None:
        """Let everything happen that is due up to *t_us*, that moment included.

        Returns
        -------
        int or None
            When something happens next by itself; None: nothing does.

        Raises
        ------
        ValueError
            If time would run backwards.
        """
        self._refuse_past(t_us)
        while (due := self._next_due()) is not None and due[0] <= t_us:
            self.output.now_us = max(self.output.now_us, due[0])
            due[1]()
        self.output.now_us = t_us
        return None if due is None else due[0]

    def play_to(self, t_us: int) -> None:
        """Latch the frames of a playback that are due up to *t_us*, until anything else is due.

        The last one is left, as it ends the playback, and one that is due at the same time.
        """
        playback = self._playback
        while playback is not None and not playback.ends_next:
            due_us, action = self._next_due() or (t_us + 1, self._latch_playback)
            if due_us > t_us or action != self._latch_playback:
                return
            timer = self.output.next_timer()
            if timer is not None and timer[0] == due_us:
                return
            self.output.now_us = due_us
            self._latch_playback()

    def idle_to(self, t_us: int) -> None:
        """Let time pass in which nothing is due.

        Raises
        ------
        ValueError
            If time would run backwards.
        """
        self._refuse_past(t_us)
        self.output.now_us = t_us

    def _refuse_past(self, t_us: int) -> None:
        """Raise ValueError if *t_us* is before the present time of the board."""
        if t_us < self.output.now_us:
            raise ValueError(f"board is at {self.output.now_us} µs, cannot go back to {t_us} µs")

    def _next_due(self) -> Due | None:
        """Return (time in µs, action) of what is due next; None if nothing is.

        A latch comes before a timer of the same time.
        """
        due = self.output.next_timer()
        if self._playback is not None:
            due_us = self.output.boundary_us(self._playback.due_us)
            if due is None or due_us <= due[0]:
                due = due_us, self._latch_playback
        head = self._queue.head
        if head is not None and (due is None or head.t_latch_us <= due[0]):
            due = head.t_latch_us, self._latch_stream
        return due

    # --- session -------------------------------------------------------------------------------

    def open_session(self, nonce: int) -> None:
        """Begin a session: output off, queue and trace empty; sequences and settings stay."""
        self.output.begin_session(nonce)
        self._uploads.abandon()
        self.last_stream_index = 0
        self.output.note(SessionOpened(self.output.now_us, nonce))

    def _stop_sources(self) -> None:
        """Flush the queue and end playback."""
        self.output.counters.flushed += self._queue.flush()
        self._end_playback()

    # --- stream --------------------------------------------------------------------------------

    def submit(self, frame: StreamFrame) -> Drop | None:
        """Queue a stream frame; return why not, if it was dropped (and counted)."""
        dropped = self._refuse(frame)
        if dropped is not None:
            self.output.counters.drop(dropped)
            return dropped
        if frame.t_apply_us is None:
            self.output.counters.flushed += self._queue.flush()
        entry = self._entry(frame)
        self._computed_us = entry.t_ready_us - self.settings.latch_lead_us
        self.output.counters.accepted += 1
        self.output.counters.flushed += self._queue.push(entry)
        if entry.t_latch_us <= self.output.now_us:  # its boundary is this very moment
            self.advance_to(self.output.now_us)
        return None

    @property
    def undisturbed_until_us(self) -> int:
        """Until when :meth:`take_run` is possible: nothing but latches is due before."""
        if self.output.state is not OutputState.ARMED or self.output.is_ramping or self.is_playing:
            return 0
        timer = self.output.next_timer()
        held_us = self.output.now_us + 1000 * self.output.config.hold_ms  # a latch begins a hold
        return held_us if timer is None else min(timer[0], held_us)

    def take_run(self, frames: Sequence[tuple[int, StreamFrame]]) -> list[QueueEntry]:
        """Queue frames, each when it came, as :meth:`submit` does; return latches passed over.

        Each carries a drive, comes in time, has a boundary of its own and finds room.  Of the
        latches until the last one came, the last is carried out; those before are counted.
        """
        output, carrier_us = self.output, self.settings.carrier_us
        for t_us, frame in frames:
            ready_us, t_apply_us = t_us + self.settings.latch_lead_us, frame.t_apply_us or 0
            self.margins.add(t_apply_us - ready_us)
            latch_us = -(-t_apply_us // carrier_us) * carrier_us
            drive, bits = self._focuser.registers(frame.content)
            entry = QueueEntry(
                frame.index, t_apply_us, ready_us, latch_us, False, t_us, drive, bits
            )
            self._queue.push(entry)
        self._computed_us = t_us = frames[-1][0]
        output.counters.accepted += len(frames)
        passed = self._queue.pass_over(t_us)
        output.count_latches(len(passed))
        output.counters.late += sum(entry.late for entry in passed)
        output.now_us = t_us
        output.renew_lease()
        if (head := self._queue.head) is not None and head.t_latch_us <= t_us:
            output.now_us = head.t_latch_us
            self._latch_stream()
            output.now_us = t_us
        return passed

    @property
    def queued(self) -> int:
        """Stream frames that wait for their t_apply."""
        return len(self._queue)

    @property
    def last_apply_us(self) -> int:
        """The t_apply of the newest of them; 0: there is none."""
        return self._queue.last_apply_us

    def _refuse(self, frame: StreamFrame) -> Drop | None:
        """Return why a stream frame is dropped (state, order, room, time); None: it is accepted.

        The margin of a frame with a time is counted either way.
        """
        if self.output.state is not OutputState.ARMED or self._playback is not None:
            return Drop.STATE
        if frame.t_apply_us is None:
            return None
        margin_us = frame.t_apply_us - self._ready_us(frame.content)
        self.margins.add(margin_us)
        if not self._queue.precedes(frame.t_apply_us):
            return Drop.ORDER
        if self._queue.is_full:
            return Drop.FULL
        if frame.t_apply_us - self.output.now_us > self.settings.max_horizon_us:
            return Drop.FUTURE
        return Drop.LATE if -margin_us > self.output.config.late_window_us else None

    def _ready_us(self, content: Content) -> int:
        """Return the earliest latch time of a frame that arrives now, POINTS computed (HG-5.8).

        In µs of the device clock.
        """
        begins_us, settings = max(self.output.now_us, self._computed_us), self.settings
        if isinstance(content, Drive):
            return begins_us + settings.latch_lead_us
        return begins_us + len(content) * settings.point_time_us + settings.latch_lead_us

    def _entry(self, frame: StreamFrame) -> QueueEntry:
        """Return a frame as queue entry; its latch is due at its time or, without one, at once."""
        drive, bits = self._focuser.registers(frame.content)
        ready_us = self._ready_us(frame.content)
        t_apply_us = ready_us if frame.t_apply_us is None else frame.t_apply_us
        return QueueEntry(
            frame.index,
            t_apply_us,
            ready_us,
            self.output.boundary_us(max(t_apply_us, ready_us)),
            t_apply_us < ready_us,
            self.output.now_us,
            drive,
            bits,
        )

    def _latch_stream(self) -> None:
        """Latch the next frame of the queue."""
        entry = self._queue.pop()
        self.last_stream_index = entry.index
        self.output.counters.late += entry.late
        key = m.LatchKey(0, 0, entry.index & 0xFFFFFFFF)
        self.output.latch(
            key,
            entry.drive,
            entry.commanded_bits,
            late=entry.late,
            t_received_us=entry.t_received_us,
        )

    # --- settings and sequences ----------------------------------------------------------------

    @property
    def config_crc(self) -> int:
        """CRC-32 of configuration and phase correction."""
        return board_config_crc(self.output.config, self.output.correction)

    def configure(self, config: m.Config) -> None:
        """Put *config* in force, timers included.

        Raises
        ------
        RefusalError
            BAD_VALUE with the offset of the first value out of its bounds.
        """
        check_board_config(config, self.settings)
        if config.sound_speed_mm_s != self.output.config.sound_speed_mm_s:
            self._focuser = self._focuser_of(self.settings, config.sound_speed_mm_s)
        self.output.configure(config)
        self.advance_to(self.output.now_us)  # a shorter hold may have run out already

    def begin_upload(self, begin: m.UploadBegin) -> None:
        """Make room for an upload; see :meth:`BoardUploads.begin` for what is refused."""
        self._refuse_while_playing(begin.target)
        kept = sum(len(s.data) for n, s in self._sequences.items() if n != begin.target)
        self._uploads.begin(begin, self.settings.max_stored_bytes - kept)

    def store_chunk(self, chunk: m.UploadChunk) -> int:
        """Store a piece of an upload; return how many of its bytes are there."""
        self._refuse_without_upload()
        return self._uploads.chunk(chunk)

    def commit_upload(self, commit: m.UploadCommit) -> int:
        """Take the upload, whole; return how many frames, or transducers, it holds."""
        self._refuse_without_upload()
        if commit.target != self._uploads.target:
            raise RefusalError(m.ErrorCode.BAD_VALUE, 0)
        self._refuse_while_playing(commit.target)
        upload = self._uploads.commit()
        if upload.begin.kind is m.UploadKind.CORRECTION:
            self.output.correct(upload.data)
        else:
            self._sequences[commit.target] = upload
        self._uploads.abandon()
        return len(upload.data) if upload.begin.kind is m.UploadKind.CORRECTION else len(upload)

    def _refuse_without_upload(self) -> None:
        """Refuse a request (RefusalError BAD_STATE) if no upload is pending."""
        if self._uploads.target is None:
            raise RefusalError(m.ErrorCode.BAD_STATE, int(self.output.state))

    def _refuse_while_playing(self, sequence: int) -> None:
        """Refuse a request (RefusalError BAD_STATE) that would replace the sequence that plays."""
        if self._playback is not None and self._playback.sequence == sequence:
            raise RefusalError(m.ErrorCode.BAD_STATE, int(self.output.state))

    # --- playback ------------------------------------------------------------------------------

    @property
    def is_playing(self) -> bool:
        """True from PLAY to the end of the playback."""
        return self._playback is not None

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
        if self.output.state is not OutputState.ARMED or self._playback is not None:
            raise RefusalError(m.ErrorCode.BAD_STATE, int(self.output.state))
        frames = self._sequences.get(sequence)
        if frames is None:
            raise RefusalError(m.ErrorCode.NOT_FOUND, len(self._sequences))
        ready_us = self._ready_us(frames[0])
        self._check_period(period_us, frames[0])
        self._check_play(start_us, ready_us, unattended_ms)
        start_us = ready_us if start_us is None else start_us
        self.output.counters.flushed += self._queue.flush()
        self._playback = BoardPlayback(sequence, frames, start_us, period_us, loops, unattended_ms)
        self.output.unattended_ms = unattended_ms
        self.output.renew_lease()
        self.advance_to(self.output.now_us)

    def _check_period(self, period_us: int, content: Content) -> None:
        """Refuse a playback period (RefusalError BAD_VALUE) that is too short.

        It is for the board's highest rate, or for computing the points of *content*.
        """
        limits = self.settings
        points = 0 if isinstance(content, Drive) else len(content)
        too_fast = limits.max_playback_rate_hz * period_us < 1_000_000
        if too_fast or period_us < points * limits.point_time_us:
            raise RefusalError(m.ErrorCode.BAD_VALUE, m.Play.WIRE["period_us"].offset)

    def _check_play(self, start_us: int | None, ready_us: int, unattended_ms: int) -> None:
        """Refuse a PLAY (RefusalError BAD_VALUE) whose unattended time or start is out of limits.

        *start_us* may be from *ready_us*, the earliest latch, to the horizon; None: at once.
        """
        limits = self.settings
        if not 1 <= unattended_ms <= limits.max_unattended_ms:
            raise RefusalError(m.ErrorCode.BAD_VALUE, m.Play.WIRE["unattended_ms"].offset)
        last_us = self.output.now_us + limits.max_horizon_us
        if start_us is not None and not ready_us <= start_us <= last_us:
            raise RefusalError(m.ErrorCode.BAD_VALUE, 0)

    def stop(self) -> None:
        """End playback, if any; the last drive is held for ``hold_ms``."""
        if self._playback is not None:
            self._end_playback()
            self.output.renew_lease()

    def _latch_playback(self) -> None:
        """Latch the next frame of the playback; end it after the last one."""
        playback = self._playback
        if playback is None:
            return
        drive, bits = self._focuser.registers(playback.content)
        self.output.latch(playback.key, drive, bits, late=False)
        playback.played += 1
        if playback.is_over:
            self.stop()  # from here on the host timeout counts again

    def _end_playback(self) -> None:
        """End the playback, if one is under way, and note it."""
        if (ended := self._playback) is not None:
            self._playback, self.output.unattended_ms = None, None
            self.output.note(
                PlaybackEnd(self.output.now_us, ended.sequence, ended.loops_done, ended.played)
            )
