"""The process of a worker: reads the batches of its board, rebuilds fields, writes the records."""

from __future__ import annotations

import contextlib
import itertools
import os
import select
import selectors
import signal
import time
from collections.abc import Iterator
from typing import Any, Final

from haptogram.errors import ConfigurationError, HaptogramError

from ..board.events import Latch, PulseLatch
from .recorder import InlineReconstructionWorker
from .records import backdoor_record_line
from .sinks import FileSink, SocketSink, open_backdoor_sink
from .worker import READY, SKIP_FIELDS, RecordsEnd, unpacked_worker_batches

LINGER_S: Final = 5.0  # time for readers of the back door to take the last records
_READ_BYTES: Final = 65_536
_NICENESS: Final = 10  # a 40th of a core beside eight busy processes; 19 would be a 270th
_LOOK_MS: Final = 20  # time between two looks for the reader of a pipe
_IDLE_S: Final = 0.05  # how long a client of the back door may wait for its first line
_SEARCHES: Final = 16  # drives without a focus while records wait: each takes some 40 ms


def run_reconstruction_worker() -> None:
    """Be the worker: read from standard input until it ends, write the records."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)  # the board ends the worker, by closing its input
    signal.signal(SKIP_FIELDS, signal.SIG_IGN)  # until there is something to leave out
    batches = _received_batches(_READ_BYTES)
    job = next((item for batch in batches for item in batch), None)
    if job is None or not _is_board_alive():
        return  # the board has ended before it began
    try:
        sink = open_backdoor_sink(job.target, _is_board_alive)
    except ConfigurationError as error:
        _send_to_board(1, f"{error}\n".encode())
        return
    is_ready = False
    try:
        recorder = InlineReconstructionWorker(
            job.settings,
            lambda record: sink.write(backdoor_record_line(record)),
            reconstruct=job.reconstruct,
        )
        recorder.warm_up()
        recorder.limit_searches(_SEARCHES)
        signal.signal(SKIP_FIELDS, lambda *_: recorder.skip_fields())
        _send_to_board(1, READY)
        is_ready = True
        with contextlib.suppress(OSError):  # from here the board and its host come first
            os.nice(_NICENESS)
        _record_batches(batches, recorder, sink)
        _drain_sink(sink)
    except HaptogramError as error:  # the disc is full: the board goes on, and counts what it lost
        text = f"{error}\n".encode()
        _send_to_board(1, text)  # for the end of the board, or instead of READY
        if is_ready:
            _send_to_board(2, text)  # at once
    finally:
        sink.close()


def _is_board_alive() -> bool:
    """Wait up to 20 ms for the end of the pipe from the board; return False if it has ended."""
    input_end = select.poll()
    input_end.register(0, 0)
    return not input_end.poll(_LOOK_MS)


def _send_to_board(to: int, text: bytes) -> None:
    """Send *text* to the board through the file descriptor *to*; ignore a closed pipe."""
    with contextlib.suppress(BrokenPipeError):
        os.write(to, text)


def _record_batches(
    batches: Iterator[list[Any]], recorder: InlineReconstructionWorker, sink: FileSink | SocketSink
) -> None:
    """Write all records to the sink, latches in a row together; note if the board never ended."""
    for batch in batches:
        if not batch:  # no record waits
            recorder.limit_searches(_SEARCHES)
        for kind, items in itertools.groupby(batch, type):
            if kind is Latch:
                sink.write(recorder.lines_of_latches(list(items)))
                continue
            for item in items:
                if isinstance(item, RecordsEnd):
                    recorder.finish(dropped=item.dropped, notices_dropped=item.notices_dropped)
                    return
                record = recorder.latch if kind is PulseLatch else recorder.notice
                record(item)
        sink.serve()
    recorder.finish(clean=False)  # the board ended without saying so


def _drain_sink(sink: FileSink | SocketSink) -> None:
    """Serve slow readers until their records are sent, or 5 s have passed."""
    deadline_s = time.monotonic() + LINGER_S
    while sink.pending and time.monotonic() < deadline_s:
        time.sleep(_IDLE_S)
        sink.serve()


def _received_batches(chunk: int) -> Iterator[list[Any]]:
    """Yield batches from the board, an empty one whenever none waits; end when the board ends."""
    buffer = bytearray()
    with selectors.DefaultSelector() as selector:
        selector.register(0, selectors.EVENT_READ)
        while True:
            if not selector.select(0):
                yield []
                if not selector.select(_IDLE_S):
                    continue
            data = os.read(0, chunk)
            if not data:
                return
            buffer += data
            yield from unpacked_worker_batches(buffer)
