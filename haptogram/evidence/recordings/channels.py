"""The format of a recording: its channels, their schemas, and the version of the whole.

docs/recordings.md holds this table, and a test compares the two.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from haptogram.records.latch import LATCH_LAYOUT, LATCH_VERSION

#: The first bytes of every MCAP file.
MAGIC: Final = b"\x89MCAP0\r\n"
VERSION: Final = 1
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
RECONSTRUCTION: Final = "/reconstruction"
FAULTS: Final = "/faults"
RUN: Final = "/run"
MODEL: Final = "/model"
INTENDED: Final = "/intended"
VERDICT: Final = "/verdict"
SUMMARY: Final = "/summary"

_KEY: Final = {name: {"type": "integer"} for name in ("session", "sequence", "loop", "index")}


@dataclass(frozen=True, slots=True)
class Channel:
    """One channel of a recording.

    Attributes
    ----------
    topic : str
        Its name in the file.
    encoding : str
        ``json``, or ``octets``: bytes as they were on the line or as the channel's metadata say.
    clock : str
        The clock of its times: ``host``, or ``device`` with the board's microseconds times 1000.
    meaning : str
        One sentence.
    properties : dict
        JSON Schema of the fields; empty for bytes.
    metadata : dict
        Goes into the file with the channel.
    """

    topic: str
    encoding: str
    clock: str
    meaning: str
    properties: Mapping[str, Any] = field(default_factory=dict)
    metadata: Mapping[str, str] = field(default_factory=dict)

    @property
    def schema_name(self) -> str:
        """Name of its schema."""
        return f"haptogram.{self.topic[1:].title().replace('_', '')}"

    @property
    def schema(self) -> bytes:
        """Its schema: JSON Schema; empty for bytes."""
        if self.encoding != "json":
            return b""
        schema = {
            "$schema": "https://json-schema.org/draft/2020-12/schema",
            "title": self.schema_name,
            "description": self.meaning,
            "type": "object",
            "properties": dict(self.properties),
        }
        return json.dumps(schema, separators=(",", ":")).encode()


def _octet_channel(topic: str, clock: str, meaning: str, **metadata: str) -> Channel:
    return Channel(topic, "octets", clock, meaning, metadata=metadata)


def _json_channel(topic: str, clock: str, meaning: str, **properties: Any) -> Channel:
    return Channel(topic, "json", clock, meaning, properties)


def _text_in_channel(description: str) -> dict[str, str]:
    return {"type": "string", "description": description}


def _object_in_channel(description: str) -> dict[str, Any]:
    return {"type": ["object", "null"], "description": description}


def _whole_number_in_channel(description: str) -> dict[str, Any]:
    return {"type": ["integer", "null"], "description": description}


#: Every channel by topic.
CHANNELS: Final = {
    channel.topic: channel
    for channel in (
        _octet_channel(
            TO_BOARD,
            "host",
            "bytes that the port took from the host; publish time: since when they may have waited",
        ),
        _octet_channel(TO_HOST, "host", "bytes that the host read"),
        _json_channel(
            LINK,
            "host",
            "what happened to the line between host and board, and to the board",
            event=_text_in_channel(
                "opened: a line to a board begins; departed: the host closed the port; "
                "hardware_fault: the hardware of the board was made to fail; excerpt: what "
                "follows is from the midst of a soak"
            ),
            text=_text_in_channel("excerpt: the violation"),
            board=_object_in_channel(
                "opened: options of the virtual board, as `haptogram board` takes them"
            ),
            boot_ns=_whole_number_in_channel(
                "opened: time of the board's power-up; null: not known"
            ),
            paced=_whole_number_in_channel(
                "opened: 1 if a simulated line carries the bytes, 0 if a real one does"
            ),
        ),
        _octet_channel(
            LATCH,
            "device",
            "one latch: join key, times and drive",
            version=str(LATCH_VERSION),
            layout=LATCH_LAYOUT,
        ),
        _json_channel(
            PULSES,
            "device",
            "one latch of a board of another dialect, as the back door tells it",
            number={"type": "integer"},
            t_latch_us={"type": "integer", "description": "device time, us"},
            steps={"type": "integer", "description": "steps of a carrier period"},
            rises=_text_in_channel("base64, u16 for each channel"),
            widths=_text_in_channel("base64, u16 for each channel"),
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
            event=_text_in_channel(
                "session, state, ramp_began, ramp_ended, radiated_anew, playback_ended or "
                "power_down"
            ),
        ),
        _json_channel(
            RECONSTRUCTION,
            "device",
            "the field of a latch, computed without knowledge of the target",
            **_KEY,
            kind=_text_in_channel("single_focus, not_single or no_focus"),
        ),
        _json_channel(
            FAULTS,
            "device",
            "the last record of the back door: how often each fault on purpose has fired",
            latched={"type": "integer"},
            faults=_object_in_channel("how often each has fired"),
            fault_plan=_text_in_channel("plan and seed as TOML"),
        ),
        _json_channel(
            MODEL,
            "device",
            "array, air and transducers as the judge of the run knows them, as in `/board`, and "
            "how many frames follow",
            positions_m={"type": "array", "description": "N x 3, metres"},
            normals={"type": "array", "description": "N x 3, unit vectors"},
            intended_frames=_whole_number_in_channel("messages of `/intended`"),
        ),
        _json_channel(
            INTENDED,
            "device",
            "a frame that the host intended, with the drive that it expects",
            **_KEY,
            number={"type": "integer", "description": "place among all frames"},
            t_apply_us=_whole_number_in_channel(
                "device time at which it is due, µs; null: as soon as complete"
            ),
            foci={"type": "array", "description": "x, y, z in metres, amplitude, phase in rad"},
            phase_codes=_text_in_channel("base64, u8 for each element"),
            amplitude_codes=_text_in_channel("base64, u8 for each element"),
            drive_of=_whole_number_in_channel(
                "number of the frame that has the same drive, instead of the codes"
            ),
        ),
        _json_channel(
            VERDICT,
            "device",
            "the verdict on one frame",
            **_KEY,
            number={"type": "integer", "description": "place among all frames"},
            verdict=_text_in_channel("name of the verdict"),
        ),
        _json_channel(SUMMARY, "host", "the result of the run, as --json writes it"),
        _json_channel(
            RUN,
            "host",
            "what was run, by which versions",
            command=_text_in_channel("verify, board, conform, bench or soak"),
            configuration=_object_in_channel("options of the command"),
            versions=_object_in_channel("versions of the programs"),
        ),
    )
}
