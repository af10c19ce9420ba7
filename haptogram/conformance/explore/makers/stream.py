"""Stream frames of a random host, in time and late, in order and not, of every format."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from haptogram_protocol.framing import HEADER_BYTES, MAX_BODY_BYTES
from haptogram_protocol.messages import (
    Drives,
    Feature,
    Flag,
    FocalPoint,
    Message,
    Phases,
    Points,
    build_body,
)

from ..actions import LATE_WINDOWS_US, SLOT_US
from ..host import DialogueHost
from .conditions import DialogueConditions, DialogueMaker
from .words import words_of_oddities

#: What an action is made of: its name, its text and the body.
MadeAction = tuple[str, str, Callable[[DialogueHost], bytes]]

#: High: must be understood, and is not; low: may be ignored.
ODD_FLAGS: Final = (0x20, 0x40, 0x80, 0x01, 0x02, 0x04, 0x08, 0xFF & ~Flag.IMMEDIATE)
#: Of a session that is not the open one: low byte the same, high byte the same, none.
WRONG_SESSIONS: Final = (0x0100, 0x0001, 0x8000, 0x2222)
_STEPS: Final = (1, 0, -1, -2, 300, 0x2000, 0x7FF0, 0x8010, 0x7FFF, 0x8000, -32)
_STEP_WEIGHTS: Final = (4, 11, 0.6, 0.3, 0.3, 0.2, 0.4, 0.1, 0.2, 0.3, 0.1)
_FAR_US: Final = 4_000_000  # later than any dialogue ends
_FRAMES: Final = 8  # in a slot, at most
_BURST: Final = 40  # frames sent in one slot, at most
_LONG_BURST: Final = 300  # where bytes take no time: more than 8 bits count
_EDGES_UM: Final = (0, 1, -1, 1_000_000, -1_000_000)  # of a point: accuracy is demanded within 1 m
_EDGE_SHARE: Final = 0.3  # of the points
_PART_SHARE: Final = 0.4  # of the frames are those before, but for a part
_EDGES_U16: Final = (0, 1, 0x4000, 0x7FFF, 0x8000, 0xFFFF)


class RandomStream(DialogueMaker):
    """Makes stream frames."""

    def __init__(self, conditions: DialogueConditions) -> None:
        super().__init__(conditions)
        identity = conditions.identity
        self._count = identity.transducers
        self._before = bytes(2 * self._count)
        # The points of a slot are computed before its middle.
        fitting = SLOT_US // 4 // (_FRAMES * identity.point_time_us or 1)
        has_points = bool(self._can & Feature.POINTS)
        self._most_points = min(identity.max_points, fitting) * has_points
        self._aheads: list[Any] = [None, None, None, 0.5, 0.5, "far", "late", "too late", "beyond"]
        self._aheads += [0.5, 1.5, 1.5, 2.5, 3.5, 6.5] if conditions.timed else ["far"]
        self._aheads += ["at a limit", "at a limit"] if conditions.exact else []
        self._exact = conditions.exact

    def frame(self) -> MadeAction:
        """Return a frame: at once, in half a slot or some slots and a half, late, or far ahead."""
        pick = self._random.choice
        odd = self._random.random()
        return self.of(
            pick(self._aheads),
            self._drive(),
            apart_us=pick((0, 0, 10, 25, 26, 1000, 3000)),
            step=self._random.choices(_STEPS, _STEP_WEIGHTS)[0],
            flags=pick(ODD_FLAGS) if odd > 0.93 else 0,
            wrong=pick(WRONG_SESSIONS) if 0.88 < odd <= 0.93 else 0,
            cut=pick((-1, -16, -9999, 1, 300)) if 0.85 < odd <= 0.88 else 0,
        )

    def burst(self, *, may_latch: bool) -> list[MadeAction]:
        """Return so many short frames that a queue fills or a counter of few bits wraps."""
        pick = self._random.choice
        number = pick((self._random.randint(3, _BURST), self._identity.queue_depth + 1))
        number = pick((min(number, _BURST), _LONG_BURST if self._exact else _BURST))
        first_us = pick((_FAR_US, SLOT_US // 2)) if may_latch else _FAR_US
        step_us = pick((10, 25, 30, 100))
        step, wrong = pick(((0, 0), (0, 0), (1, 0), (-1, 0), (0, 1)))  # new, seen before, foreign
        return self.row(number, first_us, step_us, step=step, wrong=wrong)

    def full_queue(self) -> list[MadeAction]:
        """Return frames, far ahead, that fill the queue."""
        return self.row(min(self._identity.queue_depth, _BURST), _FAR_US)

    def row(
        self, number: int, first_us: int, step_us: int = 100, *, step: int = 0, wrong: int = 0
    ) -> list[MadeAction]:
        """Return so many frames, of a format that is short."""
        kinds = self.kinds
        if self._identity.point_time_us:
            kinds.pop("POINTS", None)
        shortest = min((make() for make in kinds.values()), key=lambda one: len(one.serialize()))
        return [
            self.of(first_us / SLOT_US, shortest, apart_us=n * step_us, step=step, wrong=wrong)
            for n in range(number)
        ]

    def pair(self) -> list[MadeAction]:
        """Return two frames, often of two formats, for one carrier period or two neighbours.

        Or, where bytes arrive to the microsecond, for any two times.
        """
        pick = self._random.choice
        if self._exact and self._random.random() < 0.5:
            times = (None, None, "late", 0.0, 0.5)
            return [self.of(pick(times)), self.of(pick(times))]
        ahead, apart_us = pick((0.5, 0.5, 1.5)), pick((0, 1, 7))
        then_us = apart_us + pick((1, 10, 18, 24, 25))
        return [self.of(ahead, apart_us=apart_us), self.of(ahead, apart_us=then_us)]

    def plain(self, ahead: float | str | None) -> MadeAction:
        """Return a frame as it should be, to be latched so many slots from now; None: at once."""
        return self.of(ahead)

    def refused(self) -> MadeAction:
        """Return a frame in time, of a kind or with a value that no board takes."""
        return self.of(0.5, self._refused(self.any()))

    def foreign(self) -> MadeAction:
        """Return a frame of another session."""
        return self.of(0.5, wrong=self._random.choice(WRONG_SESSIONS[:-1]))

    def of(
        self,
        ahead: Any,
        message: Message | None = None,
        *,
        apart_us: int = 0,
        step: int = 0,
        wrong: int = 0,
        flags: int = 0,
        cut: int = 0,
    ) -> MadeAction:
        """Return a frame so many slots ahead; None: at once; else a name of a time.

        *step* is added to the number, *cut* to the length, *wrong* combined with the session.
        """
        message = message or self.any()
        limit_us = self._limit_us() if ahead == "at a limit" else 0
        if ahead is None:  # its time counts for nothing
            far_us = self._random.randrange(1 << 32)
            limit_us = self._random.choice((0, -3 * SLOT_US, 8 * SLOT_US, 1 << 31, far_us))
        kind = message.TYPE

        def body(host: DialogueHost) -> bytes:
            host.stream_next += max(0, step)
            seq = (host.stream_next + min(0, step)) & 0xFFFF
            host.stream_next += step >= 0
            us = self._ahead_us(ahead, limit_us) + (apart_us if isinstance(ahead, float) else 0)
            whole = build_body(
                message,
                flags=flags | (Flag.IMMEDIATE if ahead is None else 0),
                seq=seq,
                time_us=(host.slot_us + us) & 0xFFFFFFFF,
                session=0 if wrong == WRONG_SESSIONS[-1] else host.session ^ wrong,
            )
            made = whole[: max(HEADER_BYTES, len(whole) + cut)] + bytes(max(0, cut))
            return made[:MAX_BODY_BYTES]

        when = "at once" if ahead is None else f"for {ahead}"
        named = f"{kind.name} {when}"
        if ahead is not None:
            due_us = self._ahead_us(ahead, limit_us) + (apart_us if isinstance(ahead, float) else 0)
            when = f"due {due_us} µs after the slot begins"
        odd = words_of_oddities(number=step, flags=flags, session=wrong, length=cut)
        return named, f"{kind.name} {when}{odd}", body

    def _ahead_us(self, ahead: Any, limit_us: int) -> int:
        if isinstance(ahead, float):
            return round(ahead * SLOT_US)
        horizon_us = self._identity.max_horizon_us
        named = {
            "late": -SLOT_US // 4,
            "too late": -SLOT_US * 3 // 2,
            "beyond": 2 * horizon_us,
            "far": min(_FAR_US, horizon_us // 2),
        }
        return named.get(str(ahead), limit_us)

    def _limit_us(self) -> int:
        """Return a time ahead at which a board's answer changes, to the microsecond."""
        horizon_us = self._identity.max_horizon_us
        lead_us = self._identity.latch_lead_us
        windows = [lead_us - window_us for window_us in LATE_WINDOWS_US]
        edges = (*windows, *windows, *windows, 1, 2**31 - 1, -(2**31))
        return self._random.choice(
            (horizon_us, horizon_us + 1, *(edge + apart for edge in edges for apart in (0, -1)))
        )

    # --- what a frame carries ------------------------------------------------------------------

    def _drive(self) -> Message:
        made = self.any()
        return self._refused(made) if self._random.random() < 0.12 else made

    @property
    def kinds(self) -> dict[str, Callable[[], Message]]:
        """Makers of the message of a frame, by type and format."""
        kinds: dict[str, Callable[[], Message]] = {}
        kinds["PHASES"] = lambda: Phases(self._codes()[: self._count])
        if self._can & Feature.AMPLITUDE:
            kinds["DRIVES"] = lambda: Drives(self._codes())
        if self._most_points:
            kinds["POINTS"] = self._points
        return kinds

    def any(self) -> Message:
        """Return the message of a frame of any kind."""
        return self._random.choice(list(self.kinds.values()))()

    def _codes(self) -> bytes:
        """Return phases and amplitudes; often those of the frame before, but for a part."""
        codes, count = self._random.randbytes(2 * self._count), self._count
        if self._random.random() < _PART_SHARE:
            one, before = self._random.randrange(2 * count), self._before
            alike = (
                before[:count] + codes[count:],
                codes[:count] + before[count:],
                before[:one] + codes[one : one + 1] + before[one + 1 :],
            )
            codes = self._random.choice(alike)
        self._before = codes
        return codes

    def _points(self) -> Message:
        most = self._most_points
        number = self._random.choice((1, 1, min(2, most), most))
        return Points(tuple(self._point() for _ in range(number)))

    def _point(self) -> FocalPoint:
        across, pick = self._random.randrange, self._random.choice
        level, phase = across(30_000, 65_536), across(65_536)
        x_um, y_um = across(-40_000, 40_000), across(-40_000, 40_000)
        place = [x_um, y_um, across(80_000, 200_000)]
        if self._random.random() < _EDGE_SHARE:
            for n in range(len(place)):
                place[n] = pick((place[n], *_EDGES_UM))
            if self._random.random() < _EDGE_SHARE:
                place[:2] = self._element()
                place[2] = 0
            level, phase = pick((level, *_EDGES_U16)), pick((phase, *_EDGES_U16))
        return FocalPoint(place[0], place[1], place[2], level, phase)

    def _element(self) -> tuple[int, int]:
        """Return where a transducer of the grid is, or its centre, in whole micrometres."""
        identity, across = self._identity, self._random.randrange
        sides = (identity.grid_nx, identity.grid_ny)
        x_um, y_um = ((2 * across(n) - n + 1) * identity.pitch_um // 2 for n in sides)
        return self._random.choice(((x_um, y_um), (0, 0)))

    def _refused(self, made: Message) -> Message:
        """Return *made* with one value or length that its type does not allow."""
        pick = self._random.choice
        if isinstance(made, Points):
            return Points(tuple(self._point() for _ in range(self._identity.max_points + 1)))
        assert isinstance(made, Phases | Drives)
        unit, data = 1 if isinstance(made, Phases) else 2, made.data
        return type(made)(pick((data[:-unit], data + bytes(unit), b"", data[: len(data) // 4 * 2])))
