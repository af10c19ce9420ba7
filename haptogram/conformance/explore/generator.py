"""Random dialogues: which actions, in which order and at which times."""

from __future__ import annotations

import dataclasses
import random
from typing import Final

from haptogram_protocol import messages as m

from .actions import ActionSlots, DialogueAction
from .makers.conditions import DialogueConditions, DialogueCoverage
from .makers.requests import RandomRequests
from .scenes.inputs import SceneInputs
from .scenes.scenes import RandomScenes

#: Share of the slots with a scene: in a dialogue with timers, and in one without.
_SCENE_SHARE: Final = {True: 0.75, False: 0.07}
_GREETING_SHARE: Final = 0.4  # share of the dialogues with numbers that wrap
_PAIR_SHARE: Final = 0.12
_UPLOAD_SHARE: Final = 0.12
_CANDIDATES: Final = 3
#: Share of frames that are delayed by some microseconds: of the first in a slot, of the others.
_FIRST_APART: Final = 0.4
_APART: Final = 0.06
_DISARMING: Final = ("MUTE", "DISARM", "HELLO last", "HELLO earlier", "HELLO new", "HELLO near")
#: Kinds of inputs, how often they are sent, and by what a dialogue multiplies that: dialogues that
#: lack a kind, or have much of one, come further than those in which everything is likely.
_WEIGHTS: Final = {
    "frame": 7.0,
    "limit": 2.0,
    "request": 7.0,
    "playback": 2.5,
    "configuration": 1.0,
    "value": 3.0,
    "HELLO": 1.5,
    "odd": 4.0,
    "burst": 0.6,
}
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
        Inputs that earlier dialogues have sent.
    timed : bool
        Whether timers end in the dialogue: else no slot of it has to be waited for.
    exact : bool
        Whether bytes arrive to the microsecond.
    slow : bool
        Whether the line cannot carry a drive for each of several latches in a slot.
    """

    def __init__(
        self,
        identity: m.HelloReply,
        seed: int,
        coverage: DialogueCoverage | None = None,
        *,
        timed: bool = True,
        exact: bool = False,
        slow: bool = True,
    ) -> None:
        self._random = source = random.Random(seed)
        self._coverage = coverage = coverage or DialogueCoverage()
        fast = not slow or source.random() < 0.5
        drives = not (slow and fast) and source.random() < 0.5
        self._timed, self._exact = timed, exact
        self._makers = makers = RandomRequests(
            DialogueConditions(
                identity, source, coverage, timed=timed, exact=exact, fast=fast, drives=drives
            )
        )
        self._inputs = SceneInputs(makers)
        self._scenes = RandomScenes(self._inputs)
        self._seen = source.choice(_SEEN)
        self._weights = [weight * source.choice(_SWARM) for weight in _WEIGHTS.values()]
        self._last = ""
        self._is_armed = False
        self._script: list[DialogueAction] = []

    def config(self) -> m.Config:
        """Return the configuration that a dialogue begins with: no STATUS before slot 0."""
        return dataclasses.replace(self._makers.configs.config(), status_period_ms=0)

    def before_hello(self) -> list[DialogueAction]:
        """Return actions for slots before 0, in which a board has no session."""
        planned = self._scenes.before_hello()
        return self._apart(self._actions(-len(planned), planned))

    def actions(self, slots: int) -> list[DialogueAction]:
        """Return a random dialogue of *slots* slots."""
        planned: ActionSlots = []
        if self._makers.configs.with_status:
            planned.append(self._inputs.named("another configuration"))
        elif self._random.random() < _GREETING_SHARE:
            planned.append(self._inputs.named("HELLO wrapping"))
        while len(planned) < slots:
            if self._random.random() < _SCENE_SHARE[self._timed]:
                planned += self._scenes.scene()
                self._is_armed = False
            else:
                planned.append(self._batch())
        return self._apart(self._actions(0, planned))

    def _batch(self) -> list[DialogueAction]:
        """Return random actions, such as frames to send, for one slot of 40 ms."""
        found: list[DialogueAction] = []
        if not self._script and self._random.random() < _UPLOAD_SHARE:
            self._script = self._makers.upload()
        if not self._is_armed and self._random.random() < 0.6:
            found.append(self._makers.frame(m.Arm()))
            self._is_armed = True
        steps = self._random.choice((0, 1, 2, 2, 8))
        found += self._script[:steps]
        self._script = self._script[steps:]
        if self._random.random() < _PAIR_SHARE:
            found += self._makers.pair()
        for _ in range(self._random.choice((0, 1, 2, 2, 3, 5))):
            found += map(self._damaged, self._rarest())
        found.sort(key=lambda action: not action.name.startswith(m.Mute.TYPE.name))
        seen = self._makers.probe() if self._random.random() < self._seen else []
        if self._exact:
            return found + seen
        last = [action for action in found if action.ends_slot]
        return [*(action for action in found if not action.ends_slot), *seen, *last[:1]]

    def _rarest(self) -> list[DialogueAction]:
        """Return the one of 3 random inputs that has followed the last input least often."""
        (kind,) = self._random.choices(list(_WEIGHTS), self._weights)
        names = self._random.choices(
            self._inputs.kinds.get(kind, self._inputs.kinds["frame"]), k=_CANDIDATES
        )
        name = min(names, key=lambda one: self._coverage.pairs[self._last, one])
        self._coverage.pairs[self._last, name] += 1
        self._last = name
        self._is_armed = name == "ARM" or (self._is_armed and not name.startswith(_DISARMING))
        return self._inputs.named(name)

    def _damaged(self, action: DialogueAction) -> DialogueAction:
        """Return the action with a random kind of damage, unless it has one."""
        (damage,) = self._random.choices(_DAMAGES, _DAMAGE_WEIGHTS)
        return action._replace(damage=action.damage or damage)

    def _actions(self, first: int, planned: ActionSlots) -> list[DialogueAction]:
        """Return all actions of *planned*, each with the number of its slot, from *first* on.

        A slot is 40 ms.
        """
        return [
            one._replace(
                slot=number,
                name=one.name + _DAMAGE_TEXT[one.damage],
                seed=self._random.getrandbits(32),
            )
            for number, some in enumerate(planned, first)
            for one in some
        ]

    def _apart(self, actions: list[DialogueAction]) -> list[DialogueAction]:
        """Delay some actions by 1 to 25 µs, if bytes take no time on the line; else none."""
        found: list[DialogueAction] = []
        for action in actions if self._exact else ():
            is_first = not found or found[-1].slot != action.slot
            share = _FIRST_APART if is_first else _APART
            if not action.wait_us and self._random.random() < share:
                action = action._replace(wait_us=self._random.randrange(1, 26))
            found.append(action)
        return found or actions
