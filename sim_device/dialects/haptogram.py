"""The Haptogram wire protocol on one side, the board's operations on the other.

:class:`~haptogram_protocol.connection.BoardConnection` has judged every frame as far as a link can;
here its events become calls of the board, and what the board did becomes replies and events.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final, TypeAlias

from haptogram_protocol import connection, messages
from haptogram_protocol.errors import RemoteProtocolError
from haptogram_protocol.framing import DELIMITER, end_of_frame

from ..board import readout
from ..board.board import Board
from ..board.clock import earliest_board_time
from ..board.events import Latch, Notice, PlaybackEnd, StateChange, StreamDropped
from ..board.refusal import RefusalError
from ..board.registers import Content, drive_of_registers
from ..board.stream_queue import StreamFrame

OUTPUT_LIMIT: Final = 16_384  # half of it for traces: 27 ms of a line of 3 Mbaud
_STATUS_LIMIT: Final = OUTPUT_LIMIT * 3 // 4  # the last quarter is for responses: HG-9.6

# What comes under which type: the table below sees to it, so that the type checker need not.
_Handler: TypeAlias = Callable[[Any, connection.RequestReceived], messages.Message]


class VirtualHaptogramDialect:
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

    ahead: Final = None
    announce: Final = None

    def __init__(
        self,
        board: Board,
        link: connection.BoardConnection,
        watch: Callable[[connection.BoardEvent], None] | None = None,
    ) -> None:
        self.board = board
        self.line_free_us = board.now_us
        self._link = link
        link.departure_us = lambda _: self._first_byte_us
        self._watch = watch
        self._trace_dropped = 0
        self._traced = 0
        self._next_status_us: int | None = None
        self._next_us: int | None = None  # next event, as long as nothing changes it
        self._is_next_known = False
        self._latches: list[Latch] = []
        self._notices: list[Notice] = []
        self._handlers: dict[type[messages.Message], _Handler] = {
            messages.Arm: self._arm,
            messages.Mute: self._mute,
            messages.Disarm: self._disarm,
            messages.Ping: self._ping,
            messages.GetStatus: lambda _, __: messages.StatusReply(*self._status()),
            messages.GetConfig: lambda _, __: messages.ConfigReply(board.config_crc, board.config),
            messages.SetConfig: self._set_config,
            messages.GetGeometry: lambda message, _: readout.board_geometry(
                board.settings, message
            ),
            messages.ReadDrive: lambda message, _: readout.board_drive(board, message),
            messages.ReadTrace: lambda message, _: readout.board_trace(board, message),
            messages.UploadBegin: self._begin_upload,
            messages.UploadChunk: self._store_chunk,
            messages.UploadCommit: self._commit_upload,
            messages.Play: self._play,
            messages.Stop: self._stop,
        }

    # --- time and bytes ------------------------------------------------------------------------

    @property
    def now_us(self) -> int:
        """Time up to which everything has happened."""
        return self.board.now_us

    @property
    def room_bytes(self) -> int | None:
        """Return None: nothing holds the host back."""
        return None

    def next_frame_end(self, data: bytes, at: int) -> int:
        """Return the index behind the next delimiter that may end a frame."""
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
            self._is_next_known = False
            self.board.advance_to(next_us)
            self.collect()
            if next_us == self._next_status_us:
                self._send_status(next_us)
        self.board.idle_to(t_us)

    def receive(self, data: bytes, t_us: int) -> None:
        """Take bytes whose last one is complete at *t_us*."""
        self.advance_to(t_us)
        self._is_next_known = False
        self._link.receive_data(data, t_us)
        while (event := self._link.next_event()) is not connection.NEED_DATA:
            if self._watch is not None:
                self._watch(event)
            self._dispatch(event)
            self.collect()
        self._is_next_known = False

    def take_output(self, limit: int | None = None) -> bytes:
        """Return whole frames for the line, at most *limit* bytes if given."""
        return self._link.data_to_send(limit)

    @property
    def output_bytes(self) -> int:
        """Bytes that wait for the line."""
        return self._link.output_bytes

    def take_latches(self) -> list[Latch]:
        """Return the latches since the last call, in order."""
        taken, self._latches = self._latches, []
        return taken

    def take_notices(self) -> list[Notice]:
        """Return the notices of the board since the last call, in order."""
        taken, self._notices = self._notices, []
        return taken

    def client_left(self) -> None:
        """Do nothing: a session ends by the lease, not with its port."""

    def raise_hardware_fault(self) -> None:
        """Let the hardware fail now, and say so."""
        self._is_next_known = False
        self.board.output.raise_hardware_fault()
        self.collect()

    def power_down(self) -> None:
        """Mute the board for good, and say so."""
        self._is_next_known = False
        self.board.mute()
        self.advance_to(self.board.now_us)
        self.collect()

    @property
    def counters(self) -> dict[str, int]:
        """Every counter of HG-9.2 by name."""
        return readout.board_counters(self.board, self._link.counters, self._trace_dropped)

    # --- events of the link --------------------------------------------------------------------

    def _dispatch(self, event: connection.BoardEvent) -> None:
        if event.renews_lease:
            self.board.output.renew_lease()
        if isinstance(event, connection.StreamReceived):
            self._stream(event)
        elif isinstance(event, connection.RequestReceived) and isinstance(
            event.message, messages.Hello
        ):
            self._greet(event.message, event)
        elif isinstance(event, connection.RequestReceived):
            self._answer(event)

    def _stream(self, event: connection.StreamReceived) -> None:
        dropped: str | None
        try:
            content = self._content(event.message)
        except RemoteProtocolError as error:
            self._link.count(dropped := error.reason)
        else:
            t_apply_us = self._unwrap(event.t_apply_us)
            dropped = self.board.submit(StreamFrame(event.index, t_apply_us, content))
        if dropped is not None:
            now_us, session = self.board.now_us, self.board.session
            self._notices.append(StreamDropped(now_us, session, event.index, str(dropped)))

    def _content(self, message: messages.Phases | messages.Drives | messages.Points) -> Content:
        count = self.board.settings.count
        if isinstance(message, messages.Points):
            _refuse_by_dialect_unless(
                len(message.points) <= self.board.settings.max_points, "too many points"
            )
            return message.points
        codes = messages.drive_codes(message, count)
        assert codes is not None  # of PHASES and DRIVES
        return drive_of_registers(*codes)

    def _greet(self, hello: messages.Hello, request: connection.RequestReceived) -> None:
        self.board.open_session(hello.nonce)
        self._link.open_session(hello.nonce)
        self._traced = 0
        self._schedule_status()
        reply = readout.board_identity(self.board)
        self._link.reply(request, reply, self._first_byte_us)  # before any event of the session

    def _answer(self, request: connection.RequestReceived) -> None:
        try:
            reply = self._handlers[type(request.message)](request.message, request)
        except RefusalError as refusal:
            self._link.refuse(request, refusal.code, refusal.detail, self._first_byte_us)
        else:
            self._link.reply(request, reply, self._first_byte_us)

    def _unwrap(self, t_wire_us: int | None) -> int | None:
        return None if t_wire_us is None else messages.unwrap(t_wire_us, self.board.now_us, 32)

    @property
    def _first_byte_us(self) -> int:
        """Device time at which the first byte of the next frame leaves."""
        baud = self.board.settings.line.baud
        waiting_us = 0 if baud is None else -(-self._link.output_bytes * 10_000_000 // baud)
        return max(self.board.now_us, self.line_free_us) + waiting_us

    # --- requests ------------------------------------------------------------------------------

    def _arm(self, _: messages.Arm, __: connection.RequestReceived) -> messages.Message:
        self.board.arm()
        return messages.ArmReply(self.board.state)

    def _mute(self, _: messages.Mute, request: connection.RequestReceived) -> messages.Message:
        self.board.mute(requested=request.renews_lease)  # another session's surprises the host
        return messages.MuteReply(self.board.state)

    def _disarm(self, _: messages.Disarm, __: connection.RequestReceived) -> messages.Message:
        self.board.disarm()
        return messages.DisarmReply(self.board.state)

    def _ping(self, ping: messages.Ping, request: connection.RequestReceived) -> messages.Message:
        t_rx_us, t_tx_us = (t & 0xFFFFFFFF for t in (request.t_rx_us, self._first_byte_us))
        return messages.Pong(echo=ping.echo, t_rx_us=t_rx_us, t_tx_us=t_tx_us)

    def _set_config(
        self, message: messages.SetConfig, _: connection.RequestReceived
    ) -> messages.Message:
        self.board.configure(message.config)
        self._traced = 0
        self._schedule_status()
        return messages.SetConfigReply(self.board.config_crc, self.board.config)

    def _begin_upload(
        self, begin: messages.UploadBegin, _: connection.RequestReceived
    ) -> messages.Message:
        self.board.begin_upload(begin)
        settings = self.board.settings
        return messages.UploadBeginReply(
            max_chunk=settings.max_chunk, window=settings.upload_window
        )

    def _store_chunk(
        self, chunk: messages.UploadChunk, _: connection.RequestReceived
    ) -> messages.Message:
        return messages.UploadChunkReply(received=self.board.store_chunk(chunk))

    def _commit_upload(
        self, commit: messages.UploadCommit, _: connection.RequestReceived
    ) -> messages.Message:
        return messages.UploadCommitReply(frames=self.board.commit_upload(commit))

    def _play(self, play: messages.Play, request: connection.RequestReceived) -> messages.Message:
        self.board.play(
            play.sequence,
            start_us=None if request.immediate else self._unwrap(request.t_wire_us),
            period_us=play.period_us,
            loops=play.loops,
            unattended_ms=play.unattended_ms,
        )
        return messages.PlayReply(self.board.state)

    def _stop(self, _: messages.Stop, __: connection.RequestReceived) -> messages.Message:
        self.board.stop()
        return messages.StopReply(self.board.state)

    # --- events of the board -------------------------------------------------------------------

    def collect(self) -> None:
        """Take from the board what it did since the last call, and tell the host."""
        for latch in self.board.take_latches():
            self._latches.append(latch)
            self._trace(latch)
        for notice in self.board.take_notices():
            self._notices.append(notice)
            if (event := _event_of_notice(notice)) is not None:
                self._link.send_event(event, now_us=notice.t_us)

    def _trace(self, latch: Latch) -> None:
        """Send a trace event for a latch, if tracing is on."""
        message = self._trace_message(latch)
        if message is not None:
            flags = messages.Flag.LATE if latch.late else 0
            t_us = latch.t_latch_us
            sent = self._link.send_event(message, now_us=t_us, flags=flags, droppable=True)
            self._trace_dropped += not sent

    def _trace_message(self, latch: Latch) -> messages.Message | None:
        config, key = self.board.output.config, latch.key
        if config.trace_mode is messages.TraceMode.DRIVE:
            self._traced += 1
            due = (self._traced - 1) % config.trace_divider == 0
            data = readout.register_codes(latch.drive)
            return messages.TraceDrive(key=key, data=data) if due else None
        if config.trace_mode is not messages.TraceMode.CRC:
            return None
        if key.sequence:
            return messages.TracePlayback(key=key, crc=latch.drive.digest())
        return messages.Trace(index=key.index, crc=latch.drive.digest())

    def _schedule_status(self) -> None:
        period_us = self.board.config.status_period_ms * 1000
        self._next_status_us = self.board.now_us + period_us if period_us else None

    def _send_status(self, t_us: int) -> None:
        if self._link.output_bytes < _STATUS_LIMIT:
            self._link.send_event(messages.Status(*self._status()), now_us=t_us)
        self._schedule_status()

    def _status(self) -> readout.StatusFields:
        free = self.board.settings.rx_window
        return readout.board_status(self.board, self.counters, free_bytes=free)


def _refuse_by_dialect_unless(holds: bool, text: str, reason: str = "bad_value") -> None:
    if not holds:
        raise RemoteProtocolError(text, reason=reason)


def _event_of_notice(notice: Notice) -> messages.Message | None:
    """Return the event message for *notice*; None for changes that the host requested."""
    if isinstance(notice, StateChange) and not notice.requested:
        return messages.StateChanged(state=notice.state, reason=notice.reason)
    if isinstance(notice, PlaybackEnd):
        return messages.PlaybackEnded(
            sequence=notice.sequence, loops=notice.loops, frames=notice.frames & 0xFFFFFFFF
        )
    return None
