"""Inputs: every request, frames with each defect, damage, and nothing at all."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import fields
from functools import partial
from itertools import combinations
from typing import Final, TypeAlias

from haptogram_protocol.framing import HEADER_BYTES, MAX_BODY_BYTES
from haptogram_protocol.messages import (
    STREAM_RANGE,
    Config,
    Feature,
    Header,
    Hello,
    Message,
    Mute,
    Ping,
    SetConfig,
)
from haptogram_protocol.record import Record

from ..actions import FAULT, PARTS
from ..host import NO_SESSION, DialogueHost
from ..makers.conditions import Told
from ..makers.frames import DEFECTS, HELLOS, ODD_FLAGS, WRONG_SESSIONS, At
from ..makers.limit_requests import REFUSED_CONFIG
from ..makers.requests import RandomRequests

_UNKNOWN_TYPES: Final = (0x00, 0x04, 0x3F, 0x50, 0x7E, 0x7F, 0x80, 0x90, 0xBF, 0xC0, 0xFF)
_LARGEST: Final = MAX_BODY_BYTES - HEADER_BYTES
_DAMAGES: Final = (1, 2, 3, 5)
#: First words of names that a state is likely to treat alike.
_GROUPS: Final = (
    *("any with", "HELLO", "type ", "another ", "refused ", "a frame", "a foreign frame", "damage"),
    *("GET_", "read ", "UPLOAD_", "PLAY"),
)
#: Stream frames, by what is odd about them.
_FRAMES: Final[dict[str, tuple[At, dict[str, tuple[int, ...]]]]] = {
    "a frame ahead": (0.5, {"apart_us": (0, 0, 10, 25, 26, 1000, 3000)}),
    "a frame at once": (None, {}),
    "a frame seen before": (0.5, {"number": (-1, -2, -32)}),
    "a frame at once, seen before": (None, {"number": (-1,)}),
    "a frame with numbers left out": (0.5, {"number": (1, 300, 0x2000, 0x7FF0)}),
    "a frame half of all numbers ahead": (0.5, {"number": (0x7FFF, 0x8000, 0x8010)}),
    "a foreign frame": (0.5, {"session": WRONG_SESSIONS}),
    "a foreign frame at once": (None, {"session": (NO_SESSION,)}),
    "a frame with a flag": (0.5, {"flags": ODD_FLAGS}),
    "a frame of a wrong length": (0.5, {"length": (-1, -16, -9999, 1, 300)}),
    "a late frame": ("late", {}),
    "a frame too late": ("too late", {}),
    "a frame beyond the horizon": ("beyond", {}),
    "a frame far ahead": ("far", {}),
}
_Makers: TypeAlias = dict[str, Callable[[], Told]]
#: Fields of which a byte may let timers end at any time, or ask for much.
_NOT_ANY_BYTE: Final = frozenset(
    {
        *("hold_ms", "ramp_ms", "host_timeout_ms", "status_period_ms", "unattended_ms"),
        *("period_us", "loops", "size", "nonce", "crc", "token"),
    }
)
_SOME_VALUES: Final = 24  # of a byte of a longer field


class SceneInputs:
    """Makes what a board is told.

    Parameters
    ----------
    makers : RandomRequests
        Makes frames.

    Attributes
    ----------
    kinds : dict of str to list of str
        Names of what can be told, by its kind.
    groups : dict of str to list of str
        Names that a state is likely to treat alike, by that of their group.
    """

    def __init__(self, makers: RandomRequests) -> None:
        self._makers, conditions = makers, makers.conditions
        self._pick = conditions.random.choice
        of_kind: dict[str, _Makers] = {
            "frame": self._frames(),
            "request": self._requests(),
            "configuration": self._configs(),
            "limit": {"a request at a limit": makers.at_limit},
            "HELLO": {f"HELLO {which}": partial(makers.hello, which) for which in HELLOS},
            "odd": self._odd_requests(),
            "damage": {
                f"damage {damage}": partial(self._damaged, damage)
                for damage in (_DAMAGES if not conditions.exact else (*_DAMAGES, PARTS))
            },
        }
        self.kinds = {kind: list(some) for kind, some in of_kind.items()} | {"burst": ["a burst"]}
        self._one = {name: make for some in of_kind.values() for name, make in some.items()}
        self._some: dict[str, Callable[[], list[Told]]] = {
            "nothing": list,
            "frames of some slots": lambda: [self.frame(n + 0.5) for n in range(4)],
            "two frames at once": makers.pair,
            "a burst": makers.burst,
            "an upload": makers.upload,
        }
        if conditions.exact:
            self._one["a fault"] = fault_told
        self.names = [*self._one, *self._some]
        self.groups: dict[str, list[str]] = {}
        for name in self.names:
            group = next((first for first in _GROUPS if name.startswith(first)), name)
            self.groups.setdefault(group, []).append(name)

    def told(self, name: str) -> list[Told]:
        """Return the frames that have a name of :attr:`names`."""
        return [self._one[name]()] if name in self._one else self._some[name]()

    def frame(self, at: At, **odd: int) -> Told:
        """Return a stream frame of any kind; see :meth:`~..makers.frames.RandomFrames.frame`."""
        return self._makers.frame(self._makers.any(), at, **odd)

    # --- frames of the stream --------------------------------------------------------------------

    def _frames(self) -> _Makers:
        conditions = self._makers.conditions
        found: _Makers = {name: partial(self._odd_frame, *odd) for name, odd in _FRAMES.items()}
        found["a refused frame"] = lambda: self._makers.frame(self._makers.refused(), 0.5)
        if conditions.timed:
            ahead = (1.5, 1.5, 2.5, 3.5, 6.5)
            found["a frame some slots ahead"] = lambda: self.frame(self._pick(ahead))
        if conditions.exact:
            found["a frame at a limit"] = partial(self.frame, "at a limit")
        return found

    def _odd_frame(self, at: At, choices: dict[str, tuple[int, ...]]) -> Told:
        return self.frame(at, **{name: self._pick(values) for name, values in choices.items()})

    # --- requests --------------------------------------------------------------------------------

    def _requests(self) -> _Makers:
        makers = self._makers
        found: _Makers = {
            name: partial(self._plain, make) for name, make in makers.messages().items()
        }
        if makers.plays:
            found["PLAY"] = makers.any_play
            found["PLAY in half a slot"] = lambda: makers.start(0.5)
        return found

    def _plain(self, make: Callable[[], Message]) -> Told:
        return self._makers.frame(make())

    def _configs(self) -> _Makers:
        if not self._makers.conditions.can & Feature.CONFIG:
            return {}
        configs = self._makers.configs
        changes: dict[str, Callable[[], Config]] = {
            "another configuration": configs.config,
            **{f"another {f.name}": partial(configs.changed, f.name) for f in fields(Config)},
            **{f"refused {name}": partial(configs.refused, name) for name in REFUSED_CONFIG},
        }
        return {name: partial(self._config, make) for name, make in changes.items()}

    def _config(self, make: Callable[[], Config]) -> Told:
        return self._makers.frame(SetConfig(make()))

    # --- what is odd about a request -------------------------------------------------------------

    def _odd_requests(self) -> _Makers:
        makers = self._makers
        found: _Makers = {f"any with {one}": partial(self._any_with, one) for one in DEFECTS}
        found |= {f"type {kind:#x}": partial(self._unknown, kind) for kind in _UNKNOWN_TYPES}
        found["foreign MUTE"] = lambda: makers.defective(Mute(), "another session")
        found["the remembered request again"] = makers.repeated
        found["the last request again"] = partial(makers.repeated, "last")
        return found

    def defects(self) -> Iterator[tuple[str, ...]]:
        """Yield every request with every defect and with every two of them, by their names."""
        alone = [(defect,) for defect in DEFECTS]
        pairs = [
            (one, other)
            for one, other in combinations(DEFECTS, 2)
            if DEFECTS[one].keys().isdisjoint(DEFECTS[other])
        ]
        for name in self._makers.messages():
            yield from ((name, *some) for some in (*alone, *pairs))

    def defective(self, name: str, *defects: str) -> Told:
        """Return the request with the defects."""
        return self._makers.defective(self._makers.messages()[name](), *defects)

    def _any_with(self, defect: str) -> Told:
        return self.defective(self._pick(list(self._makers.messages())), defect)

    def _unknown(self, kind: int) -> Told:
        size = self._pick((0, 1, 20, 256, 1000, _LARGEST - 1, _LARGEST))
        payload = self._pick((b"\0", b"U")) * size  # the one is stuffed, the other not
        told = self.frame(0.5) if kind in STREAM_RANGE else self._makers.frame(Ping(0))
        return told._replace(
            name=f"type {kind:#x}",
            text=f"type {kind:#x} with {size} bytes",
            body=lambda host: bytes([kind]) + told.body(host)[1:HEADER_BYTES] + payload,
        )

    def _damaged(self, damage: int) -> Told:
        told = self._pick((self.frame(0.5), self._makers.frame(Ping(0))))
        return told._replace(name=f"damage {damage}", damage=damage)

    # --- one byte of any value -------------------------------------------------------------------

    def with_any_byte(self) -> Told:
        """Return a frame with one byte of any value; each of a short field comes once."""
        name, offset, value = self._makers.conditions.next("byte values", self.byte_values)
        makers = self._makers
        messages = {**makers.messages(), **makers.kinds}
        told = makers.frame(messages[name](), 0.5) if name in messages else makers.hello("open")

        def body(host: DialogueHost) -> bytes:
            whole = told.body(host)
            return whole[:offset] + bytes([value]) + whole[offset + 1 :]

        # A MUTE has a write of its own: it may overtake what is sent with it.
        is_mute = offset == Header.WIRE["type"].offset and value == Mute.TYPE
        text = f"{told.text}, byte {offset} of the body is {value:#04x}"
        name = f"{told.name} with a byte"
        return told._replace(name=name, text=text, body=body, wait_us=int(is_mute))

    def byte_values(self) -> Iterator[tuple[str, int, int]]:
        """Yield name, offset and value of bytes: all of a short field, some of a longer one.

        Fields of one byte are enumerations, versions and counts; with type and flags goes what a
        longer field has.
        """
        makers, sample = self._makers, self._makers.conditions.random.sample
        messages = {**makers.messages(), **makers.kinds}
        kinds: dict[str, type[Message]] = {name: type(make()) for name, make in messages.items()}
        for name, kind in {**kinds, "HELLO": Hello}.items():
            for offset, size in ((0, 2), *_fields_of_bytes(kind, HEADER_BYTES)):
                values = range(256) if size == 1 else sample(range(256), _SOME_VALUES)
                yield from ((name, offset + n, value) for n in range(size) for value in values)


def _fields_of_bytes(record: type[Record], base: int) -> Iterator[tuple[int, int]]:
    """Yield offset in the body and size of each field, records within records included."""
    for name, field in record.WIRE.items():
        if field.record is not None:
            yield from _fields_of_bytes(field.record, base + field.offset)
        elif name not in _NOT_ANY_BYTE:
            yield base + field.offset, field.size


def fault_told() -> Told:
    """Return a fault of the hardware."""
    text = "the hardware fails"
    return Told(text, text, lambda _: b"", FAULT)
