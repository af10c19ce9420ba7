"""The option ``--record`` of the commands that talk to a board."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from haptogram.machine.terminal import terminal_error_line

from .output_files import announce_output_file

if TYPE_CHECKING:
    from haptogram.evidence.recordings.writer import RecordingWriter


@contextlib.contextmanager
def command_recording(
    path: Path | None, command: str, configuration: Mapping[str, Any]
) -> Iterator[RecordingWriter | None]:
    """Give the recording of a run; None if none was asked for.

    Raises
    ------
    ConfigurationError
        If it cannot be written.
    """
    if path is None:
        yield None
        return
    from haptogram.evidence.recordings.writer import RecordingWriter

    with RecordingWriter(path, command=command, configuration=configuration) as writer:
        yield writer


def is_command_recorded(command: str, writer: RecordingWriter | None) -> bool:
    """Return True unless the recording ended early; say on standard error how it ended."""
    if writer is None:
        return True
    writer.close()
    if writer.failure:
        print(
            terminal_error_line(f"haptogram {command}", writer.failure, sys.stderr), file=sys.stderr
        )
        return False
    announce_output_file(writer.path)
    return True
