"""Times at which no pin may sound, by the requests to the board and its own messages."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from haptogram.records.pins import PinRecord
from haptogram_protocol import messages as m
from haptogram_protocol.state import MuteReason, OutputState

from .dialogue import PinDialogue
from .findings import (
    PinClauseFindings,
    duration_by_pins,
    names_of_pins,
    time_by_pins,
)

_PERIOD: Final = 1.0  # HG-6.6/1
_CLOCKS: Final = 0.5  # periods by which device time and capture may differ: HG-6.9/2 allows 10 us
_TIMER_US: Final = 1_000  # HG-12.1/1
_BEFORE: Final = 2.5  # periods before a cause: a pin with a pulse in them sounded
_SAMPLES: Final = 2.0
_BY_TIMER: Final = (MuteReason.HOLD_EXPIRED, MuteReason.HOST_SILENT, MuteReason.UNATTENDED)
_BY_REASON: Final = {
    MuteReason.HOLD_EXPIRED: ("HG-6.10/1", "the end of the hold"),
    MuteReason.HOST_SILENT: ("HG-12.2/1", "the end of the lease"),
    MuteReason.UNATTENDED: ("HG-12.1/1", "the end of an unattended playback"),
    MuteReason.FAULT: ("HG-6.6/1", "a fault of the hardware"),
}


@dataclass(frozen=True, slots=True)
class SilenceDue:
    """A time at which no pin may begin a pulse; in periods.

    Attributes
    ----------
    cause_at : float
        When the cause came.
    begin, until : float
        From when, and up to when.
    clause : str
        Clause that a pin breaks which goes on from before the cause.
    cause : str
        The cause in words.
    doubt : float
        From when on a piece of the host's line that is no frame may have ended the silence.
    """

    cause_at: float
    begin: float
    until: float
    clause: str
    cause: str
    doubt: float


def judge_silence_clauses(dialogue: PinDialogue, findings: PinClauseFindings) -> None:
    """Judge every time at which the pins have to be silent."""
    record = dialogue.record
    if not any(len(pin.rises) for pin in record.pins.values()):
        return  # pins that never sound prove no silence: nobody knows whether they are connected
    slack = _SAMPLES / record.samples
    for due in _silence_clauses_due(dialogue):
        begin, until = due.begin + slack, due.until - slack
        if begin >= until:
            continue
        before = _pins_sounding_against_clause(record, due.cause_at - _BEFORE, due.cause_at)
        wrong = _pins_sounding_against_clause(record, begin, min(until, due.doubt))
        if not wrong and _pins_sounding_against_clause(record, max(begin, due.doubt), until):
            cause = f"{due.cause} {time_by_pins(record, due.cause_at)}"
            bytes_at = time_by_pins(record, due.doubt)
            findings.doubt(
                due.clause,
                f"pins sound behind {cause}, but after bytes {bytes_at} on to_board that are no "
                "frame: it may be one that lets them, which the analyser read wrongly",
            )
            continue
        if not wrong:
            findings.held["HG-6.6/2"] += due.clause != "HG-6.6/2"
            if before or due.clause in ("HG-6.6/2", "HG-6.12/2", "HG-6.3/1"):
                findings.add(due.clause, "")
            continue
        goes_on = any(e in before and wrong[e][0] <= begin + _BEFORE for e in wrong)
        if goes_on and due.clause == "HG-6.3/1":
            continue  # reported elsewhere: it did not fall silent
        clause = due.clause if goes_on or due.clause != "HG-6.6/1" else "HG-6.6/2"
        first, last = min(wrong.values())[0], max(rise for _, rise in wrong.values())
        how = "go on sounding" if goes_on else "begin to sound"
        findings.add(
            clause,
            f"{names_of_pins(record, sorted(wrong))} {how} "
            f"{duration_by_pins(record, first - due.cause_at)} "
            f"after {due.cause} {time_by_pins(record, due.cause_at)}, and last sound "
            f"{duration_by_pins(record, last - due.cause_at)} after it",
        )


def _pins_sounding_against_clause(
    record: PinRecord, begin: float, until: float
) -> dict[int, tuple[float, float]]:
    """Return when each pin's first and last pulse begins, from *begin* to *until*, by element.

    In carrier periods; without the pins that begin none.
    """
    found = {}
    for element, pin in record.pins.items():
        low, high = np.searchsorted(pin.rises, [begin, until])
        if low < high:
            found[element] = float(pin.rises[low]), float(pin.rises[high - 1])
    return found


def _silence_clauses_due(dialogue: PinDialogue) -> Iterator[SilenceDue]:
    """Yield every silence that the dialogue demands, with its clause and its begin."""
    yield from _silence_clauses_after_requests(dialogue)
    yield from _silence_clauses_by_words(dialogue)
    yield from _silence_clauses_after_arm(dialogue)
    for moment, within in dialogue.dated_resets:
        begin = moment + _PERIOD + _CLOCKS + within
        yield _silence_until_arm(dialogue, moment, begin, "HG-6.12/2", "a reset")


def _silence_until_arm(
    dialogue: PinDialogue, cause_at: float, begin: float, clause: str, cause: str
) -> SilenceDue:
    """Return the silence due from *begin* to the first ARM after *cause_at*.

    *cause* names what happened at *cause_at*; *clause* demands the silence. Times are in carrier
    periods of the capture.
    """
    until, doubt = dialogue.next_arm(cause_at), dialogue.next_unread(cause_at)
    return SilenceDue(cause_at, begin, until, clause, cause, doubt)


def _silence_clauses_after_requests(dialogue: PinDialogue) -> Iterator[SilenceDue]:
    """Yield the silences after MUTE, DISARM and new sessions."""
    causes = [(mute, "MUTE") for mute in dialogue.requests(m.MessageType.MUTE)]
    disarms = dialogue.requests(m.MessageType.DISARM)
    causes += [(f, "DISARM") for f in disarms if dialogue.answer(f, m.MessageType.DISARM_REPLY)]
    new = (hello for hello, _, is_new in dialogue.sessions if is_new)
    causes += [(hello, "a HELLO with another nonce") for hello in new]
    for frame, cause in causes:
        ready = frame.arrival
        if frame.header.type != m.MessageType.MUTE:  # which overtakes the frames before
            ready = _last_computing_time(dialogue, ready)
        begin = ready + _PERIOD
        yield _silence_until_arm(dialogue, frame.arrival, begin, "HG-6.6/1", cause)


def _last_computing_time(dialogue: PinDialogue, until: float) -> float:
    """Return when the POINTS received by *until* are computed (HG-5.7), *until* at least.

    Both times are in carrier periods of the capture.
    """
    point_us = 0
    ready = until
    for frame, reply in dialogue.said(m.HelloReply):
        if frame.begin <= until:
            point_us = reply.point_time_us
    if point_us:
        in_periods = point_us * dialogue.record.carrier_hz * 1e-6
        ready = 0.0
        for frame, points in dialogue.sent(m.Points):
            if frame.arrival <= until:
                ready = max(ready, frame.arrival) + len(points.points) * in_periods
    return max(ready, until)


def _silence_clauses_by_words(dialogue: PinDialogue) -> Iterator[SilenceDue]:
    """Yield the silence due after each STATE_CHANGED or status in which the board is not ARMED.

    One that crosses an ARM is left out.
    """
    timer = _TIMER_US * dialogue.record.carrier_hz * 1e-6
    for frame in dialogue.to_host:
        said = frame.message
        if not isinstance(said, m.StateChanged | m.Status | m.StatusReply):
            continue
        moment = dialogue.capture_time(frame)
        if said.state is OutputState.ARMED or moment is None or dialogue.is_arm_under_way(moment):
            continue
        begin = moment + _PERIOD + _CLOCKS + dialogue.within(moment)
        clause, cause = "HG-6.6/2", f"STATUS says {said.state.name}"
        if isinstance(said, m.StateChanged):
            clause, cause = _BY_REASON.get(said.reason, (clause, "a change of state"))
            begin += timer if said.reason in _BY_TIMER else 0.0
        due = _silence_until_arm(dialogue, moment, begin, clause, cause)
        # The board may not have answered yet what the analyser read wrongly.
        doubt = dialogue.next_unread(min(moment, dialogue.answered_before(moment)))
        yield replace(due, doubt=doubt)


def _silence_clauses_after_arm(dialogue: PinDialogue) -> Iterator[SilenceDue]:
    """Yield the silence due from an ARM after a MUTE until the next frame or PLAY."""
    off = [mute.arrival for mute in dialogue.requests(m.MessageType.MUTE)]
    before = 0.0
    for arm in dialogue.arms:
        if any(before <= moment < arm for moment in off):
            until, doubt = dialogue.next_source(arm), dialogue.next_unread(arm)
            yield SilenceDue(arm, arm, until, "HG-6.3/1", "ARM", doubt)
        before = arm
