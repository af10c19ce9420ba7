"""The beginning of a dialogue: both boards with the same configuration, sequences and session."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from haptogram_protocol import messages as m
from haptogram_protocol.framing import HEADER_BYTES, encode_frame

from ..client.board_client import BoardClient
from ..client.board_clock import BOOT_US
from ..client.wire import encoded_frame
from .actions import (
    ABSENT,
    SLOT_US,
    STORED_FRAMES,
    STORED_PHASES,
    STORED_POINTS,
    UPLOADED,
    has_room_in_dialogue,
    upload_in_dialogue,
)
from .comparison import DialogueBase
from .host import DialogueHost
from .model import DialogueModels

_QUICK_US: Final = 3000  # round trip of a host that was not held up
_TRIES: Final = 8
_BEFORE_US: Final = 1_000_000  # the model is on for so long already
#: Focal points of the sequence that is stored, one a frame.
_POINTS: Final = [m.FocalPoint(9000, y_um, 150_000, 50_000, 0) for y_um in (-4000, 1000, 6000)]
_PING_BYTES: Final = len(encode_frame(bytes(HEADER_BYTES + m.Ping.LAYOUT.size)))


#: Counters and state of a board after a power-up.
SINCE_POWER_UP: Final = DialogueBase(m.Counters(*[0] * len(m.Counters.WIRE)))


class DialogueOpening:
    """Opens dialogues at the board under test and at the model.

    Parameters
    ----------
    board : BoardClient
        Client of the board.
    models : DialogueModels
        The models.

    Attributes
    ----------
    early_us : int
        In virtual time, how far the device clock is ahead of the host's estimate.
    unsure_us : int
        At a wall clock, by how much the device clock may be ahead of the host's estimate.
    """

    def __init__(self, board: BoardClient, models: DialogueModels) -> None:
        self._board, self._models = board, models
        self.early_us = self.unsure_us = 0

    @property
    def board(self) -> BoardClient:
        """Client of the board: another one after a power-up."""
        return self._board

    def power_up(self) -> DialogueHost:
        """Switch board and models off and on; return a host without a session."""
        before = self._board
        assert before.restart is not None  # the caller has asked
        self._board = board = before.restart()
        board.adopt(replace(before.identity, nonce=0))
        board.clock.note_power_up()
        self.early_us = 0
        self._models.reset(BOOT_US)
        return DialogueHost(board.identity, 0, 0, board.clock.device_estimate_us())

    def open(self, config: m.Config, seed: int, *, is_known: bool = False) -> DialogueHost:
        """Open a session at both, with stored sequences and *config*; return the host.

        Configuration and sequences are sent in a session before it, so that both boards open it in
        the same state.  *is_known*: both are alike already, and the device time is known.
        """
        board = self._board
        if is_known:
            now_us = max(board.clock.device_estimate_us(), self._models.now_us)
            board.wire.idle(now_us - board.clock.device_estimate_us())
        else:
            board.hello()  # a board that differs may have another session open
            now_us = self._learn_time()
            self._models.reset(board.clock.on_carrier(now_us) - _BEFORE_US)
        host = DialogueHost(board.identity, 0, board.link.seq, now_us)
        host.computed.add((STORED_POINTS, 0))
        host.note_config(config)
        self._hello(host)
        for message in self.preamble(config, seed):
            self._ask(host, message)
        self._hello(host)
        host.sessions.pop(0)  # 0
        return host

    def baseline(self, host: DialogueHost) -> tuple[DialogueBase, DialogueBase]:
        """Return the counters of both before slot 0."""
        stored = [0, 0]
        if self._board.identity.features & (m.Feature.SEQUENCE_PHASES | m.Feature.SEQUENCE_POINTS):
            self._ask(host, m.Arm())
            refusals = self._ask(host, m.Play(ABSENT, SLOT_US, 1, 1000))
            stored = [
                refusal.detail
                for refusal in refusals
                if isinstance(refusal, m.Error) and refusal.code == m.ErrorCode.NOT_FOUND
            ]
            self._ask(host, m.Disarm())
        ours, theirs = self._ask(host, m.GetStatus())
        assert isinstance(ours, m.StatusReply)
        assert isinstance(theirs, m.StatusReply)
        if len(stored) < len((ours, theirs)):
            stored = [0, 0]
        host.last = b""  # its reply, sent again, has a time before the dialogue
        return DialogueBase(ours.counters, stored[0]), DialogueBase(theirs.counters, stored[1])

    def _learn_time(self) -> int:
        """Return the device time in µs; note its uncertainty, the duration of the answer.

        The first of up to 8 answers that takes less than 3 ms counts, else the last.
        """
        clock, wire = self._board.clock, self._board.wire
        for _ in range(_TRIES):
            sent_us = wire.now_us()
            now_us = clock.device_us()
            self.unsure_us = wire.now_us() - sent_us
            if self.unsure_us < _QUICK_US:
                break
        if wire.is_virtual:
            # The PONG may have changed the estimate, by which the next bytes are sent.
            self.early_us = now_us - clock.device_estimate_us() + wire.now_us() - sent_us
            self.early_us -= _PING_BYTES * 10_000_000 // wire.baudrate
        return now_us

    def _hello(self, host: DialogueHost) -> None:
        """Open a session with a new nonce at board and virtual board."""
        board = self._board
        nonce = board.new_nonce()
        board.hello(nonce)
        host.seq = board.link.seq - 1
        hello = m.Hello(m.VERSION_MAJOR, 0, nonce)
        self._tell_model(host.hello(hello))

    def _ask(self, host: DialogueHost, message: m.Message) -> tuple[m.Message, m.Message]:
        """Send a request before the dialogue; return the answers of board and virtual board."""
        ours = self._board.link.ask(message).message
        host.seq = self._board.link.seq - 1
        theirs = self._tell_model(host.request(message))
        assert ours is not None  # an answer was found by what it is
        return ours, theirs

    def _tell_model(self, body: bytes) -> m.Message:
        """Pass the virtual board a request before the dialogue; return its answer."""
        now_us = self._board.clock.device_estimate_us()
        return self._models.ask(now_us, encoded_frame(body)).message

    def preamble(self, config: m.Config, seed: int) -> list[m.Message]:
        """Return the requests before slot 0: what a dialogue finds.

        All is stored anew that a dialogue before may have left.
        """
        identity = self._board.identity
        can, count = m.Feature(identity.features & sum(m.Feature)), identity.transducers
        chunk = max(1, min(identity.max_chunk, 1024))
        found: list[m.Message] = [m.SetConfig(config)]
        for target in UPLOADED if has_room_in_dialogue(identity) else ():
            is_first = target == (STORED_POINTS if m.Feature.SEQUENCE_PHASES in can else target)
            if m.Feature.SEQUENCE_POINTS in can and is_first:
                data = b"".join(point.pack() for point in _POINTS)
                found += upload_in_dialogue(m.UploadKind.POINTS, target, data, chunk, points=1)
            elif m.Feature.SEQUENCE_PHASES in can:
                size = count * (STORED_FRAMES if target == STORED_PHASES else 1)
                data = bytes((seed + 37 * n) & 0xFF for n in range(target, target + size))
                found += upload_in_dialogue(m.UploadKind.PHASES, target, data, chunk)
        if m.Feature.CORRECTION in can:
            found += upload_in_dialogue(m.UploadKind.CORRECTION, 0, bytes(count), chunk)
        return [*found, m.Arm(), m.Disarm()]
