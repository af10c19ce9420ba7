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
    Counters,
    Disarm,
    Feature,
    FocalPoint,
    Header,
    Hello,
    HelloReply,
    Message,
    MessageType,
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
    SLOT_US,
    STORED_FRAMES,
    STORED_PHASES,
    STORED_POINTS,
    DialogueAction,
    DialogueHost,
)
from .comparison import SaidInDialogue, difference
from .stepped_process import SteppedProcess

_LEAD_US: Final = 2_000_000  # the model runs so long before slot 0
_LATE_US: Final = SLOT_US // 4  # a host that sends later than this has changed the dialogue
_SHARE: Final = 6  # of a slot may pass while its frames are on the line
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
        self._model = SteppedProcess(
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
        host = self._open(config, seed)
        try:
            return self._compare(host, actions)
        finally:
            board.link.seq = host.seq + 1  # where the client goes on

    def _compare(self, host: DialogueHost, actions: Sequence[DialogueAction]) -> Played:
        """Play the slots of a dialogue up to the first difference."""
        base = self._baseline(host)
        lines: list[str] = []
        slots = max((action.slot for action in actions), default=0) + 4
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
        """Open a session at both, with two stored sequences and *config*; return the host."""
        board = self._board
        now_us = board.clock.device_us()
        start_us = board.clock.on_carrier(now_us + _LEAD_US // 4)
        self._boot_us = start_us - _LEAD_US
        self._model.step(f"reset {self._boot_us}")
        nonce = board.new_nonce()
        board.hello(nonce)
        hello = Hello(1, 0, nonce, board.description_hash)
        opening = Header(Hello.TYPE, 0, board.link.seq & 0xFFFF, 0, 0).pack() + hello.serialize()
        self._model.receive(0, encode_frame(opening))
        host = DialogueHost(board.identity, config, nonce, board.link.seq, start_us)
        for number, message in enumerate(self._preamble(config, seed), start=1):
            board.link.ask(message)
            body = host.request(message)
            self._model.receive(1000 * number, encode_frame(body))
        host.seq = board.link.seq
        return host

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
        if can & Feature.SEQUENCE_POINTS:
            points = (
                FocalPoint(9000, 5000 * n - 4000, 150_000, 50_000, 0) for n in range(STORED_FRAMES)
            )
            data = b"".join(point.pack() for point in points)
            found += self._upload(UploadKind.POINTS, STORED_POINTS, data, 1)
        return [*found, Arm(), Disarm()]

    def _upload(self, kind: UploadKind, target: int, data: bytes, points: int) -> list[Message]:
        size = max(1, min(self._board.identity.max_chunk, 1024))
        edges = [*range(0, len(data), size), len(data)]
        chunks = [UploadChunk(a, data[a:b]) for a, b in pairwise(edges)]
        begin = UploadBegin(kind, points, target, len(data), zlib.crc32(data))
        return [begin, *chunks, UploadCommit(target)]

    def _baseline(self, host: DialogueHost) -> tuple[Counters, Counters]:
        """Return the counters of both before slot 0."""
        board = self._board
        ours = board.status().counters
        host.seq = board.link.seq
        body = Header(0x45, 0, board.link.seq & 0xFFFF, 0, host.session).pack()
        said = _frames_in_lockstep(self._model.receive(200_000, encode_frame(body)))
        status = said[-1][1]
        assert isinstance(status, StatusReply)
        return ours, status.counters

    # --- one slot ------------------------------------------------------------------------------

    def _slot(
        self, host: DialogueHost, slot: int, data: bytes, base: tuple[Counters, Counters]
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
        tolerance_us = (board.wire.limits.slack_us or 2000) + board.wire.line_us(len(data) + heard)
        return difference(
            SaidInDialogue.of(ours, base[0]),
            SaidInDialogue.of(_frames_in_lockstep(theirs), base[1]),
            tolerance_us,
        )


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


def identity_suits_model(identity: HelloReply) -> bool:
    """Return True if the virtual board can be made like this one: a grid, 40 kHz, the clock."""
    grid = identity.grid_nx * identity.grid_ny == identity.transducers > 0
    return grid and identity.carrier_hz == 40_000
