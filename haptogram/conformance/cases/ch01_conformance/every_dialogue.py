"""HG-1.2: random dialogues, with the virtual board as a model beside the board under test."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Final

from haptogram.errors import HaptogramError
from haptogram_protocol import messages as m
from haptogram_protocol.rules import UPLOADS

from ...case import Depth, case
from ...causes import cause_rank
from ...client.board_client import BoardClient
from ...client.wire import HELD_UP_US
from ...explore.actions import SLOT_US, UPLOADED, DialogueAction, has_room_in_dialogue
from ...explore.generator import DialogueGenerator
from ...explore.lockstep import Lockstep, Played
from ...explore.makers.conditions import DialogueCoverage
from ...explore.model import HostLateError, identity_suits_lockstep_model
from ...explore.shrinking import shrink_dialogue
from ...outcome import SELF_REPORTED, HeldUpError, check, not_observed, require

_SLOTS: Final = 20
_SLOTS_UNTIMED: Final = 40
_SLOTS_VIRTUAL: Final = 80
_TIMED: Final = 6  # every sixth dialogue has timers that end: it takes as long as others together
_TIMED_VIRTUAL: Final = 2
_DIALOGUES: Final = 20  # without --explore
_DIALOGUES_VIRTUAL: Final = 60
_LONGEST_US: Final = 4_000_000  # without --explore, at a wall clock
_EXHAUSTIVE: Final = 3  # times as many, and as long, with --full
_REPLAYS: Final = 60
_SHRINKING_US: Final = 15_000_000  # at a wall clock
_LATCHES: Final = 6  # in a slot, of a playback
_POWER_UP: Final = 15  # every 15th dialogue begins with a power-up
_LATE: Final = 3  # replays of a dialogue in which the host was late
_AGAIN: Final = 4  # how often a dialogue in which something was held up has to differ
_LONGEST_AHEAD_US: Final = 1_000_000  # of frames that are meant to be taken
_BEFORE: Final = f"a new session, sequences {min(UPLOADED)} to {max(UPLOADED)} stored"
_CLAUSES: Final = 6  # of which differences are told
_DIFFERENT: Final = 30  # dialogues, after which hardly another clause is found
_SHOWN: Final = 12  # last frames of a dialogue that differed once


@case("HG-1.2/1-dialogues", needs=m.Feature.CONFIG, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def random_dialogues_match_the_model(board: BoardClient) -> None:
    """random legal and illegal dialogues: every reply, event and counter is that of the model"""
    is_modelled = identity_suits_lockstep_model(board.identity)
    require(
        is_modelled, "the model is a grid with a pitch and a carrier of 40 kHz; this board is not"
    )
    largest = len(board.flat_phases().serialize()) + 40
    board.wire.require_carried(largest, SLOT_US // 3)
    is_soon = board.clock.ready_us(0, min(1, board.most_points)) <= SLOT_US // 5
    require(is_soon, "this board latches later than the time between two frames allows")
    if board.identity.features & UPLOADS:  # what other cases have stored cannot be replaced
        text = f"uploads of {board.identity.max_upload_bytes} bytes are too small for a dialogue"
        require(has_room_in_dialogue(board.identity), text)
    board.clock.require_horizon(_LONGEST_AHEAD_US)
    lockstep = Lockstep(board)
    number = compared = 0
    coverage, found = DialogueCoverage(), DialogueDifferences()
    start_us = board.wire.now_us()
    try:
        while found.goes_on and _goes_on_after_dialogue(lockstep.board, number, compared, start_us):
            compared += _judge_random_dialogue(lockstep, number, coverage, found)
            number += 1
        found.replay()
    except HaptogramError:
        if not found.by_clause:
            raise  # else the board differed before
    finally:
        lockstep.close()
    check(not found.by_clause, found.text())
    if 2 * compared < number:
        text = f"{compared} of {number} dialogues were compared"
        if not board.wire.is_virtual:
            raise HeldUpError(text)
        not_observed(
            f"{text}: in the others this board computes points for so long, or its line drops so "
            "many traces, that more than one course is due"
        )


def _goes_on_after_dialogue(board: BoardClient, number: int, compared: int, start_us: int) -> bool:
    """Return True if another random dialogue is to be played after *number* of them.

    A time set by the user, counted from *start_us*, decides alone.  Else 60 are played in virtual
    time; at a wall clock 20 that were *compared*, or 4 s of them.  If exhaustive, three times that.
    """
    passed_us = board.wire.now_us() - start_us
    if board.explore_us:
        return passed_us < board.explore_us
    times = _EXHAUSTIVE if board.exhaustive else 1
    if board.wire.is_virtual:
        return number < times * _DIALOGUES_VIRTUAL
    is_over = compared >= times * _DIALOGUES or passed_us >= times * _LONGEST_US
    return not is_over and number < 2 * times * _DIALOGUES


@dataclass(slots=True)
class DialogueDifferences:
    """Differences in the dialogues of a run: of each clause the first one, made short.

    Attributes
    ----------
    by_clause : dict of str to str
        Difference and dialogue, by the clause that it speaks of.
    replays : dict of str to callable
        Plays the dialogue again, by the same clause.
    dialogues : int
        Number of dialogues that differed.
    shrinking_us : int
        Time that shrinking has taken.
    """

    by_clause: dict[str, str] = field(default_factory=dict)
    replays: dict[str, Callable[[], object]] = field(default_factory=dict)
    dialogues: int = 0
    shrinking_us: int = 0

    @property
    def goes_on(self) -> bool:
        """False as soon as more dialogues would hardly tell more."""
        return len(self.by_clause) < _CLAUSES and self.dialogues < _DIFFERENT

    def replay(self) -> None:
        """Play the dialogue of the likeliest cause again: its bytes are those of the case."""
        for clause in self._clauses()[:1]:
            self.replays[clause]()

    def _clauses(self) -> list[str]:
        """Return the broken clauses, the likeliest cause first."""
        return sorted(self.by_clause, key=cause_rank)

    def text(self) -> str:
        """Return the differences in words, the likeliest cause first."""
        told = [self.by_clause[clause] for clause in self._clauses()]
        many = f"{len(told)} differences in {self.dialogues} dialogues: " if len(told) > 1 else ""
        return many + " || ".join(told)


def _judge_random_dialogue(
    lockstep: Lockstep, number: int, coverage: DialogueCoverage, found: DialogueDifferences
) -> bool:
    """Play random dialogue *number* on board and model; add a new clause's difference to *found*.

    The dialogue is minimised first; *coverage* leads it to what was not sent yet.  Returns False if
    nothing was compared because the host was late, or if a difference did not recur.
    """
    board = lockstep.board
    seed = board.random.getrandbits(32)
    is_virtual = board.wire.is_virtual
    is_fast = board.wire.carries(len(board.flat_phases().serialize()), SLOT_US // _TIMED)
    timed = is_fast and number % (_TIMED_VIRTUAL if is_virtual else _TIMED) == 0
    generator = DialogueGenerator(
        board.identity,
        seed,
        coverage,
        timed=timed,
        exact=lockstep.is_exact,
        slow=not board.wire.carries(_LATCHES * 2 * board.identity.transducers, SLOT_US // 2),
    )
    config = generator.config()
    slots = _SLOTS_VIRTUAL if is_virtual else _SLOTS
    # After a power-up the time of the board is known only where bytes take none.
    may_power_up = lockstep.is_exact and board.restart is not None and not board.explore_us
    powers_up = may_power_up and number % _POWER_UP == 1
    actions = generator.before_hello() if powers_up else []
    actions += generator.actions(slots if timed else _SLOTS_UNTIMED)

    def play(part: Sequence[DialogueAction], tries: int = _LATE) -> Played | None:
        for _ in range(tries):
            try:
                return lockstep.play(part, config, seed, timed=timed, powers_up=powers_up)
            except HostLateError:
                continue
        return None

    played = play(actions, 1)
    if played is None or not played.difference:
        return played is not None
    clause = clause_of_difference(played)
    if clause in found.by_clause:
        found.dialogues += 1
        return True
    if not is_difference_of_board(played, lambda: play(actions)):
        return False
    begin_us = lockstep.board.wire.now_us()
    end_us = begin_us + _SHRINKING_US - found.shrinking_us

    def differs(part: Sequence[DialogueAction]) -> bool:
        if not is_virtual and lockstep.board.wire.now_us() > end_us:
            return False
        again = play(part)
        if again is None or not again.difference:
            return False
        if is_virtual:
            return clause_of_difference(again) == clause
        return _is_same_difference(again, played)

    short = shrink_dialogue(actions, differs, _REPLAYS) if differs(actions) else actions
    found.shrinking_us += lockstep.board.wire.now_us() - begin_us
    last = play(short)
    if last is not None and clause_of_difference(last) == clause:
        text, lines = f"dialogue {seed} of {len(short)} frames", last.lines
    else:
        last, text = played, f"dialogue {seed}, seen once, not again; its last frames"
        lines = played.lines[-_SHOWN:]
    sent = f"[before it: {_BEFORE}, {config}; sent: {' | '.join(lines)}]"
    found.by_clause[clause] = f"{last.difference}; {text} {sent}"
    found.replays[clause] = lambda: play(short)
    found.dialogues += 1
    return True


def clause_of_difference(played: Played) -> str:
    """Return the clause that a difference speaks of; empty without one."""
    return played.difference.partition(":")[0]


def is_difference_of_board(played: Played, replay: Callable[[], Played | None]) -> bool:
    """Return True if it is the board that differs.

    Nothing was held up when it did, or it does so again and again at the same place.
    """
    for _ in range(_AGAIN):
        if played.held_up_us <= HELD_UP_US:
            return True
        again = replay()
        if again is None or not again.difference:
            return False
        if again.held_up_us > HELD_UP_US and not (
            again.slot == played.slot and _is_same_difference(again, played)
        ):
            return False
        played = again
    return True


def _is_same_difference(one: Played, other: Played) -> bool:
    """Return True if two differences have the same text once all digits are left out."""
    return re.sub(r"\d+", "", one.difference) == re.sub(r"\d+", "", other.difference)
