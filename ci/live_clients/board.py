"""The virtual board as a process, and what its back door says that it radiated."""

from __future__ import annotations

import base64
import json
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

__all__ = ["BoardFailed", "Latch", "VirtualBoard", "powered_up"]

START_S: Final = 60
QUIET_S: Final = 0.3
PATIENCE_S: Final = 5
_LISTENS: Final = re.compile(r"^listening on (?:socket://)?(.*)$", re.MULTILINE)


class BoardFailed(Exception):
    """The board did not start, or ended before it was told to."""


@dataclass(frozen=True)
class Latch:
    """What the board radiated from a moment on; (N,) rises and widths in steps of a period."""

    cause: str
    index: int
    steps: int
    rises: NDArray[np.uint16]
    widths: NDArray[np.uint16]
    counted: Mapping[str, int]

    def key(self) -> bytes:
        """Return bytes that are the same for the same pulses."""
        return self.rises.tobytes() + self.widths.tobytes()

    def weights(self) -> NDArray[np.complex128]:
        """Return the fundamental of each pulse."""
        turn = 2 * np.pi / self.steps
        amplitudes: NDArray[np.float64] = np.sin(turn / 2 * self.widths)
        weights: NDArray[np.complex128] = amplitudes * np.exp(
            1j * turn * (self.rises + self.widths / 2)
        )
        return weights

    def coherence(
        self, positions_m: NDArray[np.float64], target_m: NDArray[np.float64], wave_number: float
    ) -> float:
        """Return |p| at a target, relative to all elements in phase."""
        distances = np.linalg.norm(positions_m - target_m, axis=1)
        weights = self.weights() / distances
        waves = np.exp(1j * wave_number * distances)
        return float(abs((weights * waves).sum()) / np.abs(weights).sum())


class VirtualBoard:
    """A board that runs; *address* is the path or HOST:PORT at which clients find it."""

    def __init__(self, address: str, records: Path) -> None:
        self.address, self._records = address, records

    def latches(self, least: int = 0) -> list[Latch]:
        """Return the latches so far, once nothing more comes for a while, or after five seconds.

        There are *least* of them at least, if so many come: a board may start by waiting.
        """
        size, deadline = -1, time.monotonic() + PATIENCE_S
        while time.monotonic() < deadline:
            if size == (size := self._records.stat().st_size) and len(self._pulses()) >= least:
                break
            time.sleep(QUIET_S)
        return self._pulses()

    def _pulses(self) -> list[Latch]:
        return [_latch(row) for row in self._rows() if row["kind"] == "pulses"]

    def positions_m(self) -> NDArray[np.float64]:
        """Return the elements in the order of the channels."""
        (row,) = (row for row in self._rows() if row["kind"] == "board")
        return np.array(row["positions_m"])

    def _rows(self) -> Iterator[dict[str, Any]]:
        for line in self._records.read_text().splitlines(keepends=True):
            if line.endswith("\n"):
                yield json.loads(line)


@contextmanager
def powered_up(folder: Path, dialect: str, *options: str) -> Iterator[VirtualBoard]:
    """Run a board of *dialect* at a port that *options* name, until the block ends."""
    records, log = folder / f"{dialect}.jsonl", folder / f"{dialect}.log"
    records.unlink(missing_ok=True)
    command = [sys.executable, "-m", "haptogram", "board", "--dialect", dialect, *options]
    command += ["--backdoor", str(records), "--no-reconstruct"]
    with log.open("w+") as output:
        process = subprocess.Popen(command, stdout=output, stderr=subprocess.STDOUT)
        try:
            yield VirtualBoard(_address(process, log), records)
            if process.poll() is not None:
                raise BoardFailed(_last_line(log))
        finally:
            process.send_signal(signal.SIGTERM)
            process.wait(START_S)


def _address(process: subprocess.Popen[bytes], log: Path) -> str:
    deadline = time.monotonic() + START_S
    while time.monotonic() < deadline and process.poll() is None:
        if found := _LISTENS.search(log.read_text()):
            return found.group(1)
        time.sleep(0.1)
    raise BoardFailed(_last_line(log))


def _last_line(log: Path) -> str:
    return (log.read_text().strip().splitlines() or ["the board said nothing"])[-1]


def _latch(row: Mapping[str, Any]) -> Latch:
    rises, widths = (
        np.frombuffer(base64.b64decode(row[name]), "<u2") for name in ("rises", "widths")
    )
    return Latch(row["cause"], row["index"], row["steps"], rises, widths, row["counted"])
