"""A random host: what it has sent, and what is free about a board because of it."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, field
from typing import Final

from haptogram_protocol import messages as m
from haptogram_protocol.errors import RemoteProtocolError
from haptogram_protocol.framing import HEADER_BYTES

#: The flag as a number: an operation on a flag takes microseconds.
IMMEDIATE: Final = int(m.Flag.IMMEDIATE)
#: Stands for no session, in place of the bits in which a session differs from the open one.
NO_SESSION: Final = 0x10000


@dataclass(slots=True)
class DialogueHost:
    """A host's state while a dialogue is rendered.

    Attributes
    ----------
    identity : HelloReply
        The board.
    session, seq, stream_next : int
        Of the next frames.
    slot_us : int
        Device time of the slot that is rendered.
    last : bytes
        Body of the last request.
    sessions : list of int
        Nonces of the sessions before the open one, the latest last.
    computed : set of tuple of int
        Sequence and number (stream: sequence 0, 16 bits) of drives that the board computes.
    inexact : set of tuple of int
        The same of drives that are latched when their frame has arrived.
    least_ramp_us : int
        The shortest ramp of all configurations; 0: none had any.
    unsent : bytes
        The rest of a frame that was begun.
    """

    identity: m.HelloReply
    session: int
    seq: int
    slot_us: int
    stream_next: int = m.FIRST_STREAM_SEQ
    last: bytes = b""
    sessions: list[int] = field(default_factory=list)
    computed: set[tuple[int, int]] = field(default_factory=set)
    inexact: set[tuple[int, int]] = field(default_factory=set)
    least_ramp_us: int = 0
    unsent: bytes = b""
    _of_session: dict[tuple[int, str], bytes] = field(default_factory=dict)

    def is_computed(self, key: m.LatchKey) -> bool:
        """Return True if the board may have computed the drive."""
        return _read_drive_address(key) in self.computed

    def is_exact(self, key: m.LatchKey) -> bool:
        """Return True if the time of the latch does not depend on an arrival."""
        return bool(key.sequence or key.index) and _read_drive_address(key) not in self.inexact

    def ramp_codes(self, apart_us: int) -> int:
        """Return by how many codes an amplitude may differ in readings *apart_us* apart."""
        return -(-255 * apart_us // self.least_ramp_us) if self.least_ramp_us else 0

    def take_unsent(self) -> bytes:
        """Return the rest of a frame that was begun."""
        unsent, self.unsent = self.unsent, b""
        return unsent

    def remember(self, body: bytes) -> None:
        """Note a request that the board remembers with its reply."""
        self._of_session.setdefault((self.session, "first"), body)
        self._of_session[self.session, "last"] = body

    def of_session(self, which: str, age: int) -> bytes:
        """Return ``hello``, ``first`` or ``last`` request of the nonce that was open *age* ago.

        A nonce may have been that of several sessions; empty if there is no such request.
        """
        nonces = [self.session, *reversed(self.sessions)]
        return self._of_session.get((nonces[min(age, len(nonces) - 1)], which), b"")

    def note(self, body: bytes) -> None:
        """Note what a frame that is sent makes of drives and their times."""
        with suppress(RemoteProtocolError):  # no board takes it
            header, message = m.parse_body(body)
            drive = (0, header.seq)
            if isinstance(message, m.Play):
                drive = (message.sequence, 0)
            elif isinstance(message, m.UploadBegin) and message.kind is m.UploadKind.POINTS:
                self.computed.add((message.target, 0))
            elif isinstance(message, m.Points):
                self.computed.add(drive)
            elif isinstance(message, m.SetConfig):
                self.note_config(message.config)
            if self.is_latched_as_it_comes(body):
                self.inexact.add(drive)

    def is_latched_as_it_comes(self, body: bytes) -> bool:
        """Return True if the time of a latch depends on when the frame arrives (HG-3.5)."""
        if len(body) < HEADER_BYTES:
            return False
        header = m.Header.unpack(body[:HEADER_BYTES])
        ahead_us = m.signed_difference(header.time_us, self.slot_us & 0xFFFFFFFF, 32)
        is_at_once = bool(header.flags & IMMEDIATE)
        if header.type in m.STREAM_RANGE:
            return is_at_once or ahead_us < 0
        return header.type == m.MessageType.PLAY and is_at_once

    def note_config(self, config: m.Config) -> None:
        """Note the ramp of a configuration that is sent."""
        ramp_us = config.ramp_ms * 1000
        if ramp_us:
            self.least_ramp_us = min(ramp_us, self.least_ramp_us or ramp_us)

    def request(
        self,
        message: m.Message,
        *,
        number: int = 0,
        flags: int = 0,
        time_us: int = 0,
        other: int = 0,
    ) -> bytes:
        """Return the body of a request, whose number is the next one and *number*.

        One that was used before uses none up; *other* is combined with the open session.
        """
        seq = self.seq + 1 + number
        self.seq = seq if number >= 0 else self.seq
        self.last = self._body(message, flags, seq, time_us, other)
        return self.last

    def stream(
        self,
        message: m.Message,
        *,
        number: int = 0,
        flags: int = 0,
        time_us: int = 0,
        other: int = 0,
    ) -> bytes:
        """Return the body of a frame of the stream, as :meth:`request` does."""
        seq = self.stream_next + number
        self.stream_next = seq + 1 if number >= 0 else self.stream_next
        return self._body(message, flags, seq, time_us, other)

    def _body(self, message: m.Message, flags: int, seq: int, time_us: int, other: int) -> bytes:
        """Return a frame body; its session is the open one XOR *other*, or 0 for NO_SESSION.

        *flags*, *seq* and *time_us* are for its header.
        """
        session = 0 if other == NO_SESSION else self.session ^ other
        return m.build_body(message, flags=flags, seq=seq, time_us=time_us, session=session)

    def hello(self, message: m.Hello, *, takes: bool = True) -> bytes:
        """Return the body of a HELLO, and go on in its session if the board *takes* it."""
        body = self.request(message, other=NO_SESSION)
        if takes:
            self._of_session[message.nonce, "hello"] = body
            self.go_on_in(message.nonce)
        return body

    def go_on_in(self, nonce: int) -> None:
        """Go on in the session of a HELLO."""
        if nonce != self.session:
            self.sessions.append(self.session)
            self.session, self.stream_next = nonce, m.FIRST_STREAM_SEQ


def _read_drive_address(key: m.LatchKey) -> tuple[int, int]:
    """Return (sequence, number) with which READ_DRIVE asks for a latch.

    For a latch of a stored sequence the number is 0, else the low 16 bits of the frame's index.
    """
    return key.sequence, 0 if key.sequence else key.index & 0xFFFF
