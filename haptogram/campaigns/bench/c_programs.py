"""The same in C: what the machine allows, measured beside what this program reaches.

Two small programs are compiled with the C compiler that is there, in a temporary folder.
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

_COMPILE_S: Final = 60.0
_GRACE_S: Final = 30.0

#: Absolute deadlines with clock_nanosleep, then a spin: period, ticks, spin in ns -> lateness, s64.
_LOOP: Final = r"""
#define _GNU_SOURCE
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/prctl.h>
#include <time.h>
static int64_t now(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec * 1000000000LL + t.tv_nsec;
}
int main(int argc, char **argv) {
    if (argc != 4) return 2;
    int64_t period = atoll(argv[1]), count = atoll(argv[2]), spin = atoll(argv[3]);
    int64_t *late = calloc(count, sizeof *late), n = 0;
    if (!late) return 1;
    for (int64_t i = 0; i < count; i++) late[i] = 1;  /* touch every page */
    prctl(PR_SET_TIMERSLACK, 1UL, 0, 0, 0);
    puts("ready");
    fflush(stdout);
    int64_t deadline = now() + period;
    for (; n < count; n++) {
        int64_t wake = deadline - spin;
        struct timespec t = {wake / 1000000000LL, wake % 1000000000LL};
        clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &t, NULL);
        int64_t is;
        while ((is = now()) < deadline) {}
        late[n] = is - deadline;
        deadline += period * ((is - deadline) / period + 1);
    }
    return fwrite(late, sizeof *late, n, stdout) != (size_t)n;
}
"""

#: Bytes over a raw pseudo-terminal to a child and an answer back: there, back, times -> ns, s64.
_PING_PONG: Final = r"""
#define _GNU_SOURCE
#include <fcntl.h>
#include <signal.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/wait.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>
static int64_t now(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec * 1000000000LL + t.tv_nsec;
}
static void raw(int fd) {
    struct termios t;
    tcgetattr(fd, &t);
    cfmakeraw(&t);
    tcsetattr(fd, TCSANOW, &t);
}
static int whole(int fd, char *at, int size) {
    for (int got = 0; got < size;) {
        int n = read(fd, at + got, size - got);
        if (n <= 0) return 0;
        got += n;
    }
    return 1;
}
int main(int argc, char **argv) {
    if (argc != 4) return 2;
    int there = atoi(argv[1]), back = atoi(argv[2]), count = atoi(argv[3]);
    static char bytes[4096];
    int64_t *trip = calloc(count, sizeof *trip);
    int board = posix_openpt(O_RDWR | O_NOCTTY);
    if (!trip || there > 4096 || back > 4096) return 1;
    if (board < 0 || grantpt(board) || unlockpt(board)) return 1;
    int host = open(ptsname(board), O_RDWR | O_NOCTTY);
    if (host < 0) return 1;
    raw(board);
    raw(host);
    int child = fork();
    if (!child) {
        while (whole(board, bytes, there) && write(board, bytes, back) == back) {}
        _exit(0);
    }
    for (int i = 0; i < count; i++) {
        int64_t begin = now();
        if (write(host, bytes, there) != there || !whole(host, bytes, back)) return 1;
        trip[i] = now() - begin;
    }
    kill(child, SIGKILL);
    waitpid(child, NULL, 0);
    puts("ready");
    fflush(stdout);
    return fwrite(trip, sizeof *trip, count, stdout) != (size_t)count;
}
"""


@dataclass(frozen=True, slots=True)
class CPrograms:
    """Two programs, compiled."""

    loop: Path
    ping_pong: Path

    @contextlib.contextmanager
    def running_loop(
        self, *, period_ns: int, count: int, spin_ns: int
    ) -> Iterator[list[NDArray[np.float64]]]:
        """Run the loop beside what is inside; the list holds its lateness in us afterwards."""
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

    def round_trips_us(self, *, there: int, back: int, count: int) -> NDArray[np.float64]:
        """Return (count,) round trips over a pseudo-terminal, in microseconds."""
        numbers = (there, back, count)
        done = subprocess.run(
            [self.ping_pong, *map(str, numbers)],
            stdout=subprocess.PIPE,
            timeout=_GRACE_S + count * 0.01,
            check=True,
        )
        return _microseconds(done.stdout)


@contextlib.contextmanager
def c_programs() -> Iterator[CPrograms | None]:
    """Compile the programs and remove them afterwards; None where there is no C compiler.

    Raises
    ------
    ConfigurationError
        If the compiler does not take them.
    """
    compiler = os.environ.get("CC") or shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        yield None
        return
    with tempfile.TemporaryDirectory(prefix="haptogram-") as folder:
        loop = _compiled(compiler, Path(folder), "loop", _LOOP)
        yield CPrograms(loop, _compiled(compiler, Path(folder), "ping_pong", _PING_PONG))


def _compiled(compiler: str, folder: Path, name: str, source: str) -> Path:
    text, program = folder / f"{name}.c", folder / name
    text.write_text(source)
    command = [*compiler.split(), "-O2", "-o", str(program), str(text)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=_COMPILE_S, check=False)
    if done.returncode:
        said = (done.stderr.strip().splitlines() or ["it said nothing"])[0]
        raise ConfigurationError(f"{compiler} does not compile {name}.c: {said}")
    return program


def _microseconds(data: bytes) -> NDArray[np.float64]:
    _, _, numbers = data.partition(b"\n")
    values: NDArray[np.float64] = np.frombuffer(numbers, dtype=np.int64) / 1e3
    return values
