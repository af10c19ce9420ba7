"""Requests of a random host, and values at and around every limit."""

from __future__ import annotations

import random
import zlib
from collections.abc import Callable
from typing import Final

from haptogram_protocol.messages import (
    Arm,
    Config,
    Disarm,
    DriveKind,
    Feature,
    Flag,
    GetConfig,
    GetGeometry,
    GetStatus,
    Hello,
    HelloReply,
    Message,
    Mute,
    Ping,
    Play,
    ReadDrive,
    ReadTrace,
    SetConfig,
    Stop,
    TraceMode,
    UploadBegin,
    UploadChunk,
    UploadCommit,
    UploadKind,
)

from .actions import (
    ABSENT,
    REPLACED,
    SLOT_US,
    STORED_FRAMES,
    STORED_PHASES,
    STORED_POINTS,
    DialogueHost,
)
from .coverage import DialogueCoverage
from .limit_requests import random_limit_requests
from .stream_actions import UNKNOWN_FLAGS, MadeAction

_SLOT_MS: Final = SLOT_US // 1000
_POINT_BYTES: Final = 16


class RandomRequests:
    """Makes requests.

    Parameters
    ----------
    identity : HelloReply
        The board, with its capabilities and limits.
    source : random.Random
        Chance.
    coverage : DialogueCoverage
        What dialogues before have sent.
    """

    def __init__(
        self, identity: HelloReply, source: random.Random, coverage: DialogueCoverage
    ) -> None:
        self._coverage = coverage
        self._same_number = False
        self._identity = identity
        self._random = source
        self._can = Feature(identity.features & sum(Feature))

    @property
    def uploads_sequences(self) -> bool:
        """True if the board has room for the sequences of a dialogue, one of them replaced."""
        room = (STORED_FRAMES + 2 * 2) * self._identity.transducers + 8 * _POINT_BYTES
        can = bool(self._can & Feature.SEQUENCE_PHASES)
        return can and room <= self._identity.max_upload_bytes

    def config(self) -> Config:
        """Return a configuration: no timer ends where bytes may arrive.

        Frames arrive at the beginning of a slot and are latched there or in its middle, so that
        the hold ends at 0.2 or 0.7 of one; the lease at 0.25, behind a playback that ends at up to
        0.63 at 0.88; an unattended playback at 0.85.  A timer of 10 s never ends.
        """
        pick = self._random.choice
        modes = [TraceMode.OFF]
        for feature, mode in (
            (Feature.TRACE, TraceMode.CRC),
            (Feature.TRACE_DRIVE, TraceMode.DRIVE),
            (Feature.TRACE_RING, TraceMode.RING),
        ):
            modes += [mode] * 2 if self._can & feature else []
        if self._can & Feature.TRACE_DRIVE:
            modes += [TraceMode.DRIVE] * 2
        return Config(
            hold_ms=pick([_SLOT_MS * slots + _SLOT_MS // 5 for slots in (2, 2, 4, 20)] + [10_000]),
            ramp_ms=0,
            host_timeout_ms=pick(
                [_SLOT_MS * slots + _SLOT_MS // 4 for slots in (3, 5, 50)] + [10_000]
            ),
            status_period_ms=0,
            late_window_us=pick((0, 30_000, 30_000, 100_000)),
            sound_speed_mm_s=pick((343_200, 331_000, 352_000, 300_000, 380_000)),
            trace_mode=pick(modes),
            amplitude_ceiling=pick((255, 255, 100, 1)),
            trace_divider=pick((1, 2, 3, 3)),
        )

    def request(self, slot: int) -> MadeAction:
        """Return a request sent in *slot*."""
        return self._made(slot, self._random.choice(self._choices())())

    def at_limit(self, slot: int) -> MadeAction:
        """Return a request with one field at or beyond a limit: each once before any twice."""
        if not self._coverage.limits:
            self._coverage.limits = random_limit_requests(self._identity, self.config())
            self._random.shuffle(self._coverage.limits)
        name, text, body = self._made(slot, self._coverage.limits.pop(), is_odd=False)
        self._same_number = self._random.random() < 0.4
        return f"{name} at a limit", text, body

    def _made(self, slot: int, message: Message, *, is_odd: bool = True) -> MadeAction:
        pick = self._random.choice
        flags = other = back = 0
        if is_odd:
            flags = pick([0] * 20 + [Flag.IMMEDIATE, *UNKNOWN_FLAGS])
            back = self._random.choices((0, 1, 2, 5), (14, 2, 1, 1))[0]
            other = pick([0] * 20 + [0x2222])
        if self._same_number:  # a number that the refused request before may have used up
            back, self._same_number = 1, False
        if isinstance(message, Play) and message.period_us < SLOT_US:
            flags |= pick((0, Flag.IMMEDIATE))  # later frames of it end before the next slot
        elif isinstance(message, Play):
            flags &= ~Flag.IMMEDIATE
        later = pick((0.5, 1.5, 1.5, -2.0, -0.25, -0.25, 10_000))

        def body(host: DialogueHost) -> bytes:
            us = host.start_us + slot * SLOT_US + round(later * SLOT_US)
            return host.request(message, back=back, flags=flags, time_us=us, other=other)

        name = message.TYPE.name
        shown = {field: getattr(message, field) for field in message.WIRE}
        if isinstance(message, SetConfig):
            shown = {"config": message.config}
        return name, f"{name} {shown}, {back} back, flags {flags:#x}", body

    # --- what a host means to send -------------------------------------------------------------

    def _choices(self) -> list[Callable[[], Message]]:
        across = self._random.randrange
        count = self._identity.transducers
        choices: list[Callable[[], Message]] = [Arm] * 6
        choices += [Mute, Mute, Disarm, GetStatus, GetStatus, GetConfig]
        choices += [lambda: Ping(across(2**64)), lambda: GetGeometry(across(count + 2), across(9))]
        if self._can & Feature.CONFIG:
            choices += [lambda: SetConfig(self.config())] * 2
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
            choices += [self._begin, self._chunk, lambda: UploadCommit(REPLACED)]
        return choices

    def _play(self) -> Message:
        pick = self._random.choice
        sequences = [STORED_PHASES, STORED_PHASES, ABSENT]
        if self._can & Feature.SEQUENCE_POINTS:
            sequences.append(STORED_POINTS)
        if self.uploads_sequences:
            sequences.append(REPLACED)
        # A whole slot a frame, or all frames well within half a slot.
        period_us, loops = pick(((SLOT_US, 0), (SLOT_US, 1), (SLOT_US, 4), (1003, 1), (1003, 2)))
        alone_ms = pick((0, 4 * _SLOT_MS + 85 * _SLOT_MS // 100, 10_000))
        return Play(pick(sequences), period_us, loops, alone_ms)

    def _begin(self) -> Message:
        count, pick = self._identity.transducers, self._random.choice
        data = bytes(2 * count)
        size = pick((len(data), len(data), len(data) + 1, 0))
        kind = pick((UploadKind.PHASES, UploadKind.PHASES, UploadKind.CORRECTION))
        return UploadBegin(kind, pick((0, 0, 1)), pick((REPLACED, 0)), size, zlib.crc32(data))

    def _chunk(self) -> Message:
        count = self._identity.transducers
        largest = min(count, self._identity.max_chunk)
        return UploadChunk(self._random.choice((0, count, 7 * count)), bytes(largest))

    def upload(self) -> list[MadeAction]:
        """Return the requests of a whole upload: a sequence replaced, or a correction.

        Empty if the board has no room for one.
        """
        count, pick = self._identity.transducers, self._random.choice
        wanted: list[tuple[UploadKind, int]] = []
        if self.uploads_sequences:
            wanted += [(UploadKind.PHASES, REPLACED)] * 2
        if self._can & Feature.CORRECTION:
            wanted.append((UploadKind.CORRECTION, 0))
        if not wanted:
            return []
        kind, target = pick(wanted)
        frames = 1 if kind is UploadKind.CORRECTION else pick((1, 2))
        data = self._random.randbytes(frames * count)
        step = min(self._identity.max_chunk, 512)
        parts = [UploadChunk(at, data[at : at + step]) for at in range(0, len(data), step)]
        steps = [UploadBegin(kind, 0, target, len(data), zlib.crc32(data)), *parts]
        return [_plain_random_request(message) for message in (*steps, UploadCommit(target))]

    def arm(self) -> MadeAction:
        """Return ARM, without which most frames are refused."""
        return "ARM", "ARM", lambda host: host.request(Arm())

    def new_config(self) -> MadeAction:
        """Return SET_CONFIG as it should be: timers that run take their new lengths."""
        message = SetConfig(self.config())
        return "SET_CONFIG", f"{message}", lambda host: host.request(message)

    def status(self) -> MadeAction:
        """Return GET_STATUS, which shows every counter."""
        return "GET_STATUS", "GET_STATUS", lambda host: host.request(GetStatus())

    # --- sessions ------------------------------------------------------------------------------

    def hello(self) -> MadeAction:
        """Return a HELLO: with the open nonce, one of sessions before, a new one or none."""
        across, pick = self._random.randrange, self._random.choice
        which = pick(("open", "open", "last", "last", "earlier", "new", "new", "0", "major 2"))
        new = across(1, 0x10000)
        table = pick((self._identity.description_hash, across(2**32)))

        def body(host: DialogueHost) -> bytes:
            known = {"open": host.session, "0": 0, "major 2": new}
            if host.sessions:
                known |= {"last": host.sessions[-1], "earlier": host.sessions[0]}
            message = Hello(1 + (which == "major 2"), 0, known.get(which, new), table)
            return host.hello(message, takes=which not in ("0", "major 2"))

        return f"HELLO {which}", f"HELLO, nonce: {which}", body


def _plain_random_request(message: Message) -> MadeAction:
    name = message.TYPE.name
    return name, f"{name} of a whole upload", lambda host: host.request(message)
