"""The format of a recording: its channels, their schemas, and the version of the whole.

docs/recordings.md holds this table, and a test compares the two.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from .scene import FRAME_SCHEMA, LOG_SCHEMA, SCENE_SCHEMA

#: The first bytes of every MCAP file.
MAGIC: Final = b"\x89MCAP0\r\n"
VERSION: Final = 2
PROFILE: Final = "haptogram"
#: Name of the metadata record that stands first in the file.
METADATA: Final = "haptogram"

TO_BOARD: Final = "/to_board"
TO_HOST: Final = "/to_host"
LINK: Final = "/link"
LATCH: Final = "/latch"
PULSES: Final = "/pulses"
BOARD: Final = "/board"
OUTPUT: Final = "/output"
FAULTS: Final = "/faults"
RUN: Final = "/run"
MODEL: Final = "/model"
INTENDED: Final = "/intended"
VERDICT: Final = "/verdict"
SUMMARY: Final = "/summary"
LOG: Final = "/log"
FRAME: Final = "/tf"
ARRAY: Final = "/scene/array"
FOCUS: Final = "/scene/focus"
_KEY: Final = "session sequence loop index"


@dataclass(frozen=True, slots=True)
class Channel:
    """One channel of a recording.

    Attributes
    ----------
    topic : str
        Its name in the file.
    clock : str
        The clock that its times were taken from: ``host`` or ``device``.
    meaning : str
        One sentence.
    properties : dict
        JSON Schema of the fields.
    known_schema : str
        Name of a schema that viewers draw; empty: it is Haptogram's own.
    """

    topic: str
    clock: str
    meaning: str
    properties: Mapping[str, Any] = field(default_factory=dict)
    known_schema: str = ""

    @property
    def schema_name(self) -> str:
        """Name of its schema."""
        return self.known_schema or f"haptogram.{self.topic[1:].title().replace('_', '')}"

    @property
    def schema(self) -> bytes:
        """Its JSON Schema.

        Viewers read fields of one type, objects, and arrays of either, and refuse a channel with
        any other: fields that may be null or are tables are in the messages, not in the schema.
        """
        schema = {
            "$schema": "https://json-schema.org/draft/2020-12/schema",
            "title": self.schema_name,
            "description": self.meaning,
            "type": "object",
            "properties": self.properties,
        }
        return json.dumps(schema, separators=(",", ":")).encode()


def _channel_fields(
    *, whole: str = "", yes_or_no: str = "", text: str = "", base64: str = ""
) -> dict[str, Any]:
    """Return the JSON Schema of fields by name; each argument holds names of one type.

    They are separated by spaces.
    """
    kinds: dict[str, dict[str, str]] = {
        whole: {"type": "integer"},
        yes_or_no: {"type": "boolean"},
        text: {"type": "string"},
        base64: {"type": "string", "contentEncoding": "base64"},
    }
    return {name: kind for names, kind in kinds.items() for name in names.split()}


#: Every channel by topic.
CHANNELS: Final = {
    channel.topic: channel
    for channel in (
        Channel(
            TO_BOARD,
            "host",
            "bytes that the port took from the host; publish time: since when they may have waited",
            _channel_fields(base64="data"),
        ),
        Channel(TO_HOST, "host", "bytes that the host read", _channel_fields(base64="data")),
        Channel(
            LINK,
            "host",
            "what happened to the line between host and board, and to the board",
            _channel_fields(text="event text"),
        ),
        Channel(
            LATCH,
            "device",
            "one latch, as the back door tells it: join key, times, drive, and the field that was "
            "computed without knowledge of the target",
            _channel_fields(
                whole=f"{_KEY} number t_latch_us commanded_bits phase_bits drive_crc",
                yes_or_no="late ramping",
                base64="phase_codes amplitude_codes",
            ),
        ),
        Channel(
            PULSES,
            "device",
            "one latch of a board of another dialect, as the back door tells it",
            _channel_fields(whole="number t_latch_us steps", base64="rises widths"),
        ),
        Channel(
            BOARD,
            "device",
            "the first record of the back door: array, air and transducers of the board",
            _channel_fields(whole="transducers carrier_hz"),
        ),
        Channel(
            OUTPUT,
            "device",
            "a change of the output, as the back door tells it",
            _channel_fields(whole="t_us", text="event"),
        ),
        Channel(
            FAULTS,
            "device",
            "the last record of the back door: how often each fault on purpose has fired",
            _channel_fields(whole="latched", text="fault_plan"),
        ),
        Channel(
            MODEL,
            "host",
            "array, air and transducers as the judge of the run knows them, as in `/board`, and "
            "how many frames follow",
        ),
        Channel(
            INTENDED,
            "device",
            "a frame that the host intended, with the drive that it expects",
            _channel_fields(whole=f"{_KEY} number", base64="phase_codes amplitude_codes"),
        ),
        Channel(
            VERDICT,
            "device",
            "the verdict on one frame",
            _channel_fields(whole=f"{_KEY} number", text="verdict"),
        ),
        Channel(SUMMARY, "host", "the result of the run, as --json writes it"),
        Channel(
            RUN,
            "host",
            "what was run, by which versions",
            _channel_fields(text="command"),
        ),
        Channel(LOG, "device", "events and findings in words", LOG_SCHEMA, "foxglove.Log"),
        Channel(FRAME, "host", "the axes of the scene", FRAME_SCHEMA, "foxglove.FrameTransform"),
        Channel(ARRAY, "host", "the array, in cm", SCENE_SCHEMA, "foxglove.SceneUpdate"),
        Channel(
            FOCUS,
            "device",
            "target and focus of a frame, in cm",
            SCENE_SCHEMA,
            "foxglove.SceneUpdate",
        ),
    )
}
