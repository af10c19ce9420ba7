"""The model of random dialogues in this process: one of its own takes 0.4 s to start."""

import json

from haptogram.conformance.explore import model
from sim_device.driven import stepped_board


class ModelHere:
    """Steps the board that a process of `stepped_board` would step."""

    runs = True

    def __init__(self, command, _failure):
        limits = json.loads(command[-1])
        settings = stepped_board._stepped_board_settings(limits)  # noqa: SLF001  of its process
        self._board = stepped_board.VirtualSteppedBoard(settings)

    def step(self, line):
        return ";".join(map(self._board.step, line.split(";")))

    def close(self):
        pass


def model_here(monkeypatch):
    """Fixture: random dialogues start no process."""
    monkeypatch.setattr(model, "LockstepProcess", ModelHere)
