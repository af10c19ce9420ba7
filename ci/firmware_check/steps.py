"""What is done to the firmware of a port, and how it ended."""

from __future__ import annotations

import contextlib
import shlex
import subprocess
import sys
import time
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from .emulator import Emulator
from .pins import CHANNELS, write_capture
from .ports import Port, build

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
_VERIFY: Final = ("verify", "--object", "hemisphere", "--quiet")
BOOT_S: Final = 20.0
_STOP_S: Final = 10.0
_ANSWER_S: Final = 5  # a busy machine holds QEMU up


@dataclass(frozen=True)
class Step:
    """One command on the firmware of a port.

    Attributes
    ----------
    name : str
        ``conform``, ``verify`` or ``pins``.
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
    return _run("conform", ["conform", "--port", url, *words, *_files(folder, "conform")], folder)


def verify(port: Port, url: str, folder: Path, *, quick: bool) -> Step:
    """Display a hemisphere, and judge every frame by the board's own trace."""
    how = _PLAY if quick or port.baud < _SLOW_BAUD else _STREAM
    return _run("verify", [*_VERIFY, "--port", url, *how, *_files(folder, "verify")], folder)


def pins(port: Port, folder: Path) -> Step:
    """Display a hemisphere with firmware that tells its drives, and judge it by 16 drive pins."""
    start_s = time.monotonic()
    records, recording = folder / "pins.records", folder / "pins.mcap"
    records.unlink(missing_ok=True)
    firmware = build(port, folder / "pins", DEFINES="-DPORT_TRACES_PINS=1")
    with Emulator(port.machine, firmware, pins=records.resolve()) as emulator:
        count = emulator.wait_for_board(BOOT_S).transducers
        words = [*_VERIFY, "--port", emulator.url, *_PLAY, "--record", str(recording)]
        step = _run("pins", words, folder)
    if step.status == 0:
        step = judge_pins(records, count, recording, folder)
    return replace(step, seconds=time.monotonic() - start_s)


def judge_pins(records: Path, count: int, recording: Path, folder: Path) -> Step:
    """Judge a recorded run by what firmware told of its drives.

    Parameters
    ----------
    records : Path
        What ``emulate --pins`` wrote.
    count : int
        Elements of the array.
    recording : Path
        What ``haptogram verify --record`` wrote.
    folder : Path
        Where capture, map and results are written.
    """
    capture, channels = folder / "pins.vcd", folder / "pins.toml"
    write_capture(records, count, capture)
    channels.write_text(CHANNELS, "utf-8")
    words = ["--capture", str(capture), "--channels", str(channels), *_files(folder, "pins")]
    return _run("pins", ["verify", "--from-recording", str(recording), *words], folder)


def _files(folder: Path, name: str) -> list[str]:
    stem = str(folder / name)
    return ["--json", f"{stem}.json", "--junit", f"{stem}.xml"]


def _run(name: str, words: list[str], folder: Path) -> Step:
    command = [_HAPTOGRAM, *words]
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
