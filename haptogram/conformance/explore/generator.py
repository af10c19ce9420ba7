"""Random dialogues: which actions, in which order and at which times."""

from __future__ import annotations

import dataclasses
import random
from typing import Final

from haptogram_protocol.messages import Arm, Config, Feature, HelloReply, Mute, Ping

from .actions import DialogueAction
from .makers.conditions import DialogueConditions
from .makers.makers import DialogueMakers
from .makers.stream import MadeAction
from .scenes.scenes import RandomScenes
from .scenes.told import Told
from .tables.coverage import DialogueCoverage

#: In the name of an action whose latch may follow at once.
_AT_ONCE: Final = ("at once", "for late", "for too late", "for at a limit", "PLAY", "again")
_UNKNOWN_TYPES: Final = (0x00, 0x04, 0x3F, 0x50, 0x7E, 0x7F, 0x80, 0x90, 0xBF, 0xC0, 0xFF)
_QUIET: Final = (3, 4, 6)  # slots in which nothing is sent, so that timers end
_QUIET_SHARE: Final = 0.15  # of the slots of a dialogue with timers
_LONG_QUIET: Final = 12  # slots of a long playback
_SCENE_SHARE: Final = 0.3  # of the slots of a dialogue with timers
#: Of the slots, with a scene out of the tables: of a dialogue with timers and of one without; where
#: bytes arrive to the microsecond no slot has to be waited for.
_TABLE_SHARES: Final = {(True, True): 0.7, (True, False): 0.3, (False, True): 0.1}
_TABLE_SHARE: Final = 0.06
_GREETING_SHARE: Final = 0.4  # of the dialogues, with numbers that wrap
_SCENE: Final = (5, 6, 6, 8)  # slots in which timers run
_PAIR_SHARE: Final = 0.12
_CANDIDATES: Final = 3
#: Of the frames that begin a slot, and of the others: they come some microseconds later.
_FIRST_APART: Final = 0.4
_APART: Final = 0.06
_DISARMING: Final = ("MUTE", "DISARM", "HELLO last", "HELLO earlier", "HELLO new", "HELLO near")
#: Kinds of actions, how often they are sent, and by what a dialogue multiplies that: dialogues that
#: lack a kind, or have much of one, come further than those in which everything is likely.
_STREAM, _REQUEST, _LIMITS, _HELLO, _ODD, _BURST, _LONG = range(7)
_WEIGHTS: Final = (9, 9, 3, 1.5, 3, 0.6, 0.6)
_SWARM: Final = (0.2, 1, 1, 3)
_SEEN: Final = (0.15, 0.6, 1.0)  # share of the slots after which the board is read
_DAMAGES: Final = (0, 1, 2, 3, 4, 5)
_DAMAGE_WEIGHTS: Final = (24, 1.2, 0.5, 0.3, 0.05, 0.4)
_DAMAGE_TEXT: Final = (
    "",
    ", a bit inverted",
    ", cut short",
    ": noise instead",
    ": long noise instead",
    ": a short run instead",
    ", its first part",
    "",
    "",
)


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
    timed : bool
        Whether timers end in the dialogue: else no slot of it has to be waited for.
    exact : bool
        Whether bytes arrive to the microsecond.
    slow : bool
        Whether the line cannot carry a drive for each of several latches in a slot.
    """

    def __init__(
        self,
        identity: HelloReply,
        seed: int,
        coverage: DialogueCoverage | None = None,
        *,
        timed: bool = True,
        exact: bool = False,
        slow: bool = True,
    ) -> None:
        self._random = source = random.Random(seed)
        coverage = coverage or DialogueCoverage()
        self._pairs = coverage.pairs
        fast = not slow or source.random() < 0.5
        self._has_long = fast and source.random() < 0.5
        drives = not self._has_long and not (slow and fast)
        self._may_burst = exact or not drives  # the line has to carry what is traced
        conditions = DialogueConditions(
            identity, source, coverage, timed=timed, exact=exact, fast=fast, drives=drives
        )
        makers = DialogueMakers(conditions)
        self._configs, self._sessions = makers.configs, makers.sessions
        self._stream, self._requests = makers.stream, makers.requests
        self._scenes = RandomScenes(makers)
        self._table_share = _TABLE_SHARES.get((timed, exact), _TABLE_SHARE)
        self._timed, self._exact = timed, exact
        self._seen = self._random.choice(_SEEN)
        self._is_configurable = bool(identity.features & Feature.CONFIG)
        self._weights = [weight * self._random.choice(_SWARM) for weight in _WEIGHTS]
        self._weights[_LONG] *= self._has_long and not timed
        self._last = ""
        self._is_armed = False
        self._script: list[MadeAction] = []

    def config(self) -> Config:
        """Return the configuration that a dialogue begins with: no STATUS before slot 0."""
        return dataclasses.replace(self._configs.config(), status_period_ms=0)

    def before_hello(self) -> list[DialogueAction]:
        """Return actions for slots before 0, in which a board has no session."""
        told = self._scenes.before_hello()
        slots = range(-len(told), 0)
        made = [
            self._told(slot, one) for slot, some in zip(slots, told, strict=True) for one in some
        ]
        return self._apart(made) if self._exact else made

    def actions(self, slots: int) -> list[DialogueAction]:
        """Return a random dialogue of so many slots."""
        made: list[DialogueAction] = []
        slot = 0
        if self._configs.with_status:
            made.append(self._whole(slot, self._requests.new_config()))
            slot = 1
        elif self._random.random() < _GREETING_SHARE:
            made.append(self._whole(slot, self._sessions.greeting()))
            slot = 1
        while slot < slots:
            chance = self._random.random()
            if chance < self._table_share:
                for told in self._scenes.scene():
                    made += [self._told(slot, one) for one in told]
                    slot += 1
                self._is_armed = False
                continue
            if self._timed and chance < self._table_share + _SCENE_SHARE:
                made += self._scene(slot)
                slot = made[-1].slot + 1
                continue
            batch = self._batch(slot)
            batch.sort(key=lambda action: not action.text.startswith(Mute.TYPE.name))
            made += [action for action in batch if not action.ends_slot]
            is_quiet = self._random.random() < _QUIET_SHARE * self._timed
            if is_quiet and self._random.random() < 0.4 and self._is_configurable:
                made.append(self._whole(slot, self._requests.new_config()))
            elif self._random.random() < self._seen:
                made += [self._whole(slot, one) for one in self._requests.probe()]
            last = [action for action in batch if action.ends_slot][:1]
            made += last
            slot += self._random.choice(_QUIET) if is_quiet else 1
            if self._has_long and any("loops=300" in a.text for a in batch):
                slot += _LONG_QUIET
            elif self._has_long and any("loops=100" in a.text for a in batch):
                slot += _LONG_QUIET // 3
            self._is_armed &= not is_quiet
        return self._apart(made) if self._exact else made

    def _apart(self, actions: list[DialogueAction]) -> list[DialogueAction]:
        """Let the bytes of some slots, and some frames in them, come within a carrier period."""
        found: list[DialogueAction] = []
        for action in actions:
            is_first = not found or found[-1].slot != action.slot
            if not action.wait_us and self._random.random() < (
                _FIRST_APART if is_first else _APART
            ):
                action = dataclasses.replace(action, wait_us=self._random.randrange(1, 26))
            found.append(action)
        return found

    def _batch(self, slot: int) -> list[DialogueAction]:
        if not self._script and self._random.random() < 0.12:
            self._script = self._requests.uploads.upload()
        found: list[DialogueAction] = []
        if not self._is_armed and self._random.random() < 0.6:
            found.append(self._whole(slot, self._requests.plain(Arm())))
            self._is_armed = True
        steps = self._random.choice((0, 1, 2, 2, 8))
        found += [self._whole(slot, step) for step in self._script[:steps]]
        self._script = self._script[steps:]
        if self._random.random() < _PAIR_SHARE:
            pair = [self._whole(slot, made) for made in self._stream.pair()]
            found += pair
        number = self._random.choice((0, 1, 2, 2, 3, 4, 6))
        for _ in range(number):
            found += self._rarest(slot)
        return found

    def _scene(self, slot: int) -> list[DialogueAction]:
        """Return slots in which timers run: something sounds or plays, and nothing renews them.

        Or only frames of one kind come: such that renew the lease, or such that must not.
        """
        pick = self._random.choice
        made = [self._whole(slot, self._requests.plain(Arm()))]
        what = pick(("frame", "frame at once", "queue", "play", "play", "nothing"))
        if what == "play" and self._requests.plays:
            made.append(self._whole(slot, self._requests.start()))
        elif what == "queue":
            made += [self._whole(slot, self._stream.plain(n + 0.5)) for n in range(pick(_SCENE))]
        elif what.startswith("frame"):
            ahead = None if what == "frame at once" else 0.5
            made.append(self._whole(slot, self._stream.plain(ahead)))
        end, filler = slot + pick(_SCENE), pick(("", "", "broken", "foreign", "keeping"))
        if pick((0, 1)):
            made += self._disturbance(pick(range(slot + 1, end)))
        keeping = self._requests.keeping()
        for place in range(slot + 2, end):
            if filler == "keeping":
                made.append(self._whole(place, keeping))
            elif filler == "broken":
                made.append(
                    self._named(place, self._made(pick((_STREAM, _REQUEST))), pick((1, 2, 5)))
                )
            elif filler == "foreign":
                made.append(self._whole(place, self._stream.foreign()))
        made += [self._whole(end, one) for one in self._requests.probe()]
        self._is_armed = False
        return made

    def _disturbance(self, slot: int) -> list[DialogueAction]:
        """Return an action that may change timers that run, or a ramp."""
        pick = self._random.choice
        what = pick(("any", "any", "configuration", "request", "ARM"))
        if what == "any":
            return self._rarest(slot)[-1:]
        if what == "configuration" and self._is_configurable:
            return [self._whole(slot, self._requests.new_config())]
        made = self._requests.plain(Arm()) if what == "ARM" else self._requests.keeping()
        return [self._whole(slot, made)]

    def _rarest(self, slot: int) -> list[DialogueAction]:
        """Return the one of a few actions that has followed the last one least often."""
        kind = self._random.choices(range(len(_WEIGHTS)), self._weights)[0]
        if kind == _BURST:
            return [
                self._whole(slot, made) for made in self._stream.burst(may_latch=self._may_burst)
            ]
        if kind == _LIMITS:
            made = self._requests.at_limit()
        elif kind == _LONG:
            made = self._requests.long_play()
        else:
            candidates = [self._made(kind) for _ in range(_CANDIDATES)]
            made = min(candidates, key=lambda one: self._pairs[self._last, one[0]])
        name = made[0]
        self._pairs[self._last, name] += 1
        self._last = name
        self._is_armed = name == "ARM" or (self._is_armed and not name.startswith(_DISARMING))
        return [self._named(slot, made)]

    def _whole(self, slot: int, made: MadeAction) -> DialogueAction:
        return self._named(slot, made, 0)

    def _told(self, slot: int, told: Told) -> DialogueAction:
        action = self._named(slot, told.made, told.damage)
        return dataclasses.replace(action, wait_us=told.wait_us)

    def _named(self, slot: int, made: MadeAction, damage: int | None = None) -> DialogueAction:
        name, text, body = made
        if damage is None:
            damage = self._random.choices(_DAMAGES, _DAMAGE_WEIGHTS)[0]
        ends_slot = not self._exact and any(word in name for word in _AT_ONCE)
        text += _DAMAGE_TEXT[damage]
        return DialogueAction(slot, text, body, damage, self._random.getrandbits(32), ends_slot)

    def _made(self, kind: int) -> MadeAction:
        if kind == _STREAM:
            return self._stream.frame()
        if kind == _REQUEST:
            return self._requests.request()
        return self._sessions.hello() if kind == _HELLO else self._odd()

    def _odd(self) -> MadeAction:
        """Return a frame of an unknown type, or the last request again."""
        kind = self._random.choice(_UNKNOWN_TYPES)
        _, text, body = self._random.choice((self._stream.frame, self._requests.request))()
        again = Ping(0)
        if self._random.random() < 0.6:
            repeated = "the last request again"
            return repeated, repeated, lambda host: host.last or host.request(again)
        text = f"{text}, as type {kind:#x}"
        return f"type {kind:#x}", text, lambda host: bytes([kind]) + body(host)[1:]
