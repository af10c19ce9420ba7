"""The latches that the board tells of, against the moments and drives that its pins show."""

from __future__ import annotations

import bisect
import math
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from haptogram.acoustics.arrays import ComplexArray, FloatArray
from haptogram.records.pins import PinRecord
from haptogram.verification.pins.line_frames import LineFrame
from haptogram.verification.pins.run_drives import fundamentals_of_run_drives
from haptogram.verification.pins.shown_frames import CaptureLimits
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
from .findings import (
    PinClauseFindings,
    duration_by_pins,
    names_of_pins,
    time_by_pins,
)

_Vectors: TypeAlias = tuple[FloatArray, ComplexArray]
_FULL: Final = 255
_TURN: Final = 256
_SETTLED: Final = 2.0  # periods after a latch until no pulse of the old drive is left
_LATE: Final = 20.0  # the same, where pins latch late
_LONGEST: Final = 40.0  # periods of a drive that are looked at beside a latch
_SHORTEST: Final = 3.0
_SEARCHED: Final = 8.0  # periods on both sides of a latch in which it is sought
_TORN: Final = 1.25  # a period, and what a pulse that a latch cut may seem to be off
_MISSED: Final = 2.0  # a period, and where its pulse lies in it
_KNOWN: Final = 1.0  # period within which a time must be known to show that a latch is in time
_SILENT: Final = 2.5  # periods without a pulse
_BEFORE_WORD_MS: Final = 1.0  # a board may be silent before it says so: HG-12.1/1
_STEADY: Final = 3.0  # samples by which the pulses of one drive may differ
_LEAST_STEP: Final = 0.06  # of full drive: drives nearer than that are not told apart


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


def judge_latch_clauses(dialogue: PinDialogue, findings: PinClauseFindings) -> None:
    """Judge every latch that the board told, one event for each."""
    if not dialogue.clocks:
        for clause in ("HG-5.8/1", "HG-5.8/2", "HG-5.8/5", "HG-8.3/1", "HG-5.2/1", "HG-5.3/1"):
            findings.missing[clause] = "no PING was answered: the device clock is not known"
        return
    told = list(_latches_of_pin_dialogue(dialogue))
    pins = _PinsOfLatchClauses(dialogue.record)
    for number, latch in enumerate(told):
        pins.judge_moment(latch, told[number - 1].at if number else -math.inf, findings)
    # Pins that latch at another time than the board tells show an old drive for a while.
    is_late = any(findings.broken.get(clause) for clause in ("HG-5.8/1", "HG-5.8/2", "HG-8.3/1"))
    for latch in told:
        pins.judge_drive(latch, _LATE if is_late else _SETTLED, findings)


@dataclass
class _PinsOfLatchClauses:
    """The pulses of the captured pins."""

    record: PinRecord
    _shared: dict[float, float] = field(default_factory=dict, init=False)

    @cached_property
    def vectors(self) -> dict[int, _Vectors]:
        """Centre and fundamental of each pulse, by element."""
        return {
            element: fundamentals_of_run_drives(pin) for element, pin in self.record.pins.items()
        }

    @cached_property
    def limits(self) -> CaptureLimits:
        """Errors that the samples may hide."""
        return CaptureLimits.of(self.record)

    @cached_property
    def tolerance(self) -> float:
        """By how much two pulses of one drive may differ."""
        return _STEADY * math.pi / self.record.samples

    def judge_moment(self, latch: ToldLatch, before: float, findings: PinClauseFindings) -> None:
        """Judge when the pins change in a latch; *before* is the latch before it."""
        after, first = self._moments(latch, before)
        if after:
            self._judge_moments(latch, after, first, findings)

    # --- when ------------------------------------------------------------------------------------

    def _moments(
        self, latch: ToldLatch, before: float
    ) -> tuple[dict[int, float], dict[int, float]]:
        """Return the last old and the first new pulse of each pin that shows the latch."""
        settled = _SETTLED + latch.within
        low = max(before + settled, latch.at - _LONGEST)
        high = min(latch.until - settled, latch.at + _LONGEST)
        after: dict[int, float] = {}
        first: dict[int, float] = {}
        if latch.at - low < settled + _SHORTEST or high - latch.at < settled + _SHORTEST:
            return after, first
        for element, (centres, vectors) in self.vectors.items():
            old = self._steady(centres, vectors, low, latch.at - settled)
            new = self._steady(centres, vectors, latch.at + settled, high)
            if old is None or new is None or abs(new - old) < max(_LEAST_STEP, 3 * self.tolerance):
                continue
            reach = min(_SEARCHED + latch.within, latch.at - low, high - latch.at)
            begin, end = np.searchsorted(centres, [latch.at - reach, latch.at + reach])
            near = vectors[begin:end]
            is_old = np.abs(near - old) < np.abs(near - new)
            times = centres[begin:end]
            olds, news = times[is_old], times[~is_old]
            if not len(times) or (not len(news) and abs(new) > 0.0):
                continue
            starts = float(news[0]) if len(news) else float(olds[-1]) + 1.0
            after[element] = float(olds[-1]) if len(olds) else starts - 1.0
            first[element] = starts
        return after, first

    def _steady(
        self, centres: FloatArray, vectors: ComplexArray, low: float, high: float
    ) -> complex | None:
        """Return the drive of a pin from *low* to *high*; None: it changes meanwhile."""
        begin, end = np.searchsorted(centres, [low, high])
        some = vectors[begin:end]
        if not len(some):
            return 0j
        if len(some) < math.floor(high - low) - 1:
            return None
        mean = complex(some.mean())
        return mean if np.abs(some - mean).max() <= self.tolerance else None

    def _judge_moments(
        self,
        latch: ToldLatch,
        after: dict[int, float],
        first: dict[int, float],
        findings: PinClauseFindings,
    ) -> None:
        record = self.record
        begin, end = min(first.values()), max(after.values())
        where = time_by_pins(record, latch.at)
        if len(after) > 1:
            torn = ""
            if end - begin > _TORN:
                behind = [element for element in after if after[element] - begin > _TORN]
                torn = (
                    f"{names_of_pins(record, behind)} of {len(after)} pins change "
                    f"{duration_by_pins(record, end - begin)} or more after the first, "
                    f"in the latch {where}"
                )
            findings.add("HG-5.8/2", torn)
        middle = float(np.median([(after[e] + first[e]) / 2.0 for e in after]))
        told = f"than the trace tells, {where}"
        self._judge_time(findings, "HG-8.3/1", middle - latch.at, latch.within, told)
        if latch.due is not None:
            told = f"than the frame of the latch {where} is due"
            self._judge_time(findings, "HG-5.8/1", middle - latch.due, latch.within, told)

    def _judge_time(
        self, findings: PinClauseFindings, clause: str, late: float, within: float, than: str
    ) -> None:
        """Judge how *late* pins change, by a device clock that is known *within* so many periods.

        A clock that is known worse than a period shows no board to be in time.
        """
        length = duration_by_pins(self.record, abs(late))
        text = f"the pins change {length} {_side_of_clause(late)} {than}"
        known = duration_by_pins(self.record, within)
        if abs(late) > _MISSED + within:
            findings.add(clause, text)
        elif abs(late) > _MISSED:
            findings.doubt(clause, f"{text}; the device clock is known within {known} there")
        elif within <= _KNOWN:
            findings.add(clause, "")
        else:
            findings.missing[clause] = (
                f"the device clock is known within {known} only: more PINGs are needed, or a "
                "capture of the carrier's clock"
            )

    # --- what ------------------------------------------------------------------------------------

    def judge_drive(self, latch: ToldLatch, settled: float, findings: PinClauseFindings) -> None:
        """Compare the drives with the codes, from *settled* periods behind the latch on."""
        settled += latch.within
        if latch.codes is None or latch.until - latch.at <= settled + latch.within + _SHORTEST:
            return
        record, where = self.record, time_by_pins(self.record, latch.at)
        elements = list(record.pins)
        meant = (
            latch.codes[1, elements]
            / _FULL
            * np.exp(2j * math.pi / _TURN * latch.codes[0, elements])
        )
        low, high = latch.at + settled, latch.until - 1.0 - latch.within
        seen = np.full(len(elements), np.nan, np.complex128)
        gone, sounding = [], False
        drift = self._drift(low, high)
        for place, element in enumerate(elements):
            centres, vectors = self.vectors[element]
            begin, end = np.searchsorted(centres, [low, high])
            times = centres[begin:end]
            pulses = vectors[begin:end] * np.exp(-1j * np.polyval(drift, times - low))
            seen[place] = pulses.sum() / max(1, round(high - low)) if len(times) else 0
            edges = np.concatenate([[low], times, [high]])
            has_gap = len(times) > 0 and np.diff(edges).max() > _SILENT
            sounding |= abs(meant[place]) > self.limits.amplitude and len(times) > 0
            if abs(meant[place]) > self.limits.amplitude and has_gap:
                gone.append(element)
            elif len(times):
                seen[place] = pulses.mean()
        lost = ""
        if gone:
            length = duration_by_pins(record, high - low)
            lost = f"{names_of_pins(record, gone)} fall silent within {length} of the latch {where}"
        if sounding:
            findings.add("HG-5.8/5", lost)
        wrong = [
            e for e, bad in zip(elements, self._wrong(seen, meant, latch.boot), strict=True) if bad
        ]
        wrong = [element for element in wrong if element not in gone]
        text = f"{names_of_pins(record, wrong)} show another drive after the latch {where}"
        findings.add(latch.clause, text if wrong else "")

    def _drift(self, low: float, high: float) -> FloatArray:
        """Return the polynomial by which the phase of the reference wanders behind *low*.

        An element counts no periods, so there the analyser's clock turns all phases slowly.
        """
        if self.record.reference_element is None:
            return np.zeros(1)
        centres, vectors = self.vectors[self.record.reference_element]
        begin, end = np.searchsorted(centres, [low, high])
        if end - begin < _LONGEST:
            return np.zeros(1)
        phases = np.unwrap(np.angle(vectors[begin:end]))
        found: FloatArray = np.polyfit(centres[begin:end] - low, phases - phases[0], 2)
        return found

    def _wrong(self, seen: ComplexArray, meant: ComplexArray, boot: float) -> NDArray[np.bool_]:
        """Return the pins that differ, on the phase that the pins share with their drives."""
        limits = self.limits
        turn = seen * np.conj(meant)
        sizes = np.abs(np.abs(seen) - np.abs(meant)) > limits.amplitude
        audible = np.minimum(np.abs(seen), np.abs(meant)) > limits.amplitude
        if self.record.reference_element is None:
            offset = self._offset(turn, boot)
        else:
            place = list(self.record.pins).index(self.record.reference_element)
            offset = float(np.angle(turn[place]))
            audible &= audible[place]  # a silent reference has no phase
        errors = np.abs(np.angle(turn * np.exp(-1j * offset)))
        # The shared phase is known to a sample only.
        bad: NDArray[np.bool_] = sizes | (audible & (errors > 2.0 * limits.phase_rad))
        return bad

    def _offset(self, turn: ComplexArray, boot: float) -> float:
        """Return the phase of the pins against their codes: one from a reset to the next."""
        if boot not in self._shared and (np.abs(turn) > 0.0).any():
            self._shared[boot] = _shared_angle_of_clause(np.angle(turn[np.abs(turn) > 0.0]))
        return self._shared.get(boot, 0.0)


def _side_of_clause(periods: float) -> str:
    return "later" if periods > 0.0 else "earlier"


def _shared_angle_of_clause(angles: FloatArray) -> float:
    """Return the angle that most of *angles* are next to."""
    apart = np.abs(np.angle(np.exp(1j * (angles[:, None] - angles[None, :]))))
    near = apart <= math.tau / _TURN
    best = near[near.sum(axis=1).argmax()]
    return float(np.angle(np.exp(1j * angles[best]).sum()))


# --- what the board told -------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class _Sent:
    frame: LineFrame
    index: int
    codes: NDArray[np.uint8]


def _latches_of_pin_dialogue(dialogue: PinDialogue) -> Iterator[ToldLatch]:
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
