"""The latches of which an event of the board tells, joined with the frames of the stream."""

from __future__ import annotations

import bisect
import math
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from haptogram.verification.pins.line_frames import LineFrame
from haptogram_protocol.errors import RemoteProtocolError
from haptogram_protocol.messages import (
    EVENT_RANGE,
    FIRST_STREAM_SEQ,
    STREAM_RANGE,
    Drives,
    Flag,
    HelloReply,
    MessageType,
    StateChanged,
    Trace,
    TraceDrive,
    TraceMode,
    TracePlayback,
    drive_codes,
    unwrap,
)
from haptogram_protocol.state import OutputState

from .configurations import ConfigurationsByPins
from .dialogue import PinDialogue

_BEFORE_WORD_MS: Final = 1.0  # a board may be silent before it says so: HG-12.1/1


@dataclass(frozen=True, slots=True)
class ToldLatch:
    """A latch that the board told.

    Attributes
    ----------
    at : float
        Its time in periods of the capture.
    until : float
        Up to when nothing else can have changed the output.
    due : float or None
        When the frame was to be latched; None: at once, late, or not of the stream.
    codes : (2, N) numpy.ndarray of uint8, or None
        Phases and amplitudes that the pins show; None: not known.
    clause : str
        Clause that says so.
    boot : float
        Begin of the device clock that told it.
    within : float
        By how many periods these times may be wrong.
    """

    at: float
    until: float
    due: float | None
    codes: NDArray[np.uint8] | None
    clause: str
    boot: float
    within: float = 0.0


@dataclass(frozen=True, slots=True)
class _Sent:
    frame: LineFrame
    index: int
    codes: NDArray[np.uint8]


def latches_of_pin_dialogue(dialogue: PinDialogue) -> Iterator[ToldLatch]:
    """Yield the latches of which an event of its own tells, in the order of their times."""
    sent = _drives_of_pin_dialogue(dialogue)
    configs = ConfigurationsByPins(dialogue)
    per_ms = dialogue.record.carrier_hz * 1e-3
    ends = _output_ends_of_pin_dialogue(dialogue)
    events = []
    for frame in dialogue.to_host:
        is_told = isinstance(frame.message, Trace | TracePlayback | TraceDrive)
        if is_told and (at := dialogue.told(frame)) is not None:
            events.append((at, frame))
    events.sort(key=lambda event: event[0])
    lost = _lost_events_of_pin_dialogue(dialogue)
    for place, (at, frame) in enumerate(events):
        known = configs.at(at)
        if known is None or known.trace_mode is not TraceMode.CRC:
            continue  # a latch of which nothing tells may be next to it
        following = events[place + 1][0] if place + 1 < len(events) else math.inf
        since = events[place - 1][1].begin if place else -math.inf
        until = events[place + 1][1].begin if place + 1 < len(events) else frame.begin + per_ms
        if any(since < moment <= until for moment in lost):
            continue  # the event of a latch next to it was damaged
        limit = min(following, ends[bisect.bisect_right(ends, at)], at + known.hold_ms * per_ms)
        found = _frame_of_pin_dialogue(sent, frame)
        codes = due = None
        clause = "HG-5.2/1"
        if found is not None:
            limit = min(limit, found.frame.arrival + known.host_timeout_ms * per_ms)
            codes = found.codes.copy() if configs.is_plain(at) else None
            if codes is not None:
                codes[1] = np.minimum(codes[1], known.amplitude_ceiling)
            clause = "HG-5.3/1" if isinstance(found.frame.message, Drives) else clause
            due = _latch_due_in_pin_dialogue(dialogue, found, frame)
        boot = next(c.begin for c in dialogue.clocks if c.begin <= frame.begin < c.end)
        yield ToldLatch(at, limit, due, codes, clause, boot, dialogue.within(at))


def _latch_due_in_pin_dialogue(
    dialogue: PinDialogue, found: _Sent, told: LineFrame
) -> float | None:
    """Return when the frame of a latch is due; None: at once, or late."""
    header = found.frame.header
    if header.flags & Flag.IMMEDIATE or told.header.flags & Flag.LATE:
        return None
    due = dialogue.told(told, header.time_us)
    return None if due is None else max(due, found.frame.arrival)


def _drives_of_pin_dialogue(dialogue: PinDialogue) -> dict[tuple[int, int, int], _Sent]:
    """Return the frames of the stream that hold a drive, by session, number and CRC-32."""
    count = next((reply.transducers for _, reply in dialogue.said(HelloReply)), 0)
    newest: dict[int, int] = {}
    found = {}
    for frame in dialogue.to_board:
        header = frame.header
        if header.type not in STREAM_RANGE or frame.message is None:
            continue
        index = unwrap(header.seq, newest.get(header.session, FIRST_STREAM_SEQ), 16)
        newest[header.session] = max(index, newest.get(header.session, index))
        try:
            parts = drive_codes(frame.message, count)
        except RemoteProtocolError:
            continue
        if parts is None or len(parts[0]) != count or len(parts[1]) != count:
            continue
        codes = np.array([np.frombuffer(part, np.uint8) for part in parts])
        key = header.session, index, zlib.crc32(b"".join(parts))
        found[key] = _Sent(frame, index, codes)
    return found


def _lost_events_of_pin_dialogue(dialogue: PinDialogue) -> list[float]:
    """Return when an event came before which one is missing on the captured line, or damaged."""
    events = [frame for frame in dialogue.to_host if frame.header.type in EVENT_RANGE]
    missing = [
        after.begin
        for before, after in pairwise(events)
        if before.header.session == after.header.session
        and (after.header.seq - before.header.seq) % 2**16 != 1
    ]
    return [*missing, *dialogue.unread_to_host]


def _frame_of_pin_dialogue(
    sent: dict[tuple[int, int, int], _Sent], told: LineFrame
) -> _Sent | None:
    message = told.message
    if not isinstance(message, Trace):
        return None
    return sent.get((told.header.session, message.index, message.crc))


def _output_ends_of_pin_dialogue(dialogue: PinDialogue) -> list[float]:
    """Return when the output may change by something else than a latch, in order, and the end."""
    kinds = {
        MessageType.HELLO,
        MessageType.ARM,
        MessageType.MUTE,
        MessageType.DISARM,
        MessageType.SET_CONFIG,
        MessageType.UPLOAD_COMMIT,
        MessageType.PLAY,
        MessageType.STOP,
    }
    found = [f.arrival for f in dialogue.to_board if f.header.type in kinds]
    found += dialogue.unread_to_board  # it may have been one of them
    for frame, changed in dialogue.said(StateChanged):  # by a fault, which no request brings
        moment = dialogue.told(frame)
        if changed.state is not OutputState.ARMED and moment is not None:
            found += [moment - _BEFORE_WORD_MS * dialogue.record.carrier_hz * 1e-3, moment]
    return sorted([*found, *dialogue.resets, dialogue.record.end, math.inf])
