"""The command ``ci/firmware``."""

from __future__ import annotations

import argparse
import signal
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from haptogram.errors import ConfigurationError, HaptogramError

from .emulator import Emulator
from .hang import hang
from .memory import footprint
from .ports import PORTS, Port, build, install, missing_tool
from .steps import BOOT_S, QUICK, Step, conform, pins, verify

_USAGE: Final = 2
_INTERRUPTED: Final = 130


def main(words: list[str] | None = None) -> int:
    """Judge the firmware of each port and print the result; return the exit status."""
    arguments = _parser().parse_args(words)
    for number in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.default_int_handler)
    try:
        if arguments.install and missing_tool():
            install()
        if why := missing_tool():
            return _refuse(why)
        chosen = [PORTS[name] for name in arguments.port or PORTS]
        return worst_status([_judge(port, arguments.out, quick=arguments.quick) for port in chosen])
    except (HaptogramError, OSError) as error:  # of --install
        return _refuse(str(error))
    except KeyboardInterrupt:
        sys.stderr.write("ci/firmware: interrupted\n")
        return _INTERRUPTED


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="ci/firmware",
        description="Build the C board for microcontrollers, start each firmware in QEMU, and run "
        "'haptogram conform' and then 'haptogram verify' against the emulated chip, resets "
        "included. What was printed, JSON and JUnit files are in a folder for each port.",
        epilog="exit status: 0 all passed; 1 a clause or a frame failed; 2 usage or environment: a "
        "tool is missing, the firmware does not compile, start or answer; 3 nothing failed and "
        "something could not be judged; 130 interrupted",
    )
    parser.add_argument(
        "--port",
        action="append",
        choices=tuple(PORTS),
        help="only this port; may be repeated [all]",
    )
    parser.add_argument(
        "--quick", action="store_true", help="some clauses and few points: half a minute a port"
    )
    parser.add_argument(
        "--install", action="store_true", help="install QEMU and the compiler by apt-get first"
    )
    parser.add_argument(
        "--out",
        type=Path,
        default=Path("out/firmware"),
        metavar="FOLDER",
        help="where results are written [out/firmware]",
    )
    return parser


def _refuse(why: str) -> int:
    sys.stderr.write(f"ci/firmware: {why}\n")
    return _USAGE


def _judge(port: Port, out: Path, *, quick: bool) -> int:
    """Judge one firmware; print a line for each step; return the worst status."""
    found = []
    try:
        for step in _steps(port, out / port.name, quick=quick):
            print(f"  {step.name:<8} {step.summary} ({step.seconds:.0f} s; {step.log})", flush=True)
            found.append(step.status)
    except (
        HaptogramError,
        OSError,
    ) as error:  # what was judged before stands, and so do other ports
        found.append(_refuse(f"{port.name}: {error}"))
    return worst_status(found)


def _steps(port: Port, folder: Path, *, quick: bool) -> Iterator[Step]:
    """Build and start the firmware, and judge it step by step."""
    firmware = build(port, folder)
    with Emulator(port.machine, firmware) as emulator:
        board = emulator.wait_for_board(BOOT_S)
        print(f"{port.name}: {board.transducers} transducers, QEMU {port.machine}", flush=True)
        depth = QUICK if quick else ()
        yield conform(port, emulator.url, emulator.reset_command, folder, depth)
        yield verify(port, emulator.url, folder, quick=quick)
        print(f"  memory   {_measure(firmware, emulator)}", flush=True)
    yield pins(port, folder)
    yield hang(port, firmware, folder)


def _measure(firmware: Path, emulator: Emulator) -> str:
    try:
        return str(footprint(firmware, emulator))
    except ConfigurationError as error:  # the verdicts stand
        return f"not measured: {error}"


def worst_status(statuses: list[int]) -> int:
    """Return the status that says most: a failure, then what ended a step early, then doubt."""
    order = (1, _INTERRUPTED, _USAGE, 3, 0)
    known = [status if status in order else _USAGE for status in statuses]  # -9: it was killed
    return min(known, key=order.index)


if __name__ == "__main__":
    sys.exit(main())
