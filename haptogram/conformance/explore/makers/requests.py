"""Requests of a random host, and values at and around every limit."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial
from typing import Final

from haptogram_protocol.framing import HEADER_BYTES, MAX_BODY_BYTES
from haptogram_protocol.messages import (
    Arm,
    Disarm,
    DriveKind,
    Feature,
    Flag,
    GetConfig,
    GetGeometry,
    GetStatus,
    Message,
    Mute,
    Ping,
    Play,
    ReadDrive,
    ReadTrace,
    SetConfig,
    Stop,
    UploadChunk,
)
from haptogram_protocol.rules import READ_CAPABILITIES

from ..actions import ABSENT, REPLACED, SLOT_US, STORED_PHASES, UPLOADED
from ..host import DialogueHost
from ..tables.limit_requests import random_limit_requests
from .conditions import DialogueConditions, DialogueMaker
from .configurations import RandomConfigs
from .stream import ODD_FLAGS, WRONG_SESSIONS, MadeAction
from .uploads import RandomUploads
from .words import words_of_message, words_of_oddities

_MOST_U16: Final = 0xFFFF
_MOST_U32: Final = 0xFFFFFFFF
_BACK: Final = (0, 1, 2, 5, 0x7FFF)  # 0: the next number; 1: the last one
_BACK_WEIGHTS: Final = (20, 2, 1, 1, 0.3)
_JUMPS: Final = (0, 300, 0x7FF0)  # numbers that are left out
_JUMP_WEIGHTS: Final = (60, 1, 1)
#: Defects of a request, of which each has its place in the order of the checks (HG-3.8).
DEFECTS: Final[dict[str, dict[str, int]]] = {
    "IMMEDIATE": {"flags": Flag.IMMEDIATE},
    "a flag that must be understood": {"flags": 0x40},
    "a flag that may be ignored": {"flags": 0x02},
    "another session": {"other": WRONG_SESSIONS[0]},
    "no session": {"other": WRONG_SESSIONS[-1]},
    "a byte less": {"cut": -1},
    "a byte more": {"cut": 1},
    "300 bytes more": {"cut": 300},
    "no payload": {"cut": -9999},
    "the last number": {"back": 1},
    "an old number": {"back": 5},
}
_LONG_PERIOD_US: Final = 450  # 100 loops of 1 to 3 frames, and 300, end where no bytes arrive


class RandomRequests(DialogueMaker):
    """Makes requests.

    Parameters
    ----------
    conditions : DialogueConditions
        Conditions of the dialogue.
    configs : RandomConfigs
        Makes configurations.

    Attributes
    ----------
    uploads : RandomUploads
        Makes uploads.
    """

    def __init__(self, conditions: DialogueConditions, configs: RandomConfigs) -> None:
        super().__init__(conditions)
        self._coverage = conditions.coverage
        self._same_number = False
        self._configs = configs
        waiting = (0.5, 1.5, 1.5) if conditions.timed else (100, 100, 100)
        self._starts = [0.5, *waiting, -2.0, -0.25, 10_000]  # slots from now
        horizon = self._identity.max_horizon_us / SLOT_US
        self._starts += [horizon - 1, horizon + 1]
        if conditions.exact:
            self._starts += [horizon, horizon + 1 / SLOT_US]
        # A whole slot a frame, or all frames well within half a slot.
        self._periods = [(SLOT_US, 0), (SLOT_US, 1), (SLOT_US, 4), (SLOT_US + 7, 3)]
        if conditions.fast:
            self._periods += [(1003, 1), (1003, 2), (507, 3)] * (1 if conditions.timed else 4)
        self.uploads = RandomUploads(conditions)

    @property
    def plays(self) -> bool:
        """True if the board plays sequences."""
        return bool(self._can & Feature.SEQUENCE_PHASES)

    def request(self) -> MadeAction:
        """Return a request ."""
        return self._made(self._random.choice(self._choices())())

    def at_limit(self) -> MadeAction:
        """Return a request with one field at or beyond a limit: each once before any twice."""
        if not self._coverage.limits:
            self._coverage.limits = random_limit_requests(self._identity, self._configs.config())
            self._random.shuffle(self._coverage.limits)
        name, text, body = self._made(self._coverage.limits.pop(), is_odd=False)
        self._same_number = self._random.random() < 0.4
        return f"{name} at a limit", text, body

    def _made(self, message: Message, *, is_odd: bool = True) -> MadeAction:
        pick = self._random.choice
        flags = other = back = jump = cut = 0
        if is_odd:
            odd = self._random.random()
            flags = pick((Flag.IMMEDIATE, *ODD_FLAGS)) if odd > 0.92 else 0
            other = pick(WRONG_SESSIONS) if 0.87 < odd <= 0.92 else 0
            cut = pick((-1, -9999, 1, 1, 300, 2500)) if 0.83 < odd <= 0.87 else 0
            back = self._random.choices(_BACK, _BACK_WEIGHTS)[0]
            jump = 0 if back else self._random.choices(_JUMPS, _JUMP_WEIGHTS)[0]
        if isinstance(message, Mute) and cut:
            cut = pick((1, 300, 3000))
        if self._same_number:  # a number that the refused request before may have used up
            back = 1
        self._same_number = bool(flags or other or cut) and self._random.random() < 0.5
        if isinstance(message, Play) and message.period_us < SLOT_US // 2:
            flags |= pick((0, Flag.IMMEDIATE))  # later frames of it end before the next slot
        elif isinstance(message, Play):
            flags &= ~Flag.IMMEDIATE
        return self._built(message, flags=flags, other=other, cut=cut, back=back, jump=jump)

    def defective(self, message: Message, defects: Iterable[str]) -> MadeAction:
        """Return a request with some of :data:`DEFECTS`."""
        some = list(defects)
        merged = {key: value for defect in some for key, value in DEFECTS[defect].items()}
        if isinstance(message, Mute):
            merged["cut"] = max(0, merged.get("cut", 0))
        made = self._built(message, **merged)
        return f"{made[0]} with {' and '.join(some)}", *made[1:]

    def _built(
        self,
        message: Message,
        *,
        flags: int = 0,
        other: int = 0,
        cut: int = 0,
        back: int = 0,
        jump: int = 0,
    ) -> MadeAction:
        """Return a request with flags, another session, bytes more or less, and its number.

        A number of another session is any, and none of the open one is left out for it.
        """
        later = self._random.choice(self._starts)
        apart = self._random.randrange(1 << 16) if other and self._random.random() < 0.5 else 0

        def body(host: DialogueHost) -> bytes:
            host.seq += jump
            us = host.slot_us + round(later * SLOT_US)
            wrong = host.session if other == WRONG_SESSIONS[-1] else other
            seq = host.seq
            host.seq += apart
            whole = host.request(message, back=back, flags=flags, time_us=us, other=wrong)
            if apart:
                host.seq = seq
            host.last = whole[: max(HEADER_BYTES, len(whole) + cut)] + bytes(max(0, cut))
            return host.last[:MAX_BODY_BYTES]

        odd = words_of_oddities(number=-back, left_out=jump, flags=flags, session=other, length=cut)
        return message.TYPE.name, f"{words_of_message(message)}{odd}", body

    # --- what a host means to send -------------------------------------------------------------

    def _choices(self) -> list[Callable[[], Message]]:
        across = self._random.randrange
        choices: list[Callable[[], Message]] = [Arm] * 6
        choices += [Mute, Mute, Disarm, Disarm, GetStatus, GetConfig]
        choices.append(lambda: Ping(across(2**64)))
        choices.append(lambda: GetGeometry(across(self._identity.transducers + 2), across(9)))
        if self._can & Feature.CONFIG:
            choices += [lambda: SetConfig(self._configs.config())] * 2
        choices += [self._read] * 4
        if self._can & Feature.SEQUENCE_PHASES:
            choices += [self._play, self._play, self._play, self._play, Stop, Stop]
        return choices + self.uploads.single()

    def _read(self) -> Message:
        reads = self.reads()
        return self._random.choice(reads)() if reads else GetStatus()

    def reads(self) -> list[Callable[[], Message]]:
        """Return the makers of requests that read drives and latches, whole and in part."""
        pick, across = self._random.choice, self._random.randrange
        count = self._identity.transducers
        reads: list[Callable[[], Message]] = []

        def drive(kind: DriveKind) -> Message:
            first = pick((0, 0, 0, across(count), count - 1))
            return ReadDrive(kind, first, pick((count, count - first, 1, _MOST_U16)))

        reads += [partial(drive, whole.kind) for whole in self._whole_drives()]
        if self._can & Feature.TRACE_RING:
            firsts = (0, 0, 0, across(12), across(300), _MOST_U32, _MOST_U16)
            reads.append(lambda: ReadTrace(pick(firsts), pick((_MOST_U16, 4, 30, 1))))
        return reads

    def _play(self) -> Message:
        pick = self._random.choice
        sequences = [*UPLOADED, *UPLOADED, ABSENT]
        period_us, loops = pick(self._periods)
        return Play(pick(sequences), period_us, loops, self._configs.unattended_ms())

    def long_play(self, loops: int = 0) -> MadeAction:
        """Return PLAY of hundreds of frames within a few slots."""
        loops = loops or self._random.choice((100, 100, 300))
        play = Play(STORED_PHASES, _LONG_PERIOD_US, loops, self._configs.unattended_ms() or 6000)
        name, text, body = self._made(play, is_odd=False)
        return f"{name} long", text, body

    def play_at_once(self) -> MadeAction:
        """Return PLAY with IMMEDIATE, of a few frames."""
        period_us = self._random.choice((507, 1003))
        unattended_ms = self._configs.unattended_ms() or 6000
        play = Play(self._random.choice(UPLOADED), period_us, 1, unattended_ms)
        return self._built(play, flags=Flag.IMMEDIATE)

    def short_play(self) -> MadeAction:
        """Return PLAY of a long sequence, once and as fast as the board can."""
        period_us = -(-1_000_000 // max(1, self._identity.max_playback_rate_hz))
        play = Play(REPLACED, period_us, 1, self._configs.unattended_ms() or 6000)

        def body(host: DialogueHost) -> bytes:
            return host.request(play, time_us=host.slot_us + SLOT_US // 2)

        return "PLAY", words_of_message(play), body

    # --- what makes a dialogue go on, or shows what it did -------------------------------------

    def plain(self, message: Message) -> MadeAction:
        """Return a request as it should be."""

        def body(host: DialogueHost) -> bytes:
            whole = host.request(message)
            if not isinstance(message, UploadChunk):
                host.remember(whole)
            return whole

        return message.TYPE.name, words_of_message(message), body

    def new_config(self) -> MadeAction:
        """Return SET_CONFIG as it should be: timers that run take their new lengths."""
        return self.plain(SetConfig(self._configs.config()))

    def probe(self) -> list[MadeAction]:
        """Return requests that together show what a board may have changed."""
        asked: list[Message] = [*self._whole_drives()]
        if self.plays:  # its refusal shows how many sequences are stored
            asked.append(Play(ABSENT, SLOT_US, 1, 1000))
        if self._can & Feature.TRACE_RING:
            asked.append(ReadTrace(self._random.choice((0, 1)), _MOST_U16))
        asked += [UploadChunk(0, b""), GetConfig()]
        self._random.shuffle(asked)
        shown = [GetStatus(), *asked[: self._random.choice((0, 1, 2, len(asked)))]]
        made = [self.plain(message) for message in shown]
        return [self.repeated(), *made] if self._random.random() < 0.4 else made

    def _whole_drives(self) -> list[ReadDrive]:
        count = self._identity.transducers
        return [
            ReadDrive(kind, 0, count)
            for kind, needed in READ_CAPABILITIES.items()
            if self._can & needed
        ]

    def read_backs(self) -> list[MadeAction]:
        """Return requests for the whole drive, latched and radiated."""
        return [self.plain(message) for message in self._whole_drives()]

    def repeated(self) -> MadeAction:
        """Return the request that the board remembers, once more."""
        ping = Ping(0)
        text = "the remembered request once more"
        return text, text, lambda host: host.remembered or host.request(ping)

    def keeping(self) -> MadeAction:
        """Return a request that changes nothing and renews the lease."""
        count = self._identity.transducers
        messages: list[Message] = [Ping(0), GetStatus(), GetConfig(), GetGeometry(0, 1), Arm()]
        messages += [UploadChunk(0, b""), UploadChunk(0, bytes(count)), Stop()]
        messages += [make() for make in self.reads()]
        return self.plain(self._random.choice(messages))

    def start(
        self,
        *,
        later: float | None = None,
        loops: int | None = None,
        unattended_ms: int | None = None,
    ) -> MadeAction:
        """Return PLAY as it should be, from the middle of a slot on until something ends it."""
        pick = self._random.choice
        loops = pick((0, 0, 1, 2)) if loops is None else loops
        unattended_ms = unattended_ms or self._configs.unattended_ms() or 1
        play = Play(pick(UPLOADED), SLOT_US, loops, unattended_ms)
        later = later or pick((0.5, 0.5, 1.5, 8.5))

        def body(host: DialogueHost) -> bytes:
            return host.request(play, time_us=host.slot_us + round(later * SLOT_US))

        text = f"{words_of_message(play)}, to begin {round(later * SLOT_US)} µs after the slot"
        return "PLAY", text, body
