"""Command line: parses, wires, prints, returns the exit status.

The only module of the host that may import the virtual board: everything else meets a board
through a port.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import signal
import sys
import threading
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any, Final
from urllib.parse import parse_qsl, urlencode, urlsplit

from . import __version__
from .commands import bench, budget, paper, presets, soak
from .commands.conform import command as conform
from .commands.field import command as field
from .commands.modulation import command as modulation
from .commands.shell.exit_status import EXIT_STATUS, INTERRUPTED, USAGE
from .commands.shell.interrupts import heard_interrupts, leave_at_once
from .commands.shell.places import joined
from .commands.shell.standard_streams import patient_streams
from .commands.verify import command as verify
from .errors import ConfigurationError, HaptogramError

if TYPE_CHECKING:
    from .campaigns.soak import MakeBoard
    from .conformance.run.access import VirtualAccess
    from .driver.line.port import Transport
    from .evidence.boards import BoardUnderTest
    from .settings.verify_config import VerifyConfig

_SCHEME: Final = "haptogram://"
_ENDINGS: Final = (signal.SIGTERM, signal.SIGHUP)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line *argv* and return its exit status."""
    # One thread each: two threads of a linear algebra library ruin the loop on a busy machine.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    leave_at_once()
    with patient_streams():
        return _run(argv)


def _run(argv: Sequence[str] | None) -> int:
    arguments = _parser().parse_args(joined(sys.argv[1:] if argv is None else argv))
    try:
        with _terminated_like_interrupted(), heard_interrupts():
            return int(arguments.run(arguments))
    except HaptogramError as error:
        print(f"haptogram: {error}", file=sys.stderr)
    except KeyboardInterrupt:  # before there was anything to keep
        print("haptogram: interrupted", file=sys.stderr)
        return INTERRUPTED
    return USAGE


@contextlib.contextmanager
def _terminated_like_interrupted() -> Iterator[None]:
    """Let SIGTERM and SIGHUP (a CI out of time, a closed terminal) clean up as Ctrl-C does."""

    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    if threading.current_thread() is not threading.main_thread():
        yield  # whoever owns the main thread decides
        return
    before = {number: signal.signal(number, interrupt) for number in _ENDINGS}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="haptogram",
        description="Hardware-in-the-loop test harness for ultrasonic phased arrays.",
        epilog=EXIT_STATUS,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"haptogram {__version__}")
    commands = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")
    verify.add(commands, _prepare_simulator, board_in_virtual_time)
    conform.add(commands, access_in_program)
    soak.add(commands, board_without_a_line)
    for command in (bench, budget, field, modulation, presets, paper):
        command.add(commands)
    return parser


def _prepare_simulator(config: VerifyConfig) -> verify.PlannedFaults:
    """Open the way to a board in this program, and read the faults that it shall have.

    Raises
    ------
    ConfigurationError
        For a fault that is not known, or a parameter of it; for a plan that cannot be read.
    """
    if config.port is not None and config.port.startswith(_SCHEME):
        return _faults_of_url(config.port)
    if not config.fault and config.fault_plan is None:
        return verify.PlannedFaults((), config.seed)
    from .settings.faults.plan import read_fault_plan

    plan = read_fault_plan(config.fault, config.fault_plan, config.seed)
    in_file = plan.faults[: len(plan.faults) - len(config.fault)]
    return verify.PlannedFaults((*map(str, in_file), *config.fault), plan.seed)


def _faults_of_url(url: str) -> verify.PlannedFaults:
    import sim_device
    from sim_device.protocol_haptogram import parse_url

    from .settings.faults.plan import read_fault_plan

    sim_device.register_url_handler()
    said = parse_url(url)
    plan = read_fault_plan(said.get("fault", ()), said.get("fault_plan"), said.get("seed", 0))
    return verify.PlannedFaults(tuple(map(str, plan.faults)), plan.seed)


@contextlib.contextmanager
def board_in_virtual_time(config: VerifyConfig) -> Iterator[BoardUnderTest]:
    """Make a virtual board in this program, behind the same bytes as any other."""
    import serial

    import sim_device

    from .driver.line.port import PyserialTransport
    from .evidence.boards import InProcessBoard

    sim_device.register_url_handler()
    options: dict[str, Any] = {
        "clock": "virtual",
        "array": config.virtual_array,
        "pitch_mm": config.pitch_mm,
        "temperature_c": config.air_over_board_c,
        "baud": config.link_baud,
        "seed": config.seed,
        "reconstruct": 1,
        "fault": config.fault,
    }
    for name in ("calibration", "fault_plan"):
        if (path := getattr(config, name)) is not None:
            options[name] = path
    url = f"{_SCHEME}?{urlencode(options, doseq=True)}"
    virtual: Any = serial.serial_for_url(url, timeout=0)  # the stubs know no URL handler
    with contextlib.closing(virtual) as port:
        model = port.simulation.board.settings.truth
        transport = PyserialTransport(port, "virtual board")
        yield InProcessBoard(transport, lambda: port.records, port.wait_until_ns, model)


def access_in_program(url: str | None, baudrate: int, seed: int) -> VirtualAccess:
    """Return a virtual board in this program that starts anew whenever its port is opened.

    Without a URL its time is virtual, and so is that of a URL that says ``clock=virtual``.
    """
    import serial

    import sim_device

    from .conformance.run.access import VirtualAccess
    from .driver.line.port import PyserialTransport

    sim_device.register_url_handler()
    given = [("clock", "virtual")] if url is None else parse_qsl(urlsplit(url).query)
    options = {"baud": str(baudrate), "seed": str(seed)} | dict(given)
    repeated = [(name, value) for name, value in given if name not in ("baud", "seed")]
    for name in ("baud", "seed"):
        if not options[name].isdecimal():
            raise ConfigurationError(f"{url}: {name} is {options[name]!r}, must be a number")
    first_seed = int(options["seed"])

    def start(number: int) -> Transport:
        # Another seed is another boot_id, as after a reset.
        own = [("baud", options["baud"]), ("seed", str(first_seed + number))]
        here = f"{_SCHEME}?{urlencode(own + repeated)}"
        port: Any = serial.serial_for_url(here, timeout=0)  # the stubs know no URL handler
        return PyserialTransport(port, here)

    return VirtualAccess(
        url or f"{_SCHEME}?{urlencode(options)}",
        start,
        baudrate=int(options["baud"]),
        virtual=options.get("clock") == "virtual",
    )


def board_without_a_line(mutant: str | None) -> MakeBoard:
    """Return what powers up virtual boards whose line is the caller's.

    Raises
    ------
    ConfigurationError
        If there is no such mutant.
    """
    import functools

    from sim_device.mutants import parts_of
    from sim_device.soak_board import JudgedBoard

    parts_of(mutant)
    return functools.partial(JudgedBoard, mutant=mutant)
