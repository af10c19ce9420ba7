"""The dialogue of host and board on the clock of the pins, and the board's clock against it."""

from __future__ import annotations

import bisect
from collections.abc import Iterator, Sequence
from functools import cached_property
from itertools import pairwise
from typing import Final, TypeVar

import numpy as np

from haptogram.errors import ConfigurationError
from haptogram.records.pins import LineBytes, PinRecord
from haptogram.verification.pins.line_frames import LineFrame, read_captured_line
from haptogram_protocol import messages as m

from .device_clock import PinDialogueClock, last_mark_before_lost_samples

_AT_RESET_US: Final = 4_284_967_296  # HG-6.9/4
_BITS: Final = 32
#: Types of the frames of each line, and who sends those of the other one.
_SENDERS: Final = {
    "to_board": ((m.STREAM_RANGE, m.REQUEST_RANGE), "board"),
    "to_host": ((m.RESPONSE_RANGE, m.EVENT_RANGE), "host"),
}
_M = TypeVar("_M", bound=m.Message)


class PinDialogue:
    """Frames of both directions in a capture with one line of the UART, or both.

    Attributes
    ----------
    missing : str
        Name of the line that was not captured; empty: both were.

    Raises
    ------
    ConfigurationError
        Neither line was captured, or one carries no frame of its own.
    """

    def __init__(self, record: PinRecord) -> None:
        if record.to_board is None and record.to_host is None:
            raise ConfigurationError(
                f"{record.name}: neither line of the UART; clauses are judged by what the board "
                "was told (to_board) and says (to_host): name both in the map, or one of them "
                "(docs/captures.md)"
            )
        self.record = record
        lines = {"to_board": record.to_board, "to_host": record.to_host}
        self.missing = next((name for name, line in lines.items() if line is None), "")
        self.to_board, self.unread_to_board = _read_line(record, "to_board", record.to_board)
        self.to_host, self.unread_to_host = _read_line(record, "to_host", record.to_host)

    def requests(self, *kinds: m.MessageType) -> list[LineFrame]:
        """Return the requests of these *kinds* that the host sent."""
        return [frame for frame in self.to_board if frame.header.type in kinds]

    def sent(self, kind: type[_M]) -> Iterator[tuple[LineFrame, _M]]:
        """Yield the frames of the host with a message of this *kind*."""
        return ((f, f.message) for f in self.to_board if isinstance(f.message, kind))

    def said(self, kind: type[_M]) -> Iterator[tuple[LineFrame, _M]]:
        """Yield the frames of the board with a message of this *kind*."""
        return ((f, f.message) for f in self.to_host if isinstance(f.message, kind))

    def answer(self, asked: LineFrame, kind: m.MessageType) -> LineFrame | None:
        """Return the answer of this *kind* to a request, if it came before the next request."""
        first = bisect.bisect_right(self.to_host, asked.arrival, key=lambda f: f.arrival)
        for frame in self.to_host[first:]:
            if frame.header.seq == asked.header.seq and frame.header.type == kind:
                return frame
            if frame.arrival > asked.arrival + self._second_periods:
                break
        return None

    @property
    def _second_periods(self) -> float:
        """Return how many carrier periods a second has."""
        return self.record.carrier_hz  # a second: no host waits longer without asking again

    @cached_property
    def arms(self) -> list[float]:
        """Arrivals of ARM."""
        return [arm.arrival for arm in self.requests(m.MessageType.ARM)]

    @cached_property
    def _armings(self) -> list[float]:
        """Return when each ARM arrived, or its reply began if ARM was unreadable, in periods."""
        read = {(f.header.session, f.header.seq) for f in self.requests(m.MessageType.ARM)}
        replies = (f for f in self.to_host if f.header.type == m.MessageType.ARM_REPLY)
        lost = [f.begin for f in replies if (f.header.session, f.header.seq) not in read]
        return sorted([*self.arms, *lost])

    @cached_property
    def sources(self) -> list[float]:
        """Arrivals of frames that may bring sound: of the stream, and PLAY."""
        plays = [frame for frame, _ in self.sent(m.Play)]
        return sorted(frame.arrival for frame in (*self.stream, *plays))

    def next_arm(self, t: float) -> float:
        """Return when the board may sound again from *t* on: by ARM; else the end."""
        armed = _next_time(self._armings, t, self.record.end)
        if self.missing == "to_board":
            armed = self.answered_before(armed)
        return max(t, armed)

    def is_arm_under_way(self, t: float) -> bool:
        """Return True if an ARM may have arrived by *t* that is not answered by then.

        No clause bounds the time that a board takes to carry it out: HG-4.11/3 is a SHOULD.
        """
        if self.missing == "to_board":
            armed = _next_time(self._armings, t, self.record.end)
            return armed < self.record.end and self.answered_before(armed) <= t
        return any(begin <= t < end for begin, end in self._arms_under_way)

    @cached_property
    def _arms_under_way(self) -> list[tuple[float, float]]:
        """Return (arrival of ARM, begin of its answer) for every ARM, in carrier periods.

        Without an answer the second is 1 s after the first.
        """
        found = []
        for arm in self.requests(m.MessageType.ARM):
            answer = self.answer(arm, m.MessageType.ARM_REPLY)
            end = arm.arrival + self._second_periods if answer is None else answer.begin
            found.append((arm.arrival, end))
        return found

    @cached_property
    def _responses(self) -> list[float]:
        """Return when each response begins, in carrier periods of the capture."""
        return [f.begin for f in self.to_host if f.header.type in m.RESPONSE_RANGE]

    def answered_before(self, t: float) -> float:
        """Return the begin of the last response before *t*, 0 if there is none.

        A host asks one thing after the other (HG-4.8/1): the request whose response begins at *t*
        did not come before it.
        """
        place = bisect.bisect_left(self._responses, t)
        return self._responses[place - 1] if place else 0.0

    def next_source(self, t: float) -> float:
        """Return the first arrival of a frame that may bring sound from *t* on, else the end."""
        return _next_time(self.sources, t, self.record.end)

    def next_unread(self, t: float) -> float:
        """Return when the first piece from *t* on begins that the host sent and that is no frame.

        The board may have read it: then it may be anything. Where the board's line alone was
        captured, a piece of that may be the answer.
        """
        if self.missing != "to_board":
            return _next_time(self.unread_to_board, t, self.record.end)
        piece = _next_time(self.unread_to_host, t, self.record.end)
        return max(t, self.answered_before(piece)) if piece < self.record.end else piece

    def is_due(self, begin: float, end: float) -> bool:
        """Return True if a frame that arrived before *begin* may be due between the two."""
        clock = self.clock_at(begin)
        if clock is None:
            return True
        begin, end = begin - clock.within(begin), end + clock.within(end)
        low = bisect.bisect_left(self.stream, begin - self._horizon, key=lambda f: f.arrival)
        high = bisect.bisect_left(self.stream, begin, key=lambda f: f.arrival)
        due = (clock.periods(f.header.time_us, f.arrival) for f in self.stream[low:high])
        return any(begin <= moment <= end for moment in due)

    @property
    def _horizon(self) -> float:
        """Return the board's scheduling horizon in carrier periods; 0.0 if it named none."""
        horizons = [reply.max_horizon_us for _, reply in self.said(m.HelloReply)]
        return max(horizons, default=0) * self.record.carrier_hz * 1e-6

    @cached_property
    def stream(self) -> list[LineFrame]:
        """Frames of the stream."""
        return [f for f in self.to_board if f.header.type in m.STREAM_RANGE]

    # --- sessions and resets ---------------------------------------------------------------------

    @cached_property
    def sessions(self) -> list[tuple[LineFrame, LineFrame, bool]]:
        """HELLO, its reply, and whether it is known to have opened another session."""
        hellos = self.requests(m.MessageType.HELLO)
        found: list[tuple[LineFrame, LineFrame, bool]] = []
        nonce, boot = None, None
        for frame, reply in self.said(m.HelloReply):
            asked = [
                f for f in hellos if f.arrival <= frame.begin and f.header.seq == frame.header.seq
            ]
            is_new = nonce is not None and (reply.nonce, reply.boot_id) != (nonce, boot)
            nonce, boot = reply.nonce, reply.boot_id
            if asked:
                found.append((asked[-1], frame, is_new))
        return found

    @cached_property
    def resets(self) -> list[float]:
        """Periods at which the board was reset within the capture."""
        found = []
        boot = None
        for frame, reply in self.said(m.HelloReply):
            if reply.boot_id == boot:
                continue
            boot = reply.boot_id
            passed_us = m.signed_difference(frame.header.time_us, _AT_RESET_US % 2**_BITS, _BITS)
            moment = frame.begin - passed_us * self.record.carrier_hz * 1e-6
            if moment > 0.0:
                found.append(moment)
        return found

    @cached_property
    def clocks(self) -> list[PinDialogueClock]:
        """The device clock between resets, by PING and PONG; without them there is none."""
        hz = self.record.carrier_hz
        return [PinDialogueClock.of(begin, end, marks, hz) for begin, end, marks in self._marks]

    @property
    def end_before_lost_samples(self) -> float | None:
        """Period up to which no samples are missing, where an element is the reference.

        None: none are, or no PINGs tell. A clock of the carrier counts its periods itself.
        """
        if self.record.reference_element is None:
            return None
        hz = self.record.carrier_hz
        ends = (last_mark_before_lost_samples(marks, hz) for _, _, marks in self._marks)
        return next((end for end in ends if end is not None), None)

    @cached_property
    def _marks(self) -> list[tuple[float, float, list[tuple[float, int]]]]:
        """Return (begin, end, PINGs) for each run between resets; none of a run without PING.

        Times are in carrier periods, a PING is (arrival, device time in µs). Where the board's line
        alone was captured, it is the begin of the PONG and its time.
        """
        bounds = [0.0, *self.resets, self.record.end]
        pings: dict[tuple[int, int, int], float] = {}
        for frame, ping in self.sent(m.Ping):
            pings.setdefault((frame.header.session, frame.header.seq, ping.echo), frame.arrival)
        found = []
        for begin, end in pairwise(bounds):
            pairs = []
            for frame, pong in self.said(m.Pong):
                key = frame.header.session, frame.header.seq, pong.echo
                if not begin <= frame.begin < end:
                    continue
                if self.missing == "to_board":
                    pairs.append((frame.begin - self._first_bytes, pong.t_tx_us))
                elif key in pings:
                    pairs.append((pings.pop(key), pong.t_rx_us))
            if pairs:
                found.append((begin, end, pairs))
        return found

    @cached_property
    def _first_bytes(self) -> float:
        """Return the duration of the first two bytes of a frame, in carrier periods."""
        assert self.record.to_host is not None  # it has a PONG
        return 2.0 * float(np.diff(self.record.to_host.times).min())

    @property
    def dated_resets(self) -> Iterator[tuple[float, float]]:
        """Yield when each reset was, and within how many periods that is known."""
        for rough in self.resets:
            clock = self.clock_at(rough)
            moment = rough if clock is None else clock.periods(_AT_RESET_US % 2**_BITS, rough)
            yield moment, 0.0 if clock is None else clock.within(moment)

    def clock_at(self, period: float) -> PinDialogueClock | None:
        """Return the device clock at a period of the capture; None: it is not known."""
        return next((c for c in self.clocks if c.begin <= period < c.end), None)

    def within(self, period: float) -> float:
        """Return by how many periods a time of the device near this one may be wrong."""
        clock = self.clock_at(period)
        return 0.0 if clock is None else clock.within(period)

    def capture_time(self, frame: LineFrame, t_us: int | None = None) -> float | None:
        """Return the capture time of *t_us* on the device clock, or of the time in a header."""
        clock = self.clock_at(frame.begin)
        if clock is None:
            return None
        return clock.periods(frame.header.time_us if t_us is None else t_us, frame.begin)


def _read_line(
    record: PinRecord, name: str, line: LineBytes | None
) -> tuple[list[LineFrame], list[float]]:
    """Return the frames of a captured line, and when pieces begin that are no frame.

    Raises
    ------
    ConfigurationError
        A line without a frame, or with those of the other line.
    """
    if line is None:
        return [], []
    read = read_captured_line(line)
    if not read.frames:
        raise ConfigurationError(
            f"{record.name}: {name} carries {len(line.values)} bytes, {line.damaged} characters "
            "without a stop bit and no frame; check channel and baud of the map"
        )
    own, other = _SENDERS[name]
    if not any(frame.header.type in types for frame in read.frames for types in own):
        raise ConfigurationError(
            f"{record.name}: {name} carries frames of the {other} alone; exchange to_board and "
            "to_host in the map"
        )
    return read.frames, read.unread


def _next_time(times: Sequence[float], t: float, otherwise: float) -> float:
    """Return the first of the sorted *times* at or after *t*; *otherwise* if there is none."""
    place = bisect.bisect_left(times, t)
    return times[place] if place < len(times) else otherwise
