"""HG-1.2: random dialogues, with the virtual board as a model beside the board under test."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from haptogram_protocol.messages import Config, Feature

from ...case import Depth, case
from ...client.board_client import BoardClient
from ...explore.actions import SLOT_US, DialogueAction
from ...explore.coverage import DialogueCoverage
from ...explore.generator import DialogueGenerator
from ...explore.lockstep import HostLateError, Lockstep, Played, identity_suits_lockstep_model
from ...explore.shrinking import shrink_dialogue
from ...outcome import SELF_REPORTED, fail, inconclusive, not_observed

_SLOTS: Final = 16
_DIALOGUES: Final = 16  # without --explore
_DIALOGUES_VIRTUAL: Final = 48
_REPLAYS: Final = 60
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
    lockstep = Lockstep(board)
    late = number = 0
    coverage = DialogueCoverage()
    start_us = board.wire.now_us()
    try:
        while _goes_on_after_dialogue(board, number, start_us):
            late += not _judge_random_dialogue(
                board, lockstep, board.random.getrandbits(32), coverage
            )
            number += 1
    finally:
        lockstep.close()
    if late == number:
        inconclusive(f"the host was late in each of {number} dialogues")


def _goes_on_after_dialogue(board: BoardClient, number: int, start_us: int) -> bool:
    if board.explore_us:
        return board.wire.now_us() - start_us < board.explore_us
    return number < (_DIALOGUES if board.wire.limits.slack_us else _DIALOGUES_VIRTUAL)


def _judge_random_dialogue(
    board: BoardClient, lockstep: Lockstep, seed: int, coverage: DialogueCoverage
) -> bool:
    """Play one dialogue; FAILED with a short one if the board differs.

    Returns False if the host was late, so that nothing was compared.
    """
    generator = DialogueGenerator(board.identity, seed, coverage)
    config, actions = generator.config(), generator.actions(_SLOTS)
    played = _play_random_dialogue(lockstep, actions, config, seed)
    if played is None:
        return False
    if not played.difference:
        return True

    def differs(part: Sequence[DialogueAction]) -> bool:
        again = _play_random_dialogue(lockstep, part, config, seed)
        return again is not None and bool(again.difference)

    if not differs(actions):  # once, and not again: the host may have been at fault
        return False
    short = shrink_dialogue(actions, differs, _REPLAYS)
    played = _play_random_dialogue(lockstep, short, config, seed) or played
    fail(
        f"dialogue {seed}, {len(short)} frames: {played.difference or 'now and then another reply'}"
        f" [{config}; {' | '.join(played.lines)}]"
    )


def _play_random_dialogue(
    lockstep: Lockstep, actions: Sequence[DialogueAction], config: Config, seed: int
) -> Played | None:
    for _ in range(_LATE):
        try:
            return lockstep.play(actions, config, seed)
        except HostLateError:
            continue
    return None
