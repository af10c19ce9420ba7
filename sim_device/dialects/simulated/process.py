"""A simulator as a process, in lines of text; docs/simulators.md has the protocol.

::

    L 4340          a bit of the line takes 4340 ns; 0: the line takes no time
    B 1000000 fe    the start bit of the byte fe begins at 1000000 ns
    T 2000000       time passes up to 2000000 ns, or to the first byte of the board

    hello 1         first of all, and then up to a full stop: pins, period, start, by
    P 781 00ff      the levels of all pins from 781 ns of this period on
    |               this period of the carrier ends
    = 399           399 more have ended, in which the pins did as in the last one
    R 1500000 41    the board has sent the byte 41
    . 2000000       the time that is reached
"""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from typing import Final, NamedTuple, NoReturn

from haptogram.errors import ConfigurationError, LinkLostError
from haptogram.machine.line_process import LineProcess
from haptogram.settings.frozen import dataclass

VERSION: Final = 1
PERIOD: Final = b"|\n"  # and nothing else has this sign
SAME: Final = b"= "
PATIENCE_S: Final = 20.0
_LONGEST_GRANT_NS: Final = 10_000_000  # a simulator that is slow still answers in time
_MOST_PINS: Final = 4096
_SHOWN: Final = 60  # characters of a line that nobody understands


class SentByte(NamedTuple):
    """A byte that the board has sent, when its last bit has ended."""

    t_ns: int
    value: int


@dataclass(frozen=True)
class SimulatedHello:
    """The board of a simulator, by its own word.

    Attributes
    ----------
    pins : tuple of str
        Names; the first is the lowest bit.
    period_ns : int
        Period of the carrier.
    start_ns : int
        Time from power-up after which the board takes bytes.
    by : str
        The simulator, and what it simulates.
    """

    pins: tuple[str, ...]
    period_ns: int
    start_ns: int = 0
    by: str = ""


class SimulatorProcess:
    """A simulator at the end of a line of *baud* bits a second.

    Parameters
    ----------
    command : str
        Command line, without a shell.
    baud : int or None
        None: the line takes no time.
    channels : int
        Pins that the array needs.

    Attributes
    ----------
    hello : SimulatedHello
        The simulator's description of its board.
    now_ns : int
        Time that it has reached.

    Raises
    ------
    ConfigurationError
        It cannot be started, is no simulator, or one of another version or with too few pins.
    LinkLostError
        From every later call: it has ended, does not answer, or makes no sense.
    """

    def __init__(self, command: str, baud: int | None, channels: int) -> None:
        self._failure: type[ConfigurationError | LinkLostError] = ConfigurationError
        self._name = f"simulator {command!r}"
        try:
            words = shlex.split(command)
        except ValueError as error:
            raise ConfigurationError(f"{self._name}: {error}") from error
        if not words:
            raise ConfigurationError("simulator is empty; it names a program")
        self._process = LineProcess(words, self._name, lambda text: self._failure(text), PATIENCE_S)
        self.close = self._process.close
        self.now_ns = 0
        self._announced = b""
        bit_ns = round(1e9 / baud) if baud else 0
        self.hello = self._read_hello(self._process.ask(b"L %d\n" % bit_ns, _is_complete_hello))
        if len(self.hello.pins) < channels:
            self.fail(
                f"has {len(self.hello.pins)} pins, and the array {channels} channels: give an "
                f"array that fits, such as array {len(self.hello.pins)}x1"
            )
        self._failure = LinkLostError

    def announce(self, begin_ns: Sequence[int], data: bytes) -> None:
        """Let bytes begin at these times; a grant hands them over."""
        for t_ns, byte in zip(begin_ns, data, strict=True):
            self._announced += b"B %d %02x\n" % (max(t_ns, self.now_ns), byte)

    def grant(self, until_ns: int) -> tuple[bytes, list[SentByte]]:
        """Let time pass, up to *until_ns* or the first byte that is sent; return pins and bytes."""
        until_ns = min(until_ns, self.now_ns + _LONGEST_GRANT_NS)
        text, self._announced = self._announced, b""
        answer = self._ask(text + b"T %d\n" % until_ns)
        at = answer.find(b"R ")
        pins = answer[: at if at >= 0 else answer.rfind(b". ")]
        *lines, stop = answer[len(pins) :].splitlines()
        sent = [self._read_sent(line, until_ns) for line in lines]
        reached_ns = self._number(stop.removeprefix(b". "), stop)
        if not self.now_ns <= reached_ns <= until_ns:
            way = "back in time" if reached_ns < self.now_ns else "ahead of its time"
            self.fail(f"went {way}: from {self.now_ns} ns to {reached_ns} ns of {until_ns} ns")
        if reached_ns < until_ns and not sent:
            self.fail(f"stopped at {reached_ns} ns of {until_ns} ns, and sent no byte")
        self.now_ns = reached_ns
        return pins, sent

    def fail(self, what: str) -> NoReturn:
        """End the process, and raise the error that it did *what*."""
        self.close()
        raise self._failure(f"{self._name} {what}")

    def _ask(self, text: bytes) -> bytes:
        """Send a request to the simulator and return its whole answer."""
        return self._process.ask(text, _is_complete_answer)

    def _read_sent(self, line: bytes, until_ns: int) -> SentByte:
        """Parse the line of a byte that the board sent; end the process with an error if wrong.

        Wrong is a malformed line, or a time in the past or after *until_ns*.
        """
        try:
            word, t_ns, value = line.split()
            sent = SentByte(int(t_ns), int(value, 16))
        except ValueError:
            self.garbage(line)
        in_time = self.now_ns <= sent.t_ns <= until_ns
        if word != b"R" or not in_time or not 0 <= sent.value <= 0xFF:
            self.garbage(line)
        return sent

    def _number(self, text: bytes, line: bytes) -> int:
        """Parse *text* as a whole number; else end the process with an error that shows *line*."""
        try:
            return int(text)
        except ValueError:
            self.garbage(line)

    def garbage(self, text: bytes) -> NoReturn:
        """End the process, and raise the error that it wrote *text*."""
        lines = text.decode(errors="replace").strip().splitlines() or [""]
        self.fail(f"wrote {lines[0][:_SHOWN]!r}, which is no line of a simulator here")

    def _read_hello(self, answer: bytes) -> SimulatedHello:
        """Parse the greeting of the simulator: version, pins, carrier period and start."""
        first, *lines = answer.decode(errors="replace").strip().splitlines() or [""]
        if not first.startswith("hello "):
            self.garbage(answer)
        if first != f"hello {VERSION}":
            self.fail(f"speaks version {first[6:]} of the protocol, must be {VERSION}")
        said = dict(line.partition(" ")[::2] for line in lines)
        pins = tuple(said.get("pins", "").split())
        times = (said.get(name, "0") for name in ("period", "start"))
        period_ns, start_ns = (self._number(text.encode(), text.encode()) for text in times)
        if not 1 <= len(set(pins)) == len(pins) <= _MOST_PINS:
            self.fail(f"names {len(pins)} pins, must be 1 to {_MOST_PINS} that differ")
        if not 1_000 <= period_ns <= 1_000_000 or start_ns < 0:
            self.fail(f"has a carrier of {period_ns} ns, must be 1000 to 1000000; start {start_ns}")
        return SimulatedHello(pins, period_ns, start_ns, said.get("by", ""))


def count_of_same(line: bytes) -> int:
    """Return the number of periods that are like the last one; raise ValueError for no number."""
    count = line.removeprefix(SAME)
    if not count.isdigit():
        raise ValueError(f"{line.decode(errors='replace')!r}; behind = stands a number of periods")
    return int(count)


def _is_complete_hello(answer: bytearray) -> bool:
    """Return True if the hello is complete, or the first line is no hello."""
    return (b"\n" in answer and not answer.startswith(b"hello ")) or _is_complete_answer(answer)


def _is_complete_answer(answer: bytearray) -> bool:
    """Return True if the last line begins with a full stop and a space, and has ended."""
    if not answer.endswith(b"\n"):
        return False
    return answer.startswith(b". ", answer.rfind(b"\n", 0, -1) + 1)
