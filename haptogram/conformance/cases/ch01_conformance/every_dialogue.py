"""HG-1.2: random dialogues, with the virtual board as a model beside the board under test."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Final

from haptogram_protocol.messages import Feature

from ...case import Depth, case
from ...client.board_client import BoardClient
from ...explore.actions import SLOT_US, DialogueAction
from ...explore.coverage import DialogueCoverage
from ...explore.generator import DialogueGenerator
from ...explore.lockstep import HostLateError, Lockstep, Played
from ...explore.model import identity_suits_lockstep_model
from ...explore.shrinking import shrink_dialogue
from ...outcome import SELF_REPORTED, fail, inconclusive, not_observed

_SLOTS: Final = 20
_SLOTS_UNTIMED: Final = 40
_TIMED: Final = 6  # every sixth dialogue has timers that end: it takes as long as others together
_TIMED_VIRTUAL: Final = 2
_DIALOGUES: Final = 60  # without --explore
_LONGEST_US: Final = 20_000_000  # without --explore, at a wall clock
_REPLAYS: Final = 60
_SHRINKING_US: Final = 15_000_000  # at a wall clock
_LATCHES: Final = 6  # in a slot, of a playback
_LONGEST: Final = 4096  # bytes of a frame
_LATE: Final = 3  # replays of a dialogue in which the host was late


@case(
    "HG-1.2/1",
    "random legal and illegal dialogues: every reply, event and counter is that of the model",
    variant="dialogues",
    needs=Feature.CONFIG,
    evidence=SELF_REPORTED,
    depth=Depth.DEFAULT,
)
def random_dialogues_match_the_model(board: BoardClient) -> None:
    if not identity_suits_lockstep_model(board.identity):
        not_observed("the model is a grid with a carrier of 40 kHz; this board is not")
    largest = len(board.flat_phases().serialize()) + 40
    if board.wire.line_us(largest) > SLOT_US // 8:
        not_observed("this line carries too few frames in the time between two of them")
    if board.ready_after_us() > SLOT_US // 20:
        not_observed("this board latches later than the time between two frames allows")
    lockstep = Lockstep(board)
    late = number = 0
    coverage = DialogueCoverage()
    once: list[str] = []
    start_us = board.wire.now_us()
    try:
        while _goes_on_after_dialogue(board, number, start_us):
            late += not _judge_random_dialogue(board, lockstep, number, coverage, once)
            number += 1
    finally:
        lockstep.close()
    if once and not board.wire.limits.slack_us:
        inconclusive(f"{len(once)} of {number} dialogues differ, and not again: {once[0]}")
    if 2 * late > number:
        inconclusive(f"{number - late} of {number} dialogues were compared: the host was late")


def _goes_on_after_dialogue(board: BoardClient, number: int, start_us: int) -> bool:
    passed_us = board.wire.now_us() - start_us
    if board.explore_us:
        return passed_us < board.explore_us
    return number < _DIALOGUES and (passed_us < _LONGEST_US or not board.wire.limits.slack_us)


def _judge_random_dialogue(
    board: BoardClient,
    lockstep: Lockstep,
    number: int,
    coverage: DialogueCoverage,
    once: list[str],
) -> bool:
    """Play one dialogue; FAILED with a short one if the board differs.

    Returns False if the host was late, so that nothing was compared, or if a difference did not
    come again: that is put into *once*.
    """
    seed = board.random.getrandbits(32)
    timed = number % (_TIMED if board.wire.limits.slack_us else _TIMED_VIRTUAL) == 0
    line_us = board.wire.line_us
    generator = DialogueGenerator(
        board.identity,
        seed,
        coverage,
        timed=timed,
        exact=not board.wire.limits.slack_us and line_us(_LONGEST) <= 1,
        slow=line_us(_LATCHES * 2 * board.identity.transducers) > SLOT_US // 2,
    )
    config = generator.config()
    actions = generator.actions(_SLOTS if timed else _SLOTS_UNTIMED)

    def play(part: Sequence[DialogueAction], tries: int = _LATE) -> Played | None:
        for _ in range(tries):
            try:
                return lockstep.play(part, config, seed, timed=timed)
            except HostLateError:
                continue
        return None

    played = play(actions, 1)
    if played is None:
        return False
    if not played.difference:
        return True

    end_us = board.wire.now_us() + _SHRINKING_US

    def differs(part: Sequence[DialogueAction]) -> bool:
        if board.wire.limits.slack_us and board.wire.now_us() > end_us:
            return False
        again = play(part)
        return again is not None and bool(again.difference)

    again = play(actions)
    if again is None or not _is_same_difference(again.difference, played.difference):
        once.append(f"dialogue {seed}: {played.difference}")
        return False  # at a wall clock the host may have been at fault
    short = shrink_dialogue(actions, differs, _REPLAYS)
    last = play(short)
    text = last.difference if last and last.difference else f"now and then {played.difference}"
    lines = (last or played).lines
    fail(f"dialogue {seed}, {len(short)} frames: {text} [{config}; {' | '.join(lines)}]")


def _is_same_difference(one: str, other: str) -> bool:
    """Return True if two differences have the same words: numbers may differ."""
    return re.sub(r"\d+", "", one) == re.sub(r"\d+", "", other)
