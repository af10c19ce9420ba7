"""The same dialogue at the board under test and at the model: what each says, slot by slot."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

from haptogram.errors import HaptogramError
from haptogram_protocol.framing import FrameDecoder, encode_frame
from haptogram_protocol.messages import (
    Config,
    HelloReply,
    Message,
    MessageType,
    Ping,
    build_body,
)

from ..client.board_client import BoardClient
from ..client.wire import ReceivedByClient
from ..outcome import CaseEndedError
from .actions import SLOT_US, DialogueAction, DialogueHost
from .comparison import (
    DialogueAnswers,
    DialogueBase,
    DialogueComparison,
    DialogueMemory,
    FrameInDialogue,
    is_optional_in_dialogue,
    superfluous_in_dialogue,
)
from .model import DialogueModel
from .opening import DialogueOpening

#: Bytes that arrive later than this have changed a dialogue with timers, or one without.
_LATE_US: Final = {True: SLOT_US // 8, False: SLOT_US // 4}
_NEAR_US: Final = 200  # error of times in virtual time
_SHARE: Final = 6  # of a slot may pass while its frames are on the line
_SHARES: Final = 3  # every third frame
_PIECES: Final = 5  # every fifth slot's bytes come in pieces
_TAIL: Final = 6  # slots after the last frame: timers end
_END_US: Final = 2000  # before the end of a slot the board has said everything
_SETTLED_US: Final = 1000  # a latch and what is said of it
_IDLE_US: Final = 400_000  # a model that does nothing for so long need not be waited for
_LONGEST_US: Final = 2_000_000  # of a dialogue whose slots are cut short: no timer ends
_MISSED_US: Final = 1_000_000  # how long a frame that is missing is waited for
_FOREIGN: Final = 0x5555  # session of the request that ends a slot, beside the open one


class HostLateError(HaptogramError):
    """Bytes came too late for a comparison."""


@dataclass(frozen=True, slots=True)
class Played:
    """A dialogue that was played.

    Attributes
    ----------
    difference : str
        First difference between board and model; empty if there is none.
    lines : tuple of str
        The dialogue: time, description and bytes of each frame sent.
    """

    difference: str
    lines: tuple[str, ...]


class Lockstep:
    """A board under test, and the model beside it.

    Parameters
    ----------
    board : BoardClient
        Client of the board, with a session.

    Raises
    ------
    CaseEndedError
        INCONCLUSIVE, from every step: the model's process has ended.
    """

    def __init__(self, board: BoardClient) -> None:
        self._board = board
        self._model = DialogueModel(board.identity)
        self._opening = DialogueOpening(board, self._model)
        self._session = self._near_us = 0
        self._late_us = _LATE_US[True]

    def close(self) -> None:
        """End the model's process."""
        self._model.close()

    def play(
        self, actions: Sequence[DialogueAction], config: Config, seed: int, *, timed: bool
    ) -> Played:
        """Play a dialogue at both boards and compare; without timers slots are cut short.

        Raises
        ------
        HostLateError
            If bytes came late: nothing was compared.
        """
        board = self._board
        board.wire.begin_case()
        self._late_us = _LATE_US[timed]
        try:
            host = self._opening.open(config, seed)
        except CaseEndedError:
            if not board.wire.limits.slack_us:
                raise
            board.wire.idle(
                _MISSED_US
            )  # a board that was held up answers now; one that hangs fails
            host = self._opening.open(config, seed)
        try:
            return self._compare(host, actions, timed=timed)
        finally:
            # Where the client goes on.
            board.link.seq, board.link.session = host.seq + 1, host.session

    def _compare(
        self, host: DialogueHost, actions: Sequence[DialogueAction], *, timed: bool
    ) -> Played:
        """Play the slots of a dialogue up to the first difference."""
        base = self._opening.baseline(host)
        self._memory = DialogueMemory(host.session)
        self._session = host.session
        self._near_us = 0
        self._early: list[FrameInDialogue] = []
        lines: list[str] = []
        slots = max((action.slot for action in actions), default=0) + _TAIL * timed + 1
        start_us = host.slot_us = self._first_slot()
        for slot in range(slots):
            batch = self._batch(host, [a for a in actions if a.slot == slot], timed=timed)
            shown_us = host.slot_us - start_us
            lines += [f"{shown_us:>8} µs  {a.text}: {wire.hex()}" for a, wire in batch]
            wires = [wire for _, wire in batch]
            if wires:
                wires.append(_foreign_ping_in_lockstep(host, slot))
            found = self._slot(host, b"".join(wires), base, may_cut=not timed)
            if found:
                return Played(f"{shown_us} µs after the start {found}", tuple(lines))
            host.slot_us = self._next_slot(host.slot_us, may_cut=not timed)
            if not timed and host.slot_us - start_us > _LONGEST_US:
                break
        # What came early was due in the slot behind the last one, or never.
        behind = self._model.advance(host.slot_us + SLOT_US)
        return Played(superfluous_in_dialogue(self._early[len(behind) :]), tuple(lines))

    def _batch(
        self, host: DialogueHost, actions: Sequence[DialogueAction], *, timed: bool
    ) -> list[tuple[DialogueAction, bytes]]:
        """Return the frames of a slot with their actions: as many as the line carries in time."""
        found: list[tuple[DialogueAction, bytes]] = []
        room_us = SLOT_US // _SHARE if timed else SLOT_US // 2
        for action in actions:
            wire = action.wire(host)
            size = len(wire) + sum(len(data) for _, data in found)
            if self._board.wire.line_us(size) > room_us:
                break
            if found and _is_mute_in_lockstep(wire):
                break  # it may overtake what is sent with it: HG-3.8/2
            shares = found and action.seed % _SHARES == 0  # one delimiter between two frames
            found.append((action, wire[1:] if shares else wire))
        return found

    # --- time ----------------------------------------------------------------------------------

    def _first_slot(self) -> int:
        """Return the device time of slot 0."""
        clock = self._board.clock
        return clock.on_carrier(clock.device_estimate_us() + _LATE_US[True])

    def _next_slot(self, slot_us: int, *, may_cut: bool) -> int:
        """Return the time of the next slot: at once where nothing is due for long."""
        clock = self._board.clock
        next_us = self._model.next_us() if may_cut else slot_us
        if next_us is not None and next_us < slot_us + _IDLE_US:
            return slot_us + SLOT_US
        soon_us = max(clock.device_estimate_us(), slot_us + self._settled_us()) + _SETTLED_US
        return clock.on_carrier(min(soon_us, slot_us + SLOT_US))

    def _settled_us(self) -> int:
        """Return the time after which a frame that was to be latched at once is."""
        board = self._board
        ready_us = board.ready_after_us(board.identity.max_points) + _SETTLED_US
        return min(ready_us, SLOT_US - _END_US)

    def _wait_until(self, t_us: int) -> None:
        self._board.wire.idle(max(0, t_us - self._board.clock.device_estimate_us()))

    # --- one slot ------------------------------------------------------------------------------

    def _slot(
        self,
        host: DialogueHost,
        data: bytes,
        base: tuple[DialogueBase, DialogueBase],
        *,
        may_cut: bool,
    ) -> str:
        board, at_us = self._board, host.slot_us
        line_us = board.wire.line_us(len(data))
        self._wait_until(at_us - (self._opening.early_us or line_us))
        since = board.link.mark()
        if board.clock.device_estimate_us() - at_us > self._late_us:
            raise HostLateError
        for piece in _pieces_in_lockstep(data):
            board.wire.send(piece)  # a frame a slot, which the board has time for
        due = self._model.receive(at_us, data)
        due += self._model.advance(at_us + self._settled_us())
        next_us = self._model.next_us() if may_cut else at_us
        is_cut = next_us is None or next_us >= at_us + _IDLE_US
        if not is_cut:
            due += self._model.advance(at_us + SLOT_US - _END_US)
            self._wait_until(at_us + SLOT_US - _END_US - 1000)
        self._await_frames(since, due, SLOT_US if is_cut else 0)
        return self._judge(host, board.wire.received[since:], due, base, line_us)

    def _await_frames(self, since: int, due: list[FrameInDialogue], usual_us: int) -> None:
        """Wait for the frames that are due; late ones have changed the dialogue, or are missing."""
        wire = self._board.wire
        number = _number_of_lockstep_frames(frame.message for frame in due) - len(self._early)

        def are_there() -> bool:
            return _number_of_lockstep_frames(p.message for p in wire.received[since:]) >= number

        if not wire.wait(are_there, usual_us) and wire.wait(are_there, _MISSED_US):
            raise HostLateError

    def _judge(
        self,
        host: DialogueHost,
        pieces: Sequence[ReceivedByClient],
        due: list[FrameInDialogue],
        base: tuple[DialogueBase, DialogueBase],
        line_us: int,
    ) -> str:
        """Return the first difference in what both said in a slot."""
        board = self._board
        broken = [piece.fault for piece in pieces if piece.message is None]
        if broken:
            return f"the board sent {broken[0]}"
        ours = [
            FrameInDialogue(piece.header, piece.message, piece.body)
            for piece in pieces
            if piece.header is not None and piece.message is not None
        ]
        for frame in due:
            if isinstance(frame.message, HelloReply):
                self._session = frame.message.nonce
        host.session = self._session  # a HELLO that was damaged has opened none
        line_us += board.wire.line_us(sum(len(piece.piece) + 2 for piece in pieces))
        answered = [piece.t_us for piece in pieces if piece.is_response]
        behind_us = board.clock.device_estimate_us() - board.wire.now_us()
        slack_us = board.wire.limits.slack_us
        if (
            slack_us
            and answered
            and answered[-1] + behind_us - host.slot_us > self._late_us + line_us
        ):
            raise HostLateError  # the board was held up, or its line
        # A status speaks of frames of earlier slots too.
        self._near_us = max(self._near_us, (self._late_us if slack_us else _NEAR_US) + line_us)
        said = DialogueAnswers.of([*self._early, *ours], base[0])
        wanted = DialogueAnswers.of(due, base[1])
        comparison = DialogueComparison(said, wanted, host, self._near_us)
        self._early = comparison.early()
        return (
            comparison.difference()
            or self._memory.first_wrong(ours)
            or self._memory.first_altered(said.responses, wanted.responses)
        )


def _number_of_lockstep_frames(messages: Iterable[Message | None]) -> int:
    return sum(message is None or not is_optional_in_dialogue(message) for message in messages)


def _foreign_ping_in_lockstep(host: DialogueHost, slot: int) -> bytes:
    """Return a request of another session: its refusal shows that a slot's frames were read.

    It renews no lease, and uses no number up.
    """
    session = host.session ^ _FOREIGN or _FOREIGN
    return encode_frame(build_body(Ping(slot), flags=0, seq=slot, time_us=0, session=session))


def _pieces_in_lockstep(data: bytes) -> list[bytes]:
    """Return *data* whole, or now and then its first bytes one by one and the rest in pieces."""
    if not data:
        return []
    if sum(data) % _PIECES:
        return [data]
    edges = [*range(min(_PIECES, len(data))), *range(_PIECES, len(data), 97), len(data)]
    return [data[a:b] for a, b in pairwise(edges) if a < b]


def _is_mute_in_lockstep(wire: bytes) -> bool:
    return any(
        isinstance(body, bytes) and body[0] == MessageType.MUTE
        for body in FrameDecoder().feed(wire)
    )
