"""``python -m sim_device.driven.stepped_board LIMITS``: the virtual board, step by step.

LIMITS is a JSON object of fields of :class:`~sim_device.board.settings.BoardSettings`, with
``grid_nx``, ``grid_ny`` and ``pitch_um`` of the array.  Steps and answers are those
of ``protocol/c/tools/board_steps.c``; times are microseconds after power-up.
``reset US`` starts the device clock at US instead of 2^32 - 10 s.  ``next`` is answered by the time
at which the board does something by itself, ``-`` if never.  ``through TIME`` lets time pass while
somebody reads: its answer holds all that the board sends up to then.  A line may hold several steps
with ``;`` between them; so does its answer.
"""

from __future__ import annotations

import dataclasses
import json
import sys
from collections.abc import Iterable
from typing import Any, TextIO

from haptogram.acoustics import AcousticModel
from haptogram_protocol.messages import Feature

from ..assembly import HEALTHY
from ..board.settings import BoardSettings


class VirtualSteppedBoard:
    """A healthy board whose time is an argument.

    Parameters
    ----------
    settings : BoardSettings
        Hardware and limits of the board.
    """

    def __init__(self, settings: BoardSettings) -> None:
        self._settings = settings
        self.reset(settings.boot_us)

    def reset(self, boot_us: int) -> None:
        """Power the board down and up; its clock starts at *boot_us*."""
        self._settings = dataclasses.replace(self._settings, boot_us=boot_us)
        self._dialect = HEALTHY.assemble(self._settings)
        self._now_us = 0

    def receive(self, at_us: int, data: bytes) -> bytes:
        """Let *data* arrive; return the bytes that the board sends."""
        self._now_us = at_us
        self._dialect.receive(data, self._settings.boot_us + at_us)
        return self._dialect.take_output()

    def advance_until_sent(self, limit_us: int) -> tuple[int, bytes]:
        """Let time pass until the board sends something; return the time and the bytes."""
        sent = b""
        while not sent and self._now_us < limit_us:
            next_us = self._dialect.next_event_us()
            due_us = limit_us if next_us is None else next_us - self._settings.boot_us
            sent = self.receive(max(self._now_us, min(due_us, limit_us)), b"")
        return self._now_us, sent

    def advance_through(self, end_us: int) -> bytes:
        """Let time pass, with a host that reads; return the bytes that the board sends."""
        said = b""
        while self._now_us < end_us:
            said += self.advance_until_sent(end_us)[1]
        return said

    def raise_fault(self, at_us: int) -> bytes:
        """Let the hardware fail; return the bytes that the board sends."""
        said = self.receive(at_us, b"")
        self._dialect.raise_hardware_fault()
        return said + self._dialect.take_output()

    def step(self, line: str) -> str:
        """Carry out one line of input and return the line that answers it."""
        word, *rest = line.split()
        if word == "reset":
            self.reset(int(rest[0]) if rest else BoardSettings().boot_us)
            return "-"
        if word == "next":
            next_us = self._dialect.next_event_us()
            return "-" if next_us is None else str(next_us - self._settings.boot_us)
        if word == "until":
            at_us, sent = self.advance_until_sent(int(rest[0]))
            return f"{at_us} {sent.hex() or '-'}"
        if word == "through":
            return self.advance_through(int(rest[0])).hex() or "-"
        if word == "fault":
            return self.raise_fault(int(rest[0])).hex() or "-"
        data = bytes.fromhex(rest[1]) if word == "rx" else b""
        return self.receive(int(rest[0]), data).hex() or "-"


def _stepped_board_settings(limits: dict[str, Any]) -> BoardSettings:
    """Return the settings of a board with these *limits*."""
    nx, ny, pitch_um = (limits.pop(name) for name in ("grid_nx", "grid_ny", "pitch_um"))
    limits["features"] = Feature(limits.pop("features"))
    model = AcousticModel.default(nx, ny, pitch_m=pitch_um * 1e-6)
    return BoardSettings(model=model, **limits)


def run_stepped_board(words: list[str], lines: Iterable[str], answers: TextIO) -> None:
    """Answer every line of *lines* by one line."""
    board = VirtualSteppedBoard(_stepped_board_settings(json.loads(words[0])))
    for line in lines:
        answers.write(";".join(map(board.step, line.split(";"))) + "\n")
        answers.flush()


if __name__ == "__main__":
    run_stepped_board(sys.argv[1:], sys.stdin, sys.stdout)
