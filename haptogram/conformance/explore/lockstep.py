"""The same dialogue at the board under test and at its models: what each says, slot by slot."""

from __future__ import annotations

import itertools
from collections.abc import Container, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Final

from haptogram_protocol import messages as m
from haptogram_protocol.annotation.frames import annotated_frame_text
from haptogram_protocol.framing import DELIMITER, MAX_ENCODED_BYTES

from ..client.board_client import BoardClient
from ..client.wire import ReceivedByClient
from ..outcome import CaseEndedError
from .actions import (
    FAULT,
    SLOT_US,
    DialogueAction,
    end_of_slot,
    frames_of_slot,
    number_at_end_of_slot,
    pieces_of_slot,
)
from .broken_clauses import BROKEN_FRAME_CLAUSES
from .comparison import (
    DialogueAnswers,
    DialogueBase,
    DialogueComparison,
    DialogueMemory,
    FrameInDialogue,
    is_optional_in_dialogue,
    superfluous_in_dialogue,
)
from .host import DialogueHost
from .model import DialogueModels, HostLateError
from .opening import SINCE_POWER_UP, DialogueOpening

_AHEAD_US: Final = SLOT_US // 8  # a slot is planned so long before it begins
_NEAR_US: Final = 200  # error of times that a host knows
_NEAR_EXACT_US: Final = 10  # HG-6.9/2, where bytes take no time
_SHARES: Final = {True: 6, False: 2}  # parts of a slot, 1 / n, that its frames may take on the line
_AROUND: Final = 24  # bytes of the line that a body may add: checksum, stuffing, delimiters
_TAIL: Final = 6  # slots after the last frame: timers end
_END_US: Final = 2000  # time before the end of a slot at which the board has sent everything
_SETTLED_US: Final = 1000  # a latch and what is said of it
_IDLE_US: Final = 400_000  # a model that does nothing for so long need not be waited for
_LONGEST_US: Final = 2_000_000  # longest dialogue whose slots are cut short: no timer expires
_MISSED_US: Final = 1_500_000  # how long a frame that is missing is waited for, at a wall clock


@dataclass(frozen=True, slots=True)
class Played:
    """A dialogue that was played.

    Attributes
    ----------
    difference : str
        First difference between board and model; empty if there is none.
    sent : list of tuple
        The dialogue: time, description and bytes of each frame sent.
    slot : int
        Slot of the difference.
    held_up_us : int
        How long host, board or line were held up, or may have been; 0 in virtual time.
    """

    difference: str
    sent: Sequence[tuple[int, str, bytes]]
    slot: int = 0
    held_up_us: int = 0

    @property
    def lines(self) -> list[str]:
        """The dialogue as text: each frame with its time, in words and as bytes."""
        return [
            f"{t_us:>8} µs  {name} = {_annotated_text(wire)}: {wire.hex()}"
            for t_us, name, wire in self.sent
        ]


@dataclass(slots=True)
class _Arrival:
    """Encoded frames that arrive *wait_us* after those before; the hardware may fail then."""

    wait_us: int
    wires: list[bytes]
    fails: bool = False


class Lockstep:
    """A board under test, and its models beside it.

    Parameters
    ----------
    board : BoardClient
        Client of the board, with a session.

    Attributes
    ----------
    is_exact : bool
        Whether bytes arrive to the microsecond.

    Raises
    ------
    CaseEndedError
        INCONCLUSIVE, from every step: the process of a model has ended.
    """

    def __init__(self, board: BoardClient) -> None:
        self._board = board
        self._is_virtual = board.wire.is_virtual
        self._models = DialogueModels(board.identity, knows_time=self._is_virtual)
        self._opening = DialogueOpening(board, self._models)
        self.is_exact = self._is_virtual and board.wire.carries(MAX_ENCODED_BYTES, 1)
        self._least_near_us = _NEAR_EXACT_US if self.is_exact else _NEAR_US
        self._session = self._near_us = 0

    def close(self) -> None:
        """End the processes of the models."""
        self._models.close()

    @property
    def board(self) -> BoardClient:
        """Client of the board: another one after a power-up."""
        return self._board

    def play(
        self,
        actions: Sequence[DialogueAction],
        config: m.Config,
        seed: int,
        *,
        timed: bool,
        powers_up: bool = False,
    ) -> Played:
        """Play a dialogue at all boards and compare; without timers slots are cut short.

        With *powers_up* the boards are switched off and on before, and the actions of slots before
        0 come before the first HELLO.

        Raises
        ------
        HostLateError
            If bytes may have come so late that a healthy board says something else.
        """
        self._board.wire.begin_case()
        early: list[DialogueAction] = []
        if powers_up:
            host = self._opening.power_up()
            self._board = self._opening.board
            early = [action for action in actions if action.slot < 0]
            played = self._compare(host, early, (SINCE_POWER_UP, SINCE_POWER_UP), timed=False)
            if played.difference:
                self._board.link.session = 0
                return replace(played, difference=f"{played.difference}, before the first HELLO")
        host = self._open(config, seed, is_known=powers_up)
        base = (SINCE_POWER_UP, SINCE_POWER_UP) if powers_up else self._opening.baseline(host)
        try:
            late = [action for action in actions if action.slot >= 0]
            found = self._compare(host, late, base, timed=timed)
        except HostLateError:
            self._board.wire.idle(2 * SLOT_US)  # answers on their way are of no later dialogue
            raise
        finally:
            # Where the client goes on.
            self._board.link.seq, self._board.link.session = host.seq + 1, host.session
        return replace(found, sent=[*played.sent, *found.sent]) if powers_up else found

    def _open(self, config: m.Config, seed: int, *, is_known: bool) -> DialogueHost:
        """Open the session of a dialogue; retry once at wall-clock time if the host was delayed.

        *is_known*: board and virtual board are in the same state already. *seed*: of the data
        stored first.
        """
        try:
            return self._opening.open(config, seed, is_known=is_known)
        except CaseEndedError:
            if self._is_virtual:
                raise
            self._board.wire.idle(_MISSED_US)  # a board that was held up answers now
            return self._opening.open(config, seed)

    def _compare(
        self,
        host: DialogueHost,
        actions: Sequence[DialogueAction],
        base: tuple[DialogueBase, DialogueBase],
        *,
        timed: bool,
    ) -> Played:
        """Play a dialogue, slot by slot of 40 ms, on board and virtual board.

        It ends at the first difference. *base* has the counters of both boards before slot 0, the
        board's first. *timed*: timers end in it, so no slot is cut short.
        """
        self._memory = DialogueMemory()
        self._session = host.session
        self._near_us = self._least_near_us
        self._early: list[FrameInDialogue] = []
        self._since = self._board.link.mark()
        sent: list[tuple[int, str, bytes]] = []
        room_bytes = self._board.wire.baudrate * SLOT_US // _SHARES[timed] // 10_000_000
        first = min(0, *(action.slot for action in actions), 0)
        slots = max((action.slot for action in actions), default=0) + _TAIL * timed + 1
        clock = self._board.clock
        start_us = host.slot_us = clock.on_carrier(clock.device_estimate_us() + _AHEAD_US)
        by_slot: dict[int, list[DialogueAction]] = {}
        for action in actions:
            by_slot.setdefault(action.slot, []).append(action)
        slot, waited_us = first, 0
        while slot < slots:
            due = by_slot.get(slot, [])
            batch = frames_of_slot(host, due, room_bytes, exact=self.is_exact)
            shown_us = host.slot_us - start_us
            arrived_us = itertools.accumulate(action.wait_us for action, _ in batch)
            sent += [
                (shown_us + wait_us, action.name, wire)
                for (action, wire), wait_us in zip(batch, arrived_us, strict=True)
            ]
            arrivals = _slot_arrivals(batch, b"" if host.unsent else end_of_slot(host))
            silent = self._silent_slots(slot, slots, by_slot) if timed else 0
            found = self._slot(host, arrivals, base, may_cut=not timed, silent=silent)
            if found and not self.is_exact and self._has_dropped_traces(host, base[0]):
                raise HostLateError("the line of the board had no room for traces: HG-8.7/2")
            if found:
                text = f"{found} ({shown_us} µs after the start)"
                if batch and not host.unsent:
                    end = "a request whose refusal shows that all was read"
                    sent.append((shown_us, end, arrivals[-1].wires[-1]))
                return Played(text, sent, slot, self._board.wire.held_up_us)
            host.slot_us = self._next_slot(host.slot_us + silent * SLOT_US, may_cut=not timed)
            slot += 1 + silent
            waited_us += sum(arrival.wait_us for arrival in arrivals)
            if not timed and host.slot_us - start_us - waited_us > _LONGEST_US:
                break
        # What came early was due in the slot after the last one, or never.
        self._models.advance(host.slot_us + SLOT_US)
        behind = self._models.due(host, base[1], self._near_us, is_last=True)
        text = superfluous_in_dialogue(self._early[len(behind) :])
        return Played(text, sent, slots, self._board.wire.held_up_us)

    def _silent_slots(self, slot: int, slots: int, by_slot: Container[int]) -> int:
        """Return how many slots of 40 ms right after *slot* have no actions.

        *slots* is the number of all slots, *by_slot* holds the numbers of those with actions. At a
        wall clock it is 0, so that each slot is compared by itself: the host may be late.
        """
        if not self._is_virtual:
            return 0
        behind = range(slot + 1, slots)
        return next((n for n, other in enumerate(behind) if other in by_slot), len(behind))

    # --- time ----------------------------------------------------------------------------------

    def _next_slot(self, slot_us: int, *, may_cut: bool) -> int:
        """Return the device time in µs at which the next slot (40 ms) begins; skip missed ones.

        That is 1 ms after the frames of this one have latched if *may_cut* and idle, else 40 ms
        after its start.
        """
        clock = self._board.clock
        now_us = max(clock.device_estimate_us(), self._models.now_us)
        if may_cut and self._is_idle(slot_us):
            return clock.on_carrier(max(now_us, slot_us + self._settled_us()) + _SETTLED_US)
        late_us = max(0, now_us + self._early_us(0) - slot_us - SLOT_US)
        return slot_us + SLOT_US * (1 - (-late_us // SLOT_US))

    def _is_idle(self, slot_us: int) -> bool:
        """Return True if no virtual board has an event due within 400 ms of *slot_us*.

        That is the device time at which a slot of 40 ms begins.
        """
        next_us = self._models.next_us()
        return next_us is None or next_us >= slot_us + _IDLE_US

    def _settled_us(self) -> int:
        """Return how long after the start of a slot (40 ms) a frame without a time has latched.

        It is 38 ms at most.
        """
        board = self._board
        ready_us = board.clock.ready_us(_SETTLED_US, board.identity.max_points)
        return min(ready_us, SLOT_US - _END_US)

    def _early_us(self, line_us: int) -> int:
        """Return how long before its slot (40 ms) the host sends bytes that take *line_us*."""
        early_us = self._opening.early_us
        return early_us if self.is_exact else early_us + line_us

    def _wait_until(self, t_us: int) -> None:
        """Idle until the device clock, as estimated, has reached *t_us*."""
        self._board.wire.idle(max(0, t_us - self._board.clock.device_estimate_us()))

    # --- one slot ------------------------------------------------------------------------------

    def _slot(
        self,
        host: DialogueHost,
        arrivals: Sequence[_Arrival],
        base: tuple[DialogueBase, DialogueBase],
        *,
        may_cut: bool,
        silent: int = 0,
    ) -> str:
        """Play a slot of 40 ms on board and virtual board; return the first difference, or ''.

        *base* has both boards' counters before the dialogue, the board's first. *may_cut*: the slot
        ends as soon as all is answered, else after *silent* further slots without actions.
        """
        board, models, at_us = self._board, self._models, host.slot_us
        wires = [wire for arrival in arrivals for wire in arrival.wires]
        line_us = board.wire.line_us(sum(map(len, wires)))
        self._wait_until(max(at_us - self._early_us(line_us), models.now_us))
        sent_us = board.clock.device_estimate_us()
        if self._is_virtual:
            at_us = host.slot_us = self._arrive(at_us, arrivals)
        elif wires:
            self._send(wires)
            answered_us = self._answered_us(host, sent_us)
            heard_us = max([sent_us, *answered_us])
            board.wire.note_held_up(heard_us - sent_us - line_us)
            self._near_us = max(self._near_us, heard_us - sent_us + _NEAR_US)
            models.receive(sent_us, wires, answered_us)
        if may_cut:
            models.advance(max(at_us, models.now_us) + self._settled_us())
        if not (may_cut and self._is_idle(at_us)):
            at_us += silent * SLOT_US
            models.advance(at_us + SLOT_US - _END_US)
            self._wait_until(at_us + SLOT_US - _END_US - 1000)
        due = models.due(host, base[1], self._near_us)
        self._await_frames(due, at_us + SLOT_US)
        return self._judge(host, due, base, line_us)

    def _arrive(self, slot_us: int, arrivals: Iterable[_Arrival]) -> int:
        """Deliver the bytes and hardware faults of a slot (40 ms) to board and virtual board.

        Returns the device time, in µs, at which the slot begins in which the last of them come.
        """
        board, models, at_us = self._board, self._models, slot_us
        for arrival in arrivals:
            if arrival.wait_us:
                at_us += arrival.wait_us
                models.advance(at_us)
                self._wait_until(at_us - self._early_us(0))
            if self.is_exact:
                self._send(arrival.wires)
                models.receive(at_us, arrival.wires)
            else:
                self._arrive_in_turn(arrival.wires)
            if arrival.fails and board.raise_fault is not None:
                board.raise_fault()
                models.fault(at_us)
        return slot_us + (at_us - slot_us) // SLOT_US * SLOT_US

    def _arrive_in_turn(self, wires: Sequence[bytes]) -> None:
        """Deliver frames one by one to board and virtual board, at the rate of the line."""
        wire, models = self._board.wire, self._models
        begun_us = self._board.clock.device_estimate_us() + self._opening.early_us + wire.backlog_us
        self._send(wires)
        for frame, size in zip(wires, itertools.accumulate(map(len, wires)), strict=True):
            at_us = max(models.now_us, begun_us + wire.line_us(size))
            models.receive_near(at_us, frame, _NEAR_US)

    def _send(self, wires: Iterable[bytes]) -> None:
        """Send the frames of a slot of 40 ms, in pieces that the board has time to read."""
        for piece in pieces_of_slot(b"".join(wires)):
            self._board.wire.send(piece)

    def _answered_us(self, host: DialogueHost, sent_us: int) -> list[int]:
        """Return the device times in µs at which the board began each reply of a slot (40 ms).

        No time is before *sent_us*. [] if the reply to the slot's last request is missing after 1.5
        s.
        """
        board = self._board
        seq = number_at_end_of_slot(host)

        def ends_slot(piece: ReceivedByClient) -> bool:
            is_refusal = isinstance(piece.message, m.Error) and piece.message.request == m.Ping.TYPE
            return is_refusal and piece.header is not None and piece.header.seq == seq

        if board.wire.wait_for(ends_slot, self._since, _MISSED_US) is None:
            return []
        ahead_us = board.clock.device_estimate_us() - board.wire.now_us() + self._opening.unsure_us
        pieces = board.link.responses(self._since)
        bodies = [piece.body for piece in pieces]
        found: list[int] = []
        for place, piece in reversed(list(enumerate(pieces))):
            assert piece.header is not None  # it is a response
            came_us = max(sent_us, piece.t_us + ahead_us)
            said_us = m.unwrap(piece.header.time_us, came_us, 32)
            is_new = piece.body not in bodies[:place]  # one from memory tells when it was made
            is_known = is_new and sent_us <= said_us <= came_us
            found.append(min([said_us if is_known else came_us, *found[-1:]]))
        return found[::-1]

    def _await_frames(self, due: list[FrameInDialogue], end_us: int) -> None:
        """Wait until the board has sent as many frames as *due* holds.

        At most to the device time *end_us*, plus their time on the line, plus 1.5 s at a wall
        clock.
        """
        wire = self._board.wire
        number = _count_frames(frame.message for frame in due) - len(self._early)
        answers = _count_answers(due) - _count_answers(self._early)

        def are_there() -> bool:
            pieces = wire.received[self._since :]
            came = _count_frames(piece.message for piece in pieces)
            return came >= number and _count_answers(pieces) >= answers

        left_us = max(0, end_us - self._board.clock.device_estimate_us())
        left_us += wire.line_us(sum(len(frame.body) + _AROUND for frame in due))
        wire.wait(are_there, left_us if self._is_virtual else left_us + _MISSED_US)

    def _has_dropped_traces(self, host: DialogueHost, base: DialogueBase) -> bool:
        """Return True if the board has dropped trace events since *base*: SPEC.md allows it."""
        link = self._board.link
        host.seq += 1
        since = link.mark()
        wire, seq = link.request_wire(m.GetStatus(), seq=host.seq, session=host.session)
        link.send(wire)
        answer = link.try_answer(seq, since)
        status = None if answer is None else answer.message
        dropped = status.counters.trace_dropped if isinstance(status, m.StatusReply) else 0
        return dropped not in (0, base.counters.trace_dropped)

    def _judge(
        self,
        host: DialogueHost,
        due: list[FrameInDialogue],
        base: tuple[DialogueBase, DialogueBase],
        line_us: int,
    ) -> str:
        """Compare what the board sent in a slot (40 ms) with *due*, the virtual board's frames.

        Returns the first difference as text, or ''. Times may differ by the uncertainty of the
        clock plus *line_us*, the time of the slot's bytes on the line. *base* has the counters of
        both boards before the dialogue, the board's first.
        """
        board = self._board
        pieces = board.wire.received[self._since :]
        self._since += len(pieces)
        broken = [piece for piece in pieces if piece.message is None]
        if broken:
            clause = BROKEN_FRAME_CLAUSES.get(broken[0].reason, "HG-2.1/1")
            return f"{clause}: no frame: {broken[0].piece.hex()}: {broken[0].fault}"
        ours = [
            FrameInDialogue(piece.header, piece.message, piece.body)
            for piece in pieces
            if piece.header is not None and piece.message is not None
        ]
        for frame in due:
            if isinstance(frame.message, m.HelloReply):
                self._session = frame.message.nonce
        host.session = self._session  # a HELLO that was damaged has opened none
        line_us += board.wire.line_us(sum(len(piece.piece) + 2 for piece in pieces))
        # A status speaks of frames of earlier slots too.
        self._near_us = max(self._near_us, self._least_near_us + line_us)
        said = DialogueAnswers.of([*self._early, *ours], base[0])
        wanted = DialogueAnswers.of(due, base[1])
        comparison = DialogueComparison(said, wanted, host, self._near_us)
        self._early = comparison.early()
        altered = self._memory.first_altered(said.responses, wanted.responses)
        return comparison.difference() or altered


def _annotated_text(wire: bytes) -> str:
    """Return the frames in *wire* as text."""
    return "; ".join(annotated_frame_text(piece) for piece in wire.split(DELIMITER) if piece)


def _slot_arrivals(batch: Iterable[tuple[DialogueAction, bytes]], end: bytes) -> list[_Arrival]:
    """Group the frames of a slot (40 ms) that reach the board together.

    *batch* has (action, encoded frame); [] if it is empty. A new group begins where an action waits
    first, or after a hardware fault. *end*, the request that ends a slot, joins the last group.
    """
    found: list[_Arrival] = []
    for action, wire in batch:
        if not found or action.wait_us or found[-1].fails:
            found.append(_Arrival(action.wait_us, []))
        found[-1].wires.append(wire)
        found[-1].fails = action.damage == FAULT
    if found:
        found[-1].wires.append(end)
    return found


def _count_answers(frames: Iterable[FrameInDialogue | ReceivedByClient]) -> int:
    """Return the number of responses among *frames*."""
    return sum(
        frame.header is not None and frame.header.type in m.RESPONSE_RANGE for frame in frames
    )


def _count_frames(messages: Iterable[m.Message | None]) -> int:
    """Return how many of *messages* a board must send: None (unreadable) too, no optional ones."""
    return sum(message is None or not is_optional_in_dialogue(message) for message in messages)
