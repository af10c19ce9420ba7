"""The port behind which a case finds its board: no line, virtual time, every step taken down."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

from haptogram_protocol.errors import RemoteProtocolError
from haptogram_protocol.framing import FrameDecoder
from haptogram_protocol.messages import EVENT_RANGE, MessageType, parse_body
from wire_export.vectors.vector import vector_fields_of

from .boards import PythonBoard, VirtualBoard

START_US: Final = 1004  # after power-up; a carrier boundary, because 2^32 - 10 s is not one

#: Fields in which boards of one protocol may differ, by message: limits and identity.
OWN: Final = {
    "HELLO_REPLY": {
        "boot_id",
        "clock_ppm",
        "firmware",
        "max_chunk",
        "max_playback_rate_hz",
        "max_sequence_frames",
        "max_unattended_ms",
        "max_upload_bytes",
        "rx_window",
        "trace_ring",
        "upload_window",
    },
    "UPLOAD_BEGIN_REPLY": {"max_chunk", "window"},
    "STATUS": {"free_bytes"},
    "STATUS_REPLY": {"free_bytes"},
}

Frame = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Step:
    """What arrived at the boards at one moment, and the frames that both of them sent.

    Attributes
    ----------
    at_us : int
        Microseconds after power-up.
    sent : bytes
        Bytes of the host; empty where time only passed.
    frames : list of dict
        Message, header and fields of each frame, without :data:`OWN`.
    """

    at_us: int
    sent: bytes
    frames: list[Frame]


class LockstepPort:
    """A transport to the Python board; a second board gets the same bytes at the same times.

    Time jumps to whatever the Python board does next. Bytes take no time on the way.

    Parameters
    ----------
    board : PythonBoard
        Board whose bytes the host reads.
    peer : VirtualBoard or None
        Board that must send the same frames; None: nothing is compared.

    Attributes
    ----------
    steps : list of Step
        Everything since power-up.
    disagreement : str
        The first step in which the boards sent different frames; empty if there is none.
    """

    url = "lockstep://"

    def __init__(self, board: PythonBoard, peer: VirtualBoard | None) -> None:
        self.steps: list[Step] = []
        self.disagreement = ""
        self._board, self._peer = board, peer
        for one in (board, peer):
            if one is not None:
                one.reset()
        self._now_ns = START_US * 1000
        self._unread = b""

    def now_ns(self) -> int:
        """Return the virtual time in nanoseconds after power-up."""
        return self._now_ns

    def write_some(self, data: bytes) -> int:
        """Let all of *data* arrive now."""
        self._step(data)
        return len(data)

    def read_available(self, deadline_ns: int) -> bytes:
        """Return what the board sends first, or ``b""`` at the deadline."""
        while not self._unread and (next_us := self._board.next_event_us) is not None:
            if next_us * 1000 > deadline_ns:
                break
            self._now_ns = max(self._now_ns, next_us * 1000)
            self._step()
        if not self._unread:
            self._now_ns = max(self._now_ns, deadline_ns)
        data, self._unread = self._unread, b""
        return data

    def look(self) -> None:
        """Take down that the board has been silent up to now."""
        if not self.steps or self.steps[-1].at_us < self._now_ns // 1000:
            self._step(keep=True)

    def close(self) -> None:
        """Do nothing: both boards are switched off and on with the next port."""

    def _step(self, data: bytes = b"", *, keep: bool = False) -> None:
        at_us = self._now_ns // 1000
        answer = self._board(at_us, data)
        frames = _frames(answer)
        if self._peer is not None:
            self._compare(at_us, frames, _frames(self._peer(at_us, data)))
        if data or frames or keep:
            self.steps.append(Step(at_us, data, frames))
        self._unread += answer

    def _compare(self, at_us: int, ours: Sequence[Frame], theirs: Sequence[Frame]) -> None:
        """Compare responses with responses and events with events: their order is free else."""
        for events in (False, True):
            one, other = ([f for f in frames if is_event(f) is events] for frames in (ours, theirs))
            if one != other and not self.disagreement:
                self.disagreement = f"at {at_us} µs one board sent {one}, the other {other}"


def is_event(frame: Frame) -> bool:
    """Return True if a frame is an event, False if it is a response."""
    return MessageType[frame["message"]] in EVENT_RANGE


def _frames(data: bytes) -> list[Frame]:
    return [_frame(found) for found in FrameDecoder().feed(data)]


def _frame(found: bytes | RemoteProtocolError) -> Frame:
    if isinstance(found, RemoteProtocolError):
        raise found
    header, message = parse_body(found)
    own = OWN.get(message.TYPE.name, set())
    fields = vector_fields_of(message)
    head = vector_fields_of(header)
    del head["type"]  # the name says it
    kept = {name: value for name, value in fields.items() if name not in own}
    return {"message": message.TYPE.name, "header": head, "fields": kept}
