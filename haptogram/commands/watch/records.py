"""Records of the board that is watched: of one that runs, of one that is started, of bytes."""

from __future__ import annotations

import argparse
import contextlib
import os
import sys
import time
from collections import deque
from collections.abc import Callable, Generator, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypeAlias

from haptogram.errors import ConfigurationError, reading_file
from haptogram.machine.interrupts import DelayedInterrupts
from haptogram.settings.board import BOARD_OPTIONS, BoardConfig
from haptogram.settings.command_line import given_options, written_options

from .expected import WATCHED_BOARD_OPTIONS

if TYPE_CHECKING:
    from haptogram.evidence.backdoor import BackdoorReader

Record: TypeAlias = dict[str, Any]
#: Plays the bytes of a client to a virtual board; returns the records of its back door.
Replay: TypeAlias = Callable[[BoardConfig, bytes], list[Record]]

_PERIOD_S: Final = 0.05
_PATIENCE_S: Final = 5.0
_LOOKED_AT: Final = 1 << 16  # bytes of a file that say what it holds
_MOST_BYTES: Final = 1 << 26  # of a client; some minutes at the fastest line, 12 Mbaud


def is_watched_latch(record: Record) -> bool:
    """Return True if *record* is that of a latch."""
    return record["kind"] in ("pulses", "latch", "pins")


class WatchedRecords:
    """Records in their order; an interrupt loses none.

    Parameters
    ----------
    source : str
        Where they come from, for an error.
    read : callable
        Returns the records that came since the last call; None: no more will come.
    end : callable, optional
        Asks the board to end; by default the board is somebody else's, and goes on.

    Raises
    ------
    ConfigurationError
        No record comes at all.
    """

    def __init__(
        self,
        source: str,
        read: Callable[[], list[Record] | None],
        end: Callable[[], None] | None = None,
    ) -> None:
        self._source, self._read, self._end = source, read, end
        self._interrupts = DelayedInterrupts()
        self._come: deque[Record] = deque()
        self._is_ending = False
        self._patient_until_s: float | None = time.monotonic() + _PATIENCE_S
        self._interrupts.install()

    def close(self) -> None:
        """Hear interrupts as before."""
        self._interrupts.remove()

    def end(self) -> None:
        """Let the records come to an end: with the board, or with what has come by now."""
        self._is_ending = True
        if self._end is not None:
            self._end()

    def __iter__(self) -> Generator[Record, None, None]:
        """Yield the records as they come; an interrupt is heard when one has been looked at."""
        while True:
            while not self._come:
                with self._interrupts:
                    records = self._read()
                    self._come.extend(records or ())
                if not self._come and self._is_over(records):
                    return
            self._patient_until_s = None
            with self._interrupts:
                yield self._come.popleft()

    @property
    def latches_left(self) -> int:
        """Latches that have come and were not looked at."""
        return sum(map(is_watched_latch, self._come))

    def _is_over(self, records: list[Record] | None) -> bool:
        """Return True if the source has ended; else wait 50 ms and return False.

        *records* None: no more will come. ConfigurationError if it ends, or 5 s pass, without any
        record.
        """
        until_s = self._patient_until_s
        is_late = until_s is not None and time.monotonic() > until_s
        if until_s is not None and (records is None or is_late):
            raise ConfigurationError(f"{self._source}: no record of a back door came")
        if records is None or (self._is_ending and self._end is None):
            return True
        time.sleep(_PERIOD_S)
        return False


@contextlib.contextmanager
def open_watched_records(arguments: argparse.Namespace, replay: Replay) -> Iterator[WatchedRecords]:
    """Open what the command watches; see :class:`WatchedRecords`."""
    from haptogram.evidence.backdoor import BackdoorReader

    with contextlib.ExitStack() as parts:
        if arguments.capture is not None:
            found = _captured_to_watch(arguments, replay)
        elif arguments.source is None:
            found = parts.enter_context(_started_watched_board(arguments))
        elif arguments.dialect is not None:
            found = _watched_list(
                replay(_watched_board_settings(arguments), _read_watched_bytes(arguments.source))
            )
        else:
            _refuse_watched_client_bytes(arguments.source)
            stream = parts.enter_context(BackdoorReader(arguments.source))
            found = WatchedRecords(arguments.source, reader_of_watched(stream))
        parts.callback(found.close)
        yield found


def reader_of_watched(
    stream: BackdoorReader, is_running: Callable[[], bool] = lambda: True
) -> Callable[[], list[Record] | None]:
    """Return a function that reads the records of a back door as they come, until it is closed."""

    def read() -> list[Record] | None:
        running = is_running()  # before the read: a board that ends writes its last records first
        records = stream.read()
        return records if records or (stream.is_open and running) else None

    return read


def _captured_to_watch(arguments: argparse.Namespace, replay: Replay) -> WatchedRecords:
    """Return the latches in a capture of the pins, as records to watch.

    *replay* gives the board that the options assume, whose array is taken.
    """
    from haptogram.evidence.captures.channel_map import ChannelMap
    from haptogram.evidence.captures.files import read_capture
    from haptogram.evidence.captures.pin_record import pin_record_of_capture
    from haptogram.evidence.dialects.watched_board import records_of_held_drives
    from haptogram.verification.pins.held.drives import held_pin_drives

    mapped = ChannelMap.from_file(arguments.channels, "channels")
    held = held_pin_drives(pin_record_of_capture(read_capture(arguments.capture), mapped))
    board = replay(_watched_board_settings(arguments), b"")[0]
    return _watched_list(records_of_held_drives(held, board))


def _watched_list(records: list[Record]) -> WatchedRecords:
    """Return a source that yields the given records once."""
    parts = [records]
    return WatchedRecords("bytes", lambda: parts.pop() if parts else None, lambda: None)


def _watched_board_settings(arguments: argparse.Namespace) -> BoardConfig:
    """Return the settings of the board that watch starts or assumes."""
    return BoardConfig.of(**given_options(arguments, WATCHED_BOARD_OPTIONS))


def _read_watched_bytes(source: str) -> bytes:
    """Return the client's bytes in a file; ConfigurationError if more than a run of minutes has."""
    with reading_file(source), Path(source).open("rb") as file:
        data = file.read(_MOST_BYTES + 1)
    if len(data) > _MOST_BYTES:
        raise ConfigurationError(
            f"{source}: has more than {_MOST_BYTES} bytes, the most that are watched at a time; "
            f"cut it: head -c {_MOST_BYTES}"
        )
    return data


def _refuse_watched_client_bytes(source: str) -> None:
    """Raise ConfigurationError if *source* is a file of client bytes; name the likely --dialect.

    A back door, an empty file and what is no file are let pass.
    """
    from haptogram_protocol.dialects.looks_like import looks_like_dialect

    path = Path(source)
    if not path.is_file():
        return
    with reading_file(source), path.open("rb") as file:
        data = file.read(_LOOKED_AT)
    if not data or data.lstrip().startswith(b"{"):
        return
    names = looks_like_dialect(data)
    like = f"its bytes look like {' or '.join(names)}" if names else "they may be those of a client"
    which = names[0] if names else "NAME"
    raise ConfigurationError(
        f"{source}: holds no records of a back door; {like}: add --dialect {which}"
    )


@contextlib.contextmanager
def _started_watched_board(arguments: argparse.Namespace) -> Iterator[WatchedRecords]:
    """Start a board, at --link or with the program of --as-device, and end it with the watch.

    Yields its records; with --as-device, what the program printed is shown at the end.
    """
    from haptogram.evidence.backdoor import BackdoorReader
    from haptogram.evidence.board_process import BoardProcess
    from haptogram.machine.working_folder import WorkingFolder

    values = _watched_board_settings(arguments).non_default()
    folder = WorkingFolder("haptogram-watch-")
    try:
        # A pipe takes what is read, and no more: a file would grow as long as somebody watches.
        backdoor = folder.path / "backdoor"
        os.mkfifo(backdoor)
        where = ["--as-device"] if arguments.as_device else [f"--link={arguments.link}"]
        client = ["--", *arguments.client] if arguments.as_device else []
        words = [*where, f"--backdoor={backdoor}", "--no-reconstruct"]
        with contextlib.ExitStack() as parts:
            process = BoardProcess(
                [*words, *written_options(values, BOARD_OPTIONS), *client], folder.path / "log"
            )
            parts.callback(process.close_pipe)
            parts.callback(process.stop)
            # Opened before the board writes, closed before it ends: neither waits for the other.
            stream = parts.enter_context(BackdoorReader(str(backdoor)))
            process.wait_until_ready()
            at = arguments.link or arguments.client[0]
            print(f"{arguments.dialect} board at {at}", file=sys.stderr, flush=True)
            read = reader_of_watched(stream, process.is_running)
            yield WatchedRecords(at, read, process.terminate)
            if arguments.as_device and (log := process.log().partition("\n")[2]):
                print(log, end="", file=sys.stderr)  # what the program said
    finally:
        folder.remove()
