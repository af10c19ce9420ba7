"""A replay in real time, to a board at a port: its own clock, the recorded bytes.

The times in stream frames and PLAY are those of the recorded board's clock; they are moved by the
difference of the two clocks, which the first reply of each board tells.
"""

from __future__ import annotations

import contextlib
from dataclasses import replace
from typing import Final

from haptogram.driver.line.port import Transport, open_transport
from haptogram.errors import ConfigurationError, LinkError, NoAnswerError
from haptogram_protocol import messages
from haptogram_protocol.annotation.frames import Annotated, FrameAnnotator
from haptogram_protocol.cobs import cobs_encode
from haptogram_protocol.dialects.looks_like import HAPTOGRAM, LOOKED_AT_BYTES, looks_like_dialect
from haptogram_protocol.errors import RemoteProtocolError
from haptogram_protocol.framing import DELIMITER, MAX_ENCODED_BYTES, decode_frame, encode_frame

from .channels import TO_BOARD, TO_HOST
from .compare import RECORDED, REPLAYED, ReplayComparison
from .reader import Recording
from .replay import ReplayResult, recorded_facts

_PATIENCE_NS: Final = 2_000_000_000  # wait for the first reply, and for the last ones
_RETRY_NS: Final = 1_000_000
_WRAP: Final = 1 << 32


class ReplayFrameShifter:
    """Moves the times of frames on their way to another board.

    Attributes
    ----------
    shift_us : int or None
        Device time of the new board minus that of the recorded one; None: not known yet.
    """

    def __init__(self) -> None:
        self.shift_us: int | None = None
        self._partial = b""
        self._is_too_long = False  # the rest of what no frame is as long as, up to a delimiter

    def feed(self, data: bytes) -> bytes:
        """Return the bytes for the board; a frame that has not ended waits.

        Bytes longer than any frame are passed on unchanged.

        Raises
        ------
        NoAnswerError
            If a time is to be moved before the difference of the clocks is known.
        """
        *ended, self._partial = (self._partial + data).split(DELIMITER)
        moved = bytearray()
        for piece in ended:
            moved += (piece if self._is_too_long else self._moved(piece)) + DELIMITER
            self._is_too_long = False
        if self._is_too_long or len(self._partial) > MAX_ENCODED_BYTES:
            moved += self._partial
            self._partial, self._is_too_long = b"", True
        return bytes(moved)

    def _moved(self, piece: bytes) -> bytes:
        """Return a frame with its time shifted to the board's clock; damaged ones are unchanged."""
        try:
            body = decode_frame(piece)
        except RemoteProtocolError:
            return piece
        header = messages.Header.unpack(body[: messages.Header.LAYOUT.size])
        timed = header.type in messages.STREAM_RANGE or header.type == messages.MessageType.PLAY
        if not timed or header.flags & messages.Flag.IMMEDIATE:
            return piece
        if self.shift_us is None:
            raise NoAnswerError("the board has not answered before the first frame with a time")
        moved = replace(header, time_us=(header.time_us + self.shift_us) % _WRAP)
        wire = encode_frame(moved.pack() + body[messages.Header.LAYOUT.size :], cobs_encode)
        return wire.removeprefix(DELIMITER).removesuffix(DELIMITER)


def replay_to_port(recording: Recording, url: str, *, baudrate: int) -> ReplayResult:
    """Feed the first board's bytes of a recording to the board at *url*, in real time.

    The board is muted at the end.

    Raises
    ------
    ConfigurationError
        If the recording cannot be read, or is of another array than the board's.
    LinkError
        If the port does not open or breaks, or the board does not answer.
    """
    hello = recorded_facts(recording).hello
    port = open_transport(url, baudrate=baudrate)
    with contextlib.closing(port):
        player = _RecordingPlayer(port, hello)
        try:
            player.run(recording)
        finally:
            with contextlib.suppress(LinkError):
                player.mute()
    result = ReplayResult([player.comparison], [], player.to_board, player.to_host)
    if recording.note:
        result.notes.append(recording.note)
    return result


class _RecordingPlayer:
    def __init__(self, port: Transport, hello: messages.HelloReply | None) -> None:
        self.comparison = ReplayComparison(exact=False)
        self.to_board = self.to_host = 0
        self._port, self._hello = port, hello
        self._recorded, self._replayed = FrameAnnotator(), FrameAnnotator()
        self._shifter = ReplayFrameShifter()
        self._is_ours = True
        self._first_us: dict[str, int] = {}  # device time of the first reply, by side

    def run(self, recording: Recording) -> None:
        """Send what was sent, when it was sent, and take what comes."""
        self._is_ours = HAPTOGRAM in looks_like_dialect(recording.first_bytes(LOOKED_AT_BYTES))
        start_ns: int | None = None
        now_ns = self._port.now_ns()
        for entry in recording.entries((TO_BOARD, TO_HOST)):
            start_ns = now_ns - entry.t_ns if start_ns is None else start_ns
            if entry.topic == TO_HOST:
                for piece in self._recorded.feed(entry.data):
                    self._note(RECORDED, piece)
                self._wait_for_clock()
            else:
                self._listen_until(start_ns + entry.t_ns)
                self._send(self._shifter.feed(entry.data) if self._is_ours else entry.data)
        end_ns = self._port.now_ns() + _PATIENCE_NS
        while self.comparison.awaited and self._port.now_ns() < end_ns:
            self._listen_until(self._port.now_ns() + _RETRY_NS)
        self.comparison.close(_WRAP)

    def mute(self) -> None:
        """Leave the board mute, whatever the recording ends with; another wire has no MUTE."""
        if not self._is_ours:
            return
        header = messages.Header(messages.MessageType.MUTE, 0, 0xFFFF, 0, 0)
        self._send(encode_frame(header.pack() + messages.Mute().pack()))

    def _wait_for_clock(self) -> None:
        """Wait for the board's first reply where the recording has one."""
        end_ns = self._port.now_ns() + _PATIENCE_NS
        while RECORDED in self._first_us and REPLAYED not in self._first_us:
            if self._port.now_ns() > end_ns:
                raise NoAnswerError(f"{self._port.url}: the board does not answer")
            self._listen_until(self._port.now_ns() + _RETRY_NS)

    def _listen_until(self, t_ns: int) -> None:
        while True:
            data = self._port.read_available(t_ns)
            self.to_host += len(data)
            for piece in self._replayed.feed(data):
                self._note(REPLAYED, piece)
            if self._port.now_ns() >= t_ns:
                return

    def _note(self, side: str, piece: Annotated) -> None:
        self.comparison.add_frame(side, piece)
        if piece.header is None or side in self._first_us:
            return
        self._first_us[side] = piece.header.time_us
        if len(self._first_us) == 2:
            shift_us = self._first_us[REPLAYED] - self._first_us[RECORDED]
            self._shifter.shift_us = shift_us % _WRAP
        if side == REPLAYED and isinstance(piece.message, messages.HelloReply):
            self._check_array(piece.message)

    def _check_array(self, hello: messages.HelloReply) -> None:
        before = self._hello
        if before is not None and before.transducers != hello.transducers:
            raise ConfigurationError(
                f"{self._port.url}: the board has {hello.transducers} transducers; the recording "
                f"is of {before.transducers}"
            )

    def _send(self, data: bytes) -> None:
        rest = data
        while rest:
            written = self._port.write_some(rest)
            rest = rest[written:]
            self.to_board += written
            if rest:
                self._listen_until(self._port.now_ns() + _RETRY_NS)
