"""States that a board is brought into, each by the inputs of some slots."""

from __future__ import annotations

from typing import Final

from ..actions import ActionSlots
from .inputs import SceneInputs

#: States in which no timer runs that ends soon: inputs of a slot (+), slot by slot (|).
QUICK_STATES: Final = {
    "disarmed": "DISARM",
    "armed": "ARM",
    "sounding": "ARM + a frame at once",
    "with a frame in the queue": "ARM + a frame far ahead",
    "with a full queue": "ARM" + 4 * " | many frames far ahead",
    "muted": "ARM + a frame at once | MUTE",
    "muted by another host": "ARM + a frame at once | foreign MUTE",
    "with a ring that has a hole": ("a ring + frames | no trace + frames | a ring + frames"),
    "with latches of which some are traced": "some traces + frames",
    "with a playback that waits": "ARM + PLAY that waits",
    "in an upload": "a begun upload",
}
#: States in which timers run, or have run.
TIMED_STATES: Final = {
    "in a playback": "ARM + PLAY for ever |",
    "behind a playback": "timers 3 - - + PLAY once |",
    "in a playback, unattended": "timers 3 - - + PLAY unattended |",
    "muted as unattended": "timers 3 - - + PLAY unattended | | | | |",
    "with a playback that soon begins": "timers 2 - - + PLAY once, soon",
    "in the hold, before a playback": "timers - 4 - + PLAY once, later + a frame at once |",
    "with a lease that runs": "timers 1 - -",
    "in the hold": "timers - 4 - + a frame at once |",
    "in the ramp of the hold": "timers - 2 178 + a frame at once | | |",
    "in the ramp of the lease": "timers 1 - 178 + a frame at once | |",
    "in the ramp of the hold, the lease out too": "timers 3 2 178 + a frame at once | | | |",
    "in the ramp of the lease, the hold out too": "timers 1 2 178 + a frame at once | | |",
    "muted by the hold": "timers - 2 0 + a frame at once | | |",
    "muted by the lease": "timers 1 - 0 + a frame at once | |",
}


class SceneMaker:
    """Makes scenes: a state, and the inputs that the board gets in it.

    Parameters
    ----------
    inputs : SceneInputs
        Makes the inputs of a board.

    Attributes
    ----------
    quick, timed : list of str
        States that the board can be brought into: without timers that end, and with such.
    """

    def __init__(self, inputs: SceneInputs) -> None:
        self._inputs, self._makers = inputs, inputs.makers
        self._random, self._next = self._makers.conditions.random, self._makers.conditions.next
        self.quick = [state for state, row in QUICK_STATES.items() if inputs.knows(row)]
        self.timed = [state for state, row in TIMED_STATES.items() if inputs.knows(row)]

    def _state(self, state: str) -> ActionSlots:
        """Return the actions, slot by slot of 40 ms, that bring the board into the state named."""
        return self._inputs.slots((QUICK_STATES | TIMED_STATES)[state])
