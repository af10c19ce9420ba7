"""A board in virtual time as a process: each line of its input is a step, each line out its answer.

::

    rx TIME HEX   bytes whose last one is complete TIME microseconds after power-up
    at TIME       time passes
    until TIME    time passes until the board sends something, at most up to TIME
    through TIME  time passes, and what the board sends is read at once: the model only
    fault TIME    the hardware fails
    mute TIME     an interrupt has found a MUTE, whose bytes come with a later rx
    reset         power down and up again

The answer holds the bytes that the board sent in hex, ``-`` for none; that of ``until`` begins with
the time.  ``protocol/c/tools/board_steps.c`` is such a process.  Bytes take no time on their way.
The model takes several steps in one line, with ``;`` between them, and so answers them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

from haptogram.errors import LinkLostError
from haptogram.machine.line_process import LineProcess

_LONGEST_RX: Final = 16_384  # bytes in one step


class LockstepProcess:
    """A process that answers steps.

    Parameters
    ----------
    command : sequence of str
        Program and arguments.
    failure : callable
        Makes the exception that a step raises from its text.

    Raises
    ------
    LinkLostError
        Or what *failure* makes: from every step, if the process has ended or does not answer
        within 20 s.
    """

    def __init__(
        self, command: Sequence[str], failure: Callable[[str], Exception] = LinkLostError
    ) -> None:
        self._process = LineProcess(command, failure=failure)
        self.close = self._process.close

    @property
    def runs(self) -> bool:
        """True while the process answers."""
        return self._process.runs

    def receive(self, at_us: int, data: bytes) -> bytes:
        """Let *data* arrive; return the bytes that the board sent."""
        return b"".join(bytes_of_step(self.step(step)) for step in steps_of_bytes(at_us, data))

    def advance(self, at_us: int) -> bytes:
        """Let time pass; return the bytes that the board sent."""
        return bytes_of_step(self.step(f"at {at_us}"))

    def advance_until_sent(self, limit_us: int) -> tuple[int, bytes]:
        """Let time pass until the board sends something; return the time and the bytes."""
        at_us, sent = self.step(f"until {limit_us}").split()
        return int(at_us), bytes_of_step(sent)

    def fault(self, at_us: int) -> bytes:
        """Let the hardware of the board fail; return the bytes that the board sent."""
        return bytes_of_step(self.step(f"fault {at_us}"))

    def find_mute(self, at_us: int, count: int) -> bytes:
        """Let an interrupt find a MUTE, the last of *count* bytes to come; return what was sent."""
        return bytes_of_step(self.step(f"mute {at_us} {count}"))

    def reset(self) -> None:
        """Switch the board off and on; its time begins at 0 again."""
        self.step("reset")

    def step(self, line: str) -> str:
        """Send one line and return the answer."""
        answer = self._process.ask(f"{line}\n".encode(), lambda text: text.endswith(b"\n"))
        return answer.decode().strip()


def steps_of_bytes(at_us: int, data: bytes) -> list[str]:
    """Return the steps by which *data* arrive."""
    parts = range(0, len(data), _LONGEST_RX)
    return [f"rx {at_us} {data[start : start + _LONGEST_RX].hex()}" for start in parts]


def bytes_of_step(answer: str) -> bytes:
    """Return the bytes that the board has sent in a step."""
    return b"" if answer == "-" else bytes.fromhex(answer)
