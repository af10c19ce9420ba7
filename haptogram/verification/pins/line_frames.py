"""The frames on a captured line of the UART, with their times on the clock of the pins."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from haptogram.records.pins import LineBytes
from haptogram_protocol.cobs import fastest_cobs
from haptogram_protocol.errors import RemoteProtocolError
from haptogram_protocol.framing import decode_frame
from haptogram_protocol.messages import Header, Message, MessageType, parse_body


@dataclass(frozen=True, slots=True)
class LineFrame:
    """A frame whose CRC is right; times in periods of the carrier.

    Attributes
    ----------
    begin : float
        When its first byte had been received.
    arrival : float
        When its closing delimiter had been received.
    header : Header
        Its header.
    message : Message or None
        Its message; None: its payload cannot be read.
    """

    begin: float
    arrival: float
    header: Header
    message: Message | None


@dataclass(frozen=True, slots=True)
class LineReading:
    """One direction of a captured line.

    Attributes
    ----------
    frames : list of LineFrame
        Its frames, in order.
    unread : list of float
        When pieces begin that are no frame, in order: damaged, by the analyser or before it.
    """

    frames: list[LineFrame]
    unread: list[float]


def read_captured_line(line: LineBytes) -> LineReading:
    """Return the frames of one direction, and the pieces that are none.

    Examples
    --------
    >>> import numpy as np
    >>> from haptogram.records.pins import LineBytes
    >>> from haptogram_protocol.framing import encode_frame
    >>> from haptogram_protocol.messages import Mute, build_body
    >>> data = encode_frame(build_body(Mute(), flags=0, seq=1, time_us=0, session=0))
    >>> line = np.frombuffer(data + b"?" + data, np.uint8)
    >>> read = read_captured_line(LineBytes(line, np.arange(len(line)) * 0.13))
    >>> [(frame.message, round(frame.arrival, 2)) for frame in read.frames]
    [(Mute(), 2.08), (Mute(), 4.42)]
    >>> [round(begin, 2) for begin in read.unread]
    [2.21]
    """
    data, cobs = line.values.tobytes(), fastest_cobs()
    delimiters = np.flatnonzero(line.values == 0).tolist()
    found, unread = [], []
    before = -1
    for place in delimiters:
        first, before = before + 1, place
        if place == first:
            continue
        try:
            body = decode_frame(data[first:place], cobs.decode)
        except (RemoteProtocolError, cobs.refusal):
            unread.append(float(line.times[first]))
            continue
        header = Header.unpack(body[: Header.LAYOUT.size])
        begin, arrival = float(line.times[first]), float(line.times[place])
        found.append(LineFrame(begin, arrival, header, _message_on_captured_line(body)))
    if before + 1 < len(data):
        unread.append(float(line.times[before + 1]))
    return LineReading(found, unread)


def _message_on_captured_line(body: bytes) -> Message | None:
    """Return the message of a frame body; None if it is invalid."""
    try:
        return parse_body(body)[1]
    except RemoteProtocolError:
        return None


def mute_on_captured_line(line: LineBytes, begin: float, end: float) -> tuple[float | None, float]:
    """Return when the first MUTE from *begin* on arrived, and when the pins may sound again.

    That is with the next ARM, with bytes that are no frame and may have been one, or at the *end*
    of the capture; times in periods. None: there is no MUTE.
    """
    read = read_captured_line(line)
    arrivals = (f.arrival for f in read.frames if f.header.type == MessageType.MUTE)
    mute = next((arrival for arrival in arrivals if arrival >= begin), None)
    if mute is None:
        return None, end
    arms = [f.arrival for f in read.frames if f.header.type == MessageType.ARM]
    return mute, min((t for t in (*arms, *read.unread) if t > mute), default=end)
