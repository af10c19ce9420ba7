"""Requests of a random host: every type, with any value that a board may take or refuse."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Final

from haptogram_protocol import messages as m
from haptogram_protocol.rules import READ_CAPABILITIES

from ..actions import (
    ABSENT,
    POINT_BYTES,
    REPLACED,
    SLOT_US,
    STORED_PHASES,
    UPLOADED,
    DialogueAction,
)
from .conditions import DialogueConditions
from .configurations import RandomConfigs
from .frames import ODD_FLAGS
from .uploads import RandomUploads

_MOST_U16: Final = 0xFFFF
_MOST_U32: Final = 0xFFFFFFFF
_LONG_PERIOD_US: Final = 450
_LONG_LOOPS: Final = 400  # loops of a sequence of three frames


class RandomRequests(RandomUploads):
    """Makes requests.

    Attributes
    ----------
    configs : RandomConfigs
        Makes configurations.
    """

    def __init__(self, conditions: DialogueConditions) -> None:
        super().__init__(conditions)
        self.configs = RandomConfigs(conditions)
        waiting = (0.5, 1.5, 1.5) if conditions.timed else (100.0, 100.0, 100.0)
        self._starts = [0.5, *waiting, -2.0, -0.25, 10_000.0]  # slots from now
        horizon = self._identity.max_horizon_us / SLOT_US
        self._starts += [horizon - 1, horizon + 1]
        if conditions.exact:
            self._starts += [horizon, horizon + 1 / SLOT_US]
        # A whole slot a frame, or all frames well within half a slot.
        self._periods = [(SLOT_US, 0), (SLOT_US, 1), (SLOT_US, 4), (SLOT_US + 7, 3)]
        if conditions.fast:
            self._periods += [(1003, 1), (1003, 2), (507, 3)] * (1 if conditions.timed else 4)

    @property
    def plays(self) -> bool:
        """True if the board plays sequences."""
        return bool(self._can & m.Feature.SEQUENCE_PHASES)

    def messages(self) -> dict[str, Callable[[], m.Message]]:
        """Return the makers of each request that the board knows, by name."""
        count, across = self._identity.transducers, self._across
        found: dict[str, Callable[[], m.Message]] = {
            "ARM": m.Arm,
            "MUTE": m.Mute,
            "DISARM": m.Disarm,
            "PING": lambda: m.Ping(across(2**64)),
            "GET_STATUS": m.GetStatus,
            "GET_CONFIG": m.GetConfig,
            "GET_GEOMETRY": lambda: m.GetGeometry(across(count + 2), across(9)),
            "SET_CONFIG": lambda: m.SetConfig(self.configs.last),
        }
        found |= {f"read {number}": read for number, read in enumerate(self._reads())}
        if self.plays:
            found |= {
                "STOP": m.Stop,
                "UPLOAD_BEGIN": self._begin,
                "UPLOAD_CHUNK": self._chunk,
                "UPLOAD_COMMIT": lambda: m.UploadCommit(self._pick((*UPLOADED, 0))),
                "PLAY of nothing": lambda: m.Play(ABSENT, SLOT_US, 1, 1000),
            }
        return found

    def whole_requests(self) -> list[m.Message]:
        """Return requests of every type as they should be, and of every kind of upload and read."""
        count, most = self._identity.transducers, self._identity.max_points
        points = {1, min(2, most), most} if m.Feature.SEQUENCE_POINTS in self._can else set()
        uploads = [m.UploadBegin(m.UploadKind.PHASES, 0, REPLACED, count, 0)] * self.plays
        uploads += [
            m.UploadBegin(m.UploadKind.POINTS, number, REPLACED, number * POINT_BYTES, 0)
            for number in sorted(points)
        ]
        if m.Feature.CORRECTION in self._can:
            uploads.append(m.UploadBegin(m.UploadKind.CORRECTION, 0, 0, count, 0))
        found: list[m.Message] = [m.GetGeometry(0, count), *self._whole_drive_reads(), *uploads]
        others = (make() for make in self.messages().values())
        return found + [other for other in others if type(other) not in set(map(type, found))]

    # --- what shows a board, and makes a dialogue go on ------------------------------------------

    def _reads(self) -> list[Callable[[], m.Message]]:
        """Return the makers of requests that read drives and latches, whole and in part."""
        pick, across, count = self._pick, self._across, self._identity.transducers

        def drive(kind: m.DriveKind) -> m.Message:
            first = pick((0, 0, 0, across(count), count - 1))
            return m.ReadDrive(kind, first, pick((count, count - first, 1, _MOST_U16)))

        reads: list[Callable[[], m.Message]] = [
            partial(drive, whole.kind) for whole in self._whole_drive_reads()
        ]
        if self._can & m.Feature.TRACE_RING:
            firsts = (0, 0, 0, across(12), across(300), _MOST_U32, _MOST_U16)
            reads.append(lambda: m.ReadTrace(pick(firsts), pick((_MOST_U16, 4, 30, 1))))
        return reads

    def _whole_drive_reads(self) -> list[m.ReadDrive]:
        """Return a READ_DRIVE of all elements for each kind of drive that the board reads back."""
        kinds = (kind for kind, needed in READ_CAPABILITIES.items() if self._can & needed)
        return [m.ReadDrive(kind, 0, self._identity.transducers) for kind in kinds]

    def read_backs(self) -> list[DialogueAction]:
        """Return requests for the whole drive, latched and radiated."""
        return [self.frame(message) for message in self._whole_drive_reads()]

    def probe(self) -> list[DialogueAction]:
        """Return requests that together show what a board may have changed."""
        asked: list[m.Message] = [*self._whole_drive_reads()]
        if self.plays:  # its refusal shows how many sequences are stored
            asked.append(m.Play(ABSENT, SLOT_US, 1, 1000))
        if self._can & m.Feature.TRACE_RING:
            asked.append(m.ReadTrace(self._pick((0, 1)), _MOST_U16))
        asked += [m.UploadChunk(0, b""), m.GetConfig()]
        self._random.shuffle(asked)
        shown = [m.GetStatus(), *asked[: self._pick((0, 1, 2, len(asked)))]]
        again = [self.repeated()] * (self._random.random() < 0.4)
        return [*again, *map(self.frame, shown)]

    def keeping(self) -> DialogueAction:
        """Return a request that changes nothing and renews the lease."""
        count = self._identity.transducers
        messages: list[m.Message] = [
            m.Ping(0),
            m.GetStatus(),
            m.GetConfig(),
            m.GetGeometry(0, 1),
            m.Arm(),
        ]
        messages += [m.UploadChunk(0, b""), m.UploadChunk(0, bytes(count)), m.Stop()]
        messages += [make() for make in self._reads()]
        return self.frame(self._pick(messages))

    # --- playbacks -------------------------------------------------------------------------------

    def any_play(self) -> DialogueAction:
        """Return PLAY of any sequence, at once or for any time."""
        period_us, loops = self._pick(self._periods)
        sequence = self._pick((*UPLOADED, *UPLOADED, ABSENT))
        play = m.Play(sequence, period_us, loops, self.configs.unattended_ms())
        # Later frames of it end before the next slot.
        may_begin_now = period_us < SLOT_US // 2 and self._pick((True, False))
        at = None if may_begin_now else self._pick(self._starts)
        return self.frame(play, at, flags=self._pick((0,) * 24 + ODD_FLAGS))

    def start(
        self, at: float, loops: Sequence[int] = (0, 0, 1, 2), unattended_ms: int | None = None
    ) -> DialogueAction:
        """Return PLAY as it should be, from the middle of a slot on until something ends it."""
        play = self._play(self._pick(UPLOADED), SLOT_US, self._pick(loops), unattended_ms)
        return self.frame(play, at)

    def long_play(self) -> DialogueAction:
        """Return PLAY of hundreds of frames within a few slots."""
        return self.frame(self._play(STORED_PHASES, _LONG_PERIOD_US, _LONG_LOOPS), 0.5)

    def play_at_once(self) -> DialogueAction:
        """Return PLAY with IMMEDIATE, of a few frames."""
        return self.frame(self._play(self._pick(UPLOADED), self._pick((507, 1003)), 1), None)

    def short_play(self) -> DialogueAction:
        """Return PLAY of a long sequence, once and as fast as the board can."""
        period_us = -(-1_000_000 // max(1, self._identity.max_playback_rate_hz))
        return self.frame(self._play(REPLACED, period_us, 1), 0.5)

    def _play(
        self, sequence: int, period_us: int, loops: int, unattended_ms: int | None = None
    ) -> m.Play:
        """Return a PLAY; its unattended time is a random one if *unattended_ms* is None."""
        unattended_ms = unattended_ms or self.configs.unattended_ms() or 6000
        return m.Play(sequence, period_us, loops, unattended_ms)

    # --- single steps of uploads, mostly refused --------------------------------------

    def _begin(self) -> m.Message:
        """Return an UPLOAD_BEGIN with random fields; the board refuses some of them."""
        pick, data = self._pick, bytes(2 * self._count)
        size = pick((len(data), self._count, len(data) + 1, 0))
        kind = pick((m.UploadKind.PHASES, m.UploadKind.PHASES, m.UploadKind.CORRECTION))
        return m.UploadBegin(kind, pick((0, 0, 1)), pick((REPLACED, 1, 0)), size, 0)

    def _chunk(self) -> m.Message:
        """Return an UPLOAD_CHUNK of random size and offset."""
        size = self._pick((0, 1, min(self._count, self._largest)))
        return m.UploadChunk(self._pick((0, self._count, 7 * self._count)), bytes(size))
