"""The bench that a case works at: an open session, its configuration, time and counters."""

from __future__ import annotations

import contextlib
import dataclasses
import random
import zlib
from collections.abc import Iterator
from typing import Any, Final

from haptogram_protocol.messages import (
    FIRST_STREAM_SEQ,
    PHASE_FORMAT_BIT,
    VERSION_MAJOR,
    VERSION_MINOR,
    Arm,
    ArmReply,
    Config,
    ConfigReply,
    Counters,
    Disarm,
    DisarmReply,
    Error,
    ErrorCode,
    Feature,
    GetConfig,
    GetStatus,
    Hello,
    HelloReply,
    PhaseFormat,
    Phases,
    SetConfig,
    SetConfigReply,
    StatusReply,
    TraceMode,
    UploadBegin,
    UploadBeginReply,
    UploadChunk,
    UploadChunkReply,
    UploadCommit,
    UploadCommitReply,
    UploadKind,
    pack_phases,
)
from haptogram_protocol.state import OutputState

from ..outcome import CaseEndedError, check, fail, inconclusive, unimplemented
from .board_clock import DeviceClock
from .wire import Wire

#: Counters that move without anything being wrong.
_HARMLESS: Final = frozenset({"frames", "requests", "latched", "late", "trace_dropped"})
_STATUS_BYTES: Final = 144  # of a STATUS on the line


class Bench(DeviceClock):
    """A session with a board.

    Parameters
    ----------
    wire : Wire
        Open port.
    random_source : random.Random
        Where nonces and contents come from.
    description_hash : int
        That of this version.
    booted : bool
        Whether the board has just started, so that its clock is known unwrapped.

    Attributes
    ----------
    identity : HelloReply
        What the board said last.
    config : Config
        In force, as far as the host knows.
    last_boot_id, last_config
        What the board said, and had in force, before it was reset.
    """

    config: Config
    last_boot_id: int | None = None
    last_config: Config | None = None

    def __init__(
        self, wire: Wire, random_source: random.Random, description_hash: int, *, booted: bool
    ) -> None:
        super().__init__(wire, random_source, booted=booted)
        self.description_hash = description_hash
        self._last_nonce = 0

    # --- session -------------------------------------------------------------------------------

    def new_nonce(self) -> int:
        """Return a nonce that is not that of the open session."""
        nonce = self._last_nonce
        while nonce in (0, self._last_nonce, self.session):
            nonce = self.random.randrange(1, 0x10000)
        self._last_nonce = nonce
        return nonce

    def hello_message(self, nonce: int) -> Hello:
        """Return the HELLO of this version."""
        return Hello(VERSION_MAJOR, VERSION_MINOR, nonce, self.description_hash)

    def hello(self, nonce: int | None = None, **header: Any) -> HelloReply:
        """Open a session, a new one unless *nonce* says which; FAILED if the board does not."""
        nonce = self.new_nonce() if nonce is None else nonce
        reply = self.call(self.hello_message(nonce), HelloReply, session=0, **header)
        self.adopt(reply)
        return reply

    def adopt(self, reply: HelloReply) -> None:
        """Take the session that a HELLO_REPLY names for one's own."""
        if reply.nonce != self.session:
            self.stream_next = FIRST_STREAM_SEQ
        self.session, self.identity = reply.nonce, reply

    def settle(self) -> None:
        """Open a session and bring the board to where every case begins: DISARMED, quiet.

        What the board does wrong here is for the cases to find.
        """
        if self.hello().state is OutputState.FAULT:
            inconclusive("the board is in FAULT")
        self.ask(Arm())  # the only way out of MUTED
        self.ask(Disarm())
        self.config = Config(sound_speed_mm_s=self.identity.sound_speed_mm_s)
        answer = self.ask(GetConfig()).message
        if isinstance(answer, ConfigReply):
            self.config = answer.config
        if self.has(Feature.CONFIG):
            self._settle_config()
        with contextlib.suppress(CaseEndedError):
            self.device_us()

    def _settle_config(self) -> None:
        """Set timers that no case runs into by chance, and no correction."""
        reply = self.ask(SetConfig(self.base_config)).message
        if not isinstance(reply, SetConfigReply):
            return
        self.config = reply.config
        none = bytes(self.identity.transducers)
        wanted = zlib.crc32(reply.config.pack() + none)
        if self.has(Feature.CORRECTION) and reply.config_crc != wanted:
            begin = UploadBegin(UploadKind.CORRECTION, 0, 0, len(none), zlib.crc32(none))
            for step in (begin, UploadChunk(0, none), UploadCommit(0)):
                self.ask(step)

    def learn_wraps(self) -> None:
        """Find out how often the clock of a board that runs already has wrapped.

        Latches lie on multiples of the carrier period of the unwrapped clock, which the low 32
        bits of one latch tell.
        """
        if self.booted or not self.has_phases:
            return
        self.ask(Arm())
        self.send(self.stream_wire(self.flat_phases()))
        answer = self.ask(GetStatus()).message
        self.ask(Disarm())
        if isinstance(answer, StatusReply) and answer.last_seq:
            wraps = range(self.carrier_us)
            fits = (k for k in wraps if (answer.last_latch_us + (k << 32)) % self.carrier_us == 0)
            self.set_device_us(answer.last_latch_us + (next(fits, 0) << 32))

    # --- phases --------------------------------------------------------------------------------

    @property
    def has_phases(self) -> bool:
        """Whether the board takes PHASES in any format."""
        return bool(self.identity.phase_formats & 7)

    @property
    def finest(self) -> PhaseFormat:
        """The finest format of PHASES that the board advertises."""
        offered = [form for form, bit in PHASE_FORMAT_BIT.items() if self._offers(bit)]
        return max(offered, default=PhaseFormat.BITS_8)

    def _offers(self, bit: int) -> bool:
        return bool(self.identity.phase_formats & bit)

    def phases(self, registers: bytes) -> Phases:
        """Return the PHASES frame after which the registers hold *registers*."""
        shift = 8 - self.finest
        packed = pack_phases(bytes(code >> shift for code in registers), self.finest)
        return Phases(self.finest, 0, packed)

    def flat_phases(self, code: int = 0) -> Phases:
        """Return a PHASES frame with the same code for all."""
        return self.phases(bytes([code]) * self.identity.transducers)

    def random_registers(self) -> bytes:
        """Return phase codes that every format can bring about."""
        return bytes(code & 0xF8 for code in self.random.randbytes(self.identity.transducers))

    @property
    def base_config(self) -> Config:
        """The configuration that cases begin with."""
        return dataclasses.replace(
            self.config,
            hold_ms=5000,
            ramp_ms=0,
            host_timeout_ms=10_000,
            status_period_ms=0,
            late_window_us=0,
            trace_mode=TraceMode.OFF,
            amplitude_ceiling=255,
            trace_divider=1,
        )

    def configure(self, **changes: Any) -> Config:
        """Set the base configuration with *changes*; UNIMPLEMENTED without CONFIG."""
        self.need(Feature.CONFIG)
        wanted = dataclasses.replace(self.base_config, **changes)
        self.config = self.call(SetConfig(wanted), SetConfigReply).config
        check(self.config == wanted, f"SET_CONFIG_REPLY shows {self.config}, sent was {wanted}")
        return self.config

    def has(self, features: Feature) -> bool:
        """Tell whether the board advertises all of *features*."""
        return self.identity.features & features == features

    def need(self, features: Feature) -> None:
        """End the case as UNIMPLEMENTED unless the board advertises all of *features*."""
        # Among whole numbers: Python 3.11.0 to 3.11.3 invert a flag wrongly.
        lacking = Feature(int(features) & ~self.identity.features)
        if lacking:
            unimplemented(f"the board does not advertise {lacking.name or lacking!r}")

    def need_any(self, features: Feature) -> None:
        """End the case as UNIMPLEMENTED unless the board advertises one of *features*."""
        if not self.identity.features & features:
            unimplemented(f"the board advertises none of {features.name or features!r}")

    @property
    def quick_status_ms(self) -> int:
        """A status period that leaves nine tenths of the line to others (HG-7.1/2)."""
        return max(50, -(-_STATUS_BYTES * 10 * 10 * 1000 // self.wire.baudrate))

    def arm(self) -> None:
        """Arm; FAILED if the board is not ARMED then."""
        state = self.call(Arm(), ArmReply).state
        check(state is OutputState.ARMED, f"ARM_REPLY says {state.name}")

    def arm_at(self, seq: int) -> None:
        """Arm by a request of a given number."""
        self.call(Arm(), ArmReply, seq=seq)
        self.seq = seq

    def disarm(self) -> OutputState:
        """Disarm, and return the state."""
        return self.call(Disarm(), DisarmReply).state

    # --- status --------------------------------------------------------------------------------

    def status(self) -> StatusReply:
        """Return the status."""
        return self.call(GetStatus(), StatusReply)

    @contextlib.contextmanager
    def counting(self, **wanted: int) -> Iterator[None]:
        """Judge what was counted meanwhile: *wanted* exactly, and nothing else that is wrong.

        ``frames`` and ``requests`` are judged where they are named, without the GET_STATUS that
        asks for them.
        """
        before = self.status().counters
        yield
        counted = self.counted_since(before)
        differs = {
            name: number
            for name, number in counted.items()
            if number != wanted.get(name, number if name in _HARMLESS else 0)
        }
        if differs:
            names = {**dict.fromkeys(wanted, 0), **differs}
            due = ", ".join(f"{name} {wanted.get(name, 0)}" for name in names)
            got = ", ".join(f"{name} {counted[name]}" for name in names)
            fail(f"should count {due}; counted {got}")

    def counted_since(self, before: Counters) -> dict[str, int]:
        """Return how far every counter went since, but for the GET_STATUS of this call."""
        after = self.status().counters
        counted = {
            name: (getattr(after, name) - getattr(before, name)) & 0xFFFFFFFF
            for name in Counters.WIRE
        }
        counted["frames"] -= 1
        counted["requests"] -= 1
        return counted

    # --- uploads -------------------------------------------------------------------------------

    def upload(self, kind: UploadKind, target: int, data: bytes, points: int = 0) -> int:
        """Upload and commit; return what UPLOAD_COMMIT_REPLY says."""
        self.begin_upload(kind, target, data, points)
        self.send_chunks(data)
        return self.call(UploadCommit(target), UploadCommitReply).frames

    def begin_upload(
        self, kind: UploadKind, target: int, data: bytes, points: int = 0
    ) -> UploadBeginReply:
        """Announce an upload."""
        begin = UploadBegin(kind, points, target, len(data), zlib.crc32(data))
        return self.call(begin, UploadBeginReply)

    def send_chunks(self, data: bytes) -> None:
        """Send an upload in pieces, one after the other."""
        size = max(1, min(self.identity.max_chunk, 1024))
        for start in range(0, len(data), size):
            chunk = UploadChunk(start, data[start : start + size])
            received = self.call(chunk, UploadChunkReply).received
            due = start + len(chunk.data)
            check(received == due, f"UPLOAD_CHUNK_REPLY says {received} bytes, sent were {due}")

    def greet(self) -> HelloReply | Error | None:
        """Say HELLO to a board of which nothing is known; None if nothing answers."""
        seq = self.next_seq()
        wire, _ = self.request_wire(self.hello_message(self.new_nonce()), seq=seq, session=0)
        since = self.mark()
        self.send(wire)
        answer = self.try_answer(seq, since)
        if answer is None or not isinstance(answer.message, HelloReply | Error):
            return None
        if isinstance(answer.message, HelloReply):
            self.adopt(answer.message)
        return answer.message


def is_version_error(reply: HelloReply | Error | None) -> bool:
    """Tell whether a board refused HELLO because it speaks another major version."""
    return isinstance(reply, Error) and reply.code == ErrorCode.VERSION
