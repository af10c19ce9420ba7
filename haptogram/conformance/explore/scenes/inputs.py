"""Inputs: every request, frames with each defect, damage, and nothing at all."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import fields
from itertools import combinations
from typing import Final

from haptogram_protocol.framing import HEADER_BYTES, MAX_BODY_BYTES
from haptogram_protocol.messages import (
    STREAM_RANGE,
    Arm,
    Config,
    Disarm,
    Feature,
    GetConfig,
    GetGeometry,
    GetStatus,
    Message,
    Mute,
    Ping,
    Play,
    SetConfig,
    Stop,
    UploadBegin,
    UploadChunk,
    UploadCommit,
    UploadKind,
)

from ..actions import ABSENT, FAULT, PARTS, REPLACED, SLOT_US
from ..makers.makers import DialogueMakers
from ..makers.requests import DEFECTS
from ..makers.stream import ODD_FLAGS, MadeAction
from ..tables.limit_requests import REFUSED_CONFIG
from .told import Told, told_as_made

_HELLOS: Final = ("open", "last", "earlier", "new", "near", "0", "next major")
_UNKNOWN_TYPES: Final = (0x04, 0x3F, 0x50, 0x7F, 0x80, 0x90, 0xBF, 0xC0, 0xFF)
#: First words of names that a state is likely to treat alike.
_GROUPS: Final = (
    *("any with", "HELLO", "type ", "another ", "refused ", "a frame", "a foreign frame", "damage"),
    *("GET_", "read ", "UPLOAD_"),
)
_LARGEST: Final = MAX_BODY_BYTES - HEADER_BYTES
_AHEAD: Final = 4  # frames, each for a slot
_DAMAGES: Final = (1, 2, 3, 5)


class SceneInputs:
    """Makes what a board is told.

    Parameters
    ----------
    makers : DialogueMakers
        Makers of the frames.

    Attributes
    ----------
    names : list of str
        What can be told.
    groups : dict of str to list of str
        Names that a state is likely to treat alike, by that of their group.
    """

    def __init__(self, makers: DialogueMakers) -> None:
        conditions = makers.conditions
        self._random = conditions.random
        self._configs, self._sessions = makers.configs, makers.sessions
        self._stream, self._requests = stream, requests = makers.stream, makers.requests
        self._count = conditions.identity.transducers
        self._can = conditions.can
        made = self._requests_made() | self._frames_made()
        self._found: dict[str, Callable[[], list[Told]]] = {
            name: (lambda make=make: [Told(make())])  # type: ignore[misc]
            for name, make in made.items()
        }
        for damage in _DAMAGES if not conditions.exact else (*_DAMAGES, PARTS):
            self._found[f"damage {damage}"] = lambda damage=damage: [  # type: ignore[misc]
                Told(self._random.choice((stream.plain(0.5), requests.plain(Ping(0)))), damage)
            ]
        self._found["nothing"] = list
        self._found["frames of some slots"] = lambda: told_as_made(
            stream.plain(n + 0.5) for n in range(4)
        )
        self._found["two frames at once"] = lambda: told_as_made(stream.pair())
        self._found["an upload"] = lambda: told_as_made(requests.uploads.upload())
        if conditions.exact:
            self._found["a fault"] = lambda: [fault_told()]
        self.names = list(self._found)
        self.groups: dict[str, list[str]] = {}
        for name in self.names:
            self.groups.setdefault(_group_of_told(name), []).append(name)

    def told(self, name: str) -> list[Told]:
        """Return the frames that have a name of :attr:`names`."""
        return self._found[name]()

    def _requests_made(self) -> dict[str, Callable[[], MadeAction]]:
        requests, configs = self._requests, self._configs
        found: dict[str, Callable[[], MadeAction]] = {}
        for name, message in self.messages().items():
            found[name] = lambda message=message: requests.plain(message())  # type: ignore[misc]
        for defect in DEFECTS:
            found[f"any with {defect}"] = lambda defect=defect: self._defective(defect)  # type: ignore[misc]
        found["foreign MUTE"] = lambda: requests.defective(Mute(), ["another session"])
        found["the last request again"] = requests.repeated
        for which in _HELLOS:
            found[f"HELLO {which}"] = lambda which=which: self._sessions.hello(which)  # type: ignore[misc]
        for kind in _UNKNOWN_TYPES:
            found[f"type {kind:#x}"] = lambda kind=kind: self._unknown(kind)  # type: ignore[misc]
        if requests.plays:
            found["PLAY in half a slot"] = lambda: requests.start(later=0.5)
        if not self._can & Feature.CONFIG:
            return found
        found["the same configuration"] = lambda: requests.plain(SetConfig(configs.last))
        for field in fields(Config):
            found[f"another {field.name}"] = lambda name=field.name: requests.plain(  # type: ignore[misc]
                SetConfig(configs.changed(name))
            )
        for name in REFUSED_CONFIG:
            found[f"refused {name}"] = lambda name=name: requests.plain(  # type: ignore[misc]
                SetConfig(configs.refused(name))
            )
        return found

    def messages(self) -> dict[str, Callable[[], Message]]:
        """Return the makers of each request that the board knows, by name."""
        count, can = self._count, self._can
        found: dict[str, Callable[[], Message]] = {
            "ARM": Arm,
            "MUTE": Mute,
            "DISARM": Disarm,
            "PING": lambda: Ping(self._random.randrange(2**64)),
            "GET_STATUS": GetStatus,
            "GET_CONFIG": GetConfig,
            "GET_GEOMETRY": lambda: GetGeometry(0, 1),
        }
        for number, read in enumerate(self._requests.reads()):
            found[f"read {number}"] = read
        if can & Feature.SEQUENCE_PHASES:
            begin = UploadBegin(UploadKind.PHASES, 0, REPLACED, count, 0)
            found |= {
                "STOP": Stop,
                "UPLOAD_BEGIN": lambda: begin,
                "UPLOAD_CHUNK": lambda: UploadChunk(0, bytes(min(count, 13))),
                "UPLOAD_COMMIT": lambda: UploadCommit(REPLACED),
                "PLAY of nothing": lambda: Play(ABSENT, SLOT_US, 1, 1000),
            }
        return found

    def defects(self) -> list[tuple[str, ...]]:
        """Return every request with every defect and with every two of them, by their names."""
        names = [*self.messages(), *(["SET_CONFIG"] if self._can & Feature.CONFIG else [])]
        pairs = (pair for pair in combinations(DEFECTS, 2) if not _are_alike(*pair))
        defects = [*((defect,) for defect in DEFECTS), *pairs]
        return [(name, *some) for name in names for some in defects]

    def defective(self, name: str, defects: Iterable[str]) -> MadeAction:
        """Return the request with the defects."""
        is_config = name == "SET_CONFIG"
        message = SetConfig(self._configs.last) if is_config else self.messages()[name]()
        return self._requests.defective(message, defects)

    def _defective(self, defect: str) -> MadeAction:
        name = self._random.choice(list(self.messages()))
        return self.defective(name, [defect])

    def _frames_made(self) -> dict[str, Callable[[], MadeAction]]:
        stream, pick = self._stream, self._random.choice
        return {
            "a frame at once": lambda: stream.of(None),
            "a frame ahead": lambda: stream.of(0.5),
            "a frame seen before": lambda: stream.of(0.5, step=pick((-1, -2))),
            "a frame at once, seen before": lambda: stream.of(None, step=-1),
            "a frame half of all numbers ahead": lambda: stream.of(0.5, step=0x8000),
            "a foreign frame": stream.foreign,
            "a foreign frame at once": lambda: stream.of(None, wrong=0x2222),
            "a frame with a flag": lambda: stream.of(0.5, flags=pick(ODD_FLAGS)),
            "a frame of a wrong length": lambda: stream.of(0.5, cut=pick((-1, 1))),
            "a late frame": lambda: stream.of("late"),
            "a frame too late": lambda: stream.of("too late"),
            "a frame beyond the horizon": lambda: stream.of("beyond"),
            "a frame far ahead": lambda: stream.of("far"),
            "a refused frame": stream.refused,
        }

    def _unknown(self, kind: int) -> MadeAction:
        size = self._random.choice((0, 1, 20, 256, 1000, _LARGEST - 1, _LARGEST))
        payload = self._random.choice((b"\0", b"U")) * size  # the one is stuffed, the other not
        text = f"type {kind:#x} with {size} bytes"
        made = self._stream.of(0.5) if kind in STREAM_RANGE else self._requests.plain(Ping(0))
        header = made[2]
        return (
            f"type {kind:#x}",
            text,
            lambda host: bytes([kind]) + header(host)[1:HEADER_BYTES] + payload,
        )


def _group_of_told(name: str) -> str:
    """Return the group of a name: that of its first words, or the name itself."""
    return next((first for first in _GROUPS if name.startswith(first)), name)


def _are_alike(one: str, other: str) -> bool:
    """Return True if two defects are of the same part of a frame."""
    return not DEFECTS[one].keys().isdisjoint(DEFECTS[other])


def fault_told() -> Told:
    """Return a fault of the hardware."""
    text = "the hardware fails"
    return Told((text, text, lambda _: b""), FAULT)
