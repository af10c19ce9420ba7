"""The virtual board as a model, in a process of its own, at the device times of a board."""

from __future__ import annotations

import json
import sys
from typing import Final

from haptogram_protocol.errors import RemoteProtocolError
from haptogram_protocol.framing import FrameDecoder
from haptogram_protocol.messages import Feature, HelloReply, parse_body

from ..outcome import CaseEndedError
from ..verdict import Behaviour
from .comparison import FrameInDialogue
from .stepped_process import LockstepProcess

_MODEL: Final = "sim_device.driven.stepped_board"
_STORE_BYTES: Final = 1 << 20  # more than a dialogue stores
#: Limits that the model takes from HELLO_REPLY.
_LIMITS: Final = (
    "grid_nx",
    "grid_ny",
    "pitch_um",
    "features",
    "queue_depth",
    "max_horizon_us",
    "latch_lead_us",
    "point_time_us",
    "trace_ring",
    "max_points",
    "max_sequence_frames",
    "max_upload_bytes",
    "max_playback_rate_hz",
    "max_unattended_ms",
    "upload_window",
    "max_chunk",
)


class DialogueModel:
    """A healthy board like the one under test; times are device times of that one, unwrapped.

    Parameters
    ----------
    identity : HelloReply
        The board under test.

    Raises
    ------
    CaseEndedError
        INCONCLUSIVE, from every step: the process has ended.
    """

    def __init__(self, identity: HelloReply) -> None:
        limits = {name: int(getattr(identity, name)) for name in _LIMITS}
        limits["features"] &= int(sum(Feature))
        limits["max_stored_bytes"] = _STORE_BYTES + limits["max_upload_bytes"]
        self._process = LockstepProcess(
            [sys.executable, "-m", _MODEL, json.dumps(limits)], _dialogue_model_failure
        )
        self._boot_us = 0

    def close(self) -> None:
        """End the process."""
        self._process.close()

    def reset(self, boot_us: int) -> None:
        """Power the model up at a device time."""
        self._boot_us = boot_us
        self._process.step(f"reset {boot_us}")

    def receive(self, at_us: int, data: bytes) -> list[FrameInDialogue]:
        """Let *data* arrive; return the frames of the model."""
        return _frames_in_dialogue(self._process.receive(at_us - self._boot_us, data))

    def advance(self, end_us: int) -> list[FrameInDialogue]:
        """Let time pass; return the frames of the model, each event at its time."""
        said = b""
        now_us = -1
        while now_us < end_us - self._boot_us:
            now_us, more = self._process.advance_until_sent(end_us - self._boot_us)
            said += more
        return _frames_in_dialogue(said)

    def next_us(self) -> int | None:
        """Return when the model does something by itself; None: never."""
        answer = self._process.step("next")
        return None if answer == "-" else int(answer) + self._boot_us


def _frames_in_dialogue(data: bytes) -> list[FrameInDialogue]:
    found = []
    for body in FrameDecoder().feed(data):
        if isinstance(body, RemoteProtocolError):
            raise body
        found.append(FrameInDialogue(*parse_body(body), body))
    return found


def _dialogue_model_failure(text: str) -> Exception:
    return CaseEndedError(Behaviour.INCONCLUSIVE, f"the model beside the board: {text}")


def identity_suits_lockstep_model(identity: HelloReply) -> bool:
    """Return True if the virtual board can be made like this one: a grid, 40 kHz, the clock."""
    grid = identity.grid_nx * identity.grid_ny == identity.transducers > 0
    return grid and identity.carrier_hz == 40_000
