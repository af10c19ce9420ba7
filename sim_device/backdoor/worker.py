"""Numerics and records in a process of their own, away from the path of the bytes.

The board must never wait for numerics, a disc or a reader of the back door, so on the wall clock
all three belong to a worker. In virtual time :class:`InlineReconstructionWorker` does the same
on the spot.
"""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import io
import logging
import operator
import os
import pickle
import selectors
import signal
import struct
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any, Final

from haptogram.acoustics import Drive
from haptogram.acoustics.model.pulses import PulseDrive
from haptogram.errors import ConfigurationError, HaptogramError
from haptogram_protocol.messages import LatchKey

from ..board.events import AnyLatch, Latch, Notice, PulseLatch
from ..board.settings import BoardSettings

_LOG: Final = logging.getLogger(__name__)

QUEUE_LATCHES: Final = 16_384  # records that may wait for the worker: 16 s at 1 kHz
START_TIMEOUT_S: Final = 600.0  # the worker may compile, on a busy machine
STOP_TIMEOUT_S: Final = 8.0  # wait for a worker that has not begun: it may be compiling
DRAIN_TIMEOUT_S: Final = 120.0
SKIP_FIELDS_AFTER_S: Final = 20.0  # time after which the last records have no field

_KEPT_DRIVES: Final = 4096  # drives that the worker keeps, such as those of a sequence
BATCH: Final = 64  # records that are handed over at a time, unless time is up before

_PROCESS: Final = f"{__package__}.worker_process"
_PIPE_BYTES: Final = 1 << 20
_THREADS: Final = (
    "OPENBLAS_NUM_THREADS",
    "OMP_NUM_THREADS",
    "MKL_NUM_THREADS",
    "NUMBA_NUM_THREADS",
)
READY: Final = b"ready\n"  # the worker's answer to its job
# A signal, not a record: a record would wait after all records that are on their way.
SKIP_FIELDS: Final = signal.SIGUSR1
_LENGTH: Final = struct.Struct("<I")


class ReconstructionWorker:
    """A recorder that hands everything to a process of its own, and never waits for it.

    Up to :data:`QUEUE_LATCHES` records wait; a latch that finds no room is counted in ``dropped``.
    They are handed over many at a time, because each time wakes the worker up, maybe on the board's
    own processor: whenever :data:`BATCH` of them wait, and by :meth:`pump`, which whoever runs the
    board calls every so often.  The worker ends when its input does, so it cannot outlive the
    board, however that ends.

    Parameters
    ----------
    settings : BoardSettings
        The board.
    target : str
        Where the records go, see :func:`~sim_device.backdoor.sinks.open_backdoor_sink`.
    reconstruct : bool, keyword-only
        Whether the field is rebuilt.

    Raises
    ------
    ConfigurationError
        If the worker cannot write to *target*.
    HaptogramError
        If it does not start.
    """

    def __init__(self, settings: BoardSettings, target: str, *, reconstruct: bool = True) -> None:
        self.dropped = self.notices_dropped = 0
        self._waiting: deque[object] = deque()
        self._unsent = b""  # the rest of a batch
        self._batch = 0  # records in it
        self._alive = True
        self._failure = ""
        self._process = _start_worker_process()
        try:
            self._input.write(packed_worker_batch([WorkerJob(settings, target, reconstruct)]))
            self._input.flush()
            self._await_ready()
        except BaseException:
            self._await_exit(STOP_TIMEOUT_S)
            self._answers.close()
            raise
        if reconstruct and find_spec("numba") is None:
            _LOG.info("fields are rebuilt without numba, several times slower")
        _widen_worker_pipe(self._input.fileno())
        os.set_blocking(self._input.fileno(), False)

    @property
    def _input(self) -> Any:  # never None: the process was started with a pipe
        """Return the pipe to the worker."""
        return self._process.stdin

    @property
    def _answers(self) -> Any:
        """Return the pipe from the worker."""
        return self._process.stdout

    @property
    def pending(self) -> int:
        """Records that wait for the worker."""
        return len(self._waiting) + self._batch

    @property
    def is_refusing(self) -> bool:
        """True if the worker has refused a part of its input."""
        return bool(self._unsent)

    def fileno(self) -> int:
        """Return the file descriptor that is writable when :meth:`pump` can go on."""
        return int(self._input.fileno())

    def latch(self, latch: AnyLatch) -> None:
        """Take down a latch, or count it as dropped."""
        if not self._alive or self.pending >= QUEUE_LATCHES:
            self.dropped += 1
        else:
            self._queue(latch)

    def notice(self, notice: Notice) -> None:
        """Take down a change of the output; these have a quarter more room than latches."""
        if not self._alive or self.pending >= QUEUE_LATCHES + QUEUE_LATCHES // 4:
            self.notices_dropped += 1
        else:
            self._queue(notice)

    def _queue(self, item: object) -> None:
        """Queue a record; once 64 wait send them, unless the pipe to the worker is full."""
        self._waiting.append(item)
        if len(self._waiting) >= BATCH and not self.is_refusing:
            self.pump()

    def pump(self) -> None:
        """Hand over what the worker takes now."""
        while self.pending and self._alive:
            if not self._unsent:
                self._pack_batch()
            try:
                sent = os.write(self.fileno(), self._unsent)
            except BlockingIOError:
                return
            except OSError:
                self._lose()
                return
            self._unsent = self._unsent[sent:]
            if self._unsent:
                return
            self._batch = 0

    def _pack_batch(self) -> None:
        """Take up to 64 waiting records, and pack them for the pipe."""
        self._batch = min(BATCH, len(self._waiting))
        self._unsent = packed_worker_batch([self._waiting.popleft() for _ in range(self._batch)])

    def skip_fields(self) -> None:
        """From now on write every latch down without its field, those on their way included."""
        self._process.send_signal(SKIP_FIELDS)

    def close(self, timeout_s: float = DRAIN_TIMEOUT_S) -> str:
        """Let the worker write everything down and end; kill it if it takes too long.

        Returns
        -------
        str
            Why the records ended early, in one line; empty if nothing stopped them.
        """
        deadline_s = time.monotonic() + timeout_s
        skip_s = min(deadline_s, time.monotonic() + SKIP_FIELDS_AFTER_S)
        self._waiting.append(RecordsEnd(self.dropped, self.notices_dropped))
        self._drain(skip_s)
        # What is handed over may still take the worker minutes.
        if self._alive and (self.pending or not self._has_ended(skip_s)):
            self.skip_fields()
            self._drain(deadline_s)
        self._alive = False
        self._await_exit(max(0.0, deadline_s - time.monotonic()))
        if not self._answers.closed:
            self._failure = self._answers.readline().decode(errors="replace").strip()
            self._answers.close()
        if self.dropped:
            _LOG.warning("the back door lacks %d latches", self.dropped)
        return self._failure

    def _drain(self, deadline_s: float) -> None:
        """Send queued records until *deadline_s*, a time of time.monotonic()."""
        with selectors.DefaultSelector() as selector:
            selector.register(self._input, selectors.EVENT_WRITE)
            while self.pending and self._alive and time.monotonic() < deadline_s:
                selector.select(max(0.0, deadline_s - time.monotonic()))
                self.pump()

    def _lose(self) -> None:
        """Discard the dead worker; count its unprocessed records as dropped."""
        self._alive = False
        self.dropped += self.pending
        self._waiting.clear()
        self._unsent, self._batch = b"", 0

    def _await_ready(self) -> None:
        """Wait until the worker is ready; kill it after 600 s, raise if it is not."""
        killing = threading.Timer(START_TIMEOUT_S, self._process.kill)
        killing.start()
        try:
            answer = self._answers.readline()
        finally:
            killing.cancel()
        if not answer:
            raise HaptogramError("the reconstruction worker has not started")
        if answer != READY:
            raise ConfigurationError(answer.decode(errors="replace").strip())

    def _has_ended(self, deadline_s: float) -> bool:
        """Return True if the worker, which has everything, ends before the deadline."""
        try:
            self._process.wait(max(0.0, deadline_s - time.monotonic()))
        except subprocess.TimeoutExpired:
            return False
        return True

    def _await_exit(self, timeout_s: float) -> None:
        """Close the pipe to the worker and wait for its end, lest it write late.

        It is killed after *timeout_s*.
        """
        with contextlib.suppress(OSError):  # the worker closed its end first
            self._input.close()
        try:
            self._process.wait(timeout_s)
        except subprocess.TimeoutExpired:
            _LOG.warning("the back door lacks its last records: no time is left for them")
            self._process.kill()
            self._process.wait()


def _start_worker_process() -> subprocess.Popen[bytes]:
    """Start the worker as a process of its own, with one thread for numpy."""
    environment = {**os.environ, **dict.fromkeys(_THREADS, "1")}
    environment["PYTHONPATH"] = os.pathsep.join(path or os.getcwd() for path in sys.path)
    # Not multiprocessing: it would import the caller's main module again, and that may be anything.
    command = [
        sys.executable,
        "-P",
        "-c",
        f"from {_PROCESS} import run_reconstruction_worker as w; w()",
    ]
    return subprocess.Popen(
        command,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        env=environment,
        start_new_session=True,  # a terminal's Ctrl-C and its end are for the board
    )


def _widen_worker_pipe(pipe: int) -> None:
    """Enlarge a pipe where the system can, to avoid writes that block."""
    if sys.platform == "linux":
        with contextlib.suppress(OSError, ImportError):  # 64 KiB, the usual size, will do
            import fcntl

            fcntl.fcntl(pipe, fcntl.F_SETPIPE_SZ, _PIPE_BYTES)


@dataclass(frozen=True, slots=True)
class WorkerJob:
    """The settings that a worker is started with."""

    settings: BoardSettings
    target: str
    reconstruct: bool


@dataclass(frozen=True, slots=True)
class RecordsEnd:
    """Nothing more comes; so many latches and notices were dropped on the way to the worker."""

    dropped: int
    notices_dropped: int


def packed_worker_batch(items: list[object]) -> bytes:
    """Return *items* as bytes for the pipe."""
    stream = io.BytesIO()
    pickler = pickle.Pickler(stream, protocol=pickle.HIGHEST_PROTOCOL)
    pickler.dispatch_table = _REDUCERS
    pickler.dump(items)
    data = stream.getvalue()
    return _LENGTH.pack(len(data)) + data


def _worker_reducer_by_fields(kind: type[Any]) -> Callable[[Any], tuple[Any, ...]]:
    """Return a function that pickles a dataclass by its fields' values, thrice as fast."""
    values = operator.attrgetter(*(field.name for field in dataclasses.fields(kind)))
    return lambda item: (kind, values(item))


@functools.lru_cache(maxsize=_KEPT_DRIVES)
def _drive_at_worker(phases: bytes, amplitudes: bytes, phase_bits: int) -> Drive:
    """Return the drive of these codes, as the worker unpickles it."""
    return Drive.from_bytes(phases, amplitudes, phase_bits)


def _drive_for_worker(drive: Drive) -> tuple[Any, ...]:
    """Return how to pickle a drive: as a call of _drive_at_worker with its codes."""
    codes = drive.phase_bytes, drive.amplitude_codes.tobytes()
    return _drive_at_worker, (*codes, drive.phase_bits)


_REDUCERS: Final[dict[type[Any], Callable[[Any], tuple[Any, ...]]]] = {
    Drive: _drive_for_worker,
    Latch: _worker_reducer_by_fields(Latch),
    PulseLatch: _worker_reducer_by_fields(PulseLatch),
    PulseDrive: _worker_reducer_by_fields(PulseDrive),
    LatchKey: _worker_reducer_by_fields(LatchKey),
}


def unpacked_worker_batches(buffer: bytearray) -> Iterator[list[Any]]:
    """Yield the whole batches at the front of *buffer*, and take them off it."""
    size = _LENGTH.size
    while len(buffer) >= size:
        (length,) = _LENGTH.unpack_from(buffer)
        if len(buffer) < size + length:
            return
        batch = bytes(buffer[size : size + length])
        del buffer[: size + length]
        yield pickle.loads(batch)
