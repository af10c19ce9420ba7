"""The command line of the virtual board."""

from __future__ import annotations

import argparse
import contextlib
import gc
import logging
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

from haptogram.errors import ConfigurationError, HaptogramError
from haptogram.machine.terminal import terminal_error_line
from haptogram.settings.board import BoardConfig
from haptogram.settings.line import LineSettings
from haptogram.settings.parser import Parser

from . import options as board_options

if TYPE_CHECKING:
    from haptogram.machine.device_client import DeviceClient

    from ..backdoor.line_tap import LineTap, OpenRecording
    from ..backdoor.pin_capture import BackdoorPinCapture
    from ..backdoor.worker import ReconstructionWorker
    from ..board.settings import BoardSettings
    from ..line.port import BoardPort
    from ..simulation import SimulationRecorder
    from ..wallclock import Heartbeat

PROGRAM: Final = "python -m sim_device"
_LOG: Final = logging.getLogger(__name__)
_COUNTS_S: Final = 10
_LOOPBACK: Final = "127.0.0.1"


def main(
    words: Sequence[str], program: str = PROGRAM, open_recording: OpenRecording | None = None
) -> int:
    """Run a board until it is stopped; return the exit status.

    0 after SIGINT, SIGTERM or SIGHUP, 1 if the port was lost, 2 for arguments that cannot be used.

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
    board_options.set_up_board(parser, open_recording)
    try:
        options = parser.parse_args(words)
        _start_board_log(options)
        _run_board(options, open_recording)
    except HaptogramError as error:
        sys.stderr.write(terminal_error_line(program, parser.named(str(error)), sys.stderr) + "\n")
        return 2 if isinstance(error, ConfigurationError) else 1
    return 0


def _start_board_log(options: argparse.Namespace) -> None:
    """Log to standard error, warnings alone if --quiet."""
    logging.basicConfig(
        level=logging.WARNING if options.quiet else logging.INFO,
        format="%(asctime)s %(message)s",
        stream=sys.stderr,
    )


def _log_start_step(options: argparse.Namespace, step: str) -> None:
    """Log a start-up step if --until-eof says that the program that started this one waits."""
    if options.until_eof:
        _LOG.info("starting: %s", step)


def _run_board(options: argparse.Namespace, open_recording: OpenRecording | None) -> None:
    """Build the board, its port and outputs, and run it until it ends.

    *open_recording* opens the file of --record; None: it cannot be recorded.
    """
    _log_start_step(options, "importing numpy, scipy and the board")
    # Here, and not above: --help and a refusal need no numpy.
    from haptogram.machine.view_process import ViewProcess

    from ..blueprint import blueprint_of
    from ..log import BoardCountLog, BoardNoticeLog
    from ..simulation import Simulation
    from ..wallclock import Heartbeat

    _log_start_step(options, "making the board")
    board_options.check_board_outputs(options)
    config = board_options.board_config_of(options)
    if options.as_device and any(fault.name == "line.disconnect" for fault in config.faults):
        raise ConfigurationError("--as-device holds one port; leave the fault line.disconnect out")
    board = blueprint_of(config)
    client: DeviceClient | None = None
    heartbeat: Heartbeat | None = None
    settings, parts, plan = board.settings, board.parts, board.faults
    if plan.faults:
        _LOG.info("fault plan, as for --fault-plan:\n%s", plan.as_toml())
    board_options.make_board_folders(options)
    pins = _start_pin_capture(options, settings)
    tap = _start_line_tap(options, config, settings, open_recording)
    port: BoardPort | None = None
    worker: ReconstructionWorker | None = None
    ends: list[HaptogramError] = []
    with contextlib.ExitStack() as signals:  # heard until everything is closed
        if options.as_device:
            options.link = _private_board_path(signals, "board")
        try:
            if options.view and options.backdoor is None:
                options.backdoor = board_options.SOCKET + _private_board_path(signals, "backdoor")
            _log_start_step(options, "starting the process that rebuilds fields")
            worker = _start_board_worker(options, settings)
            recorders: list[SimulationRecorder] = [BoardNoticeLog(is_complete=options.verbose)]
            recorders += [worker] if worker else []
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
            # Now, and not before: whoever waits for the port to be there is answered at once.
            port = _open_board_port(options, settings.line)
            if tap is not None:
                tap.begin()
            counts = BoardCountLog((1 if options.verbose else _COUNTS_S) * 1_000_000_000)
            heartbeat = Heartbeat(simulation, port, worker, counts, tap, config.slow_down)
            if options.until_eof:
                # A closed standard input has ended.
                heartbeat.stop_at_eof(sys.stdin.fileno() if sys.stdin else os.open(os.devnull, 0))
            signals.enter_context(heartbeat.stopped_by_signals())
            if options.as_device:
                client = _start_board_client(options, heartbeat)
            _announce_board(port.description if client is None else client.device)
            if options.view:  # its address comes after that of the port
                signals.enter_context(contextlib.closing(ViewProcess(options.backdoor)))
            heartbeat.run()
        except HaptogramError as error:
            ends.append(error)
        finally:
            if port is not None:
                port.close()
            failed = None if client is None else client.close()
            if failed and not (heartbeat and heartbeat.was_stopped):  # Ctrl-C ends both
                ends.append(HaptogramError(f"{options.client[0]} ended with status {failed}"))
            failures = [worker.close() if worker is not None else ""]
            if pins is not None and port is not None:
                try:
                    _LOG.info("%s", pins.close())
                except ConfigurationError as error:  # the recording is still to be closed
                    ends.append(error)
            if tap is not None:
                failures.append(tap.close())
    ends += [ConfigurationError(failure) for failure in failures if failure]
    if ends:
        raise _board_error(ends) from ends[0]


def _board_error(ends: Sequence[HaptogramError]) -> HaptogramError:
    """Return one error with the texts of all; a ConfigurationError only if all are."""
    is_refusal = all(isinstance(error, ConfigurationError) for error in ends)
    return (ConfigurationError if is_refusal else HaptogramError)("; ".join(map(str, ends)))


def _start_line_tap(
    options: argparse.Namespace,
    config: BoardConfig,
    settings: BoardSettings,
    open_recording: OpenRecording | None,
) -> LineTap | None:
    """Return the recorder of the line's bytes, whose file *open_recording* opens.

    None without --record.
    """
    from ..backdoor.line_tap import LineTap

    if open_recording is None or options.record is None:
        return None
    names = [name for name in vars(options) if getattr(options, name) is not None]
    given = {name: getattr(options, name) for name in sorted(names) if name in options.given}
    recording = open_recording(Path(options.record), given)
    return LineTap(recording, config, settings, paced=options.serial is None)


def _start_pin_capture(
    options: argparse.Namespace, settings: BoardSettings
) -> BackdoorPinCapture | None:
    """Return the recorder of the drive pins; None without --capture."""
    config = board_options.pin_capture_config_of(options)
    if config is None:
        return None
    from ..backdoor.pin_capture import BackdoorPinCapture

    return BackdoorPinCapture(Path(options.capture), config, settings)


def _private_board_path(stack: contextlib.ExitStack, name: str) -> str:
    """Return the path *name* in a folder of its own, which is removed with *stack*."""
    from haptogram.machine.working_folder import WorkingFolder

    folder = WorkingFolder("haptogram-board-")
    stack.callback(folder.remove)
    return str(folder.path / name)


def _start_board_client(options: argparse.Namespace, heartbeat: Heartbeat) -> DeviceClient:
    """Start the program of ``--as-device``; the board ends with it."""
    from haptogram.machine.device_client import DeviceClient

    client = DeviceClient(os.path.realpath(options.link), options.client)
    if client.alive is not None:
        heartbeat.stop_after(client.alive)
    return client


def _announce_board(description: str) -> None:
    """Print where the board listens."""
    gc.collect()
    gc.freeze()  # what is there now stays: no later collection need look at it
    sys.stdout.write(f"listening on {description}\n")
    sys.stdout.flush()  # programs wait for this line


def _open_board_port(options: argparse.Namespace, line: LineSettings) -> BoardPort:
    """Return the port that the options name: pty, serial (3 Mbaud unless *line* says) or TCP."""
    from ..line.pty_port import PtyPort
    from ..line.serial_port import SerialPort
    from ..line.tcp_port import TcpPort

    if options.link is not None:
        return PtyPort(options.link)
    if options.serial is not None:
        return SerialPort(options.serial, line.baud or board_options.SERIAL_BAUD)
    host, _, port = options.tcp.rpartition(":")
    if not port.isdecimal():
        raise ConfigurationError(
            f"--tcp {options.tcp}: must be HOST:PORT, such as {_LOOPBACK}:4000 (0: any free port)"
        )
    if len(port) > 5 or int(port) > 0xFFFF:
        raise ConfigurationError(f"--tcp {options.tcp}: the port is {port}, must be 0 to 65535")
    return TcpPort(host.strip("[]") or _LOOPBACK, int(port))


def _start_board_worker(
    options: argparse.Namespace, settings: BoardSettings
) -> ReconstructionWorker | None:
    """Return the worker that writes the back door; None without --backdoor."""
    if options.backdoor is None:
        return None
    from ..backdoor.worker import ReconstructionWorker

    return ReconstructionWorker(settings, options.backdoor, reconstruct=not options.no_reconstruct)
