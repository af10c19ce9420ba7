"""Feeds the bytes of a recording to a board again, and compares what it does.

A recording on the board's own clock (of ``haptogram board``, and of boards in virtual time) runs
again byte for byte.  One by the host's clock is set against the device times of the replies.

A board at a port gets the bytes in real time. The times in stream frames and PLAY are those of the
recorded board's clock; they are moved by the difference of the two clocks, which the first reply of
each board tells.
"""

from __future__ import annotations

import contextlib
import itertools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Final, Protocol

from haptogram.driver.line.port import Transport, open_transport
from haptogram.errors import ConfigurationError, LinkError, NoAnswerError
from haptogram.records.latch import LatchRecord
from haptogram.settings.arguments import shown_argument
from haptogram_protocol import messages
from haptogram_protocol.annotation.frames import Annotated, FrameAnnotator
from haptogram_protocol.cobs import cobs_encode
from haptogram_protocol.dialects.looks_like import HAPTOGRAM, LOOKED_AT_BYTES, looks_like_dialect
from haptogram_protocol.errors import RemoteProtocolError
from haptogram_protocol.framing import DELIMITER, MAX_ENCODED_BYTES, decode_frame, encode_frame

from .channels import LATCH, LINK, OUTPUT, PULSES, TO_BOARD, TO_HOST
from .compare import RECORDED, REPLAYED, ReplayComparison
from .reader import Recording, RecordingEntry

_TOPICS: Final = (TO_BOARD, TO_HOST, LINK, LATCH, PULSES, OUTPUT)
_FRAMES: Final = (TO_BOARD, TO_HOST, LINK)
_COMPARED: Final = ("output", "pulses")  # records of the back door, beside latches
_STEP_NS: Final = 10_000_000
_AFTER_LAST_NS: Final = 12_000_000_000  # time after the last entry: the horizon of a queue
_WRAP: Final = 1 << 32
_PATIENCE_NS: Final = 2_000_000_000  # wait for the first reply, and for the last ones
_RETRY_NS: Final = 1_000_000


class RecordingReplayBoard(Protocol):
    """A board that takes recorded bytes; times are nanoseconds since its power-up."""

    @property
    def boot_us(self) -> int:
        """Device time of the power-up."""

    def write(self, t_ns: int, data: bytes, waited_ns: int) -> None:
        """Give the board bytes at *t_ns*, which may have waited for it."""

    def read(self, t_ns: int) -> bytes:
        """Return the bytes that have come from the board up to *t_ns*."""

    def unplug(self, t_ns: int) -> None:
        """Lose what is on the line: the host has closed the port."""

    def raise_hardware_fault(self, t_ns: int) -> None:
        """Let the hardware of the board fail."""

    def take_records(self) -> list[LatchRecord | Mapping[str, Any]]:
        """Return latches and other records of the back door since the last call."""


class MakeReplayBoard(Protocol):
    """Powers up the board of a recording."""

    def __call__(self, options: Mapping[str, Any], *, paced: bool) -> RecordingReplayBoard:
        """Return the board with these options."""


@dataclass(frozen=True, eq=False, slots=True)  # eq: a board may be opened twice in the same way
class _Opening:
    """One line to one board: its options, its clock, and what must be known of it beforehand."""

    options: Mapping[str, Any] | None
    boot_ns: int | None
    paced: bool
    excerpt: str = ""


@dataclass(slots=True)
class LineFacts:
    """The facts that the frames of a line tell of the board and its clock.

    Attributes
    ----------
    first_ns : int or None
        Host time of the first reply.
    device_us : int or None
        Latest device time of a reply, unwrapped.
    offset_ns : int or None
        Host time minus device time, the least of all replies.
    hello : HelloReply or None
        The board's introduction.
    immediate : set of int
        Sequence numbers of stream frames without a time to apply.
    """

    first_ns: int | None = None
    device_us: int | None = None
    offset_ns: int | None = None
    hello: messages.HelloReply | None = None
    immediate: set[int] = field(default_factory=set)


@dataclass(slots=True)
class ReplayResult:
    """The outcome of a replay.

    Attributes
    ----------
    comparisons : list of Comparison
        One for every board of the recording that was replayed.
    notes : list of str
        Parts that could not be replayed, and why.
    to_board, to_host : int
        Bytes that were fed, and bytes that came back.
    """

    comparisons: list[ReplayComparison] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    to_board: int = 0
    to_host: int = 0

    @property
    def same(self) -> int:
        """Number of entries that agree."""
        return sum(sum(comparison.same.values()) for comparison in self.comparisons)

    @property
    def differing(self) -> int:
        """Number of entries that do not."""
        return sum(sum(comparison.differing.values()) for comparison in self.comparisons)

    @property
    def is_exact(self) -> bool:
        """True if every board ran on its own clock again."""
        return all(comparison.exact for comparison in self.comparisons)

    @property
    def exit_status(self) -> int:
        """0: the same; 1: something differs; 3: there was nothing to compare."""
        if self.differing:
            return 1
        return 0 if self.same else 3


def replay_recording(recording: Recording, make_board: MakeReplayBoard) -> ReplayResult:
    """Feed a recording to virtual boards, in virtual time.

    Raises
    ------
    ConfigurationError
        If the recording cannot be read, or its board cannot be built.
    """
    result = ReplayResult()
    for opening, facts, entries in _recorded_lines(recording):
        if not _noted_as_excerpt(opening, result):
            _replay_line(opening, facts, entries, make_board, result)
    if recording.note:
        result.notes.append(recording.note)
    return result


def _noted_as_excerpt(opening: _Opening, result: ReplayResult) -> bool:
    """Add a note and return True if a line is an excerpt of a soak: it cannot be replayed."""
    if opening.excerpt:
        result.notes.append(f"an excerpt of a soak is not replayed: {opening.excerpt}")
    return bool(opening.excerpt)


def _recorded_lines(
    recording: Recording,
) -> Iterator[tuple[_Opening, LineFacts, Iterator[RecordingEntry]]]:
    """Yield for each board: its opening, what its frames tell of it, its entries in file order.

    LineFacts is empty if the opening gives the clock of the board, and for an excerpt of a soak.
    """
    facts = [
        _collect_facts(part) if opening.boot_ns is None and not opening.excerpt else LineFacts()
        for opening, part in _recorded_parts(recording, _FRAMES)
    ]
    for known, (opening, part) in zip(facts, _recorded_parts(recording, _TOPICS), strict=True):
        yield opening, known, part


def _recorded_parts(
    recording: Recording, topics: tuple[str, ...]
) -> Iterator[tuple[_Opening, Iterator[RecordingEntry]]]:
    """Yield each opening of a line with the entries of *topics* after it, in one pass.

    Entries before the first opening are left out.
    """
    last: _Opening | None = None

    def opening_of(entry: RecordingEntry) -> _Opening | None:
        nonlocal last
        last = _recorded_opening(entry) or last
        return last

    for opening, entries in itertools.groupby(recording.entries(topics), opening_of):
        if opening is not None:
            yield opening, itertools.islice(entries, 1, None)


def _recorded_opening(entry: RecordingEntry) -> _Opening | None:
    """Return the opening of a line that an entry records; None for other entries."""
    if entry.topic != LINK:
        return None
    fields = entry.fields
    if fields["event"] == "opened":
        for name, kind in (("board", dict), ("boot_ns", int)):
            if not isinstance(fields[name], kind | None):
                raise entry.damaged_error(f"holds {name} = {shown_argument(fields[name])}")
        return _Opening(fields["board"], fields["boot_ns"], bool(fields["paced"]))
    if fields["event"] == "excerpt":
        return _Opening(None, None, False, fields["text"])
    return None


def _collect_facts(entries: Iterator[RecordingEntry]) -> LineFacts:
    """Return what the frames of a line tell of the board and its clock.

    These are the host time of the first reply, the latest device time, the clock offset, the first
    HELLO_REPLY, and the stream frames without a time to apply.
    """
    facts = LineFacts()
    annotators = {TO_BOARD: FrameAnnotator(), TO_HOST: FrameAnnotator()}
    for entry in entries:
        if entry.topic == LINK:
            continue
        for piece in annotators[entry.topic].feed(entry.data):
            if piece.header is not None and entry.topic == TO_HOST:
                _note_recorded_reply(facts, entry.t_ns, piece.header)
                if isinstance(piece.message, messages.HelloReply) and facts.hello is None:
                    facts.hello = piece.message
            elif piece.header is not None and _is_recorded_immediate(piece.header):
                facts.immediate.add(piece.header.seq)
    return facts


def _is_recorded_immediate(header: messages.Header) -> bool:
    """Return True for a stream frame to be latched at once."""
    return header.type in messages.STREAM_RANGE and bool(header.flags & messages.Flag.IMMEDIATE)


def _note_recorded_reply(facts: LineFacts, t_ns: int, header: messages.Header) -> None:
    """Update *facts* with the reply of *header*, which came at *t_ns* on the host.

    Kept are the host time of the first reply, the latest device time (unwrapped), and the least
    host time minus device time.
    """
    if facts.first_ns is None or facts.device_us is None or facts.offset_ns is None:
        facts.first_ns, facts.device_us = t_ns, header.time_us
        facts.offset_ns = t_ns - header.time_us * 1000
        return
    device_us = facts.device_us + messages.signed_difference(
        header.time_us, facts.device_us % _WRAP, 32
    )
    facts.device_us = max(facts.device_us, device_us)
    facts.offset_ns = min(facts.offset_ns, t_ns - device_us * 1000)


def _replay_line(
    opening: _Opening,
    facts: LineFacts,
    entries: Iterator[RecordingEntry],
    make_board: MakeReplayBoard,
    result: ReplayResult,
) -> None:
    """Replay one line to a new board, and add the comparison to *result*.

    Without a reply to tell the clock, only a note is added.
    """
    board = make_board(_replay_options(opening, facts), paced=opening.paced)
    if opening.boot_ns is not None:
        start_ns = opening.boot_ns
    elif facts.offset_ns is not None:
        # The first device time that the recording names, as this board counts it.
        first_us = (facts.first_ns or 0) - facts.offset_ns
        ahead_us = (first_us // 1000 - board.boot_us) % _WRAP
        start_ns = (facts.first_ns or 0) - ahead_us * 1000
    else:
        result.notes.append("no reply of the board is in the recording: its clock is not known")
        return
    comparison = ReplayComparison(opening.boot_ns is not None, opening.options is not None)
    line = _ReplayLine(board, comparison, facts, start_ns)
    line.run(entries)
    if not comparison.has_backdoor:
        result.notes.append("no latches are in the recording: the frames alone are compared")
    result.comparisons.append(line.comparison)
    result.to_board += line.to_board
    result.to_host += line.to_host


def _replay_options(opening: _Opening, facts: LineFacts) -> Mapping[str, Any]:
    """Return the recorded options of the board, else those of its HELLO_REPLY; {} without both.

    Refuses a board whose reply has no grid.
    """
    if opening.options is not None:
        return opening.options
    hello = facts.hello
    if hello is None:
        return {}
    if not hello.grid_nx:
        raise ConfigurationError(
            f"the recording is of a board of {hello.transducers} transducers in no grid; name "
            "its positions with --array"
        )
    return {"array": f"{hello.grid_nx}x{hello.grid_ny}", "pitch_mm": hello.pitch_um / 1000}


class _ReplayLine:
    """Feeds one board, and hands both accounts to the comparison."""

    def __init__(
        self,
        board: RecordingReplayBoard,
        comparison: ReplayComparison,
        facts: LineFacts,
        start_ns: int,
    ) -> None:
        self.comparison = comparison
        self.to_board = self.to_host = 0
        self._board, self._facts, self._start_ns = board, facts, start_ns
        self._now_ns = 0
        self._is_over = False
        self._recorded, self._replayed = FrameAnnotator(), FrameAnnotator()

    def run(self, entries: Iterator[RecordingEntry]) -> None:
        """Feed every entry, and then let the board come to the end of its queue, 12 s at most."""
        for entry in entries:
            self._take(entry)
        end_ns = self._now_ns
        while self.comparison.awaited and self._now_ns < end_ns + _AFTER_LAST_NS:
            self._now_ns += _STEP_NS
            self._collect()
        self.comparison.forget_replayed(frames=True)
        self.comparison.close(self._board.boot_us + end_ns // 1000)

    def _take(self, entry: RecordingEntry) -> None:
        """Pass bytes of the host or a fault on to the board; compare what the board did."""
        if entry.topic == TO_BOARD:
            self._advance_to(entry)
            self.to_board += len(entry.data)
            waited_ns = entry.t_ns - entry.published_ns
            self._board.write(self._now_ns, entry.data, waited_ns)
        elif entry.topic == TO_HOST:
            self._advance_to(entry)
            for piece in self._recorded.feed(entry.data):
                self.comparison.add_frame(RECORDED, piece)
            now_us = self._board.boot_us + self._now_ns // 1000
            self.comparison.note_bytes(now_us, entry.data, self._collect())
        elif entry.topic == LINK:
            self._advance_to(entry)
            if entry.fields["event"] == "hardware_fault":
                self._board.raise_hardware_fault(self._now_ns)
            else:
                self._board.unplug(self._now_ns)
        elif entry.topic == LATCH:
            self._add(RECORDED, entry.latch)
        elif not self._is_over:
            record = entry.fields
            self._is_over = record.get("event") == "power_down"  # the mute after it is its own
            if not self._is_over:
                self._add(RECORDED, record)

    def _advance_to(self, entry: RecordingEntry) -> None:
        """Set the present time to that of an entry, unless it is already later."""
        self._now_ns = max(self._now_ns, entry.t_ns - self._start_ns)

    def _collect(self) -> bytes:
        """Read the board's output up to now, compare it and return its bytes."""
        data = self._board.read(self._now_ns)
        self.to_host += len(data)
        for piece in self._replayed.feed(data):
            self.comparison.add_frame(REPLAYED, piece)
        for record in self._board.take_records():
            self._add(REPLAYED, record)
        return data

    def _add(self, side: str, record: LatchRecord | Mapping[str, Any]) -> None:
        """Add a latch or an event of *side*, recorded or replayed, to the comparison.

        Records of other kinds, and remarks in words, are left out.
        """
        if isinstance(record, LatchRecord):
            timed = record.sequence > 0 or record.index % (1 << 16) not in self._facts.immediate
            self.comparison.add_latch(side, record, timed=timed)
        elif record["kind"] in _COMPARED and record.get("event") != "remark":  # words for a user
            self.comparison.add_record(side, record["kind"], record)


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
        """Return a frame with its time shifted to the board's clock; others unchanged.

        Raises if a timed frame comes before the shift is known.
        """
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
    result = ReplayResult()
    facts = (_collect_facts(part) for _, part in _recorded_parts(recording, _FRAMES))
    hello = next(facts, LineFacts()).hello
    parts = _recorded_parts(recording, _FRAMES)
    port = open_transport(url, baudrate=baudrate)
    with contextlib.closing(port):
        player = _RecordingPlayer(port, recording.first_bytes(LOOKED_AT_BYTES), hello)
        try:
            for opening, entries in itertools.islice(parts, 1):
                if not _noted_as_excerpt(opening, result):
                    player.run(entries)
        finally:
            with contextlib.suppress(LinkError):
                player.mute()
    result.comparisons.append(player.comparison)
    result.to_board, result.to_host = player.to_board, player.to_host
    if others := sum(1 for _ in parts):
        result.notes.append(f"the first board of the recording was fed; it has {others} more")
    if recording.note:
        result.notes.append(recording.note)
    return result


class _RecordingPlayer:
    def __init__(self, port: Transport, first: bytes, hello: messages.HelloReply | None) -> None:
        self.comparison = ReplayComparison(exact=False)
        self.to_board = self.to_host = 0
        self._port, self._hello = port, hello
        self._recorded, self._replayed = FrameAnnotator(), FrameAnnotator()
        self._shifter = ReplayFrameShifter()
        self._is_ours = HAPTOGRAM in looks_like_dialect(first)
        self._first_us: dict[str, int] = {}  # device time of the first reply, by side

    def run(self, entries: Iterator[RecordingEntry]) -> None:
        """Send what was sent, when it was sent, and compare replies; wait 2 s for the last ones."""
        start_ns: int | None = None
        now_ns = self._port.now_ns()
        for entry in (entry for entry in entries if entry.topic != LINK):
            start_ns = now_ns - entry.t_ns if start_ns is None else start_ns
            if entry.topic == TO_HOST:
                for piece in self._recorded.feed(entry.data):
                    self._compare_frame(RECORDED, piece)
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
        """Wait up to 2 s for the board's first reply, if the recording has had one by now.

        Raises if none comes.
        """
        end_ns = self._port.now_ns() + _PATIENCE_NS
        while RECORDED in self._first_us and REPLAYED not in self._first_us:
            if self._port.now_ns() > end_ns:
                raise NoAnswerError(f"{self._port.url}: the board does not answer")
            self._listen_until(self._port.now_ns() + _RETRY_NS)

    def _listen_until(self, t_ns: int) -> None:
        """Read and compare the board's frames until *t_ns* on the host's clock."""
        while True:
            data = self._port.read_available(t_ns)
            self.to_host += len(data)
            for piece in self._replayed.feed(data):
                self._compare_frame(REPLAYED, piece)
            if self._port.now_ns() >= t_ns:
                return

    def _compare_frame(self, side: str, piece: Annotated) -> None:
        """Compare a frame of *side*, recorded or replayed, with that of the other side.

        The first frames of both give the shift of the clock. Refuses a board whose HELLO_REPLY
        names another number of transducers.
        """
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
        """Refuse a board with another number of transducers than the recorded one."""
        before = self._hello
        if before is not None and before.transducers != hello.transducers:
            raise ConfigurationError(
                f"{self._port.url}: the board has {hello.transducers} transducers; the recording "
                f"is of {before.transducers}"
            )

    def _send(self, data: bytes) -> None:
        """Write all bytes to the port; read while it takes none."""
        rest = data
        while rest:
            written = self._port.write_some(rest)
            rest = rest[written:]
            self.to_board += written
            if rest:
                self._listen_until(self._port.now_ns() + _RETRY_NS)
