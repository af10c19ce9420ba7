"""The same dialogue at the board under test and at the model: what each says, slot by slot."""

from __future__ import annotations

import json
import sys
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

from haptogram.errors import HaptogramError
from haptogram_protocol.errors import RemoteProtocolError
from haptogram_protocol.framing import FrameDecoder, encode_frame
from haptogram_protocol.messages import (
    Arm,
    Config,
    Disarm,
    Error,
    ErrorCode,
    Feature,
    FocalPoint,
    GetStatus,
    Header,
    Hello,
    HelloReply,
    Message,
    MessageType,
    Play,
    SetConfig,
    StatusReply,
    UploadBegin,
    UploadChunk,
    UploadCommit,
    UploadKind,
    parse_body,
)

from ..client.board_client import BoardClient
from ..outcome import CaseEndedError
from ..verdict import Behaviour
from .actions import (
    ABSENT,
    REPLACED,
    SLOT_US,
    STORED_FRAMES,
    STORED_PHASES,
    STORED_POINTS,
    DialogueAction,
    DialogueHost,
)
from .comparison import DialogueAnswers, DialogueBase, DialogueEventNumbers, dialogue_difference
from .stepped_process import LockstepProcess

_LEAD_US: Final = 2_000_000  # the model runs so long before slot 0
_LATE_US: Final = SLOT_US // 4  # a host that sends later than this has changed the dialogue
_SHARE: Final = 6  # of a slot may pass while its frames are on the line
_TAIL: Final = 6  # slots after the last frame: timers end
_MODEL: Final = "sim_device.driven.stepped_board"
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
    """The host sent too late for a comparison."""


@dataclass(frozen=True, slots=True)
class Played:
    """A dialogue that was played.

    Attributes
    ----------
    difference : str
        First difference between board and model; empty if there is none.
    lines : tuple of str
        The dialogue: time, description and bytes of each frame sent.
    """

    difference: str
    lines: tuple[str, ...]


class Lockstep:
    """A board under test, and the model beside it.

    Parameters
    ----------
    board : BoardClient
        Client of the board, with a session.

    Raises
    ------
    CaseEndedError
        INCONCLUSIVE, from every step: the model's process has ended.
    """

    def __init__(self, board: BoardClient) -> None:
        self._board = board
        limits = {name: int(getattr(board.identity, name)) for name in _LIMITS}
        limits["features"] &= int(sum(Feature))
        limits["max_stored_bytes"] = 2 * limits["max_upload_bytes"]
        self._model = LockstepProcess(
            [sys.executable, "-m", _MODEL, json.dumps(limits)], _lockstep_model_failure
        )

    def close(self) -> None:
        """End the model's process."""
        self._model.close()

    def play(self, actions: Sequence[DialogueAction], config: Config, seed: int) -> Played:
        """Play a dialogue at both boards and compare.

        Raises
        ------
        HostLateError
            If the host was late: nothing was compared.
        """
        board = self._board
        board.wire.begin_case()
        board.hello()  # a board that differs may have another session open
        host = self._open(config, seed)
        try:
            return self._compare(host, actions)
        finally:
            # Where the client goes on.
            board.link.seq, board.link.session = host.seq + 1, host.session

    def _compare(self, host: DialogueHost, actions: Sequence[DialogueAction]) -> Played:
        """Play the slots of a dialogue up to the first difference."""
        base = self._baseline(host)
        host.last = b""  # its reply, sent again, has a time before the dialogue
        self._events = DialogueEventNumbers(host.session)
        lines: list[str] = []
        slots = max((action.slot for action in actions), default=0) + _TAIL
        for slot in range(slots):
            batch = self._batch(host, [a for a in actions if a.slot == slot])
            lines += [f"{slot * SLOT_US:>8} µs  {a.text}: {wire.hex()}" for a, wire in batch]
            found = self._slot(host, slot, b"".join(wire for _, wire in batch), base)
            if found:
                return Played(f"{slot * SLOT_US} µs after the start {found}", tuple(lines))
        return Played("", tuple(lines))

    def _batch(
        self, host: DialogueHost, actions: Sequence[DialogueAction]
    ) -> list[tuple[DialogueAction, bytes]]:
        """Return the frames of a slot with their actions: as many as the line carries in time."""
        found: list[tuple[DialogueAction, bytes]] = []
        for action in actions:
            wire = action.wire(host)
            size = len(wire) + sum(len(data) for _, data in found)
            if self._board.wire.line_us(size) > SLOT_US // _SHARE:
                break
            if found and _is_mute_in_lockstep(wire):
                break  # it may overtake what is sent with it: HG-3.8/2
            found.append((action, wire))
        return found

    # --- the beginning of a dialogue -----------------------------------------------------------

    def _open(self, config: Config, seed: int) -> DialogueHost:
        """Open a session at both, with stored sequences and *config*; return the host.

        Configuration and sequences are sent in a session before it, so that both boards open it in
        the same state.
        """
        board = self._board
        now_us = board.clock.device_us()
        start_us = board.clock.on_carrier(now_us + _LEAD_US // 4)
        self._boot_us = start_us - _LEAD_US
        self._model.step(f"reset {self._boot_us}")
        self._said_before = 0
        host = DialogueHost(board.identity, 0, board.link.seq, start_us)
        self._hello(host)
        for message in self._preamble(config, seed):
            self._ask(host, message)
        self._hello(host)
        host.sessions.pop(0)  # 0
        self._session = host.session
        return host

    def _hello(self, host: DialogueHost) -> None:
        """Open a session at both."""
        board = self._board
        nonce = board.new_nonce()
        board.hello(nonce)
        host.seq = board.link.seq - 1
        hello = Hello(1, 0, nonce, board.description_hash)
        self._tell_model(host.hello(hello))

    def _ask(self, host: DialogueHost, message: Message) -> tuple[Message, Message]:
        """Return the answers of both to a request before slot 0."""
        ours = self._board.link.ask(message).message
        host.seq = self._board.link.seq - 1
        theirs = self._tell_model(host.request(message))
        assert ours is not None  # an answer was found by what it is
        return ours, theirs

    def _tell_model(self, body: bytes) -> Message:
        """Return the model's answer to a request before slot 0."""
        self._said_before += 1000
        said = self._model.receive(self._said_before, encode_frame(body))
        return _frames_in_lockstep(said)[-1][1]

    def _preamble(self, config: Config, seed: int) -> list[Message]:
        """Return the requests before slot 0: what a dialogue finds."""
        identity = self._board.identity
        can = identity.features
        found: list[Message] = []
        if can & Feature.CONFIG:
            found.append(SetConfig(config))
        if can & Feature.SEQUENCE_PHASES:
            count = identity.transducers * STORED_FRAMES
            data = bytes((seed + 37 * n) & 0xFF for n in range(count))
            found += self._upload(UploadKind.PHASES, STORED_PHASES, data, 0)
            found += self._upload(UploadKind.PHASES, REPLACED, data[: identity.transducers], 0)
        if can & Feature.SEQUENCE_POINTS:
            points = (
                FocalPoint(9000, 5000 * n - 4000, 150_000, 50_000, 0) for n in range(STORED_FRAMES)
            )
            data = b"".join(point.pack() for point in points)
            found += self._upload(UploadKind.POINTS, STORED_POINTS, data, 1)
        if can & Feature.CORRECTION:
            none = bytes(identity.transducers)
            found += self._upload(UploadKind.CORRECTION, 0, none, 0)
        return [*found, Arm(), Disarm()]

    def _upload(self, kind: UploadKind, target: int, data: bytes, points: int) -> list[Message]:
        size = max(1, min(self._board.identity.max_chunk, 1024))
        edges = [*range(0, len(data), size), len(data)]
        chunks = [UploadChunk(a, data[a:b]) for a, b in pairwise(edges)]
        begin = UploadBegin(kind, points, target, len(data), zlib.crc32(data))
        return [begin, *chunks, UploadCommit(target)]

    def _baseline(self, host: DialogueHost) -> tuple[DialogueBase, DialogueBase]:
        """Return what both say before slot 0."""
        stored = [0, 0]
        if self._board.identity.features & Feature.SEQUENCE_PHASES:
            self._ask(host, Arm())
            refusals = self._ask(host, Play(ABSENT, SLOT_US, 1, 1000))
            stored = [
                refusal.detail
                for refusal in refusals
                if isinstance(refusal, Error) and refusal.code == ErrorCode.NOT_FOUND
            ]
            self._ask(host, Disarm())
        ours, theirs = self._ask(host, GetStatus())
        assert isinstance(ours, StatusReply)
        assert isinstance(theirs, StatusReply)
        if len(stored) < len((ours, theirs)):
            stored = [0, 0]
        return DialogueBase(ours.counters, stored[0]), DialogueBase(theirs.counters, stored[1])

    # --- one slot ------------------------------------------------------------------------------

    def _slot(
        self, host: DialogueHost, slot: int, data: bytes, base: tuple[DialogueBase, DialogueBase]
    ) -> str:
        board, at_us = self._board, host.start_us + slot * SLOT_US
        early_us = at_us - board.clock.device_estimate_us()
        board.wire.idle(max(0, early_us - board.wire.line_us(len(data))))
        since = board.link.mark()
        if board.clock.device_estimate_us() - at_us > _LATE_US:
            raise HostLateError
        if data:
            board.link.send(data)
        model_us = at_us - self._boot_us
        theirs = self._model.receive(model_us, data)
        end_us = model_us + SLOT_US - 2000
        while model_us < end_us:
            model_us, more = self._model.advance_until_sent(end_us)
            theirs += more
        board.wire.idle(at_us + SLOT_US - 3000 - board.clock.device_estimate_us())
        if board.clock.device_estimate_us() - at_us - SLOT_US > _LATE_US:
            raise HostLateError
        pieces = board.wire.received[since:]
        ours = [(p.header, p.message) for p in pieces if p.header and p.message is not None]
        broken = [p.fault for p in pieces if p.message is None]
        if broken:
            return f"the board sent {broken[0]}"
        heard = sum(len(piece.piece) + 2 for piece in pieces)
        due = _frames_in_lockstep(theirs)
        for _, message in due:
            if isinstance(message, HelloReply):
                self._session = message.nonce
        host.session = self._session  # a HELLO that was left out has opened none
        tolerance_us = (board.wire.limits.slack_us or 2000) + board.wire.line_us(len(data) + heard)
        said, wanted = DialogueAnswers.of(ours, base[0]), DialogueAnswers.of(due, base[1])
        return dialogue_difference(said, wanted, tolerance_us) or self._events.first_wrong(ours)


def _is_mute_in_lockstep(wire: bytes) -> bool:
    return any(
        isinstance(body, bytes) and body[0] == MessageType.MUTE
        for body in FrameDecoder().feed(wire)
    )


def _frames_in_lockstep(data: bytes) -> list[tuple[Header, Message]]:
    found = []
    for body in FrameDecoder().feed(data):
        if isinstance(body, RemoteProtocolError):
            raise body
        found.append(parse_body(body))
    return found


def _lockstep_model_failure(text: str) -> Exception:
    return CaseEndedError(Behaviour.INCONCLUSIVE, f"the model beside the board: {text}")


def identity_suits_lockstep_model(identity: HelloReply) -> bool:
    """Return True if the virtual board can be made like this one: a grid, 40 kHz, the clock."""
    grid = identity.grid_nx * identity.grid_ny == identity.transducers > 0
    return grid and identity.carrier_hz == 40_000
