"""The control loop and the round trip in C, which show what the machine itself allows.

The C compiler of the machine builds both programs in a temporary folder.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from haptogram.errors import ConfigurationError

_SOURCES: Final = Path(__file__).parent
_COMPILE_S: Final = 60.0
_GRACE_S: Final = 30.0


@dataclass(frozen=True, slots=True)
class CPrograms:
    """The compiled programs ``loop.c`` and ``ping_pong.c``."""

    loop: Path
    ping_pong: Path

    @contextlib.contextmanager
    def running_loop(
        self, *, period_ns: int, count: int, spin_ns: int
    ) -> Iterator[list[NDArray[np.float64]]]:
        """Run the loop beside the body; the list then holds the (count,) lateness in us."""
        numbers = (period_ns, count, spin_ns)
        process = subprocess.Popen([self.loop, *map(str, numbers)], stdout=subprocess.PIPE)
        found: list[NDArray[np.float64]] = []
        try:
            yield found
            data, _ = process.communicate(timeout=count * period_ns / 1e9 + _GRACE_S)
            found.append(_microseconds(data))
        finally:
            process.kill()
            process.wait()

    def round_trips_us(
        self, *, there: int, back: int, count: int, period_ns: int = 0
    ) -> NDArray[np.float64]:
        """Return (count,) round trips over a pseudo-terminal, in microseconds.

        With a period: the times from each deadline to the last byte at the other end.
        """
        numbers = (there, back, count, period_ns)
        done = subprocess.run(
            [self.ping_pong, *map(str, numbers)],
            stdout=subprocess.PIPE,
            timeout=_GRACE_S + count * (0.01 + period_ns / 1e9),
            check=True,
        )
        return _microseconds(done.stdout)


@contextlib.contextmanager
def c_programs() -> Iterator[CPrograms | None]:
    """Compile the programs and remove them afterwards; yield None where there is no C compiler.

    Raises
    ------
    ConfigurationError
        If the compiler refuses a program.
    """
    compiler = os.environ.get("CC") or shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        yield None
        return
    with tempfile.TemporaryDirectory(prefix="haptogram-") as folder:
        loop = _compiled(compiler, Path(folder), "loop")
        yield CPrograms(loop, _compiled(compiler, Path(folder), "ping_pong"))


def _compiled(compiler: str, folder: Path, name: str) -> Path:
    program = folder / name
    command = [*compiler.split(), "-O2", "-o", str(program), str(_SOURCES / f"{name}.c")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=_COMPILE_S, check=False)
    if done.returncode:
        said = (done.stderr.strip().splitlines() or ["no message"])[0]
        raise ConfigurationError(
            f"{compiler} does not compile {name}.c: {said}; name another compiler with CC"
        )
    return program


def _microseconds(data: bytes) -> NDArray[np.float64]:
    _, _, numbers = data.partition(b"\n")
    values: NDArray[np.float64] = np.frombuffer(numbers, dtype=np.int64) / 1e3
    return values
