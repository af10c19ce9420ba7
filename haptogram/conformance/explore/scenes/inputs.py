"""Inputs: every request, frames with each defect, damage, and nothing at all."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import fields, replace
from functools import partial
from itertools import combinations
from typing import Final, TypeAlias

from haptogram_protocol import messages as m
from haptogram_protocol.framing import HEADER_BYTES, MAX_BODY_BYTES

from ..actions import FAULT, PARTS, SLOT_US, ActionSlots, DialogueAction
from ..host import NO_SESSION, DialogueHost
from ..makers.field_values import (
    MANY_LOOPS,
    REFUSED_CONFIG,
    FieldValue,
    field_values,
    play_values,
)
from ..makers.frames import DEFECTS, HELLOS, ODD_FLAGS, WRONG_SESSIONS, At
from ..makers.requests import RandomRequests

_UNKNOWN_TYPES: Final = (0x00, 0x04, 0x3F, 0x50, 0x7E, 0x7F, 0x80, 0x90, 0xBF, 0xC0, 0xFF)
_LARGEST: Final = MAX_BODY_BYTES - HEADER_BYTES
_DAMAGES: Final = (1, 2, 3, 5)
#: First words of names that a state is likely to treat alike.
_GROUPS: Final = (
    *("any with", "HELLO", "type ", "another ", "refused ", "a frame", "a foreign frame", "damage"),
    *("GET_", "read ", "UPLOAD_", "PLAY"),
)
#: Loops of a playback that goes on: 0 for ever; 2 or 3 frames wrap a product of 32 bits.
_MANY_OR_ALL: Final = (0, 0, *MANY_LOOPS)
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
#: Steps to a state: PLAY for so many slots ahead, with so many loops.
_PLAYS: Final[dict[str, tuple[float, tuple[int, ...]]]] = {
    "PLAY that waits": (100.0, _MANY_OR_ALL),
    "PLAY for ever": (0.5, (0,)),
    "PLAY once": (0.5, (1,)),
    "PLAY once, soon": (4.5, (1,)),
    "PLAY once, later": (7.5, (1,)),
}
_TIMERS: Final = "timers "  # lease and hold in slots, ramp in ms (-: it never ends, any)
_Makers: TypeAlias = dict[str, Callable[[], DialogueAction]]
_LAST: Final = DialogueAction(
    0, "the last request again", lambda host: host.last or host.request(m.Ping(0)), ends_slot=True
)
_FAULT: Final = DialogueAction(0, "the hardware fails", lambda _: b"", FAULT)


class SceneInputs:
    """Makes the inputs of a board.

    Parameters
    ----------
    makers : RandomRequests
        Makes frames.

    Attributes
    ----------
    makers : RandomRequests
        The same.
    kinds : dict of str to list of str
        Names of the inputs, by kind.
    groups : dict of str to list of str
        Names that a state is likely to treat alike, by that of their group.
    """

    def __init__(self, makers: RandomRequests) -> None:
        self.makers, self._pick = makers, makers.conditions.random.choice
        exact = makers.conditions.exact
        of_kind: dict[str, _Makers] = {
            "frame": self._frames(),
            "request": self._requests(),
            "playback": self._playbacks(),
            "configuration": self._configs(),
            "value": {"a frame with any value": self.with_any_value},
            "HELLO": {f"HELLO {which}": partial(makers.hello, which) for which in HELLOS},
            "odd": self._odd_requests(),
            "damage": {
                f"damage {damage}": partial(self._damaged, damage)
                for damage in (*_DAMAGES, *(PARTS,) * exact)
            },
            "limit": {"a frame at a limit": partial(self.frame, "at a limit")} if exact else {},
            "fault": {"a fault": lambda: _FAULT} if exact else {},
        }
        self.kinds = {kind: list(some) for kind, some in of_kind.items() if some}
        self.kinds["burst"] = ["a burst"]
        self.names = [name for names in self.kinds.values() for name in names]
        self.names += ("nothing", "frames of some slots", "two frames at once", "an upload")
        self.groups: dict[str, list[str]] = {}
        for name in self.names:
            group = next((first for first in _GROUPS if name.startswith(first)), name)
            self.groups.setdefault(group, []).append(name)
        one = {name: make for some in of_kind.values() for name, make in some.items()}
        one |= self._steps() | self._steps_of_playbacks()
        self._made = self._rows() | {name: partial(_alone, make) for name, make in one.items()}

    def named(self, name: str) -> list[DialogueAction]:
        """Return the frames that have a name: of :attr:`names`, or a step to a state."""
        if name.startswith(_TIMERS):
            lengths = (None if word == "-" else int(word) for word in name.split()[1:])
            return self._configured(self.makers.configs.timed_config(*lengths))
        return self._made[name]()

    def knows(self, row: str) -> bool:
        """Return True if all in a row has a name."""
        names = {name for slot in _row_names(row) for name in slot}
        return all(name in self._made or name.startswith(_TIMERS) for name in names)

    def slots(self, row: str) -> ActionSlots:
        """Return the frames of a row: names of a slot (+), slot by slot (|)."""
        return [[one for name in names for one in self.named(name)] for names in _row_names(row)]

    def frame(self, at: At, **odd: int) -> DialogueAction:
        """Return a stream frame of any kind; see :meth:`~..makers.frames.RandomFrames.frame`."""
        return self.makers.frame(self.makers.any(), at, **odd)

    # --- steps to a state ------------------------------------------------------------------------

    def _steps(self) -> _Makers:
        """Return functions that make one action each, such as a frame, by name in a scene."""
        makers = self.makers
        return {
            "a frame due now": partial(self.frame, 0.0),
            "a frame a period ahead": partial(self.frame, 0.0, apart_us=25),
            "a keeping request": makers.keeping,
            "the same HELLO": partial(makers.again, "hello", 0),
            "the HELLO of a session before": partial(makers.again, "hello", 1),
            "the first request of this nonce": partial(makers.again, "first", 0),
            "the first request of a session before": partial(makers.again, "first", 1),
            "the last request of a session before": partial(makers.again, "last", 1),
        }

    def _steps_of_playbacks(self) -> _Makers:
        """Return functions that make one PLAY each, by name in a scene; {} without playback."""
        makers = self.makers
        if not makers.plays:
            return {}
        found: _Makers = {name: partial(makers.start, *how) for name, how in _PLAYS.items()}
        return found | {
            "PLAY unattended": lambda: makers.start(
                0.5, _MANY_OR_ALL, makers.configs.short_unattended_ms
            ),
            "PLAY at once": makers.play_at_once,
            "a long PLAY": makers.long_play,
            "a short PLAY": makers.short_play,
        }

    def _rows(self) -> dict[str, Callable[[], list[DialogueAction]]]:
        """Return functions that make a list of actions each, by name in a scene."""
        makers, configs = self.makers, self.makers.configs
        return {
            "nothing": list,
            "frames of some slots": lambda: [self.frame(n + 0.5) for n in range(4)],
            "two frames at once": makers.pair,
            "a burst": makers.burst,
            "many frames far ahead": makers.many_far,
            "frames": lambda: makers.row(self._pick((1, 2, 3, 5)), SLOT_US // 2),
            "an upload": makers.upload,
            "a begun upload": lambda: makers.upload()[:2],
            "a long upload": makers.long_upload,
            "traces": lambda: self._configured(configs.traced_config(m.TraceMode.CRC, 1)),
            "a ring": lambda: self._configured(configs.traced_config(m.TraceMode.RING, 1)),
            "no trace": lambda: self._configured(replace(configs.last, trace_mode=m.TraceMode.OFF)),
            "some traces": lambda: self._configured(
                configs.traced_config(None, self._pick((2, 3)))
            ),
        }

    def _configured(self, config: m.Config) -> list[DialogueAction]:
        """Return DISARM, SET_CONFIG with *config* and ARM as actions."""
        return [
            self.makers.frame(message) for message in (m.Disarm(), m.SetConfig(config), m.Arm())
        ]

    # --- frames of the stream --------------------------------------------------------------------

    def _frames(self) -> _Makers:
        """Return functions that make one stream frame each, odd or refused ones too, by name."""
        conditions = self.makers.conditions
        found: _Makers = {name: partial(self._odd_frame, *odd) for name, odd in _FRAMES.items()}
        found["a refused frame"] = lambda: self.makers.frame(self.makers.refused(), 0.5)
        if conditions.timed:
            ahead = (1.5, 1.5, 2.5, 3.5, 6.5)
            found["a frame some slots ahead"] = lambda: self.frame(self._pick(ahead))
        return found

    def _odd_frame(self, at: At, choices: dict[str, tuple[int, ...]]) -> DialogueAction:
        """Return a stream frame with odd fields, each of *choices* set to one of its values there.

        *at* is when it is due: slots of 40 ms ahead, or a name such as "late".
        """
        return self.frame(at, **{name: self._pick(values) for name, values in choices.items()})

    # --- requests --------------------------------------------------------------------------------

    def _requests(self) -> _Makers:
        """Return functions that make one request of each kind, by its name."""
        messages = self.makers.messages().items()
        return {name: partial(self._plain, make) for name, make in messages}

    def _playbacks(self) -> _Makers:
        """Return functions that make one playback request each, by name; {} without playback."""
        makers = self.makers
        found: _Makers = {
            "PLAY": makers.any_play,
            "PLAY in half a slot": partial(makers.start, 0.5),
            "STOP of a playback": lambda: makers.frame(m.Stop()),
        }
        return found if makers.plays else {}

    def _plain(self, make: Callable[[], m.Message]) -> DialogueAction:
        """Return the action that sends the request from *make*."""
        return self.makers.frame(make())

    def _configs(self) -> _Makers:
        """Return functions that make one SET_CONFIG each, changed or refused ones, by name."""
        configs = self.makers.configs
        changes: dict[str, Callable[[], m.Config]] = {
            "another configuration": configs.config,
            **{f"another {f.name}": partial(configs.changed, f.name) for f in fields(m.Config)},
            **{f"refused {name}": partial(configs.refused, name) for name in REFUSED_CONFIG},
        }
        return {name: partial(self._config, make) for name, make in changes.items()}

    def _config(self, make: Callable[[], m.Config]) -> DialogueAction:
        """Return a SET_CONFIG with the configuration from *make* as an action."""
        return self.makers.frame(m.SetConfig(make()))

    # --- what is odd about a request -------------------------------------------------------------

    def _odd_requests(self) -> _Makers:
        """Return functions that make one malformed, unknown or repeated request each, by name."""
        makers = self.makers
        found: _Makers = {f"any with {one}": partial(self._any_with, one) for one in DEFECTS}
        found |= {f"type {kind:#x}": partial(self._unknown, kind) for kind in _UNKNOWN_TYPES}
        found["foreign MUTE"] = lambda: makers.defective(m.Mute(), "another session")
        found["the remembered request again"] = makers.repeated
        found["the last request again"] = lambda: _LAST
        return found

    def defects(self) -> Iterator[tuple[str, ...]]:
        """Yield every request with every defect and with every two of them, by their names."""
        alone = [(defect,) for defect in DEFECTS]
        pairs = [
            (one, other)
            for one, other in combinations(DEFECTS, 2)
            if DEFECTS[one].keys().isdisjoint(DEFECTS[other])
        ]
        for name in self.makers.messages():
            yield from ((name, *some) for some in (*alone, *pairs))

    def defective(self, name: str, *defects: str) -> DialogueAction:
        """Return the request with the defects."""
        return self.makers.defective(self.makers.messages()[name](), *defects)

    def _any_with(self, defect: str) -> DialogueAction:
        """Return a random request with the defect of this name in DEFECTS."""
        return self.defective(self._pick(list(self.makers.messages())), defect)

    def _unknown(self, kind: int) -> DialogueAction:
        """Return a frame of the unknown message type *kind*, with a payload of random size."""
        size = self._pick((0, 1, 20, 256, 1000, _LARGEST - 1, _LARGEST))
        payload = self._pick((b"\0", b"U")) * size  # the one is stuffed, the other not
        session = self._pick((0, 0, *WRONG_SESSIONS))
        message = self.makers.any() if kind in m.STREAM_RANGE else m.Ping(0)
        action = self.makers.frame(message, 0.5, session=session)
        return action._replace(
            name=f"type {kind:#x}",
            body=lambda host: bytes([kind]) + action.body(host)[1:HEADER_BYTES] + payload,
        )

    def _damaged(self, damage: int) -> DialogueAction:
        """Return a stream frame or a PING whose bytes are damaged; *damage* numbers the way."""
        action = self._pick((self.frame(0.5), self.makers.frame(m.Ping(0))))
        return action._replace(name=f"damage {damage}", damage=damage)

    # --- one field of any value ------------------------------------------------------------------

    def with_any_value(self) -> DialogueAction:
        """Return a frame with another value of one field: each once in a run before any twice."""
        found: FieldValue = self.makers.conditions.next("values of fields", self.values)
        message, offset, value = found
        makers, end = self.makers, offset + len(value)
        is_hello = isinstance(message, m.Hello)
        action = makers.hello("open") if is_hello else makers.frame(message, 0.5)

        def body(host: DialogueHost) -> bytes:
            whole = action.body(host)
            return whole[:offset] + value + whole[end:]

        # A MUTE has a write of its own: it may overtake what is sent with it.
        is_mute = (offset, value[0]) == (m.Header.WIRE["type"].offset, m.Mute.TYPE)
        wait_us = int(is_mute and makers.conditions.exact)
        return action._replace(name=f"{action.name} with a value", body=body, wait_us=wait_us)

    def values(self) -> list[FieldValue]:
        """Return every frame that :meth:`with_any_value` may return."""
        makers, identity = self.makers, self.makers.conditions.identity
        stream = [make() for make in makers.kinds.values()]
        messages = [*makers.whole_requests(), *stream, m.Hello(m.VERSION_MAJOR, 0, 1)]
        found = [*field_values(identity, messages)]
        return [*found, *play_values(identity)] if makers.plays else found


def _alone(make: Callable[[], DialogueAction]) -> list[DialogueAction]:
    """Return a list of the one action from *make*."""
    return [make()]


def _row_names(row: str) -> list[list[str]]:
    """Return the action names of each slot of a row: '|' parts slots, '+' parts actions."""
    slots = (slot.split("+") for slot in row.split("|"))
    return [[name.strip() for name in names if name.strip()] for names in slots]
