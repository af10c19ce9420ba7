"""The command line of the virtual board."""

from __future__ import annotations

import argparse
import contextlib
import errno
import functools
import gc
import logging
import os
import secrets
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

from haptogram.errors import ConfigurationError, HaptogramError, unwritable_file
from haptogram.machine.files import (
    STANDARD_OUTPUT,
    check_distinct_files,
    check_file_writable,
    make_folder_of,
)
from haptogram.machine.terminal import terminal_error_line
from haptogram.settings.board import (
    BOARD_OPTIONS,
    BoardConfig,
    PinCaptureConfig,
    is_grid_of_elements,
)
from haptogram.settings.command_line import add_setting_options, given_options
from haptogram.settings.dialects import DIALECT_TITLES
from haptogram.settings.faults.kinds import described_faults
from haptogram.settings.line import LineSettings
from haptogram.settings.option import options_of
from haptogram.settings.parser import Parser, name_option

if TYPE_CHECKING:
    from haptogram.machine.device_client import DeviceClient

    from .backdoor.line_tap import LineTap, OpenRecording
    from .backdoor.pin_capture import PinCapture
    from .backdoor.worker import ReconstructionWorker
    from .board.settings import BoardSettings
    from .line.port import BoardPort
    from .simulation import SimulationRecorder
    from .wallclock import Heartbeat

PROGRAM: Final = "python -m sim_device"
_LOG: Final = logging.getLogger(__name__)
_SERIAL_BAUD: Final = 3_000_000
_COUNTS_S: Final = 10
_SOCKET: Final = "unix:"  # a back door that is no file
_LOOPBACK: Final = "127.0.0.1"
_CAPTURE: Final = options_of(PinCaptureConfig)
_EPILOG: Final = """\
examples:
  PROGRAM --link /tmp/board            open /tmp/board as a serial port
  PROGRAM --tcp 7000                   open socket://127.0.0.1:7000
  PROGRAM --link /tmp/board --backdoor /tmp/board.jsonl
  PROGRAM --link /tmp/board --baud 3000000 --latency-ms 16
                     as behind a USB adapter whose latency timer was left alone
  PROGRAM --link /tmp/board --baud 3000000 --rx-fifo 16 --rx-poll-us 50
                     a UART of 16 bytes, emptied every 50 µs: one that does not overrun
  PROGRAM --link /tmp/board --seed 1 --fault "line.flip ber=1e-5" \\
      --fault "device.stuck column=3 from=2s"
  PROGRAM --link /tmp/board --dialect sonicsurface
                     a board that other programs drive: start yours on /tmp/board
  PROGRAM --link /tmp/board --dialect ultraino-mega64 --dialect-option boards=2 --array tinylev
  PROGRAM --dialect ultraino-mega64 --as-device -- java -jar AcousticFieldSim.jar
                     a program that lists serial ports and takes no path

Without --baud the line takes no time, as a pseudo-terminal does, and holds as much as one; that of
another dialect has the rate of its boards.
With --baud a byte takes 10 bits, in both directions; the other options give the line the
imperfections of a real one.  The bytes that it loses by them are counted in the log at the end
and in the last record of the back door.

The board ends on SIGINT or SIGTERM: muted, every record written, the link removed.

exit status:
  0  ended by SIGINT, SIGTERM, by the program of --as-device or, with --until-eof, by the end of
     standard input
  1  the port was lost, or the program of --as-device failed
  2  usage or environment error
"""


def set_up(parser: Parser, open_recording: OpenRecording | None = None) -> None:
    """Describe the command and add its options."""
    parser.description = "A virtual ultrasonic phased array at the far end of a serial line."
    parser.epilog = _board_epilog(parser.prog)
    where = parser.add_mutually_exclusive_group(required=True)
    where.add_argument(
        "--link", metavar="PATH", type=name_option, help="pseudo-terminal with this stable name"
    )
    where.add_argument(
        "--tcp",
        metavar="[HOST:]PORT",
        type=functools.partial(name_option, what="[HOST:]PORT"),
        help="TCP server [host 127.0.0.1]",
    )
    where.add_argument(
        "--serial",
        metavar="PORT",
        type=functools.partial(name_option, what="the name of a port"),
        help="real serial port, at its far end; --baud is 3000000 there, or that of the dialect",
    )
    where.add_argument(
        "--as-device",
        action="store_true",
        help="start COMMAND, behind --, which finds the board as a serial device (Linux)",
    )
    parser.add_argument(
        "client", nargs="*", metavar="COMMAND", help="program of --as-device, with its arguments"
    )
    line = options_of(LineSettings)
    board = [row for name, row in BOARD_OPTIONS.items() if name not in line]
    add_setting_options(parser.add_argument_group("board"), board, seed="another one each time")
    add_setting_options(parser.add_argument_group("line"), line.values())
    parser.add_argument(
        "--backdoor",
        metavar="PATH|unix:PATH",
        type=name_option,
        help="radiated drives, as JSON lines",
    )
    parser.add_argument(
        "--no-reconstruct", action="store_true", help="leave the field out of the back door"
    )
    if open_recording is not None:
        parser.add_argument(
            "--record",
            metavar="FILE",
            type=name_option,
            help="write the bytes in both directions and the latches, as MCAP",
        )
    add_setting_options(parser.add_argument_group("drive pins"), _CAPTURE.values())
    parser.add_argument(
        "--view",
        action="store_true",
        help="show what is radiated, live, in a browser (see haptogram view)",
    )
    parser.add_argument(
        "--until-eof", action="store_true", help="end with standard input: with who started it"
    )
    log = parser.add_mutually_exclusive_group()
    log.add_argument("--quiet", action="store_true", help="log warnings only")
    log.add_argument("-v", "--verbose", action="store_true", help="log the counts every second")


def _board_epilog(program: str) -> str:
    """Return examples, the faults with their parameters, and the dialects."""
    dialects = "\n".join(f"  {name:<23}{title}" for name, title in DIALECT_TITLES.items())
    faults = "\n".join(f"  {text}" for text in described_faults())
    return (
        f"{_EPILOG.replace('PROGRAM', program)}\n"
        "faults, their parameters and defaults (all but those of the clock also take\n"
        "from=500ms until=2s, those of the line direction=down or up; see docs/faults.md):\n"
        f"{faults}\n"
        "\ndialects; their options are in docs/dialects.md, and packages may bring more:\n"
        f"{dialects}\n"
    )


def main(
    words: Sequence[str], program: str = PROGRAM, open_recording: OpenRecording | None = None
) -> int:
    """Run a board until it is told to stop; return the exit status.

    0 after SIGINT or SIGTERM, 1 if the port was lost, 2 for arguments that cannot be used.

    Parameters
    ----------
    words : sequence of str
        Command line, without the name of the program.
    program : str
        Name of the program, as the user called it.
    open_recording : callable, optional
        Opens the recording of ``--record``; without it there is no such option.
    """
    parser = Parser(prog=program)
    set_up(parser, open_recording)
    try:
        options = parser.parse_args(words)
        _start_board_log(options)
        _run_board(options, open_recording)
    except HaptogramError as error:
        sys.stderr.write(terminal_error_line(program, parser.named(str(error)), sys.stderr) + "\n")
        return 2 if isinstance(error, ConfigurationError) else 1
    return 0


def _start_board_log(options: argparse.Namespace) -> None:
    logging.basicConfig(
        level=logging.WARNING if options.quiet else logging.INFO,
        format="%(asctime)s %(message)s",
        stream=sys.stderr,
    )


def _run_board(options: argparse.Namespace, open_recording: OpenRecording | None) -> None:
    # Here, and not above: --help and a refusal need no numpy.
    from haptogram.machine.view_process import ViewProcess

    from .blueprint import blueprint_of
    from .log import BoardCountLog, BoardNoticeLog
    from .simulation import Simulation
    from .wallclock import Heartbeat

    config = _board_config_of(options)
    if options.as_device and any(fault.name == "line.disconnect" for fault in config.faults):
        raise ConfigurationError("--as-device holds one port; leave the fault line.disconnect out")
    board = blueprint_of(config)
    client: DeviceClient | None = None
    settings, parts, plan = board.settings, board.parts, board.faults
    if plan.faults:
        _LOG.info("fault plan, as for --fault-plan:\n%s", plan.as_toml())
    _make_board_folders(options)
    pins = _start_pin_capture(options, settings)
    tap = _start_line_tap(options, config, settings, open_recording)
    port: BoardPort | None = None
    worker: ReconstructionWorker | None = None
    with contextlib.ExitStack() as signals:  # heard until everything is closed
        if options.as_device:
            options.link = _private_board_path(signals, "board")
        try:
            port = _open_board_port(options, settings.line)
            if options.view and options.backdoor is None:
                options.backdoor = _SOCKET + _private_board_path(signals, "backdoor")
            worker = _start_board_worker(options, settings)
            if options.view:
                signals.enter_context(contextlib.closing(ViewProcess(options.backdoor)))
            recorders: list[SimulationRecorder] = [BoardNoticeLog(), *([worker] if worker else [])]
            recorders += [tap] if tap else []
            recorders += [pins] if pins else []
            simulation = Simulation(
                settings,
                *recorders,
                paced=options.serial is None,
                parts=parts,
                faults=plan,
                probe=pins,
            )
            counts = BoardCountLog((1 if options.verbose else _COUNTS_S) * 1_000_000_000)
            heartbeat = Heartbeat(simulation, port, worker, counts, tap)
            if options.until_eof:
                heartbeat.stop_at_eof(sys.stdin.fileno())
            signals.enter_context(heartbeat.stopped_by_signals())
            if options.as_device:
                client = _start_board_client(options, heartbeat)
            _serve_board(heartbeat, port.description if client is None else client.device)
        finally:
            if port is not None:
                port.close()
            failed = client is not None and client.close()
            failures = [_end_board_worker(worker) if worker is not None else ""]
            if pins is not None and port is not None:
                failures.append(_end_pin_capture(pins))
            if tap is not None:
                failures.append(tap.close())
            if any(failures):
                raise ConfigurationError("; ".join(filter(None, failures)))
    if failed:
        raise HaptogramError(f"{options.client[0]} ended with status {failed}")


def _start_line_tap(
    options: argparse.Namespace,
    config: BoardConfig,
    settings: BoardSettings,
    open_recording: OpenRecording | None,
) -> LineTap | None:
    from .backdoor.line_tap import LineTap

    if open_recording is None or options.record is None:
        return None
    names = [name for name in vars(options) if getattr(options, name) is not None]
    given = {name: getattr(options, name) for name in sorted(names) if name in options.given}
    recording = open_recording(Path(options.record), given)
    return LineTap(recording, config, settings, paced=options.serial is None)


def _start_pin_capture(options: argparse.Namespace, settings: BoardSettings) -> PinCapture | None:
    """Return the recorder of the drive pins, if a capture is wanted."""
    values = given_options(options, _CAPTURE)
    if options.capture is None:
        if values:
            word = _CAPTURE[next(iter(values))].word
            raise ConfigurationError(f"{word} acts only with --capture; leave it out")
        return None
    from .backdoor.pin_capture import PinCapture

    config = PinCaptureConfig.of(**values)
    return PinCapture(Path(options.capture), config, settings)


def _private_board_path(stack: contextlib.ExitStack, name: str) -> str:
    """Return a path in a folder of its own, which is removed with *stack*."""
    from haptogram.machine.working_folder import WorkingFolder

    folder = WorkingFolder("haptogram-board-")
    stack.callback(folder.remove)
    return str(folder.path / name)


def _end_board_worker(worker: ReconstructionWorker) -> str:
    """Close the back door; return why it ended early, or nothing."""
    failure = worker.close()
    if worker.dropped:
        _LOG.warning("the back door lacks %d latches", worker.dropped)
    return failure


def _end_pin_capture(pins: PinCapture) -> str:
    """Write the capture; return why it could not be written, or nothing."""
    try:
        _LOG.info("%s", pins.close())
    except ConfigurationError as error:  # the recording is still to be closed
        return str(error)
    return ""


def _start_board_client(options: argparse.Namespace, heartbeat: Heartbeat) -> DeviceClient:
    """Start the program of ``--as-device``; the board ends with it."""
    from haptogram.machine.device_client import DeviceClient

    client = DeviceClient(os.path.realpath(options.link), options.client)
    if client.alive is not None:
        heartbeat.stop_after(client.alive)
    return client


def _serve_board(heartbeat: Heartbeat, description: str) -> None:
    gc.collect()
    gc.freeze()  # what is there now stays: no later collection need look at it
    sys.stdout.write(f"listening on {description}\n")
    sys.stdout.flush()  # programs wait for this line
    heartbeat.run()


def _board_config_of(options: argparse.Namespace) -> BoardConfig:
    if options.no_reconstruct and options.backdoor is None:
        raise ConfigurationError("--no-reconstruct acts only with --backdoor; leave it out")
    if options.as_device != bool(options.client):
        raise ConfigurationError("--as-device and a program behind -- need each other")
    _check_virtual_board_files(options)
    values = given_options(options, BOARD_OPTIONS)
    line = [BOARD_OPTIONS[name].word for name in options_of(LineSettings) if name in values]
    if options.serial is not None:
        if imperfect := [word for word in line if word != "--baud"]:
            raise ConfigurationError(f"{', '.join(imperfect)}: the line of --serial is a real one")
        if options.dialect is None:
            values.setdefault("baud", _SERIAL_BAUD)
    values.setdefault("seed", secrets.randbits(32))
    return BoardConfig.of(**values)


def _check_virtual_board_files(options: argparse.Namespace) -> None:
    """Refuse outputs that cannot be written, or have the name of another file of the command."""
    outputs = _board_outputs_of(options)
    array = None if options.array is None or is_grid_of_elements(options.array) else options.array
    inputs = (
        ("--array", array),
        ("--calibration", options.calibration),
        ("--fault-plan", options.fault_plan),
    )
    check_distinct_files(
        outputs, [(option, Path(path)) for option, path in inputs if path is not None]
    )
    for option, path in outputs.items():
        if path == STANDARD_OUTPUT:
            raise ConfigurationError(f"{option} -: standard output names the port; name a file")
        if option != "--link":  # which looks after itself
            _check_board_output(option, path)


def _board_outputs_of(options: argparse.Namespace) -> dict[str, Path]:
    """Return the files that the board makes, by option; a socket is none."""
    given = {
        "--link": options.link,
        "--backdoor": options.backdoor,
        "--record": getattr(options, "record", None),
        "--capture": options.capture,
    }
    names = {option: str(path) for option, path in given.items() if path is not None}
    return {option: Path(name) for option, name in names.items() if not name.startswith(_SOCKET)}


def _check_board_output(option: str, path: Path) -> None:
    """Raise if *path* cannot be written; a file that is there is not replaced."""
    if path.is_file():
        if not os.access(path, os.W_OK):
            raise unwritable_file(path, PermissionError(errno.EACCES, ""), option)
        return
    try:
        check_file_writable(path)
    except ConfigurationError as error:
        raise ConfigurationError(f"{option} {error}") from error


def _make_board_folders(options: argparse.Namespace) -> None:
    """Make the folders of the outputs, and say so; that of the link is made with the link."""
    outputs = _board_outputs_of(options)
    outputs.pop("--link", None)
    if options.backdoor is not None:  # by this process, whose log is read; a socket has one too
        outputs["--backdoor"] = Path(options.backdoor.removeprefix(_SOCKET))
    for option, path in outputs.items():
        try:
            make_folder_of(path)
        except OSError as error:
            raise unwritable_file(path, error, option) from error


def _open_board_port(options: argparse.Namespace, line: LineSettings) -> BoardPort:
    from .line.pty_port import PtyPort
    from .line.serial_port import SerialPort
    from .line.tcp_port import TcpPort

    if options.link is not None:
        return PtyPort(options.link)
    if options.serial is not None:
        return SerialPort(options.serial, line.baud or _SERIAL_BAUD)
    host, _, port = options.tcp.rpartition(":")
    if not port.isdecimal() or int(port) > 0xFFFF:
        raise ConfigurationError(f"--tcp {options.tcp}: must be HOST:PORT, the port 0 to 65535")
    return TcpPort(host.strip("[]") or _LOOPBACK, int(port))


def _start_board_worker(
    options: argparse.Namespace, settings: BoardSettings
) -> ReconstructionWorker | None:
    if options.backdoor is None:
        return None
    from .backdoor.worker import ReconstructionWorker

    return ReconstructionWorker(settings, options.backdoor, reconstruct=not options.no_reconstruct)
