"""``python -m sim_device.driven.stepped_board LIMITS``: the virtual board, step by step.

LIMITS is a JSON object of fields of :class:`~sim_device.board.settings.BoardSettings`, with
``grid_nx``, ``grid_ny`` and ``pitch_um`` of the array.  Times are microseconds after power-up::

    reset US      power down and up again; the device clock starts at US
    rx TIME HEX   bytes whose last one is complete at TIME
    through TIME  time passes, and somebody reads at once what the board sends
    fault TIME    the hardware fails
    next          answered by the time at which the board does something by itself, ``-`` if never

The other answers hold what the board sends in hex, ``-`` for nothing.  A line may hold several
steps with ``;`` between them; so does its answer.
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

    def step(self, line: str) -> str:
        """Carry out one step and return its answer."""
        word, *rest = line.split()
        if word == "reset":
            self.reset(int(rest[0]))
            return "-"
        if word == "next":
            next_us = self._dialect.next_event_us()
            return "-" if next_us is None else str(next_us - self._settings.boot_us)
        at_us = int(rest[0])
        if word == "through":
            return self._advance_through(at_us).hex() or "-"
        said = self._receive(at_us, bytes.fromhex(rest[1]) if word == "rx" else b"")
        if word == "fault":
            self._dialect.raise_hardware_fault()
            said += self._dialect.take_output()
        return said.hex() or "-"

    def _receive(self, at_us: int, data: bytes) -> bytes:
        """Let *data* arrive *at_us* after power-up; return the bytes that the board sends."""
        self._now_us = at_us
        self._dialect.receive(data, self._settings.boot_us + at_us)
        return self._dialect.take_output()

    def _advance_through(self, end_us: int) -> bytes:
        """Let time pass to *end_us* while the host reads; return the bytes that the board sends."""
        said = b""
        while self._now_us < end_us:
            next_us = self._dialect.next_event_us()
            due_us = end_us if next_us is None else next_us - self._settings.boot_us
            said += self._receive(max(self._now_us, min(due_us, end_us)), b"")
        return said


def _stepped_board_settings(limits: dict[str, Any]) -> BoardSettings:
    """Return the settings of a virtual board: the fields in *limits*, all others as usual.

    *limits* has names of BoardSettings, and grid_nx, grid_ny and pitch_um (in µm) of a grid, which
    are removed from it.
    """
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
