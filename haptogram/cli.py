"""Command line: parses, wires, prints, returns the exit status.

The only module of the host that may import the virtual board: everything else meets a board
through a port.
"""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import os
import signal
import sys
import threading
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Final

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
from .errors import HaptogramError
from .settings.board import BoardConfig
from .settings.board_url import SCHEME, PortConfig, read_url, write_url

if TYPE_CHECKING:
    from .campaigns.soak import MakeBoard
    from .conformance.run.access import VirtualAccess
    from .driver.line.port import Transport
    from .evidence.boards import BoardUnderTest
    from .settings.faults.plan import FaultPlan
    from .settings.verify_config import VerifyConfig

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


def _prepare_simulator(config: VerifyConfig) -> FaultPlan:
    """Open the way to a board in this program, and return the faults of the virtual board.

    Raises
    ------
    ConfigurationError
        For a URL or a fault that is refused, or a plan that cannot be read.
    """
    if config.port is not None and config.port.startswith(SCHEME):
        import sim_device

        sim_device.register_url_handler()
        return read_url(config.port).board.plan
    return config.virtual_board().plan


@contextlib.contextmanager
def board_in_virtual_time(config: BoardConfig) -> Iterator[BoardUnderTest]:
    """Make a virtual board in this program, behind the same bytes as any other."""
    from sim_device.protocol_haptogram import open_port

    from .driver.line.port import PyserialTransport
    from .evidence.boards import InProcessBoard

    with contextlib.closing(
        open_port(PortConfig(board=config, clock="virtual", reconstruct=True))
    ) as port:
        model = port.simulation.board.settings.truth
        transport = PyserialTransport(port, "virtual board")
        yield InProcessBoard(transport, lambda: port.records, port.wait_until_ns, model)


def access_in_program(url: str | None, baudrate: int, seed: int) -> VirtualAccess:
    """Return a virtual board in this program that starts anew whenever its port is opened.

    Without a URL its time is virtual; *baudrate* and *seed* hold unless the URL gives others.
    """
    from sim_device.protocol_haptogram import open_port

    from .conformance.run.access import VirtualAccess
    from .driver.line.port import PyserialTransport

    defaults = BoardConfig.of(baud=baudrate, seed=seed)
    first = PortConfig(clock="virtual", board=defaults) if url is None else read_url(url, defaults)

    def start(number: int) -> Transport:
        # Another seed gives another boot_id, as a reset does.
        board = dataclasses.replace(first.board, seed=first.board.seed + number)
        config = dataclasses.replace(first, board=board)
        return PyserialTransport(open_port(config), write_url(config))

    return VirtualAccess(
        url or write_url(first),
        start,
        baudrate=first.board.line.baud or baudrate,
        virtual=first.is_virtual,
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
