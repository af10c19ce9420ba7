"""Copies what can be read of a recording that was cut off or damaged into a whole file."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from haptogram.errors import ConfigurationError, unwritable_file
from haptogram.machine.files import check_distinct_files

from .channels import METADATA, PROFILE
from .reader import Recording


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
    from mcap.records import Channel, Header, Message, Metadata, Schema
    from mcap.writer import CompressionType, Writer

    check_distinct_files({"the copy": target}, [("the recording", source)])
    recording = Recording(source, remedy="")
    count = 0
    if not _has_readable_message(recording):
        raise ConfigurationError(
            f"{source}: no message in it can be read; {target} was not written"
        )
    try:
        with target.open("wb") as file:
            writer: Any = Writer(file, compression=CompressionType.NONE)
            schemas: dict[int, int] = {0: 0}
            channels: dict[int, int] = {}
            for record in _readable_records(recording):
                if isinstance(record, Header):
                    writer.start(profile=PROFILE, library=record.library)
                elif isinstance(record, Metadata) and record.name == METADATA:
                    writer.add_metadata(record.name, record.metadata)
                elif isinstance(record, Schema) and record.id not in schemas:
                    schemas[record.id] = writer.register_schema(
                        record.name, record.encoding, record.data
                    )
                elif isinstance(record, Channel) and record.id not in channels:
                    channels[record.id] = writer.register_channel(
                        record.topic,
                        record.message_encoding,
                        schemas[record.schema_id],
                        record.metadata,
                    )
                elif isinstance(record, Message) and record.channel_id in channels:
                    writer.add_message(
                        channels[record.channel_id],
                        record.log_time,
                        record.data,
                        record.publish_time,
                        record.sequence,
                    )
                    count += 1
            writer.finish()
    except OSError as error:
        raise unwritable_file(target, error) from error
    return count, recording.note


def _has_readable_message(recording: Recording) -> bool:
    with contextlib.suppress(ConfigurationError):
        return any(True for _ in recording.entries())
    return False


def _readable_records(recording: Recording) -> Iterator[Any]:
    """Yield the records that lie before the damage."""
    with contextlib.suppress(ConfigurationError):
        yield from recording.raw_records()
