"""Command line: parses, wires, prints, returns the exit status.

The only module of the host that may import the virtual board: everything else meets a board
through a port.
"""

from __future__ import annotations

import contextlib
import importlib
import os
import shlex
import signal
import sys
import threading
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from . import __version__
from .commands.shell.exit_status import EVERY_STATUS, INTERRUPTED, USAGE
from .commands.shell.interrupts import exit_at_once, hear_interrupts_in_callbacks
from .commands.shell.standard_streams import patient_standard_streams
from .errors import ConfigurationError, HaptogramError
from .machine.terminal import terminal_error_line
from .settings.parser import Parser, UsageError

if TYPE_CHECKING:
    from .campaigns.soak.segment import MakeBoard
    from .conformance.run.access import VirtualAccess
    from .driver.line.port import Transport
    from .evidence.boards import BoardUnderTest
    from .evidence.dialect_run import DialectBoards
    from .evidence.recordings.replay import ReplayBoard
    from .evidence.recordings.tap import RecordedBoards
    from .evidence.recordings.writer import RecordingWriter
    from .settings.board import BoardConfig
    from .settings.board_url import PortConfig
    from .settings.verify_config import VerifyConfig

_ENDINGS: Final = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
_BOARD: Final = "board"
#: Every command: the module that adds its options, and its line in the list of commands.
COMMANDS: Final = {
    "verify": (".verify.command", "display a tactile object and verify where every focus is"),
    "conform": (".conform.command", "judge a board by every clause of the protocol"),
    _BOARD: ("sim_device.command", "start the virtual board on a pty, TCP or a serial port"),
    "view": (".view", "show a running board in a browser: phases, field, focus, time line"),
    "watch": (".watch.command", "tell what a board radiates while any program drives it"),
    "soak": (".soak", "stream for hours over a bad line and account for every fault"),
    "bench": (".bench", "measure the 1 kHz loop: percentiles, every miss with its cause"),
    "budget": (".budget", "show where the time of a frame goes, and the highest rate that fits"),
    "field": (".field.command", "compute the field of a focus, an object or a drive"),
    "modulation": (".modulation.command", "compute what a modulated focus makes at the skin"),
    "decode": (".recordings.decode", "print recorded or dumped bytes as annotated frames"),
    "replay": (".recordings.replay", "feed a recording to a board again and compare"),
    "repair": (".recordings.repair", "make a recording that was cut off a whole file again"),
    "capture": (".recordings.capture", "measure drive pins in a capture of a logic analyser"),
    "presets": (
        ".published.presets",
        "list the known systems, with their published figures next to ours",
    ),
    "paper": (".published.paper", "reproduce the Haptogram paper's simulation"),
}
# Boards that take time to start, such as InteractLab's, have done so before a client comes.
_STARTED_NS: Final = 1_500_000_000
_LAST_FRAMES_NS: Final = 50_000_000
_EXAMPLES: Final = """\
examples:
  haptogram verify                          a hemisphere at 1 kHz on the virtual board
  haptogram conform --port /dev/ttyACM0     firmware in CI: a verdict for every clause
  haptogram board --link /tmp/board         a serial port without hardware
  haptogram COMMAND --help                  options, examples and exit status of a command
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line *argv* and return its exit status."""
    words = sys.argv[1:] if argv is None else list(argv)
    if words[:1] == [_BOARD]:
        from sim_device.__main__ import main as run_board

        return run_board(words[1:], f"haptogram {_BOARD}", open_recording_of_board)
    # One thread each: two threads of a linear algebra library ruin the loop on a busy machine.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    exit_at_once()
    with patient_standard_streams():
        return _run(words)


def _run(words: Sequence[str]) -> int:
    parser = _parser(words)
    heard: list[int] = []
    try:
        arguments = parser.parse_args(words)
        arguments.command_line = shlex.join([parser.prog, *words])
        parser = arguments.parser
        with _ended_by_signals(heard), hear_interrupts_in_callbacks():
            return int(arguments.run(arguments))
    except UsageError as error:
        print(terminal_error_line(error.program, str(error), sys.stderr), file=sys.stderr)
    except HaptogramError as error:
        print(
            terminal_error_line(parser.prog, parser.named(str(error)), sys.stderr), file=sys.stderr
        )
    except KeyboardInterrupt:  # before there was anything to keep
        return _interrupted(parser)
    except Exception:
        if not heard:
            raise
        return _interrupted(parser)  # a library made another error of it
    return USAGE


def _interrupted(parser: Parser) -> int:
    print(f"{parser.prog}: interrupted", file=sys.stderr)
    return INTERRUPTED


@contextlib.contextmanager
def _ended_by_signals(heard: list[int]) -> Iterator[None]:
    """Let SIGTERM and SIGHUP (a CI out of time, a closed terminal) clean up as Ctrl-C does.

    One that is ignored from the start (nohup, a job in the background) stays so; those that came
    are in *heard*.
    """

    def interrupt(number: int, _: object) -> None:
        heard.append(number)
        raise KeyboardInterrupt

    if threading.current_thread() is not threading.main_thread():
        yield  # whoever owns the main thread decides
        return
    before = {number: signal.getsignal(number) for number in _ENDINGS}
    try:
        for number, handler in before.items():
            if handler is not signal.SIG_IGN:
                signal.signal(number, interrupt)
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _parser(words: Sequence[str]) -> Parser:
    """Return the parser of all commands; only the command that *words* name has its options."""
    parser = Parser(
        prog="haptogram",
        description="Hardware-in-the-loop test harness for ultrasonic phased arrays.",
        epilog=f"{_EXAMPLES}\n{EVERY_STATUS}",
    )
    parser.add_argument("--version", action="version", version=f"haptogram {__version__}")
    commands = parser.add_subparsers(
        title="commands", dest="command", required=True, metavar="COMMAND"
    )
    named = next((word for word in words if not word.startswith("-")), None)
    for name, (_, summary) in COMMANDS.items():
        command = commands.add_parser(name, help=summary)
        if name == named:
            _add_options(name, command)
    return parser


def command_parser(name: str) -> Parser:
    """Return the parser of one command, with all its options."""
    parser = Parser(prog=f"haptogram {name}")
    _add_options(name, parser)
    return parser


def _add_options(name: str, parser: Parser) -> None:
    """Let the module of a command describe it, given what only this module knows of boards."""
    parts = {
        "verify": (
            _prepare_simulator,
            board_in_virtual_time,
            board_behind_url,
            boards_of_dialect,
        ),
        "conform": (access_in_program,),
        "soak": (board_without_a_line,),
        "replay": (replayed_board,),
        "watch": (records_of_bytes,),
        _BOARD: (open_recording_of_board,),
    }
    module = importlib.import_module(COMMANDS[name][0], "haptogram.commands")
    module.set_up(parser, *parts.get(name, ()))


def _prepare_simulator(config: VerifyConfig) -> BoardConfig:
    """Open the way to a board in this program, and return the settings of the virtual board.

    Raises
    ------
    ConfigurationError
        For a URL or a fault that is refused, or a plan that cannot be read.
    """
    from .settings.board_url import SCHEME, read_board_url

    if config.link.port is not None and config.link.port.startswith(SCHEME):
        import sim_device

        sim_device.register_url_handler()
        board = read_board_url(config.link.port).board
        if config.link.dialect is None and board.dialect is not None:
            raise ConfigurationError(
                f"port {config.link.port} is a board of another dialect: give --dialect "
                f"{board.dialect} as well"
            )
        return board
    return config.virtual_board()


@contextlib.contextmanager
def board_in_virtual_time(config: BoardConfig) -> Iterator[BoardUnderTest]:
    """Make a virtual board in this program, behind the same bytes as any other."""
    from .settings.board_url import PortConfig

    reconstruct = config.dialect is None  # else whoever knows the frames does
    port = PortConfig(board=config, clock="virtual", reconstruct=reconstruct)
    with _board_in_program(port, "virtual board, in virtual time") as board:
        yield board


@contextlib.contextmanager
def board_behind_url(url: str) -> Iterator[BoardUnderTest]:
    """Make the virtual board in this program that *url* describes, whose back door is at hand.

    Raises
    ------
    ConfigurationError
        For a URL that gives the back door to somebody else.
    """
    import dataclasses

    from .settings.board_url import read_board_url

    port = read_board_url(url)
    if port.backdoor is not None:
        raise ConfigurationError(
            f"port {url}: backdoor writes {port.backdoor}, and verify judges by the back door "
            "itself: leave backdoor out"
        )
    with _board_in_program(dataclasses.replace(port, reconstruct=False), url) as board:
        yield board


@contextlib.contextmanager
def _board_in_program(config: PortConfig, label: str) -> Iterator[BoardUnderTest]:
    from sim_device.protocol_haptogram import open_virtual_port

    from .driver.line.port import PyserialTransport
    from .evidence.boards import InProcessBoard

    with contextlib.closing(open_virtual_port(config)) as port:
        model = port.simulation.settings.truth
        transport = PyserialTransport(port, label)
        yield InProcessBoard(transport, lambda: port.records, port.wait_until_ns, model, label)


def boards_of_dialect(config: VerifyConfig) -> DialectBoards:
    """Return the boards of the dialect that *config* names, of ours or of another package.

    Raises
    ------
    ConfigurationError
        For a dialect, an option of it or an array that is refused.
    """
    from sim_device.assembly import ForeignAssembly
    from sim_device.blueprint import blueprint_of

    from .evidence.dialect_run import DialectBoards
    from .settings.board import BoardConfig

    pitch_mm = config.array.pitch_mm
    blueprint = blueprint_of(BoardConfig.of(**config.dialect_options(), pitch_mm=pitch_mm))
    settings, parts = blueprint.settings, blueprint.parts
    if settings.wiring is None or not isinstance(parts, ForeignAssembly):
        raise ConfigurationError(f"dialect is {config.link.dialect!r}, whose boards have no wiring")
    return DialectBoards(
        parts.emulation.dialect,
        settings.model.array,
        settings.wiring.channels,
        settings.calibration,
    )


def access_in_program(
    url: str | None, baudrate: int, seed: int, boards: RecordedBoards | None = None
) -> VirtualAccess:
    """Return a virtual board in this program that starts anew whenever its port is opened.

    Without a URL its time is virtual; *baudrate* and *seed* hold unless the URL gives others.
    With *boards* every board goes into their recording.
    """
    import dataclasses

    from sim_device.protocol_haptogram import Serial, open_virtual_port

    from .conformance.run.access import VirtualAccess
    from .driver.line.port import PyserialTransport
    from .settings.board import BoardConfig
    from .settings.board_url import PortConfig, read_board_url, write_board_url

    defaults = BoardConfig.of(baud=baudrate, seed=seed)
    first = (
        PortConfig(clock="virtual", board=defaults)
        if url is None
        else read_board_url(url, defaults)
    )

    opened: list[Serial] = []

    def start(number: int) -> Transport:
        # Another seed gives another boot_id, as a reset does.
        board = dataclasses.replace(first.board, seed=first.board.seed + number)
        config = dataclasses.replace(first, board=board)
        name = write_board_url(config)
        if boards is not None and config.backdoor is None and config.reconstruct is None:
            config = dataclasses.replace(config, reconstruct=False)
        port = open_virtual_port(config)
        opened[:] = [port]
        if boards is None:
            return PyserialTransport(port, name)
        return boards(
            PyserialTransport(port, name),
            board.non_default(),
            lambda: port.records,
            just_powered=config.is_virtual,
        )

    def raise_fault() -> None:
        if boards is not None:
            boards.hardware_fault()
        opened[0].raise_hardware_fault()

    return VirtualAccess(
        url or write_board_url(first),
        start,
        baudrate=first.board.line.baud or baudrate,
        virtual=first.is_virtual,
        raise_fault=raise_fault,
    )


def replayed_board(options: Mapping[str, Any], paced: bool) -> ReplayBoard:
    """Return a virtual board that recorded bytes are fed to.

    Raises
    ------
    ConfigurationError
        If there is no such board.
    """
    from sim_device.driven.replay_board import VirtualReplayBoard

    from .settings.board import BoardConfig

    return VirtualReplayBoard(BoardConfig.of(**options), paced=paced)


def open_recording_of_board(path: Path, options: Mapping[str, Any]) -> RecordingWriter:
    """Return the recording that a virtual board writes.

    Raises
    ------
    ConfigurationError
        If it cannot be written.
    """
    from .evidence.recordings.writer import RecordingWriter
    from .machine.files import STANDARD_OUTPUT, check_file_writable

    if path == STANDARD_OUTPUT:
        raise ConfigurationError("--record -: standard output names the port; name a file")
    check_file_writable(path)
    return RecordingWriter(path, command=_BOARD, configuration=options)


def board_without_a_line(mutant: str | None) -> MakeBoard:
    """Return a function that powers up virtual boards whose line is the caller's.

    Raises
    ------
    ConfigurationError
        If there is no such mutant.
    """
    import functools

    from sim_device.driven.soak_board import SoakBoard
    from sim_device.mutants import mutant_parts

    mutant_parts(mutant)
    return functools.partial(SoakBoard, mutant=mutant)


def records_of_bytes(config: BoardConfig, data: bytes) -> list[dict[str, Any]]:
    """Return the back door of a virtual board in this program that takes the bytes of a client.

    Raises
    ------
    ConfigurationError
        If the board cannot be built.
    """
    from sim_device.protocol_haptogram import open_virtual_port

    from .settings.board_url import PortConfig

    with contextlib.closing(
        open_virtual_port(PortConfig(board=config, clock="virtual", reconstruct=False))
    ) as port:
        port.wait_until_ns(port.now_ns() + _STARTED_NS)
        port.write(data)
        port.flush()
        # What waits in the board, such as a FIFO of frames, is shown as well.
        port.wait_until_ns(port.now_ns() + _LAST_FRAMES_NS)
        port.simulation.unplug()  # it is looked at once more when its client leaves
    return list(port.records)
