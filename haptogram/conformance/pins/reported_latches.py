"""The latches that the board reports, joined with the frames of the stream."""

from __future__ import annotations

import bisect
import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from operator import itemgetter
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from haptogram.verification.pins.line_frames import LineFrame
from haptogram_protocol import messages as m
from haptogram_protocol.errors import RemoteProtocolError
from haptogram_protocol.state import OutputState

from .configurations import ConfigurationsByPins
from .dialogue import PinDialogue
from .reported_drives import DrivesOfPinDialogue, ReportedDrive

#: Time in periods, the frame that reports it, and until when no other latch can have followed.
_Reported: TypeAlias = tuple[float, LineFrame, float]
#: Requests that may change the output.
_OF_OUTPUT: Final = (
    m.MessageType.HELLO,
    m.MessageType.ARM,
    m.MessageType.MUTE,
    m.MessageType.DISARM,
    m.MessageType.SET_CONFIG,
    m.MessageType.UPLOAD_COMMIT,
    m.MessageType.PLAY,
    m.MessageType.STOP,
)
_BEFORE_WORD_MS: Final = 1.0  # time that a board may be silent before it reports it: HG-12.1/1


@dataclass(frozen=True, eq=False, slots=True)
class ShownDrive:
    """The drive that the pins have to show from a latch on.

    Attributes
    ----------
    codes : (2, N) numpy.ndarray of uint8
        Phases and amplitudes, after correction and ceiling.
    free : (N,) numpy.ndarray of bool
        Elements whose phase is free.
    steps : int
        By how many steps a code may differ: of a drive that the board computes.
    clause, path : str
        Clause that says so, and how the drive came to the registers.
    clauses : tuple of str
        Clauses about what correction and ceiling made of it.
    """

    codes: NDArray[np.uint8]
    free: NDArray[np.bool_]
    steps: int
    clause: str
    path: str
    clauses: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class ReportedLatch:
    """A latch that the board reported.

    Attributes
    ----------
    at : float
        Its time in periods of the capture.
    until : float
        Up to when nothing else can have changed the output.
    due : float or None
        When the frame was to be latched; None: at once, late, or not of the stream.
    due_clause : str
        Clause that says when.
    drive : ShownDrive or None
        The drive that the pins should show; None: not known.
    boot : float
        Begin of the device clock that dates it.
    within : float
        By how many periods these times may be wrong.
    """

    at: float
    until: float
    due: float | None
    due_clause: str
    drive: ShownDrive | None
    boot: float
    within: float = 0.0


def latches_of_pin_dialogue(dialogue: PinDialogue) -> Iterator[ReportedLatch]:
    """Yield the latches that the board reports, in the order of their times."""
    asked = DrivesOfPinDialogue(dialogue)
    configs = ConfigurationsByPins(dialogue, asked)
    per_ms = dialogue.record.carrier_hz * 1e-3
    changes = sorted(_unlatched_change_intervals(dialogue), key=lambda change: change[1])
    ends = [last for _, last in changes]
    firsts = np.minimum.accumulate([first for first, _ in changes][::-1])[::-1]
    reports = [*_traced_latches(dialogue, configs), *_latches_read_back(dialogue, configs)]
    for at, frame, limit in sorted(reports, key=itemgetter(0)):
        known = configs.at(at)
        if known is None:
            continue
        changed = firsts[bisect.bisect_right(ends, at)]
        limit = min(limit, max(at, changed), at + known.hold_ms * per_ms)
        found = asked.of(frame, at)
        due = shown = None
        if found is not None:
            play = found.playing
            alone_ms = known.host_timeout_ms if play is None else play.unattended_ms
            limit = min(limit, found.frame.arrival + alone_ms * per_ms)
            shown = _shown_drive(found, asked, configs, at)
            due = _due_time(dialogue, found, frame)
        due_clause = "HG-5.8/1" if found is None or found.playing is None else "HG-7.6/4"
        boot = next(c.begin for c in dialogue.clocks if c.begin <= frame.begin < c.end)
        yield ReportedLatch(at, limit, due, due_clause, shown, boot, dialogue.within(at))


def _traced_latches(dialogue: PinDialogue, configs: ConfigurationsByPins) -> Iterator[_Reported]:
    """Yield (time of latch, trace event, time of the next latch) while every latch has an event.

    That is in the trace mode CRC. Times are in carrier periods, the last "next" is inf. A latch
    next to a lost or unreadable event is left out.
    """
    events = []
    for frame in dialogue.to_host:
        is_report = isinstance(frame.message, m.Trace | m.TracePlayback | m.TraceDrive)
        if is_report and (at := dialogue.capture_time(frame)) is not None:
            events.append((at, frame))
    events.sort(key=lambda event: event[0])
    lost = _lost_event_times(dialogue)
    per_ms = dialogue.record.carrier_hz * 1e-3
    for place, (at, frame) in enumerate(events):
        known = configs.at(at)
        if known is None or known.trace_mode is not m.TraceMode.CRC:
            continue  # an unreported latch may be next to it
        following = events[place + 1][0] if place + 1 < len(events) else math.inf
        since = events[place - 1][1].begin if place else -math.inf
        until = events[place + 1][1].begin if place + 1 < len(events) else frame.begin + per_ms
        if any(since < moment <= until for moment in lost):
            continue  # the event of a latch next to it was damaged
        yield at, frame, following


def _latches_read_back(dialogue: PinDialogue, configs: ConfigurationsByPins) -> Iterator[_Reported]:
    """Yield (time of latch, DRIVE_REPLY, time of the request) of latches that READ_DRIVE reports.

    Times are in carrier periods. Only where the trace mode is not CRC.
    """
    requests = {
        (frame.header.session, frame.header.seq): frame.arrival
        for frame in dialogue.requests(m.MessageType.READ_DRIVE)
    }
    found: dict[tuple[int, m.LatchKey, int], _Reported] = {}
    for frame, reply in dialogue.said(m.DriveReply):
        at = dialogue.capture_time(frame, reply.t_latch_us)
        asked_at = requests.get((frame.header.session, frame.header.seq))
        if at is None or asked_at is None or reply.key == m.LatchKey(0, 0, 0):
            continue
        known = configs.at(at)
        if known is not None and known.trace_mode is not m.TraceMode.CRC:
            found[frame.header.session, reply.key, reply.t_latch_us] = (at, frame, asked_at)
    yield from found.values()


def _due_time(dialogue: PinDialogue, found: ReportedDrive, frame: LineFrame) -> float | None:
    """Return when a latch is due, in carrier periods; None: at once, late or unknown."""
    is_late = frame.header.flags & m.Flag.LATE or isinstance(frame.message, m.DriveReply)
    if found.due_us is None or is_late:
        return None  # a read-back does not say whether the latch was late
    due = dialogue.capture_time(frame, found.due_us)
    return None if due is None else max(due, found.frame.arrival)


def _shown_drive(
    found: ReportedDrive, asked: DrivesOfPinDialogue, configs: ConfigurationsByPins, at: float
) -> ShownDrive | None:
    """Return the drive that the pins must show at *at*, with correction and amplitude ceiling.

    None if the configuration or the codes are not known. *at* is in carrier periods.
    """
    known, correction = configs.at(at), configs.correction(at)
    if known is None or correction is None:
        return None
    model = asked.model(known.sound_speed_mm_s)
    try:
        codes = found.registers(model, asked.count)
    except RemoteProtocolError:
        return None
    if codes is None or codes.shape[1] != asked.count:
        return None
    codes = codes.copy()
    if asked.identity is not None and not asked.identity.features & m.Feature.AMPLITUDE:
        codes[1] = 255
    clauses = ["HG-7.9/1"] if any(correction) else []
    if (codes[1] > known.amplitude_ceiling).any():
        clauses.append("HG-7.9/2")
    codes[0] += np.frombuffer(correction, np.uint8)
    codes[1] = np.minimum(codes[1], known.amplitude_ceiling)
    free = found.free_phases(model, asked.count)
    steps = int(isinstance(found.message, m.Points))
    return ShownDrive(codes, free, steps, found.clause, found.path, tuple(clauses))


def _lost_event_times(dialogue: PinDialogue) -> list[float]:
    """Return the times, in carrier periods, before which an event may be missing.

    That is where an event's number leaps, and where bytes to the host are unreadable.
    """
    events = [frame for frame in dialogue.to_host if frame.header.type in m.EVENT_RANGE]
    missing = [
        after.begin
        for before, after in pairwise(events)
        if before.header.session == after.header.session
        and (after.header.seq - before.header.seq) % 2**16 != 1
    ]
    return [*missing, *dialogue.unread_to_host]


def _unlatched_change_intervals(dialogue: PinDialogue) -> list[tuple[float, float]]:
    """Return (begin, end) of every time in which the output may change without a latch.

    In carrier periods: by a request, a fault, a reset, unreadable bytes, and the end of the
    capture. The last one is (inf, inf).
    """
    found = [frame.arrival for frame in dialogue.requests(*_OF_OUTPUT)]
    found += dialogue.unread_to_board  # it may have been one of them
    asked: list[tuple[float, float]] = []
    if dialogue.missing == "to_board":
        kinds = {kind + m.RESPONSE_OFFSET for kind in _OF_OUTPUT}
        answers = (f for f in dialogue.to_host if f.header.type in kinds)
        asked = [(dialogue.answered_before(f.begin), f.begin) for f in answers]
    for frame, changed in dialogue.said(m.StateChanged):  # by a fault, which no request brings
        moment = dialogue.capture_time(frame)
        if changed.state is not OutputState.ARMED and moment is not None:
            found += [moment - _BEFORE_WORD_MS * dialogue.record.carrier_hz * 1e-3, moment]
    found += [*dialogue.resets, dialogue.record.end, math.inf]
    return [*asked, *((t, t) for t in found)]
