"""The virtual board as a model, in a process of its own, at the device times of a board.

A host at a wall clock knows within an interval only when the board under test hears a frame:
between the sending and the next answer.  So there are two models, of which one hears all frames as
early as that may be, and the other as late.  Where both live alike, so does a healthy board.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from typing import Final

from haptogram.errors import HaptogramError
from haptogram_protocol import messages as m
from haptogram_protocol.errors import RemoteProtocolError
from haptogram_protocol.framing import FrameDecoder

from ..client.wire import CLIENT_COBS
from ..outcome import CaseEndedError
from ..verdict import Behaviour
from .actions import LATE_WINDOWS_US, bodies_of_wire
from .comparison import (
    DialogueAnswers,
    DialogueBase,
    DialogueComparison,
    FrameInDialogue,
    superfluous_in_dialogue,
)
from .host import IMMEDIATE, DialogueHost
from .stepped_process import LockstepProcess, bytes_of_step, steps_of_bytes

_MODEL: Final = "sim_device.driven.stepped_board"
_STORE_BYTES: Final = 1 << 20  # memory of the model: more than a dialogue stores
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


class HostLateError(HaptogramError):
    """The host does not know when the board heard its bytes, and what is due depends on that."""


class DialogueModel:
    """A healthy board like the one under test; times are device times of that one, unwrapped.

    Steps are carried out when an answer is needed: together, so that host and model rarely wait
    for each other.

    Parameters
    ----------
    identity : HelloReply
        The board under test.

    Raises
    ------
    CaseEndedError
        INCONCLUSIVE, from every answer: the process has ended.
    """

    def __init__(self, identity: m.HelloReply) -> None:
        self._process = LockstepProcess(
            [sys.executable, "-m", _MODEL, limits_of_lockstep_model(identity)],
            _dialogue_model_failure,
        )
        self._boot_us, self._sent = 0, b""
        self._steps: list[str] = []

    def close(self) -> None:
        """End the process."""
        self._process.close()

    def reset(self, boot_us: int) -> None:
        """Power the model up at a device time; forget what it has sent."""
        self._boot_us, self._sent = boot_us, b""
        self._steps = [f"reset {boot_us}"]

    def receive(self, at_us: int, data: bytes) -> None:
        """Let *data* arrive."""
        self._steps += steps_of_bytes(at_us - self._boot_us, data)

    def advance(self, end_us: int) -> None:
        """Let time pass, each event at its time."""
        self._steps.append(f"through {end_us - self._boot_us}")

    def fault(self, at_us: int) -> None:
        """Let the hardware fail."""
        self._steps.append(f"fault {at_us - self._boot_us}")

    def frames(self) -> list[FrameInDialogue]:
        """Return the frames that the model has sent since the last call."""
        self._pass_steps()
        sent, self._sent = self._sent, b""
        return _frames_in_dialogue(sent)

    def next_us(self) -> int | None:
        """Return when the model does something by itself; None: never."""
        answer = self._pass_steps()
        return None if answer == "-" else int(answer) + self._boot_us

    def _pass_steps(self) -> str:
        """Pass the collected steps (bytes, faults, time) to the virtual board; keep what it sends.

        Returns when it next does something by itself, in microseconds as text; "-": never.
        """
        steps, self._steps = [*self._steps, "next"], []
        *answers, next_us = self._process.step(";".join(steps)).split(";")
        self._sent += b"".join(map(bytes_of_step, answers))
        return next_us


class DialogueModels:
    """Models that hear the same bytes as early, and as late, as the board may have.

    Parameters
    ----------
    identity : HelloReply
        The board under test.
    knows_time : bool
        Whether the host knows when the board hears bytes, as in virtual time: one model will do.

    Attributes
    ----------
    now_us : int
        Device time of the later one.

    Raises
    ------
    CaseEndedError
        INCONCLUSIVE, from every step: a process has ended.
    """

    def __init__(self, identity: m.HelloReply, *, knows_time: bool) -> None:
        self._early = DialogueModel(identity)
        self._late = None if knows_time else DialogueModel(identity)
        self._all = [model for model in (self._early, self._late) if model is not None]
        self._ready_us = identity.latch_lead_us + identity.max_points * identity.point_time_us
        self._later: list[FrameInDialogue] = []
        self._ahead: list[FrameInDialogue] = []
        self.now_us = 0

    def close(self) -> None:
        """End the processes."""
        for model in self._all:
            model.close()

    def reset(self, boot_us: int) -> None:
        """Power the models up at a device time."""
        self.now_us = boot_us
        self._later, self._ahead = [], []
        for model in self._all:
            model.reset(boot_us)

    def ask(self, at_us: int, data: bytes) -> FrameInDialogue:
        """Let a request arrive before the dialogue; return the answer."""
        self.now_us = at_us
        for model in self._all:
            model.receive(at_us, data)
        answers = [model.frames()[-1] for model in self._all]
        return answers[0]

    def receive(
        self, early_us: int, wires: Sequence[bytes], answered_us: Sequence[int] = ()
    ) -> None:
        """Let *wires* arrive: all at once, or each when the board has sent the next answer.

        Parameters
        ----------
        early_us : int
            Device time before which none can have arrived.
        wires : sequence of bytes
            The sent bytes, in pieces that each lead to one answer at most.
        answered_us : sequence of int
            When the board has sent its answers.

        Raises
        ------
        HostLateError
            If a stream frame may have been latched before the next one flushes it: the early model
            flushes it then, and the late one drops it.
        """
        self._early.receive(early_us, b"".join(wires))
        self.now_us = max([early_us, *answered_us])
        if self._late is None:
            return
        answers = doubtful = 0
        for wire in wires:
            at_us = max([early_us, *answered_us[: answers + 1]])
            headers = _headers_in_dialogue(wire)
            if doubtful and any(map(_flushes_in_dialogue, headers)):
                raise HostLateError(f"within {doubtful} µs a frame was latched, flushed or late")
            if any(self._is_in_time_or_late(header, early_us, at_us) for header in headers):
                doubtful = at_us - early_us
            self._late.advance(at_us)
            self._late.receive(at_us, wire)
            said = self._late.frames()
            answers += sum(frame.header.type in m.RESPONSE_RANGE for frame in said)
            self._later += said

    def receive_near(self, at_us: int, wire: bytes, near_us: int) -> None:
        """Let the bytes of a frame arrive at a time that the host knows but for *near_us*.

        Raises
        ------
        HostLateError
            If a stream frame may be in time, or late.
        """
        times = at_us - near_us, at_us + near_us
        if any(self._is_in_time_or_late(one, *times) for one in _headers_in_dialogue(wire)):
            raise HostLateError(f"within {2 * near_us} µs a frame is in time, or late")
        self.receive(at_us, [wire])

    def _is_in_time_or_late(self, header: m.Header, early_us: int, late_us: int) -> bool:
        """Return True if it is open whether a timed stream frame is late, or too late.

        The frame came at an uncertain time from *early_us* to *late_us*, in which a limit lies.
        """
        if header.type not in m.STREAM_RANGE or header.flags & IMMEDIATE:
            return False
        t_us = m.unwrap(header.time_us, early_us, 32)
        ends_us = (t_us + window_us for window_us in LATE_WINDOWS_US)
        return any(early_us < end_us <= late_us + self._ready_us for end_us in ends_us)

    def advance(self, end_us: int) -> None:
        """Let time pass."""
        self.now_us = max(self.now_us, end_us)
        for model in self._all:
            model.advance(end_us)

    def fault(self, at_us: int) -> None:
        """Let the hardware fail, at a time that the host knows."""
        self._early.fault(at_us)

    def next_us(self) -> int | None:
        """Return when a model does something by itself; None: never."""
        found = [next_us for model in self._all if (next_us := model.next_us()) is not None]
        return min(found, default=None)

    def due(
        self, host: DialogueHost, base: DialogueBase, near_us: int, *, is_last: bool = False
    ) -> list[FrameInDialogue]:
        """Return the frames that are due since the last call, with the times of the early model.

        An event is due when both models have sent it.

        Raises
        ------
        HostLateError
            If the late model has sent something else, beyond times that differ by *near_us*, or at
            last less.
        """
        sent = [*self._ahead, *self._early.frames()]
        if self._late is None:
            return sent
        later, self._later = [*self._later, *self._late.frames()], []
        mine = DialogueAnswers.of(sent, base)
        comparison = DialogueComparison(mine, DialogueAnswers.of(later, base), host, near_us)
        self._ahead = comparison.early()
        text = comparison.difference()
        if self._ahead and (is_last or self._ahead[0].header.type in m.RESPONSE_RANGE):
            text = text or superfluous_in_dialogue(self._ahead)
        if text:
            raise HostLateError(f"if the board has heard its bytes {near_us} µs later: {text}")
        return [frame for frame in sent if frame not in self._ahead]


def _headers_in_dialogue(wire: bytes) -> list[m.Header]:
    """Return the header of each undamaged frame in *wire*."""
    return [m.Header.of_body(body) for body in bodies_of_wire(wire)]


def _flushes_in_dialogue(header: m.Header) -> bool:
    """Return True if a frame may empty the queue of the board.

    Such are an IMMEDIATE stream frame, HELLO, MUTE and DISARM.
    """
    if header.type in m.STREAM_RANGE:
        return bool(header.flags & IMMEDIATE)
    return header.type in (m.MessageType.HELLO, m.MessageType.MUTE, m.MessageType.DISARM)


def _frames_in_dialogue(data: bytes) -> list[FrameInDialogue]:
    """Return the frames in *data*; raise if the virtual board has sent a damaged one."""
    found = []
    for body in FrameDecoder(CLIENT_COBS).feed(data):
        if isinstance(body, RemoteProtocolError):
            raise body
        found.append(FrameInDialogue(*m.parse_body(body), body))
    return found


def _dialogue_model_failure(text: str) -> Exception:
    """Return the error that ends a case as inconclusive if the virtual board itself fails."""
    return CaseEndedError(Behaviour.INCONCLUSIVE, f"the model beside the board: {text}")


def limits_of_lockstep_model(identity: m.HelloReply) -> str:
    """Return the argument of the process of a model that is like this board."""
    limits = {name: int(getattr(identity, name)) for name in _LIMITS}
    limits["features"] &= int(sum(m.Feature))
    limits["max_stored_bytes"] = _STORE_BYTES + limits["max_upload_bytes"]
    return json.dumps(limits)


def identity_suits_lockstep_model(identity: m.HelloReply) -> bool:
    """Return True if the virtual board can be made like this one: a grid, 40 kHz."""
    grid = identity.grid_nx * identity.grid_ny == identity.transducers > 0
    return grid and identity.pitch_um > 0 and identity.carrier_hz == 40_000
