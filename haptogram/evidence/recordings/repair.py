"""Copies what can be read of a recording that was cut off or damaged into a whole file."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from haptogram.errors import ConfigurationError, unwritable_file
from haptogram.machine.files import check_distinct_files

from .channels import CHANNELS
from .reader import Recording, RecordingEntry
from .writer import begin_recording


def repair_recording(source: Path, target: Path) -> tuple[int, str]:
    """Write the messages of *source* that can be read to *target*.

    Returns
    -------
    tuple of int and str
        How many there were, and what was left out; empty: nothing.

    Raises
    ------
    ConfigurationError
        If *source* is no recording or holds no message that can be read, or *target* cannot be
        written or is the same file.
    """
    from mcap.writer import CompressionType, Writer

    check_distinct_files({"the copy": target}, [("the recording", source)])
    recording = Recording(source, remedy="")
    if next(_readable_entries(recording), None) is None:
        raise ConfigurationError(
            f"{source}: no message in it can be read; {target} was not written"
        )
    count = 0
    try:
        with target.open("wb") as file:
            writer: Any = Writer(file, compression=CompressionType.NONE)
            ids = begin_recording(writer, recording.library)
            for entry in _readable_entries(recording):
                count += 1
                writer.add_message(ids[entry.topic], entry.t_ns, entry.content, entry.published_ns)
            writer.finish()
    except OSError as error:
        raise unwritable_file(target, error) from error
    return count, recording.note


def _readable_entries(recording: Recording) -> Iterator[RecordingEntry]:
    """Yield the messages that lie before the damage."""
    with contextlib.suppress(ConfigurationError):
        yield from recording.entries(CHANNELS)
