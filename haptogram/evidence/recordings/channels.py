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

_KEY: Final = {name: {"type": "integer"} for name in ("session", "sequence", "loop", "index")}


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
            "properties": {
                name: about for name, about in self.properties.items() if _is_plain(about)
            },
        }
        return json.dumps(schema, separators=(",", ":")).encode()


def _is_plain(about: Mapping[str, Any]) -> bool:
    """Return True if the JSON schema of a property describes one scalar or typed list."""
    return isinstance(about["type"], str) and (about["type"] != "array" or "items" in about)


def _json_channel(topic: str, clock: str, meaning: str, **properties: Any) -> Channel:
    return Channel(topic, clock, meaning, properties)


def _bytes_schema(description: str) -> dict[str, str]:
    """Return the JSON schema of a base64 string."""
    return {"type": "string", "contentEncoding": "base64", "description": description}


def _text_schema(description: str) -> dict[str, str]:
    return {"type": "string", "description": description}


def _object_schema(description: str) -> dict[str, Any]:
    return {"type": ["object", "null"], "description": description}


def _integer_schema(description: str) -> dict[str, Any]:
    return {"type": ["integer", "null"], "description": description}


#: Every channel by topic.
CHANNELS: Final = {
    channel.topic: channel
    for channel in (
        _json_channel(
            TO_BOARD,
            "host",
            "bytes that the port took from the host; publish time: since when they may have waited",
            data=_bytes_schema("the bytes"),
        ),
        _json_channel(TO_HOST, "host", "bytes that the host read", data=_bytes_schema("the bytes")),
        _json_channel(
            LINK,
            "host",
            "what happened to the line between host and board, and to the board",
            event=_text_schema(
                "opened: a line to a board begins; departed: the host closed the port; "
                "hardware_fault: the hardware of the board was made to fail; excerpt: what "
                "follows is from the midst of a soak"
            ),
            text=_text_schema("excerpt: the violation"),
            board=_object_schema(
                "opened: options of the virtual board, as `haptogram board` takes them"
            ),
            boot_ns=_integer_schema("opened: time of the board's power-up; null: not known"),
            paced=_integer_schema(
                "opened: 1 if a simulated line carries the bytes, 0 if a real one does"
            ),
        ),
        _json_channel(
            LATCH,
            "device",
            "one latch, as the back door tells it: join key, times, drive, and the field that was "
            "computed without knowledge of the target",
            **_KEY,
            number={"type": "integer", "description": "count of latches in the session"},
            t_latch_us={"type": "integer", "description": "device time, us"},
            t_received_us=_integer_schema("device time; null: out of a sequence"),
            late={"type": "boolean"},
            ramping={"type": "boolean"},
            commanded_bits={"type": "integer"},
            phase_bits={"type": "integer"},
            phase_codes=_bytes_schema("u8 for each element; from 9 bits on u16, little-endian"),
            amplitude_codes=_bytes_schema("u8 for each element"),
            drive_crc={"type": "integer"},
            radiated=_object_schema("the drive that left the transducers; null: the same"),
            reconstruction=_object_schema("single_focus, not_single or no_focus"),
        ),
        _json_channel(
            PULSES,
            "device",
            "one latch of a board of another dialect, as the back door tells it",
            number={"type": "integer"},
            t_latch_us={"type": "integer", "description": "device time, us"},
            steps={"type": "integer", "description": "steps of a carrier period"},
            rises=_bytes_schema("u16 for each channel"),
            widths=_bytes_schema("u16 for each channel"),
        ),
        _json_channel(
            BOARD,
            "device",
            "the first record of the back door: array, air and transducers of the board",
            transducers={"type": "integer"},
            carrier_hz={"type": "integer"},
            positions_m={"type": "array", "description": "N x 3, metres"},
            normals={"type": "array", "description": "N x 3, unit vectors"},
        ),
        _json_channel(
            OUTPUT,
            "device",
            "a change of the output, as the back door tells it",
            t_us={"type": "integer", "description": "device time, us"},
            event=_text_schema(
                "session, state, ramp_began, ramp_ended, radiated_anew, playback_ended or "
                "power_down"
            ),
        ),
        _json_channel(
            FAULTS,
            "device",
            "the last record of the back door: how often each fault on purpose has fired",
            latched={"type": "integer"},
            faults=_object_schema("how often each has fired"),
            fault_plan=_text_schema("plan and seed as TOML"),
        ),
        _json_channel(
            MODEL,
            "host",
            "array, air and transducers as the judge of the run knows them, as in `/board`, and "
            "how many frames follow",
            positions_m={"type": "array", "description": "N x 3, metres"},
            normals={"type": "array", "description": "N x 3, unit vectors"},
            intended_frames=_integer_schema("messages of `/intended`"),
        ),
        _json_channel(
            INTENDED,
            "device",
            "a frame that the host intended, with the drive that it expects",
            **_KEY,
            number={"type": "integer", "description": "place among all frames"},
            t_apply_us=_integer_schema(
                "device time at which it is due, µs; null: as soon as complete"
            ),
            foci={"type": "array", "description": "x, y, z in metres, amplitude, phase in rad"},
            phase_codes=_bytes_schema("u8 for each element; from 9 bits on u16, little-endian"),
            amplitude_codes=_bytes_schema("u8 for each element"),
            drive_of=_integer_schema(
                "number of the frame that has the same drive, instead of the codes"
            ),
        ),
        _json_channel(
            VERDICT,
            "device",
            "the verdict on one frame",
            **_KEY,
            number={"type": "integer", "description": "place among all frames"},
            verdict=_text_schema("name of the verdict"),
        ),
        _json_channel(SUMMARY, "host", "the result of the run, as --json writes it"),
        _json_channel(
            RUN,
            "host",
            "what was run, by which versions",
            command=_text_schema("verify, board, conform, bench or soak"),
            configuration=_object_schema("options of the command"),
            versions=_object_schema("versions of the programs"),
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
