"""Rules that hold in every frame of a run: each frame that comes is judged, whatever the case is.

A case asks for a rule where it expects a board to break it; here nothing is asked, and every
reply and event of every case counts.
"""

from __future__ import annotations

import dataclasses
import itertools
import zlib
from collections import Counter as Counts
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import Final

from haptogram_protocol import messages as m
from haptogram_protocol.annotation.frames import annotated_frame_text, annotated_type_name
from haptogram_protocol.framing import DELIMITER, HEADER_BYTES
from haptogram_protocol.state import MuteReason, OutputState

from ..causes import cause_rank
from ..client.board_client import PARTS_OF_FRAMES
from ..client.recording import counter_steps
from ..client.wire import ReceivedByClient
from ..outcome import RuleFindings, record_differences
from .line_rules import TRACES, Broken, LineRules
from .sent_drives import DRIVE_OF, SentDrives

_WRAP: Final = 1 << 32
_LONG_US: Final = 1_000_000_000  # beyond this two times of 32 bits tell no difference
_SPARE_US: Final = 5_000_000  # largest age of a message in transit
#: Fields of HELLO_REPLY that a new session may find changed.
_OF_SESSION: Final = ("nonce", "state", "sound_speed_mm_s", "config_crc")
_REASONS: Final = {
    OutputState.DISARMED: (MuteReason.NEVER_ARMED, MuteReason.DISARM, MuteReason.NEW_SESSION),
    OutputState.ARMED: (MuteReason.NONE,),
    OutputState.MUTED: (
        MuteReason.MUTE,
        MuteReason.HOLD_EXPIRED,
        MuteReason.HOST_SILENT,
        MuteReason.UNATTENDED,
    ),
    OutputState.FAULT: (MuteReason.FAULT,),
}


@dataclass(slots=True)
class _Since:
    """What was seen of a board since it started, or since its port was opened."""

    identity: m.HelloReply | None = None
    counters: m.Counters | None = None
    config: m.Config | None = None
    config_crc: int | None = None
    elements: dict[int, m.Element] = field(default_factory=dict)
    session: int = 0
    next_event: int | None = None
    latch: tuple[int, int] | None = None  # time of the last traced latch, and of its trace
    ended: tuple[int, int] | None = None  # session and time of the last PLAYBACK_ENDED
    response: tuple[int, int] | None = None  # the same of the newest response
    sent: Counts[int] = field(default_factory=Counts)  # frames since the last status, by type
    at_once: set[bytes] = field(default_factory=set)  # responses of that time


class StandingRules:
    """Judges every frame that comes.

    Parameters
    ----------
    findings : RuleFindings
        Where the result is noted.
    is_lossless : bool
        Whether the line can neither lose nor change a byte.
    """

    def __init__(self, findings: RuleFindings, *, is_lossless: bool = False) -> None:
        self._findings = findings
        self._line = LineRules(is_lossless=is_lossless)
        self._sent = SentDrives()
        self._since = _Since()
        self._case = ""
        self._in_case: dict[str, str] = {}
        self._rules: tuple[tuple[Callable[..., Broken], tuple[type[m.Message], ...]], ...] = (
            (self._judge_identity, (m.HelloReply,)),
            (self._judge_status, (m.Status, m.StatusReply)),
            (
                self._judge_config,
                (m.UploadCommitReply, m.SetConfigReply, m.ConfigReply, m.StatusReply),
            ),
            (self._judge_geometry, (m.GeometryReply,)),
            (self._judge_upload_limits, (m.UploadBeginReply,)),
            (self._judge_events, (m.Message,)),
            (self._judge_traces, (m.TraceReply, *TRACES)),
            (self._judge_order, (m.Message,)),
            (self._judge_times, (m.Message,)),
            (self._judge_drives, (m.DriveReply, m.TraceReply, m.UploadCommitReply, *TRACES)),
            (self._judge_room, (m.UploadBeginReply, m.UploadCommitReply, m.Error)),
        )

    def begin_board(self, line_us: Callable[[int], int] | None = None) -> None:
        """Note that a board has started, or its port was opened; bytes take *line_us* there."""
        self._since = _Since()
        self._sent.forget()
        self._line.begin_board(line_us)

    def begin_case(self, name: str) -> None:
        """Note the case whose frames come now."""
        self._case, self._in_case = name, {}

    @property
    def found_in_case(self) -> str:
        """Finding in the frames of this case, of the likeliest cause; empty without any."""
        clause = min(self._in_case, key=cause_rank, default="")
        return f"{clause}: {self._in_case[clause]}" if clause else ""

    def take_sent(self, data: bytes, t_us: int = 0) -> None:
        """Note bytes that the host sends."""
        pieces = data.split(DELIMITER)
        self._since.sent.update([piece[1] for piece in pieces if len(piece) > HEADER_BYTES])
        self._sent.take(data)
        self._line.take_sent(data, t_us)

    def take(self, piece: ReceivedByClient) -> None:
        """Judge a piece that came."""
        self._note_all(self._line.broken_by(piece), piece)
        if piece.header is None or piece.message is None:
            self._since.next_event = None  # bytes were lost, and frames with them perhaps
            return
        if self._is_repeated(piece) or not (piece.is_response or piece.is_event):
            return
        for rule, kinds in self._rules:
            if isinstance(piece.message, kinds):
                self._note_all(rule(piece, piece.message), piece)

    def _is_repeated(self, piece: ReceivedByClient) -> bool:
        """Return True if a response is a copy from the board's memory (HG-4.11/6).

        Its time is then before that of the newest response, or its bytes have already come with it.
        """
        assert piece.header is not None  # take
        if not piece.is_response:
            return False
        before, now_us = self._since.response, piece.header.time_us
        recent = before is not None and piece.t_us - before[1] < _LONG_US
        if before is not None and recent and m.signed_difference(now_us, before[0], 32) < 0:
            return True
        if before is None or now_us != before[0]:
            self._since.at_once.clear()
        elif piece.piece in self._since.at_once:
            return True
        self._since.at_once.add(piece.piece)
        self._since.response = now_us, piece.t_us
        return False

    def _note_all(self, broken: Broken, piece: ReceivedByClient) -> None:
        """Note the clauses that a frame was judged by, and those with a text as broken.

        *broken* yields (clause, text), the text '' if it is kept.
        """
        judged = self._findings.judged
        for clause, text in broken:
            judged.add(clause)
            if text:
                self._note(clause, text, piece)

    def _note(self, clause: str, text: str, piece: ReceivedByClient) -> None:
        """Record a broken clause with its case and frame."""
        if clause not in self._in_case or DRIVE_OF in text:
            self._in_case[clause] = text
        if clause not in (broken := self._findings.broken):
            broken[clause] = f"in {self._case}: {text} [{annotated_frame_text(piece.piece)}]"

    # --- HELLO -----------------------------------------------------------------------------------

    def _judge_identity(self, _: ReceivedByClient, message: m.HelloReply) -> Broken:
        """Yield HG-4.3/1, with a text if the identity in HELLO_REPLY has changed, else ''."""
        was = self._since.identity or message
        fields = (field.name for field in dataclasses.fields(message))
        kept = (name for name in fields if name not in _OF_SESSION)
        names = [name for name in kept if getattr(message, name) != getattr(was, name)]
        yield "HG-4.3/1", f"{', '.join(names)} changed" if names else ""
        self._since.identity = message

    # --- STATUS ----------------------------------------------------------------------------------

    def _judge_status(self, _: ReceivedByClient, message: m.Status | m.StatusReply) -> Broken:
        """Yield clauses on a status, each with a text if it is broken, else ''.

        State, reason and counters must agree, and no counter may have decreased.
        """
        yield "HG-3.9/2", self._wrong_counter_sum(message.counters)
        due = _REASONS[OutputState(message.state)]
        text = f"{message.state.name} with the reason {message.reason.name}"
        yield "HG-6.2/3", text if message.reason not in due else ""
        yield "HG-9.1/3", "; ".join(_contradictions(message))
        yield "HG-9.2/1", self._decreased_counters(message.counters)

    def _wrong_counter_sum(self, counters: m.Counters) -> str:
        """Return a text if the counter `frames` is not the sum of its parts, else ''.

        The parts count what became of each frame (HG-3.9/2). A difference that was in the status
        before is let pass.
        """
        lacks, sent = _lacking_parts(counters), +self._since.sent
        self._since.sent.clear()
        before = self._since.counters
        if lacks == (_lacking_parts(before) if before is not None else 0):
            return ""  # or reported at its beginning
        text = f"frames is {counters.frames}, its parts make {counters.frames - lacks}"
        if before is None:
            return text
        steps = counter_steps(before, counters)
        parts = ", ".join(f"{name} {steps[name]}" for name in PARTS_OF_FRAMES if steps[name])
        named = ", ".join(f"{many} {annotated_type_name(kind)}" for kind, many in sent.items())
        return f"{text}; since the STATUS before: frames {steps['frames']}, {parts}; sent: {named}"

    def _decreased_counters(self, now: m.Counters) -> str:
        """Return a text on counters that have decreased since the last status, or ''."""
        before, self._since.counters = self._since.counters or now, now
        return "; ".join(
            f"{name} {getattr(before, name)}, then {getattr(now, name)}"
            for name in m.Counters.WIRE
            if (getattr(now, name) - getattr(before, name)) % _WRAP >= _WRAP // 2
        )

    # --- Configuration and geometry --------------------------------------------------------------

    def _judge_config(self, _: ReceivedByClient, message: m.Message) -> Broken:
        """Yield clauses on the configuration and its CRC, each with a text if broken, else ''.

        They may change only when they are set.
        """
        since = self._since
        if isinstance(message, m.UploadCommitReply):
            since.config_crc = None
        elif isinstance(message, m.SetConfigReply):
            since.config, since.config_crc = message.config, message.config_crc
        elif isinstance(message, m.ConfigReply):
            was = since.config if since.config is not None else message.config
            text = f"nothing was set, and {record_differences(message.config, was, 'was')}"
            yield "HG-7.1/3", text if message.config != was else ""
            since.config = message.config
        if isinstance(message, m.ConfigReply | m.StatusReply):
            crc = since.config_crc if since.config_crc is not None else message.config_crc
            text = f"config_crc was {crc:#010x}, and nothing was set"
            yield "HG-7.1/5", text if message.config_crc != crc else ""
            since.config_crc = message.config_crc

    def _judge_geometry(self, _: ReceivedByClient, message: m.GeometryReply) -> Broken:
        """Yield HG-7.5/1, with a text if a transducer is reported at another place, else ''."""
        since = self._since
        if since.identity is None:
            return
        total = since.identity.transducers
        wrong = [f"total is {message.total} of {total}"] if message.total != total else []
        for number, element in enumerate(message.elements, message.first):
            if since.elements.setdefault(number, element) != element:
                was = since.elements[number]
                wrong.append(f"transducer {number}: {record_differences(element, was, 'was')}")
        yield "HG-7.5/1", "; ".join(wrong[:2])

    def _judge_upload_limits(self, _: ReceivedByClient, message: m.UploadBeginReply) -> Broken:
        """Yield HG-7.2/6, with a text if limits of UPLOAD_BEGIN_REPLY and HELLO_REPLY differ.

        '' if they agree.
        """
        identity = self._since.identity
        if identity is None:
            return
        told = message.max_chunk, message.window
        due = identity.max_chunk, identity.upload_window
        text = f"max_chunk and window are {told}, in HELLO_REPLY {due}"
        yield "HG-7.2/6", text if told != due else ""

    # --- Events ----------------------------------------------------------------------------------

    def _judge_events(self, piece: ReceivedByClient, message: m.Message) -> Broken:
        """Yield HG-3.6/2, with a text if an event's number is not the next one, else ''.

        Numbers begin at 0 with a session; of the first session seen, any may be the first.
        """
        header, since = piece.header, self._since
        assert header is not None  # take
        if header.session and header.session != since.session:
            # Behind the first session that is seen it is not known how many events went before.
            since.next_event = 0 if since.session and isinstance(message, m.HelloReply) else None
            since.session = header.session
            self._sent.begin_session()
        if not piece.is_event:
            return
        due = header.seq if since.next_event is None else since.next_event
        yield "HG-3.6/2", f"event {header.seq}, due is {due}" if header.seq != due else ""
        since.next_event = (header.seq + 1) & 0xFFFF

    def _judge_order(self, piece: ReceivedByClient, message: m.Message) -> Broken:
        """Yield HG-4.11/5, with a text if PLAYBACK_ENDED came before STATE_CHANGED, else ''.

        Only if both have the same session and time, and the reason of STATE_CHANGED is not FAULT.
        """
        header, since = piece.header, self._since
        assert header is not None  # take
        if isinstance(message, m.StateChanged):
            same = since.ended == (header.session, header.time_us)
            same &= message.reason is not MuteReason.FAULT  # after STOP in the same microsecond
            yield "HG-4.11/5", "PLAYBACK_ENDED of the same moment came before" if same else ""
        elif isinstance(message, m.PlaybackEnded):
            since.ended = header.session, header.time_us
        elif piece.is_response:
            since.ended = None  # what comes next is of another request

    def _judge_times(self, piece: ReceivedByClient, _: m.Message) -> Broken:
        """Yield HG-3.1/1, with a text if an event is over 5 s older than the newest response.

        With a text, too, if it is over 5 s ahead of the present; else with ''.
        """
        header, newest = piece.header, self._since.response
        assert header is not None  # take
        if newest is None or piece.t_us - newest[1] > _LONG_US:
            return
        off_us = m.signed_difference(header.time_us, newest[0], 32)
        most_us = piece.t_us - newest[1] + _SPARE_US
        if piece.is_event:
            text = f"its time is {off_us} µs behind that of the last response"
            yield "HG-3.1/1", text if not -_SPARE_US <= off_us <= most_us else ""

    def _judge_traces(self, piece: ReceivedByClient, message: m.Message) -> Broken:
        """Yield clauses on record numbers of the trace ring, and on times of traced latches.

        Two latches must be half a carrier period apart at least. The text of a clause is '' unless
        it is broken.
        """
        header, since = piece.header, self._since
        assert header is not None  # take
        if isinstance(message, m.TraceReply):
            yield "HG-8.5/2", _wrong_records(message)
            times = [record.t_latch_us for record in message.records]
            yield "HG-5.8/3", self._wrong_steps(times)
        elif isinstance(message, TRACES):
            before, since.latch = since.latch, (header.time_us, piece.t_us)
            if before is not None and piece.t_us - before[1] < _LONG_US:
                yield "HG-5.8/3", self._wrong_steps((before[0], header.time_us))

    def _judge_drives(self, piece: ReceivedByClient, message: m.Message) -> Broken:
        """Yield clauses on latched drives, each with a text if it is broken, else ''.

        A drive must be that of a frame sent or stored with its number.
        """
        session, identity = piece.header.session if piece.header else 0, self._since.identity
        if identity is None:
            return
        number = identity.transducers
        if isinstance(message, m.UploadCommitReply):
            self._sent.note_commit()
        for key, crc in _crcs_of_latches(message, number):
            if key.sequence:
                stored = self._sent.stored_crcs(key.sequence, key.index, number)
                text = f"frame {key.index} of a sequence was latched as another one than stored"
                yield "HG-7.6/4", text if stored and crc not in stored else ""
                continue
            sent = self._sent.codes_of(session, key.index, number)
            text = f"frame {key.index} was latched as another drive than it was sent"
            due = [zlib.crc32(phases + amplitudes) for phases, amplitudes in sent]
            is_wrong = due and crc not in due
            yield "HG-8.3/2", text + self._sent.other_frame(session, crc) if is_wrong else ""
        if isinstance(message, m.DriveReply) and message.kind is m.DriveKind.LATCHED:
            key, half = message.key, len(message.data) // 2
            part = slice(message.first, message.first + half)
            sent = [] if key.sequence else self._sent.codes_of(session, key.index, number)
            due_codes = [phases[part] + amplitudes[part] for phases, amplitudes in sent]
            text = f"frame {key.index} is shown as another drive than it was sent"
            if due_codes and message.data not in due_codes:
                told = dataclasses.replace(message, data=due_codes[-1])
                text += self._sent.other_frame(session, zlib.crc32(message.data), part)
                yield "HG-8.6/3", f"{text}: {record_differences(message, told)}"
            else:
                yield "HG-8.6/3", ""

    def _judge_room(self, piece: ReceivedByClient, message: m.Message) -> Broken:
        """Yield HG-7.2/7, with a text if the free memory for uploads has shrunk, else ''.

        Nothing is yielded where it cannot be compared, as other sequences are stored.
        """
        identity = self._since.identity
        if identity is None or piece.header is None or not piece.is_response:
            return
        text = self._sent.room.shrunk(piece.header.seq, message, identity)
        if text is not None:
            yield "HG-7.2/7", text

    def _wrong_steps(self, times: Iterable[int]) -> str:
        """Return a text on two *times* (µs) of latches under half a carrier period apart, or ""."""
        identity = self._since.identity
        if identity is None or not identity.carrier_hz:
            return ""
        carrier_us, told = 1_000_000 // identity.carrier_hz, list(times)
        for one, two in itertools.pairwise(told):
            step_us = (two - one) % _WRAP
            if 2 * step_us < carrier_us:
                return f"latches at {one} and {two} µs, the carrier period is {carrier_us} µs"
        return ""


def _crcs_of_latches(message: m.Message, transducers: int) -> Iterator[tuple[m.LatchKey, int]]:
    """Yield latch and CRC-32 of each drive in a message; nothing if no drive is in it.

    A drive of other than N *transducers* is left out.
    """
    if isinstance(message, m.Trace):
        yield m.LatchKey(0, 0, message.index), message.crc
    elif isinstance(message, m.TracePlayback):
        yield message.key, message.crc
    elif isinstance(message, m.TraceDrive):
        if len(message.data) == 2 * transducers:
            yield message.key, zlib.crc32(message.data)
    elif isinstance(message, m.TraceReply):
        for item in message.records:
            yield item.key, item.crc


def _lacking_parts(counters: m.Counters) -> int:
    """Return the counter `frames` minus the counters of what became of a frame (HG-3.9/2).

    0 if they agree; it is signed, modulo 2^32.
    """
    parts = sum(int(getattr(counters, name)) for name in PARTS_OF_FRAMES)
    return (counters.frames - parts + _WRAP // 2) % _WRAP - _WRAP // 2


def _contradictions(status: m.Status | m.StatusReply) -> Iterator[str]:
    """Yield a text on each contradiction of state, queue, margins and counters in a status."""
    if status.state is not OutputState.ARMED and status.queued:
        yield f"{status.queued} frames are queued while {status.state.name}"
    if not status.margins and (status.margin_min_us or status.margin_mean_us):
        yield "margins of no frame"
    if status.margins and status.margin_min_us > status.margin_mean_us:
        yield "the least margin is above the mean"
    counters = status.counters
    of_stream = (counters.accepted - counters.flushed - status.queued) % _WRAP
    if (counters.latched - of_stream) % _WRAP >= _WRAP // 2:  # HG-5.7/8
        yield f"{of_stream} latches by accepted, flushed and queued, {counters.latched} in all"
    if counters.late > counters.latched:
        yield "more late latches than latches"


def _wrong_records(reply: m.TraceReply) -> str:
    """Return a text if record numbers of the trace ring do not rise or are outside it, else "".

    It is from `oldest` to before `next`, both in *reply*.
    """
    numbers = [record.number for record in reply.records]
    inside = all(reply.oldest <= number < reply.next for number in numbers)
    if reply.oldest <= reply.next and inside and numbers == sorted(set(numbers)):
        return ""
    return f"records {numbers[:4]}... of a ring from {reply.oldest} to {reply.next}"
