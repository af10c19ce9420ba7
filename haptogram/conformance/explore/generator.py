"""Random dialogues: which actions, in which order and at which times."""

from __future__ import annotations

import random
from typing import Final

from haptogram_protocol.messages import Config, Feature, HelloReply, Mute, Ping

from .actions import DialogueAction
from .coverage import DialogueCoverage
from .request_actions import RandomRequests
from .stream_actions import MadeAction, RandomStream

_AT_ONCE: Final = (
    "at once",
    "for late",
    "for too late",
    "PLAY",
    "again",
)  # in the text of such an action
_UNKNOWN_TYPES: Final = (0x3F, 0x7E, 0x90, 0xC8)
_QUIET: Final = (3, 4, 6)  # slots in which nothing is sent, so that timers end
_QUIET_SHARE: Final = 0.15  # of the slots
_CANDIDATES: Final = 3
_DISARMING: Final = ("MUTE", "DISARM", "HELLO last", "HELLO earlier", "HELLO new")
#: Kinds of actions, how often they are sent, and by what a dialogue multiplies that: dialogues that
#: lack a kind, or have much of one, come further than those in which everything is likely.
_STREAM, _REQUEST, _LIMITS, _HELLO, _ODD = range(5)
_WEIGHTS: Final = (9, 9, 4, 2, 3)
_SWARM: Final = (0.2, 1, 1, 3)


class DialogueGenerator:
    """Makes random dialogues for one board.

    Parameters
    ----------
    identity : HelloReply
        The board, with its capabilities and limits.
    seed : int
        The same seed gives the same dialogue, after the same dialogues.
    coverage : DialogueCoverage, optional
        What dialogues before have sent.
    """

    def __init__(
        self, identity: HelloReply, seed: int, coverage: DialogueCoverage | None = None
    ) -> None:
        self._random = random.Random(seed)
        coverage = coverage or DialogueCoverage()
        self._pairs = coverage.pairs
        self._stream = RandomStream(identity, self._random)
        self._requests = RandomRequests(identity, self._random, coverage)
        self._is_configurable = bool(identity.features & Feature.CONFIG)
        self._weights = [weight * self._random.choice(_SWARM) for weight in _WEIGHTS]
        self._last = ""
        self._is_armed = False

    def config(self) -> Config:
        """Return the configuration that a dialogue begins with."""
        return self._requests.config()

    def actions(self, slots: int) -> list[DialogueAction]:
        """Return a random dialogue of so many slots."""
        made: list[DialogueAction] = []
        slot = 0
        while slot < slots:
            batch = self._batch(slot)
            batch.sort(key=lambda action: not action.text.startswith(Mute.TYPE.name))
            made += [action for action in batch if not action.ends_slot]
            chance = self._random.random()
            is_quiet = self._random.random() < _QUIET_SHARE
            if is_quiet and chance < 0.4 and self._is_configurable:
                made.append(self._whole(slot, self._requests.new_config()))
            elif chance < 0.6:
                made.append(self._whole(slot, self._requests.status()))
            made += [action for action in batch if action.ends_slot][:1]
            slot += self._random.choice(_QUIET) if is_quiet else 1
            self._is_armed &= not is_quiet
        return made

    def _batch(self, slot: int) -> list[DialogueAction]:
        if self._random.random() < 0.08 and (upload := self._requests.upload()):
            return [self._whole(slot, step) for step in upload]
        found: list[DialogueAction] = []
        if not self._is_armed and self._random.random() < 0.6:
            found.append(self._whole(slot, self._requests.arm()))
            self._is_armed = True
        number = self._random.choice((0, 1, 2, 2, 3, 4, 6))
        return found + [self._rarest(slot) for _ in range(number)]

    def _rarest(self, slot: int) -> DialogueAction:
        """Return the one of a few actions that has followed the last one least often."""
        kind = self._random.choices(range(len(_WEIGHTS)), self._weights)[0]
        if kind == _LIMITS:
            made = self._requests.at_limit(slot)
        else:
            candidates = [self._made(slot, kind) for _ in range(_CANDIDATES)]
            made = min(candidates, key=lambda one: self._pairs[self._last, one[0]])
        name = made[0]
        self._pairs[self._last, name] += 1
        self._last = name
        self._is_armed = name == "ARM" or (self._is_armed and not name.startswith(_DISARMING))
        return self._whole(slot, made) if name.startswith("HELLO") else self._named(slot, made)

    def _whole(self, slot: int, made: MadeAction) -> DialogueAction:
        return self._named(slot, made, may_break=False)

    def _named(self, slot: int, made: MadeAction, *, may_break: bool = True) -> DialogueAction:
        _, text, body = made
        damage = 0
        if may_break:
            damage = self._random.choices((0, 1, 2, 3, 4), (16, 1.2, 0.5, 0.3, 0.05))[0]
        named = (
            text
            + ("", ", a bit inverted", ", cut short", ": noise instead", ": long noise instead")[
                damage
            ]
        )
        ends_slot = any(word in text for word in _AT_ONCE)
        return DialogueAction(slot, named, body, damage, self._random.getrandbits(32), ends_slot)

    def _made(self, slot: int, kind: int) -> MadeAction:
        if kind == _STREAM:
            return self._stream.frame(slot)
        if kind == _REQUEST:
            return self._requests.request(slot)
        return self._requests.hello() if kind == _HELLO else self._odd(slot)

    def _odd(self, slot: int) -> MadeAction:
        """Return a frame of an unknown type, of a wrong length, or the last request again."""
        kind = self._random.choice(_UNKNOWN_TYPES)
        name, text, body = self._random.choice((self._stream.frame, self._requests.request))(slot)
        chance = self._random.random()
        if chance < 0.5:
            again = Ping(slot)
            repeated = "the last request again"
            return repeated, repeated, lambda host: host.last or host.request(again)
        if chance < 0.75:
            text = f"{text}, as type {kind:#x}"
            return "unknown type", text, lambda host: bytes([kind]) + body(host)[1:]
        return f"{name} too long", f"{text}, a byte too long", lambda host: body(host) + b"\x00"
