"""Command line: parses, wires, prints, returns the exit status."""

from __future__ import annotations

import contextlib
import importlib
import io
import os
import signal
import sys
import threading
from collections.abc import Iterator, Sequence
from typing import Final

from .. import __version__
from ..commands.shell.exit_status import INTERRUPTED, USAGE
from ..commands.shell.help_text import describe_command
from ..commands.shell.interrupts import exit_at_once, hear_interrupts_in_callbacks
from ..commands.shell.standard_streams import patient_standard_streams
from ..errors import HaptogramError, plain_reason
from ..machine.terminal import terminal_command_line, terminal_error_line
from ..settings.parser import Parser, UsageError
from . import boards

_ENDINGS: Final = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
_BOARD: Final = "board"
_ALONE: Final = threading.Lock()  # standard output is that of the process
#: Every command: the module that adds its options, and its line in the list of commands.
COMMANDS: Final = {
    "verify": (".verify.command", "display a tactile object and verify where every focus is"),
    "conform": (".conform.command", "judge a board by every clause of the protocol"),
    _BOARD: (
        "sim_device.command.options",
        "start the virtual board on a pty, TCP or a serial port",
    ),
    "view": (".view", "show a running board in a browser: phases, field, focus, time line"),
    "watch": (".watch.command", "tell what a board radiates while any program drives it"),
    "soak": (".soak", "stream for hours over a bad line and account for every fault"),
    "sweep": (".sweep", "run verify, conform or soak over many values of their options"),
    "bench": (".bench", "measure the 1 kHz loop: percentiles, every miss with its cause"),
    "budget": (".budget", "show where the time of a frame goes, and the highest rate that fits"),
    "field": (".field.command", "compute the field of a focus, an object or a drive"),
    "modulation": (".modulation.command", "compute what a modulated focus makes at the skin"),
    "decode": (".recordings.decode", "print recorded or dumped bytes as annotated frames"),
    "replay": (".recordings.replay", "feed a recording to a board again and compare"),
    "repair": (".recordings.repair", "make a recording that was cut off a whole file again"),
    "capture": (".recordings.capture", "measure drive pins in a capture of a logic analyser"),
    "presets": (".presets", "list the known systems, with their published figures next to ours"),
}


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line *argv* and return its exit status."""
    words = sys.argv[1:] if argv is None else list(argv)
    if words[:1] == [_BOARD]:
        from sim_device.__main__ import main as run_board

        with patient_standard_streams():
            return run_board(words[1:], f"haptogram {_BOARD}", boards.open_recording_of_board)
    # One thread each: two threads of a linear algebra library ruin the loop on a busy machine.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    exit_at_once()
    with patient_standard_streams():
        return _run_command(words, [])


def result_of_command(words: Sequence[str]) -> tuple[int, bytes, str]:
    """Run a command beside others, one at a time in a process, for its result as JSON.

    Returns
    -------
    tuple of int, bytes and str
        Exit status, the result, and the text on standard error, whose last line is the reason for
        no result.  A process that is told to end does.
    """
    heard: list[int] = []
    content, said = io.BytesIO(), io.StringIO()
    output = io.TextIOWrapper(content, encoding="utf-8")
    with _ALONE, contextlib.redirect_stdout(output), contextlib.redirect_stderr(said):
        try:
            status = _run_command([*words, "--quiet", "--json=-"], heard)
            output.flush()
        except Exception as error:  # not every error can be sent to another process
            reason = " ".join(plain_reason(error).split())  # on one line
            return USAGE, b"", f"{type(error).__name__}: {reason}"
    if heard:  # the result is a part of one, and the pool of this process waits for its end
        os._exit(status)
    return status, content.getvalue(), said.getvalue()


def _run_command(words: Sequence[str], heard: list[int]) -> int:
    """Run a command, print its error; return the exit status. Signals are added to *heard*."""
    parser = _command_parser(words)
    try:
        arguments = parser.parse_args(words)
        arguments.command_line = terminal_command_line([parser.prog, *words])
        parser = arguments.parser
        with _command_ended_by_signals(heard), hear_interrupts_in_callbacks():
            return int(arguments.run(arguments))
    except UsageError as error:
        print(terminal_error_line(error.program, str(error), sys.stderr), file=sys.stderr)
    except HaptogramError as error:
        print(
            terminal_error_line(parser.prog, parser.named(str(error)), sys.stderr), file=sys.stderr
        )
    except KeyboardInterrupt:  # before there was anything to keep
        return _interrupted_command(parser)
    except Exception:
        if not heard:
            raise
        return _interrupted_command(parser)  # a library made another error of it
    return USAGE


def _interrupted_command(parser: Parser) -> int:
    """Print that the command was interrupted; return its exit status."""
    print(f"{parser.prog}: interrupted", file=sys.stderr)
    return INTERRUPTED


@contextlib.contextmanager
def _command_ended_by_signals(heard: list[int]) -> Iterator[None]:
    """Handle SIGTERM and SIGHUP like Ctrl-C; append them to *heard*.

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


def _command_parser(words: Sequence[str]) -> Parser:
    """Return the parser of all commands; only the command that *words* name has its options."""
    parser = Parser(prog="haptogram")
    describe_command(parser, "haptogram")
    parser.add_argument("--version", action="version", version=f"haptogram {__version__}")
    commands = parser.add_subparsers(
        title="commands", dest="command", required=True, metavar="COMMAND"
    )
    named = next((word for word in words if not word.startswith("-")), None)
    for name, (_, summary) in COMMANDS.items():
        command = commands.add_parser(name, help=summary)
        if name == named:
            _add_command_options(name, command)
    return parser


def command_parser(name: str) -> Parser:
    """Return the parser of one command, with all its options."""
    parser = Parser(prog=f"haptogram {name}")
    _add_command_options(name, parser)
    return parser


def _add_command_options(name: str, parser: Parser) -> None:
    """Let the module of the command *name* add its options to *parser*.

    It is passed what the command needs from this program, such as the functions that open boards.
    """
    parts = {
        "verify": (boards,),
        "conform": (boards.access_in_program,),
        "soak": (boards.board_without_a_line,),
        "sweep": (command_parser, result_of_command),
        "replay": (boards.replayed_board,),
        "watch": (boards.records_of_bytes,),
        _BOARD: (boards.open_recording_of_board,),
    }
    if name != _BOARD:
        describe_command(parser, name)
    module = importlib.import_module(COMMANDS[name][0], "haptogram.commands")
    getattr(module, f"set_up_{name}")(parser, *parts.get(name, ()))
