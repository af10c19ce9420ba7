"""Actions of a random host: legal and illegal frames, rendered when they are sent."""

from __future__ import annotations

import random
import zlib
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

from haptogram_protocol.framing import encode_frame
from haptogram_protocol.messages import (
    FIRST_STREAM_SEQ,
    Arm,
    Config,
    Disarm,
    DriveKind,
    Drives,
    Feature,
    Flag,
    FocalPoint,
    GetConfig,
    GetGeometry,
    GetStatus,
    HelloReply,
    Message,
    Mute,
    PhaseFormat,
    Phases,
    Ping,
    Play,
    Points,
    ReadDrive,
    ReadTrace,
    SetConfig,
    Stop,
    TraceMode,
    UploadBegin,
    UploadChunk,
    UploadCommit,
    UploadKind,
    build_body,
    pack_phases,
)

from ..client.malformed_frames import noise_bytes

SLOT_US: Final = 40_000
#: Sequences that every dialogue finds stored.
STORED_PHASES: Final = 1
STORED_POINTS: Final = 2
ABSENT: Final = 60_000
STORED_FRAMES: Final = 3
_AT_ONCE: Final = ("at once", "for late", "PLAY", "again")  # in the text of such an action
_UNKNOWN_TYPES: Final = (0x3F, 0x7E, 0x90, 0xC8)
_UNKNOWN_FLAGS: Final = (0x20, 0x40, 0x80)


@dataclass(slots=True)
class DialogueHost:
    """A host's state while a dialogue is rendered.

    Attributes
    ----------
    identity : HelloReply
        The board.
    config : Config
        Configuration that dialogues vary.
    session, seq, stream_next : int
        Of the next frames.
    start_us : int
        Device time of slot 0.
    last : bytes
        Body of the last request.
    """

    identity: HelloReply
    config: Config
    session: int
    seq: int
    start_us: int
    stream_next: int = FIRST_STREAM_SEQ
    last: bytes = b""

    def request(
        self, message: Message, *, back: int = 0, flags: int = 0, time_us: int = 0, other: int = 0
    ) -> bytes:
        """Return the body of a request, *back* numbers behind the next one."""
        if not back:
            self.seq += 1
        seq = (self.seq - max(0, back - 1)) & 0xFFFF
        session = self.session ^ other
        self.last = build_body(
            message, flags=flags, seq=seq, time_us=time_us & 0xFFFFFFFF, session=session
        )
        return self.last


@dataclass(frozen=True, slots=True)
class DialogueAction:
    """One frame of a random host.

    Attributes
    ----------
    slot : int
        Slot at whose beginning the frame is sent.
    text : str
        Description, for the dialogue that is printed.
    body : callable
        Given the host, returns header and payload.
    damage : int
        0: none; 1: a bit of the frame inverted; 2: cut; 3: noise instead.
    seed : int
        Of the damage.
    ends_slot : bool
        Whether the frame is latched right after its arrival: in which carrier period depends on
        microseconds, so that only one such frame is sent in a slot, as the last one.
    """

    slot: int
    text: str
    body: Callable[[DialogueHost], bytes] = field(repr=False)
    damage: int = 0
    seed: int = 0
    ends_slot: bool = False

    def wire(self, host: DialogueHost) -> bytes:
        """Return the bytes on the line."""
        source, wire = random.Random(self.seed), encode_frame(self.body(host))
        if self.damage == 1:
            at = source.randrange(1, len(wire) - 1)
            flipped = wire[at] ^ (1 << source.randrange(8)) or wire[at] ^ 0xFF
            return wire[:at] + bytes([flipped]) + wire[at + 1 :]
        if self.damage == 2:
            return wire[: source.randrange(2, len(wire) - 1)] + b"\x00"
        if self.damage == 3:
            return b"\x00" + noise_bytes(source, source.choice((3, 40, 300))) + b"\x00"
        return wire


class DialogueGenerator:
    """Makes random dialogues for one board.

    Parameters
    ----------
    identity : HelloReply
        The board, with its capabilities and limits.
    seed : int
        The same seed gives the same dialogue.
    """

    def __init__(self, identity: HelloReply, seed: int) -> None:
        self._identity = identity
        self._random = random.Random(seed)
        self._can = Feature(identity.features & sum(Feature))

    def config(self) -> Config:
        """Return the configuration of a dialogue: no timer ends where bytes may arrive.

        Frames arrive at the beginning of a slot and are latched there or in its middle, so that
        the hold ends at 0.2 or 0.7 of one; the lease at 0.35, an unattended playback at 0.85.
        """
        pick = self._random.choice
        slot_ms = SLOT_US // 1000
        modes = [TraceMode.OFF]
        for feature, mode in (
            (Feature.TRACE, TraceMode.CRC),
            (Feature.TRACE_DRIVE, TraceMode.DRIVE),
            (Feature.TRACE_RING, TraceMode.RING),
        ):
            modes += [mode] * 2 if self._can & feature else []
        return Config(
            hold_ms=slot_ms * pick((2, 4, 20)) + slot_ms // 5,
            ramp_ms=0,
            host_timeout_ms=slot_ms * pick((3, 5, 50)) + 35 * slot_ms // 100,
            status_period_ms=0,
            late_window_us=pick((0, 30_000)),
            sound_speed_mm_s=pick((343_200, 331_000, 352_000)),
            trace_mode=pick(modes),
            amplitude_ceiling=pick((255, 255, 100, 1)),
            trace_divider=pick((1, 1, 2, 3)),
        )

    def actions(self, slots: int) -> list[DialogueAction]:
        """Return a random dialogue of so many slots."""
        made = []
        for slot in range(slots):
            number = self._random.choice((0, 1, 1, 2, 2, 3, 6))
            batch = [self._action(slot) for _ in range(number)]
            batch.sort(key=lambda action: not action.text.startswith(Mute.TYPE.name))
            made += [action for action in batch if not action.ends_slot]
            made += [action for action in batch if action.ends_slot][:1]
        return made

    def _action(self, slot: int) -> DialogueAction:
        pick = self._random.choice
        kinds = [self._stream] * 9 + [self._request] * 8 + [self._odd] * 4
        text, body = pick(kinds)(slot)
        ends_slot = any(word in text for word in _AT_ONCE)
        damage = self._random.choices((0, 1, 2, 3), (16, 1.5, 0.5, 0.3))[0]
        named = text + ("", ", a bit inverted", ", cut short", ": noise instead")[damage]
        return DialogueAction(slot, named, body, damage, self._random.getrandbits(32), ends_slot)

    # --- stream --------------------------------------------------------------------------------

    def _stream(self, slot: int) -> tuple[str, Callable[[DialogueHost], bytes]]:
        pick = self._random.choice
        message = self._drive()
        # In slots from now on; -1, -3: 10 ms and 60 ms late; the horizon: far beyond it.
        ahead = pick((None, None, 0.5, 0.5, 1.5, 1.5, 2.5, 3.5, 6.5, "late", "too late", "far"))
        step = self._random.choices((0, 1, -1, 300), (14, 1, 2, 0.3))[0]
        flags = pick([0] * 14 + list(_UNKNOWN_FLAGS))
        wrong = pick([0] * 14 + [0x0101])
        apart_us = pick((0, 0, 25, 1000, 3000))
        cut = pick([0] * 18 + [1])

        def body(host: DialogueHost) -> bytes:
            host.stream_next += max(0, step)
            seq = host.stream_next + min(0, step)
            host.stream_next += step >= 0
            offsets = {"late": -10_000, "too late": -60_000}
            far_us = 2 * host.identity.max_horizon_us
            us = far_us if ahead == "far" else offsets.get(str(ahead), 0)
            if isinstance(ahead, float):
                us = round(ahead * SLOT_US) + apart_us
            time_us = host.start_us + slot * SLOT_US + us
            whole = build_body(
                message,
                flags=flags | (Flag.IMMEDIATE if ahead is None else 0),
                seq=seq & 0xFFFF,
                time_us=time_us & 0xFFFFFFFF,
                session=host.session ^ wrong,
            )
            return whole[: len(whole) - cut]

        when = "at once" if ahead is None else f"for {ahead} slots ahead"
        return f"{message.TYPE.name} {when}, step {step}, flags {flags:#x}, session ^ {wrong}", body

    def _drive(self) -> Message:
        count, pick = self._identity.transducers, self._random.choice
        kinds: list[Callable[[], Message]] = []
        for bits, bit in ((8, 1), (6, 2), (5, 4)):
            if self._identity.phase_formats & bit:
                kinds.append(lambda bits=bits: self._phases(bits))  # type: ignore[misc]
        if self._can & Feature.AMPLITUDE:
            codes = self._random.randbytes(2 * count)
            kinds.append(lambda: Drives(PhaseFormat.BITS_8, 0, codes))
        if self._can & Feature.POINTS:
            kinds.append(lambda: Points((self._point(),)))
        return pick(kinds)()

    def _phases(self, bits: int) -> Message:
        count = self._identity.transducers
        codes = bytes(self._random.randrange(1 << bits) for _ in range(count))
        return Phases(PhaseFormat(bits), 0, pack_phases(codes, PhaseFormat(bits)))

    def _point(self) -> FocalPoint:
        across = self._random.randrange
        level = across(30_000, 65_536)
        x_um, y_um = across(-40_000, 40_000), across(-40_000, 40_000)
        return FocalPoint(x_um, y_um, across(80_000, 200_000), level, across(65_536))

    # --- requests ------------------------------------------------------------------------------

    def _request(self, slot: int) -> tuple[str, Callable[[DialogueHost], bytes]]:
        pick = self._random.choice
        flags = pick([0] * 16 + [Flag.IMMEDIATE, *_UNKNOWN_FLAGS])
        back = self._random.choices((0, 1, 2, 5), (16, 2, 1, 1))[0]
        other = pick([0] * 16 + [0x2222])
        message = pick(self._requests())()
        if isinstance(message, Play) and message.period_us < SLOT_US:
            flags |= pick((0, Flag.IMMEDIATE))  # later frames of it end before the next slot
        elif isinstance(message, Play):
            flags &= ~Flag.IMMEDIATE
        later = pick((0.5, 1.5, 1.5, -2.0, 10_000))

        def body(host: DialogueHost) -> bytes:
            sent = message
            if isinstance(sent, SetConfig):
                sent = SetConfig(host.config)
            us = host.start_us + slot * SLOT_US + round(later * SLOT_US)
            return host.request(sent, back=back, flags=flags, time_us=us, other=other)

        return (
            f"{message.TYPE.name} {_told_in_dialogue(message)}, {back} back, flags {flags:#x}",
            body,
        )

    def _requests(self) -> list[Callable[[], Message]]:
        across = self._random.randrange
        count = self._identity.transducers
        choices: list[Callable[[], Message]] = [Arm] * 6
        choices += [Mute, Disarm, GetStatus, GetStatus, GetConfig]
        choices += [lambda: Ping(across(2**64)), lambda: GetGeometry(across(count + 2), across(9))]
        if self._can & Feature.CONFIG:
            choices.append(lambda: SetConfig(Config()))
        for feature, kind in (
            (Feature.READ_LATCHED, DriveKind.LATCHED),
            (Feature.READ_RADIATED, DriveKind.RADIATED),
        ):
            if self._can & feature:
                choices += [lambda kind=kind: ReadDrive(kind, 0, count)] * 2  # type: ignore[misc]
        if self._can & Feature.TRACE_RING:
            choices.append(lambda: ReadTrace(across(6), across(30)))
        if self._can & Feature.SEQUENCE_PHASES:
            choices += [self._play, self._play, self._play, Stop]
            choices += [self._begin, self._chunk, lambda: UploadCommit(3)]
        return choices

    def _play(self) -> Message:
        pick = self._random.choice
        sequences = [STORED_PHASES, STORED_PHASES, ABSENT]
        if self._can & Feature.SEQUENCE_POINTS:
            sequences.append(STORED_POINTS)
        # A whole slot a frame, or all frames well within half a slot.
        period_us, loops = pick(((SLOT_US, 0), (SLOT_US, 1), (SLOT_US, 4), (1003, 1), (1003, 2)))
        slot_ms = SLOT_US // 1000
        alone_ms = pick((0, 4 * slot_ms + 85 * slot_ms // 100, 10_000))
        return Play(pick(sequences), period_us, loops, alone_ms)

    def _begin(self) -> Message:
        count, pick = self._identity.transducers, self._random.choice
        data = bytes(2 * count)
        size = pick((len(data), len(data), len(data) + 1, 0))
        kind = pick((UploadKind.PHASES, UploadKind.PHASES, UploadKind.CORRECTION))
        return UploadBegin(kind, pick((0, 0, 1)), pick((3, 3, 0)), size, zlib.crc32(data))

    def _chunk(self) -> Message:
        count = self._identity.transducers
        largest = min(count, self._identity.max_chunk)
        return UploadChunk(self._random.choice((0, count, 7 * count)), bytes(largest))

    def _odd(self, slot: int) -> tuple[str, Callable[[DialogueHost], bytes]]:
        """Return a frame of an unknown type, of a wrong length, or the last request again."""
        kind = self._random.choice(_UNKNOWN_TYPES)
        text, body = self._random.choice((self._stream, self._request))(slot)
        chance = self._random.random()
        if chance < 0.4:
            again = Ping(slot)
            return "the last request again", lambda host: host.last or host.request(again)
        if chance < 0.7:
            return f"{text}, as type {kind:#x}", lambda host: bytes([kind]) + body(host)[1:]
        return f"{text}, a byte too long", lambda host: body(host) + b"\x00"


def _told_in_dialogue(message: Message) -> str:
    return str({name: getattr(message, name) for name in message.WIRE})
