"""What is done to the firmware of a port, and how it ended."""

from __future__ import annotations

import contextlib
import shlex
import subprocess
import sys
import time
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from .ports import Port

_HAPTOGRAM: Final = str(Path(sys.executable).with_name("haptogram"))
#: The clauses that a chip can spoil: line, identity, points, output, clock, chunks, memory.
QUICK: Final = (
    "--quick",
    *(f"--clause=HG-{section}" for section in ("2.1", "2.7", "4.3", "5.4", "6.4", "6.9", "7.3")),
)
# The board latches by its own clock; the longest lead that the lease of 500 ms allows.
_STREAM: Final = ("--rate-hz", "50", "--lead-ms", "450", "--resolution-mm", "10")
#: Uploaded once, then played by the board: for a slow line, and whatever else the machine does.
_PLAY: Final = ("--mode", "sequence", "--rate-hz", "100", "--resolution-mm", "15")
_SLOW_BAUD: Final = 200_000
_STOP_S: Final = 10.0
_ANSWER_S: Final = 5  # a busy machine holds QEMU up


@dataclass(frozen=True)
class Step:
    """One command on the firmware of a port.

    Attributes
    ----------
    name : str
        ``conform`` or ``verify``.
    status : int
        Its exit status.
    seconds : float
        How long it took.
    summary : str
        The line of its verdict.
    log : Path
        All that it printed.
    """

    name: str
    status: int
    seconds: float
    summary: str
    log: Path


def conform(
    port: Port, url: str, reset_command: str, folder: Path, selection: Iterable[str] = ()
) -> Step:
    """Run the conformance suite, the clauses about a reset included.

    Parameters
    ----------
    port : Port
        Chip of the board.
    url, reset_command : str
        Where it listens, and how it is restarted.
    folder : Path
        Where results are written.
    selection : iterable of str
        Options of ``haptogram conform`` that select cases.
    """
    line = ["--baud", str(port.baud), "--timeout", str(_ANSWER_S)]
    words = [*line, "--reset-cmd", reset_command, *selection]
    return _run("conform", [*words, *_files(folder, "conform")], url, folder)


def verify(port: Port, url: str, folder: Path, *, quick: bool) -> Step:
    """Display a hemisphere, and judge every frame by the board's own trace."""
    how = _PLAY if quick or port.baud < _SLOW_BAUD else _STREAM
    words = ["--object", "hemisphere", "--quiet", *how, *_files(folder, "verify")]
    return _run("verify", words, url, folder)


def _files(folder: Path, name: str) -> list[str]:
    stem = str(folder / name)
    return ["--json", f"{stem}.json", "--junit", f"{stem}.xml"]


def _run(name: str, words: list[str], url: str, folder: Path) -> Step:
    command = [_HAPTOGRAM, name, "--port", url, *words]
    log = folder / f"{name}.txt"
    start_s = time.monotonic()
    with log.open("w", encoding="utf-8") as output:
        print(shlex.join(command), file=output, flush=True)
        process = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=output, stderr=subprocess.STDOUT
        )
        try:
            status = process.wait()
        except BaseException:  # Ctrl-C, SIGTERM: the command mutes the board and ends
            process.terminate()
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(_STOP_S)
            process.kill()
            raise
    return Step(name, status, time.monotonic() - start_s, _verdict(log), log)


def _verdict(log: Path) -> str:
    """Return the last line that a command printed, or the verdict that verify prints first."""
    lines = [line for line in log.read_text("utf-8").splitlines()[1:] if line.strip()]
    judged = [line for line in lines if line.startswith(("PASS", "FAIL", "INCONCLUSIVE", "cases"))]
    return " ".join((judged or lines or ["nothing was printed"])[-1].split())
