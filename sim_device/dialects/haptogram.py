"""The Haptogram wire protocol on one side, the board's operations on the other.

:class:`~haptogram_protocol.connection.BoardConnection` has judged every frame as far as a link can;
here its events become calls of the board, and what the board did becomes replies and events.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Final, TypeAlias

from haptogram_protocol import connection
from haptogram_protocol import messages as m
from haptogram_protocol.errors import RemoteProtocolError
from haptogram_protocol.framing import DELIMITER, end_of_frame

from ..board import answers
from ..board.board import Board
from ..board.clock import earliest_board_time
from ..board.events import Latch, Notice, PlaybackEnd, StateChange, StreamDropped
from ..board.refusal import RefusalError
from ..board.registers import Content, drive_of_registers
from ..board.stream_queue import QueueEntry, StreamFrame
from .virtual_dialect import VirtualDialect

OUTPUT_LIMIT: Final = 16_384  # half of it for traces: 27 ms of a line of 3 Mbaud
_TRACED_AT_ONCE: Final = (m.TraceMode.CRC, m.TraceMode.DRIVE)
_STATUS_LIMIT: Final = OUTPUT_LIMIT * 3 // 4  # the last quarter is for responses: HG-9.6

# What comes under which type: the tables see to it, so that the type checker need not.
_Handler: TypeAlias = Callable[[Any, connection.RequestReceived], m.Message]


class VirtualHaptogramDialect(VirtualDialect):
    """One board at the end of one line.

    Time is device time, unwrapped, as in :class:`Board`; bytes that come at a moment find
    everything done that was due at it.

    Parameters
    ----------
    board : Board
        The board.
    link : BoardConnection
        The board's end of the link.
    watch : callable, optional
        Called with every event of the link before the board acts on it.

    Attributes
    ----------
    line_free_us : int
        When the line has sent what was taken from here, so that a reply can tell the device time
        of its first byte. Whoever takes the output keeps it up to date.
    """

    def __init__(
        self,
        board: Board,
        link: connection.BoardConnection,
        watch: Callable[[connection.BoardEvent], None] | None = None,
    ) -> None:
        super().__init__(board.output.now_us)
        self.board = board
        self._link = link
        link.departure_us = lambda _: self._first_byte_us
        self._watch = watch
        self._trace_dropped = 0
        self._traced = 0
        self._next_status_us: int | None = None
        self._next_us: int | None = None  # next event, as long as nothing changes it
        self._is_next_known = False
        self._handlers: dict[type[m.Message], _Handler] = {
            m.Mute: self._mute,
            m.Ping: self._ping,
            m.GetStatus: lambda _, __: m.StatusReply(*self._status()),
            m.SetConfig: self._set_config,
            m.Play: self._play,
        }

    @property
    def now_us(self) -> int:
        """Time up to which everything has happened."""
        return self.board.output.now_us

    def next_frame_end(self, data: bytes, at: int) -> int:
        """Return the index after the next delimiter that may end a frame."""
        begins = not self._link.buffered and data.startswith(DELIMITER, at)
        return end_of_frame(data, at + begins)

    def next_event_us(self) -> int | None:
        """Return when something happens next by itself, or None."""
        if not self._is_next_known:
            self._next_us = earliest_board_time(self.board.next_event_us(), self._next_status_us)
            self._is_next_known = True
        return self._next_us

    def advance_to(self, t_us: int) -> None:
        """Let everything happen that is due up to *t_us*, and say so on the line."""
        while (next_us := self.next_event_us()) is not None and next_us <= t_us:
            due_us = self.board.advance_to(next_us)
            self.collect()
            if next_us == self._next_status_us:
                self._send_status(next_us)
            self._next_us = earliest_board_time(due_us, self._next_status_us)
        self.board.idle_to(t_us)

    def play_to(self, t_us: int) -> None:
        """Latch the frames of a playback up to *t_us*, of which the line hears nothing."""
        if self.board.output.config.trace_mode in _TRACED_AT_ONCE:
            return
        if self._next_status_us is not None:
            t_us = min(t_us, self._next_status_us - 1)
        self.board.play_to(t_us)
        self.collect()
        self._is_next_known = False

    def receive(self, data: bytes, t_us: int) -> None:
        """Take bytes whose last one is complete at *t_us*."""
        self.advance_to(t_us)
        self._is_next_known = False
        self._link.receive_data(data, t_us)
        while (event := self._link.next_event()) is not connection.NEED_DATA:
            self._act_on(event)
        self._is_next_known = False

    @property
    def next_stream_index(self) -> int:
        """Unwrapped number of the next stream frame, if none is lost."""
        return self._link.next_stream_index

    @property
    def quiet_until_us(self) -> int:
        """Until when :meth:`take_run` is possible: the line hears nothing, if nothing is traced."""
        until_us, status_us = self.board.undisturbed_until_us, self._next_status_us
        return until_us if status_us is None else min(until_us, status_us)

    def take_run(self, frames: Sequence[tuple[int, StreamFrame]]) -> list[QueueEntry]:
        """Take the next stream frames of the session without bytes; see :meth:`Board.take_run`."""
        passed = self.board.take_run(frames)
        self._link.skip_stream(len(frames))
        self.collect()
        self._is_next_known = False
        return passed

    def _act_on(self, event: connection.BoardEvent) -> None:
        """Report an event to the board's watcher, if any; carry it out; collect its effects."""
        if self._watch is not None:
            self._watch(event)
        self._dispatch(event)
        self.collect()

    def take_output(self, limit: int | None = None) -> bytes:
        """Return whole frames for the line, at most *limit* bytes if given."""
        return self._link.data_to_send(limit)

    @property
    def output_bytes(self) -> int:
        """Bytes that wait for the line."""
        return self._link.output_bytes

    def raise_hardware_fault(self) -> None:
        """Let the hardware fail now, and say so."""
        self._is_next_known = False
        self.board.output.raise_hardware_fault()
        self.collect()

    def power_down(self) -> None:
        """Mute the board for good, and say so."""
        self._is_next_known = False
        self.board.mute()
        self.advance_to(self.board.output.now_us)
        self.collect()

    @property
    def counters(self) -> dict[str, int]:
        """Every counter of HG-9.2 by name."""
        return answers.board_counters(self.board, self._link.counters, self._trace_dropped)

    # --- events of the link --------------------------------------------------------------------

    def _dispatch(self, event: connection.BoardEvent) -> None:
        """Renew the lease, then stream, greet or answer, by the kind of event."""
        if event.renews_lease:
            self.board.output.renew_lease()
        if isinstance(event, connection.StreamReceived):
            self._stream(event)
        elif isinstance(event, connection.RequestReceived) and isinstance(event.message, m.Hello):
            self._greet(event.message, event)
        elif isinstance(event, connection.RequestReceived):
            self._answer(event)

    def _stream(self, event: connection.StreamReceived) -> None:
        """Submit a stream frame to the board; count and note it if dropped."""
        dropped: str | None
        try:
            content = self.content(event.message)
        except RemoteProtocolError as error:
            self._link.count(dropped := error.reason)
        else:
            t_apply_us = self._unwrap(event.t_apply_us)
            dropped = self.board.submit(StreamFrame(event.index, t_apply_us, content))
        if dropped is not None:
            now_us, session = self.board.output.now_us, self.board.output.session
            self._notices.append(StreamDropped(now_us, session, event.index, str(dropped)))

    def content(self, message: m.Phases | m.Drives | m.Points) -> Content:
        """Return the content of a stream frame for the registers."""
        count = self.board.settings.count
        if isinstance(message, m.Points):
            if len(message.points) > self.board.settings.max_points:
                raise RemoteProtocolError("too many points")
            return message.points
        codes = m.drive_codes(message, count)
        assert codes is not None  # of PHASES and DRIVES
        return drive_of_registers(*codes)

    def _greet(self, hello: m.Hello, request: connection.RequestReceived) -> None:
        """Open a session at board and link, and reply with the board's identity."""
        self.board.open_session(hello.nonce)
        self._link.open_session(hello.nonce)
        self._traced = 0
        self._schedule_status()
        reply = answers.board_identity(self.board)
        self._link.reply(request, reply, self._first_byte_us)  # before any event of the session

    def _answer(self, request: connection.RequestReceived) -> None:
        """Carry out a request and send the reply, or the ERROR that the board refuses it with."""
        try:
            reply = self._reply_to(request.message, request)
        except RefusalError as refusal:
            self._link.refuse(request, refusal.code, refusal.detail, self._first_byte_us)
        else:
            self._link.reply(request, reply, self._first_byte_us)

    def _reply_to(self, message: m.Message, request: connection.RequestReceived) -> m.Message:
        """Carry out a request and return the reply."""
        if (own := self._handlers.get(type(message))) is not None:
            return own(message, request)
        return answers.ANSWERS[type(message)](self.board, message)

    def _unwrap(self, t_wire_us: int | None) -> int | None:
        """Return the device time nearest to now with these lowest 32 bits; None stays None."""
        return None if t_wire_us is None else m.unwrap(t_wire_us, self.board.output.now_us, 32)

    @property
    def _first_byte_us(self) -> int:
        """Device time at which the first byte of the next frame leaves."""
        baud = self.board.settings.line.baud
        waiting_us = 0 if baud is None else -(-self._link.output_bytes * 10_000_000 // baud)
        return max(self.board.output.now_us, self.line_free_us) + waiting_us

    # --- requests ------------------------------------------------------------------------------

    def _mute(self, _: m.Mute, request: connection.RequestReceived) -> m.Message:
        """Mute the board; a MUTE of another session counts as not requested by the host."""
        self.board.mute(requested=request.renews_lease)  # another session's surprises the host
        return m.MuteReply(self.board.output.state)

    def _ping(self, ping: m.Ping, request: connection.RequestReceived) -> m.Message:
        """Return PONG with the times at which PING came and PONG leaves."""
        t_rx_us, t_tx_us = (t & 0xFFFFFFFF for t in (request.t_rx_us, self._first_byte_us))
        return m.Pong(echo=ping.echo, t_rx_us=t_rx_us, t_tx_us=t_tx_us)

    def _set_config(self, message: m.SetConfig, _: connection.RequestReceived) -> m.Message:
        """Set the configuration; trace divider and STATUS period start anew."""
        self.board.configure(message.config)
        self._traced = 0
        self._schedule_status()
        return m.SetConfigReply(self.board.config_crc, self.board.output.config)

    def _play(self, play: m.Play, request: connection.RequestReceived) -> m.Message:
        """Start a playback at the request's time, or at once if it is IMMEDIATE."""
        self.board.play(
            play.sequence,
            start_us=None if request.immediate else self._unwrap(request.t_wire_us),
            period_us=play.period_us,
            loops=play.loops,
            unattended_ms=play.unattended_ms,
        )
        return m.PlayReply(self.board.output.state)

    # --- events of the board -------------------------------------------------------------------

    def collect(self) -> None:
        """Take from the board what it did since the last call, and tell the host."""
        output = self.board.output
        for latch in output.take_latches():
            self._latches.append(latch)
            self._trace(latch)
        for notice in output.take_notices():
            self._notices.append(notice)
            if (event := _notice_event(notice)) is not None:
                self._link.send_event(event, now_us=notice.t_us)

    def _trace(self, latch: Latch) -> None:
        """Send the trace event of a latch, if there is one; count it if the line has no room."""
        message = self._trace_message(latch)
        if message is not None:
            flags = m.Flag.LATE if latch.late else 0
            t_us = latch.t_latch_us
            sent = self._link.send_event(message, now_us=t_us, flags=flags, droppable=True)
            self._trace_dropped += not sent

    def _trace_message(self, latch: Latch) -> m.Message | None:
        """Return the trace event of a latch; None if the mode has none or the divider skips it."""
        config, key = self.board.output.config, latch.key
        if config.trace_mode is m.TraceMode.DRIVE:
            self._traced += 1
            due = (self._traced - 1) % config.trace_divider == 0
            data = answers.register_codes(latch.drive)
            return m.TraceDrive(key=key, data=data) if due else None
        if config.trace_mode is not m.TraceMode.CRC:
            return None
        if key.sequence:
            return m.TracePlayback(key=key, crc=latch.drive.digest())
        return m.Trace(index=key.index, crc=latch.drive.digest())

    def _schedule_status(self) -> None:
        """Set when the next STATUS is due; never if its period is 0."""
        period_us = self.board.output.config.status_period_ms * 1000
        self._next_status_us = self.board.output.now_us + period_us if period_us else None

    def _send_status(self, t_us: int) -> None:
        """Send STATUS, unless 12 288 bytes or more wait, and schedule the next."""
        if self._link.output_bytes < _STATUS_LIMIT:
            self._link.send_event(m.Status(*self._status()), now_us=t_us)
        self._schedule_status()

    def _status(self) -> answers.StatusFields:
        """Return the fields that STATUS and STATUS_REPLY share."""
        free = self.board.settings.rx_window
        return answers.board_status(self.board, self.counters, free_bytes=free)


def _notice_event(notice: Notice) -> m.Message | None:
    """Return the event message for *notice*; None for changes that the host requested."""
    if isinstance(notice, StateChange) and not notice.requested:
        return m.StateChanged(state=notice.state, reason=notice.reason)
    if isinstance(notice, PlaybackEnd):
        return m.PlaybackEnded(
            sequence=notice.sequence, loops=notice.loops, frames=notice.frames & 0xFFFFFFFF
        )
    return None
