"""Captures of drive pins that a command judges by: waiting for their files, and reading them."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Final, TypeVar

from haptogram.errors import ConfigurationError
from haptogram.settings.arguments import Progress

from .output_files import print_command_error

if TYPE_CHECKING:
    from haptogram.evidence.captures.channel_map import ChannelMap
    from haptogram.records.pins import PinRecord
    from haptogram.settings.run.files import CaptureConfig

_Verdict = TypeVar("_Verdict")
_PATIENCE_S: Final = 120.0  # wait after a run for an analyser that still writes
_QUIET_S: Final = 1.0  # time without a change after which a file is complete
_POLL_S: Final = 0.1


def read_channel_maps(config: CaptureConfig) -> list[ChannelMap]:
    """Return the maps of the channels of all captures; none is read without a map.

    Raises
    ------
    ConfigurationError
        A map that cannot be read.
    """
    from haptogram.evidence.captures.channel_map import ChannelMap

    return [ChannelMap.from_file(path, "channels") for path in config.channels]


def read_capture_arguments(
    config: CaptureConfig, progress: Progress | None = None
) -> list[PinRecord]:
    """Return the pins of all captures; *progress* gets the number read, and the total.

    Raises
    ------
    ConfigurationError
        A capture or a map that cannot be read, or that do not suit each other.
    """
    from haptogram.evidence.captures.files import read_capture
    from haptogram.evidence.captures.pin_record import pin_record_of_capture

    maps = read_channel_maps(config)
    every = maps * len(config.capture) if len(maps) == 1 else maps
    records: list[PinRecord] = []
    for path, mapped in zip(config.capture, every, strict=True):
        if progress is not None:
            progress(len(records), len(every))
        records.append(pin_record_of_capture(read_capture(path), mapped))
    return records


def judge_captures_at_port(
    program: str,
    config: CaptureConfig,
    since_s: float,
    judge: Callable[[], _Verdict],
    *,
    interrupted: bool,
) -> _Verdict | None:
    """Wait for the captures of a run that began at *since_s*; return what *judge* makes of them.

    None: a capture did not come, or cannot be judged; that was said, and the run stands alone.
    """
    try:
        if interrupted:
            raise KeyboardInterrupt
        _wait_for_captures(config, since_s)
        return judge()
    except KeyboardInterrupt:
        print(f"{program}: interrupted; --capture was not judged", file=sys.stderr)
    except ConfigurationError as error:
        print_command_error(program, error)
    return None


def _wait_for_captures(config: CaptureConfig, since_s: float) -> None:
    """Wait up to 120 s until every capture was written after *since_s*, and is complete.

    Raises
    ------
    ConfigurationError
        One that does not come.
    """
    end_s = time.monotonic() + _PATIENCE_S
    for path in config.capture:
        told = False
        while not _is_capture_complete(path, since_s):
            if time.monotonic() > end_s:
                raise ConfigurationError(
                    f"--capture {path}: not written within {_PATIENCE_S:g} s of the end of the "
                    "run; record the run (--record) and judge the capture by --from-recording later"
                )
            if not told:
                print(f"waiting for {path}: end the capture", file=sys.stderr, flush=True)
                told = True
            time.sleep(_POLL_S)


def _is_capture_complete(path: Path, since_s: float) -> bool:
    """Return True if *path* was written after *since_s* (epoch), and not in the last second.

    False if there is no such file.
    """
    try:
        status = path.stat()
    except OSError:
        return False
    return status.st_mtime >= since_s and time.time() - status.st_mtime >= _QUIET_S
