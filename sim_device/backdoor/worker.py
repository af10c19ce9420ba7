"""Numerics and records in a process of their own, away from the path of the bytes.

The board must never wait for numerics, a disc or a reader of the back door, so on the wall clock
all three belong to a worker. In virtual time :class:`InlineReconstruction` does the same on the
spot.
"""

from __future__ import annotations

import contextlib
import dataclasses
import io
import logging
import operator
import os
import pickle
import select
import selectors
import signal
import struct
import subprocess
import sys
import time
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any, Final

import numpy as np

from haptogram.acoustics import Drive
from haptogram.acoustics.model.pulses import PulseDrive
from haptogram.errors import ConfigurationError, HaptogramError
from haptogram_protocol.messages import LatchKey

from ..board.events import AnyLatch, Latch, Notice, PulseLatch
from ..board.settings import BoardSettings
from .recorder import InlineReconstruction
from .records import backdoor_record_line
from .sinks import RecordSink, open_backdoor_sink

_LOG: Final = logging.getLogger(__name__)

QUEUE_LATCHES: Final = 16_384  # records that may wait for the worker: 16 s at 1 kHz
START_TIMEOUT_S: Final = 60.0
DRAIN_TIMEOUT_S: Final = 120.0
SKIP_FIELDS_AFTER_S: Final = 20.0  # from then on the last records come without their field
LINGER_S: Final = 5.0  # for readers of the back door to take the last records

BATCH: Final = 64  # records that are handed over at a time, unless time is up before

_LENGTH: Final = struct.Struct("<I")
_READ_BYTES: Final = 65_536
_PIPE_BYTES: Final = 1 << 20
_NICENESS: Final = 19
_LOOK_MS: Final = 20  # between two looks for the reader of a pipe
_IDLE_S: Final = 0.05  # how long a client of the back door may wait for its first line
_READY: Final = b"ready\n"
# A signal, not a record: a record would wait behind all records that are on their way.
_SKIP_FIELDS: Final = signal.SIGUSR1
_THREADS: Final = (
    "OPENBLAS_NUM_THREADS",
    "OMP_NUM_THREADS",
    "MKL_NUM_THREADS",
    "NUMBA_NUM_THREADS",
)


# --- The board's side of the worker ------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class _Job:
    """The settings that a worker is started with."""

    settings: BoardSettings
    target: str
    reconstruct: bool


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
        self._process = _start_worker_process()
        self._input.write(_packed_for_worker([_Job(settings, target, reconstruct)]))
        self._input.flush()
        self._await_ready()
        if reconstruct and find_spec("numba") is None:
            _LOG.info("fields are rebuilt without numba, several times slower")
        _widen_worker_pipe(self._input.fileno())
        os.set_blocking(self._input.fileno(), False)

    @property
    def _input(self) -> Any:  # never None: the process was started with a pipe
        return self._process.stdin

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
        self._batch = min(BATCH, len(self._waiting))
        self._unsent = _packed_for_worker([self._waiting.popleft() for _ in range(self._batch)])

    def skip_fields(self) -> None:
        """From now on write every latch down without its field, those on their way included."""
        self._process.send_signal(_SKIP_FIELDS)

    def close(self, timeout_s: float = DRAIN_TIMEOUT_S) -> None:
        """Let the worker write everything down and end; kill it if it takes too long."""
        deadline_s = time.monotonic() + timeout_s
        self._waiting.append(_End(self.dropped, self.notices_dropped))
        self._drain(min(deadline_s, time.monotonic() + SKIP_FIELDS_AFTER_S))
        if self.pending and self._alive:
            self.skip_fields()
            self._drain(deadline_s)
        self._alive = False
        for pipe in (self._input, self._process.stdout):
            _close_worker_pipe(pipe)
        try:
            self._process.wait(max(0.0, deadline_s - time.monotonic()))
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def _drain(self, deadline_s: float) -> None:
        with selectors.DefaultSelector() as selector:
            selector.register(self._input, selectors.EVENT_WRITE)
            while self.pending and self._alive and time.monotonic() < deadline_s:
                selector.select(max(0.0, deadline_s - time.monotonic()))
                self.pump()

    def _lose(self) -> None:
        """Go on without the worker, which is gone; count what it did not take."""
        self._alive = False
        self.dropped += self.pending
        self._waiting.clear()
        self._unsent, self._batch = b"", 0

    def _await_ready(self) -> None:
        answer = _read_worker_line(self._process.stdout, START_TIMEOUT_S)
        if answer == _READY:
            return
        self._process.kill()
        self._process.wait()
        for pipe in (self._input, self._process.stdout):
            _close_worker_pipe(pipe)
        if answer:
            raise ConfigurationError(answer.decode(errors="replace").strip())
        raise HaptogramError("the reconstruction worker has not started")


@dataclass(frozen=True, slots=True)
class _End:
    """Nothing more comes; so many latches and notices were dropped on the way to the worker."""

    dropped: int
    notices_dropped: int


def _start_worker_process() -> subprocess.Popen[bytes]:
    environment = {**os.environ, **dict.fromkeys(_THREADS, "1")}
    environment["PYTHONPATH"] = os.pathsep.join(path or os.getcwd() for path in sys.path)
    # Not multiprocessing: it would import the caller's main module again, and that may be anything.
    command = [
        sys.executable,
        "-P",
        "-c",
        f"from {__name__} import run_reconstruction_worker as w; w()",
    ]
    return subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=environment)


def _packed_for_worker(items: list[object]) -> bytes:
    stream = io.BytesIO(bytes(_LENGTH.size))
    stream.seek(_LENGTH.size)
    pickler = pickle.Pickler(stream, protocol=pickle.HIGHEST_PROTOCOL)
    pickler.dispatch_table = _REDUCERS
    pickler.dump(items)
    data = stream.getbuffer()
    _LENGTH.pack_into(data, 0, len(data) - _LENGTH.size)
    return bytes(data)


def _reducer_by_fields(kind: type[Any]) -> Callable[[Any], tuple[Any, ...]]:
    """Return a recipe to pickle a dataclass by its values: a third of the time of the usual one."""
    values = operator.attrgetter(*(field.name for field in dataclasses.fields(kind)))
    return lambda item: (kind, values(item))


def _drive_for_worker(drive: Drive) -> tuple[Any, ...]:
    codes = drive.phase_codes.tobytes(), drive.amplitude_codes.tobytes()
    return _drive_at_worker, (*codes, drive.phase_bits)


def _drive_at_worker(phase_codes: bytes, amplitude_codes: bytes, phase_bits: int) -> Drive:
    phases, amplitudes = (np.frombuffer(c, np.uint8) for c in (phase_codes, amplitude_codes))
    return Drive(phases, amplitudes, phase_bits)


_REDUCERS: Final[dict[type[Any], Callable[[Any], tuple[Any, ...]]]] = {
    Drive: _drive_for_worker,
    Latch: _reducer_by_fields(Latch),
    PulseLatch: _reducer_by_fields(PulseLatch),
    PulseDrive: _reducer_by_fields(PulseDrive),
    LatchKey: _reducer_by_fields(LatchKey),
}


def _widen_worker_pipe(pipe: int) -> None:
    """Make a pipe hold more, where the system can: every refused write costs a wake-up."""
    if sys.platform == "linux":
        with contextlib.suppress(OSError, ImportError):  # 64 KiB, the usual size, will do
            import fcntl

            fcntl.fcntl(pipe, fcntl.F_SETPIPE_SZ, _PIPE_BYTES)


def _read_worker_line(pipe: Any, timeout_s: float) -> bytes:
    """Return the bytes up to the first line feed, the end or the timeout."""
    line, deadline_s = b"", time.monotonic() + timeout_s
    with selectors.DefaultSelector() as selector:
        selector.register(pipe, selectors.EVENT_READ)
        while not line.endswith(b"\n"):
            if not selector.select(max(0.0, deadline_s - time.monotonic())):
                break
            piece = os.read(pipe.fileno(), 4096)
            if not piece:
                break
            line += piece
    return line


def _close_worker_pipe(pipe: Any) -> None:
    with contextlib.suppress(OSError):  # the worker closed its end first
        pipe.close()


# --- The worker's side -------------------------------------------------------------------------


def run_reconstruction_worker() -> None:
    """Be the worker: read from standard input until it ends, write the records."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)  # the board ends the worker, by closing its input
    with contextlib.suppress(OSError):  # the field can wait, the board and its host cannot
        os.nice(_NICENESS)
    signal.signal(_SKIP_FIELDS, signal.SIG_IGN)  # until there is something to leave out
    items = _items_at_worker(_READ_BYTES)
    job = next((item for item in items if item is not None), None)
    if job is None:
        return  # the board has ended before it began
    try:
        sink = open_backdoor_sink(job.target, _is_board_of_worker_there)
    except ConfigurationError as error:
        _answer_of_worker(1, f"{error}\n".encode())
        return
    answer = 1  # the board reads this until it has heard that all is ready
    try:
        recorder = InlineReconstruction(
            job.settings,
            lambda record: sink.write(backdoor_record_line(record)),
            reconstruct=job.reconstruct,
        )
        recorder.warm_up()
        signal.signal(_SKIP_FIELDS, lambda *_: recorder.skip_fields())
        _answer_of_worker(answer, _READY)
        answer = 2
        _record_all_at_worker(items, recorder, sink)
        _linger_at_sink(sink)
    except HaptogramError as error:  # the disc is full: the board goes on, and counts what it lost
        _answer_of_worker(answer, f"{error}\n".encode())
    finally:
        sink.close()


def _is_board_of_worker_there() -> bool:
    """Wait a moment; return False once the board has closed its end of the input, or has died."""
    input_end = select.poll()
    input_end.register(0, 0)
    return not input_end.poll(_LOOK_MS)


def _answer_of_worker(to: int, text: bytes) -> None:
    """Tell the board *text*; a board that was ended in the meantime has closed the pipe."""
    with contextlib.suppress(BrokenPipeError):
        os.write(to, text)


def _record_all_at_worker(
    items: Iterator[Any], recorder: InlineReconstruction, sink: RecordSink
) -> None:
    for item in items:
        if isinstance(item, Latch | PulseLatch):
            recorder.latch(item)
        elif isinstance(item, _End):
            recorder.finish(dropped=item.dropped, notices_dropped=item.notices_dropped)
            return
        elif item is not None:
            recorder.notice(item)
        sink.serve()
    recorder.finish(clean=False)  # the board ended without saying so


def _linger_at_sink(sink: RecordSink) -> None:
    """Let slow readers take the last records."""
    deadline_s = time.monotonic() + LINGER_S
    while sink.pending and time.monotonic() < deadline_s:
        time.sleep(_IDLE_S)
        sink.serve()


def _items_at_worker(chunk: int) -> Iterator[Any]:
    """Yield the items of the board, None now and then while it is silent; end when it ends."""
    buffer = bytearray()
    with selectors.DefaultSelector() as selector:
        selector.register(0, selectors.EVENT_READ)
        while True:
            if not selector.select(_IDLE_S):
                yield None
                continue
            data = os.read(0, chunk)
            if not data:
                return
            buffer += data
            yield from _unpacked_at_worker(buffer)


def _unpacked_at_worker(buffer: bytearray) -> Iterator[Any]:
    """Yield the whole items at the front of *buffer*, and take them off it."""
    size = _LENGTH.size
    while len(buffer) >= size:
        (length,) = _LENGTH.unpack_from(buffer)
        if len(buffer) < size + length:
            return
        batch = bytes(buffer[size : size + length])
        del buffer[: size + length]
        yield from pickle.loads(batch)
