"""The command line of the virtual board."""

from __future__ import annotations

import argparse
import contextlib
import gc
import logging
import secrets
import sys
from typing import Final, NoReturn

from haptogram.errors import ConfigurationError, HaptogramError
from haptogram.settings.faults.kinds import described
from haptogram.settings.faults.plan import read_fault_plan

from .backdoor.worker import ReconstructionWorker
from .board.settings import BoardSettings
from .line.port import Port, PtyPort, SerialPort, TcpPort
from .log import CountLog, NoticeLog
from .mutants import parts_of
from .options import board_settings
from .simulation import Recorder, Simulation
from .wallclock import Heartbeat

_LOG: Final = logging.getLogger(__name__)
_SERIAL_BAUD: Final = 3_000_000
_COUNTS_S: Final = 10
_LOOPBACK: Final = "127.0.0.1"
_LINE_OPTIONS: Final = (
    "baud_error_ppm",
    "rx_fifo",
    "rx_poll_us",
    "latency_ms",
    "host_buffer",
)
_EPILOG: Final = """\
examples:
  python -m sim_device --link /tmp/board            open /tmp/board as a serial port
  python -m sim_device --tcp 7000                   open socket://127.0.0.1:7000
  python -m sim_device --link /tmp/board --backdoor /tmp/board.jsonl
  python -m sim_device --link /tmp/board --baud 3000000 --latency-ms 16
                     as behind a USB adapter whose latency timer was left alone
  python -m sim_device --link /tmp/board --baud 3000000 --rx-fifo 16 --rx-poll-us 50
                     a UART of 16 bytes, emptied every 50 us: one that does not overrun
  python -m sim_device --link /tmp/board --seed 1 --fault "line.flip ber=1e-5" \\
      --fault "device.stuck column=3 from=2s"

The line: without --baud it takes no time, as a pseudo-terminal does, and whatever fits a
pseudo-terminal fits it.  With --baud a byte takes 10 bits, in both directions; the other
options of the line say what else a real one has.  What it loses by its nature is counted:
in the log at the end and in the last record of the back door.

It ends on SIGINT or SIGTERM: muted, every record written, the link removed.
"""


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        """Exit with status 2 and one line."""
        self.exit(2, f"{self.prog}: {message}\n")


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(
        prog="python -m sim_device",
        description="A virtual ultrasonic phased array at the far end of a serial line.",
        epilog=_epilog(),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    where = parser.add_mutually_exclusive_group(required=True)
    where.add_argument("--link", metavar="PATH", help="pseudo-terminal with this stable name")
    where.add_argument("--tcp", metavar="[HOST:]PORT", help="TCP server [host 127.0.0.1]")
    where.add_argument("--serial", metavar="PORT", help="real serial port, at its far end")
    parser.add_argument(
        "--baud", type=int, metavar="N", help="pace of the line [none; --serial: 3000000]"
    )
    _add_line(parser)
    parser.add_argument("--array", default="16x16", help="NXxNY or a CSV file [%(default)s]")
    parser.add_argument("--pitch-mm", type=float, default=10.0, metavar="MM", help="[%(default)s]")
    parser.add_argument(
        "--temperature-c", type=float, default=20.0, metavar="C", help="of the air [%(default)s]"
    )
    parser.add_argument(
        "--calibration",
        metavar="FILE",
        help="CSV file: gain, phase and place of each element, as the field has them and neither "
        "the board nor its host knows [all equal]",
    )
    parser.add_argument("--seed", type=int, metavar="N", help="of the board [random]")
    parser.add_argument(
        "--backdoor", metavar="PATH|unix:PATH", help="what it really radiated, as JSON lines"
    )
    parser.add_argument(
        "--no-reconstruct", action="store_true", help="leave the field out of the back door"
    )
    parser.add_argument("--mutant", metavar="NAME", help="a board that is wrong in one way")
    parser.add_argument(
        "--fault",
        action="append",
        default=[],
        metavar="FAULT",
        help="something that goes wrong on purpose, as listed below; may be given many times",
    )
    parser.add_argument(
        "--fault-plan",
        metavar="FILE",
        help="faults from a TOML file: seed = N, and tables [[fault]] with name and parameters",
    )
    parser.add_argument(
        "--until-eof", action="store_true", help="end with standard input: with who started it"
    )
    parser.add_argument("--quiet", action="store_true", help="log warnings only")
    parser.add_argument("-v", "--verbose", action="store_true", help="log the counts every second")
    return parser


def _add_line(parser: argparse.ArgumentParser) -> None:
    line = parser.add_argument_group("the line, beyond its rate")
    line.add_argument(
        "--baud-error-ppm",
        type=int,
        metavar="PPM",
        help="the board's UART is so fast; from 53000 (5.3 %%) on characters are damaged [0]",
    )
    line.add_argument(
        "--rx-fifo",
        type=int,
        metavar="BYTES",
        help="the board's UART holds so many bytes, what finds it full is lost [no limit]",
    )
    line.add_argument(
        "--rx-poll-us", type=int, metavar="US", help="how often its firmware empties that [50]"
    )
    line.add_argument(
        "--latency-ms",
        type=float,
        metavar="MS",
        help="the host has a USB adapter with this latency timer: bytes come in packets of 62, or "
        "when it runs out; 16 is usual, 1 the least of a good driver [no adapter]",
    )
    line.add_argument(
        "--host-buffer",
        type=int,
        metavar="BYTES",
        help="so much may lie unread at the host, what comes then is lost [the board waits]",
    )


def _epilog() -> str:
    """Return examples, and the faults with their parameters."""
    faults = "\n".join(f"  {text}" for text in described())
    return (
        f"{_EPILOG}\nfaults, their parameters and what these are if left out (all but those of the "
        f"clock take\nfrom=500ms until=2s, those of the line direction=down or up; docs/faults.md "
        f"tells more):\n"
        f"{faults}\n"
    )


def main(arguments: list[str] | None = None) -> int:
    """Run a board until it is told to stop; return the exit status.

    0 after SIGINT or SIGTERM, 1 if the port was lost, 2 for arguments that cannot be used.
    """
    options = _parser().parse_args(arguments)
    logging.basicConfig(
        level=logging.WARNING if options.quiet else logging.INFO,
        format="%(asctime)s %(message)s",
        stream=sys.stderr,
    )
    try:
        _run(options)
    except HaptogramError as error:
        sys.stderr.write(f"sim_device: {error}\n")
        return 2 if isinstance(error, ConfigurationError) else 1
    return 0


def _run(options: argparse.Namespace) -> None:
    settings, parts = _settings(options), parts_of(options.mutant)
    plan = read_fault_plan(options.fault, options.fault_plan, settings.seed)
    if plan.faults:
        _LOG.info("fault plan, as for --fault-plan:\n%s", plan.as_toml())
    port = _open_port(options)
    worker = None
    with contextlib.ExitStack() as signals:  # heard until everything is closed
        try:
            worker = _start_worker(options, settings)
            recorders: list[Recorder] = [NoticeLog(), *([worker] if worker else [])]
            paced = options.serial is None
            simulation = Simulation(settings, *recorders, paced=paced, parts=parts, faults=plan)
            counts = CountLog((1 if options.verbose else _COUNTS_S) * 1_000_000_000)
            heartbeat = Heartbeat(simulation, port, worker, counts)
            if options.until_eof:
                heartbeat.stop_at_eof(sys.stdin.fileno())
            signals.enter_context(heartbeat.stopped_by_signals())
            _serve(heartbeat, port)
        finally:
            port.close()
            if worker is not None:
                _end(worker)


def _end(worker: ReconstructionWorker) -> None:
    worker.close()
    if worker.dropped:
        _LOG.warning("the back door lacks %d latches", worker.dropped)


def _serve(heartbeat: Heartbeat, port: Port) -> None:
    gc.collect()
    gc.freeze()  # what is there now stays: no later collection need look at it
    sys.stdout.write(f"listening on {port.description}\n")
    sys.stdout.flush()  # programs wait for this line
    heartbeat.run()


def _settings(options: argparse.Namespace) -> BoardSettings:
    baud = options.baud
    if options.serial is not None and baud is None:
        baud = _SERIAL_BAUD
    line = {name: getattr(options, name) for name in _LINE_OPTIONS}
    given = {name: value for name, value in line.items() if value is not None}
    if given and options.serial is not None:
        named = ", ".join(f"--{name.replace('_', '-')}" for name in given)
        raise ConfigurationError(f"{named}: the line of --serial is a real one")
    return board_settings(
        array=options.array,
        pitch_mm=options.pitch_mm,
        temperature_c=options.temperature_c,
        calibration=options.calibration,
        seed=secrets.randbits(32) if options.seed is None else options.seed,
        baud=baud,
        **given,
    )


def _open_port(options: argparse.Namespace) -> Port:
    if options.link is not None:
        return PtyPort(options.link)
    if options.serial is not None:
        return SerialPort(options.serial, options.baud or _SERIAL_BAUD)
    host, _, port = options.tcp.rpartition(":")
    if not port.isdecimal() or int(port) > 0xFFFF:
        raise ConfigurationError(f"--tcp {options.tcp}: must be HOST:PORT, the port 0 to 65535")
    return TcpPort(host.strip("[]") or _LOOPBACK, int(port))


def _start_worker(
    options: argparse.Namespace, settings: BoardSettings
) -> ReconstructionWorker | None:
    if options.backdoor is None:
        return None
    return ReconstructionWorker(settings, options.backdoor, reconstruct=not options.no_reconstruct)
