"""Stream frames of a random host: drives of every format, alone and in a row."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from haptogram_protocol import messages as m

from ..actions import SLOT_US, DialogueAction
from .conditions import DialogueConditions
from .frames import RandomFrames

_FAR_US: Final = 4_000_000  # later than any dialogue ends
_FRAMES: Final = 8  # most frames in a slot
_BURST: Final = 40  # frames sent in one slot, at most
_LONG_BURST: Final = 300  # frames that overflow 8 bits, where bytes take no time
_EDGES_UM: Final = (0, 1, -1, 1_000_000, -1_000_000)  # up to 1 m, where accuracy is required
_EDGE_SHARE: Final = 0.3  # share of the points with such a coordinate
_PART_SHARE: Final = 0.4  # share of the frames that repeat the last one but for a part
_EDGES_U16: Final = (0, 1, 0x4000, 0x7FFF, 0x8000, 0xFFFF)


class RandomStream(RandomFrames):
    """Makes stream frames."""

    def __init__(self, conditions: DialogueConditions) -> None:
        super().__init__(conditions)
        identity = self._identity
        self._count = identity.transducers
        self._before = bytes(2 * self._count)
        # The points of a slot are computed before its middle.
        fitting = SLOT_US // 4 // (_FRAMES * identity.point_time_us or 1)
        has_points = bool(self._can & m.Feature.POINTS)
        self._most_points = min(identity.max_points, fitting) * has_points

    def burst(self) -> list[DialogueAction]:
        """Return enough short frames to fill a queue or wrap a counter of few bits."""
        exact = self.conditions.exact
        most = self._pick((_BURST, _LONG_BURST)) if exact else _BURST
        may_latch = exact or not self.conditions.drives  # the line has to carry what is traced
        number = self._pick((self._random.randint(3, _BURST), self._identity.queue_depth + 1))
        first_us = self._pick((_FAR_US, SLOT_US // 2)) if may_latch else _FAR_US
        step_us = self._pick((10, 25, 30, 100))
        # New, seen before, foreign.
        step, session = self._pick(((0, 0), (0, 0), (1, 0), (-1, 0), (0, 1)))
        return self.row(min(number, most), first_us, step_us, number=step, session=session)

    def many_far(self) -> list[DialogueAction]:
        """Return as many frames, far ahead, as a slot carries: some slots fill the queue."""
        return self.row(_BURST, _FAR_US)

    def row(
        self, count: int, first_us: int, step_us: int = 100, *, number: int = 0, session: int = 0
    ) -> list[DialogueAction]:
        """Return *count* frames of a short format."""
        kinds = self.kinds
        if self._identity.point_time_us:
            kinds.pop("POINTS", None)
        shortest = min((make() for make in kinds.values()), key=lambda one: len(one.serialize()))
        return [
            self.frame(
                shortest, first_us / SLOT_US, apart_us=n * step_us, number=number, session=session
            )
            for n in range(count)
        ]

    def pair(self) -> list[DialogueAction]:
        """Return two frames, often of two formats, for one carrier period or two neighbours.

        Or, where bytes arrive to the microsecond, for any two times.
        """
        if self.conditions.exact and self._random.random() < 0.5:
            times = (None, None, "late", 0.0, 0.5)
            return [self.frame(self.any(), self._pick(times)) for _ in range(2)]
        at, apart_us = self._pick((0.5, 0.5, 1.5)), self._pick((0, 1, 7))
        then_us = apart_us + self._pick((1, 10, 18, 24, 25))
        return [self.frame(self.any(), at, apart_us=us) for us in (apart_us, then_us)]

    # --- what a frame carries ------------------------------------------------------------------

    @property
    def kinds(self) -> dict[str, Callable[[], m.Message]]:
        """Makers of the message of a frame, by type and format."""
        kinds: dict[str, Callable[[], m.Message]] = {}
        kinds["PHASES"] = lambda: m.Phases(self._codes()[: self._count])
        if self._can & m.Feature.AMPLITUDE:
            kinds["DRIVES"] = lambda: m.Drives(self._codes())
        if self._most_points:
            kinds["POINTS"] = lambda: self._points(self._pick((1, 1, 2, self._most_points)))
        return kinds

    def any(self) -> m.Message:
        """Return the message of a frame of any kind."""
        return self._pick(list(self.kinds.values()))()

    def refused(self) -> m.Message:
        """Return a message with one value or length that its type does not allow."""
        made = self.any()
        if isinstance(made, m.Points):
            return m.Points(tuple(self.point() for _ in range(self._identity.max_points + 1)))
        assert isinstance(made, m.Phases | m.Drives)
        unit, data = 1 if isinstance(made, m.Phases) else 2, made.data
        wrong = (data[:-unit], data + bytes(unit), b"", data[: len(data) // 4 * 2])
        return type(made)(self._pick(wrong))

    def _codes(self) -> bytes:
        """Return N phase and N amplitude codes; often only a part differs from the frame before."""
        codes, count = self._random.randbytes(2 * self._count), self._count
        if self._random.random() < _PART_SHARE:
            one, before = self._across(2 * count), self._before
            alike = (
                before[:count] + codes[count:],
                codes[:count] + before[count:],
                before[:one] + codes[one : one + 1] + before[one + 1 :],
            )
            codes = self._pick(alike)
        self._before = codes
        return codes

    def _points(self, number: int) -> m.Message:
        """Return a POINTS message of *number* random points, fewer if the board takes fewer."""
        return m.Points(tuple(self.point() for _ in range(min(number, self._most_points))))

    def point(self) -> m.FocalPoint:
        """Return a focal point, often with a field at an edge, or at a transducer."""
        pick, across = self._pick, self._across
        level, phase = across(30_000, 65_536), across(65_536)
        x_um, y_um, z_um = across(-40_000, 40_000), across(-40_000, 40_000), across(80_000, 200_000)
        if self._random.random() < _EDGE_SHARE:
            x_um, y_um, z_um = (pick((value, *_EDGES_UM)) for value in (x_um, y_um, z_um))
            if self._random.random() < _EDGE_SHARE:
                x_um, y_um, z_um = *pick((self._element(), (0, 0))), 0
            level, phase = pick((level, *_EDGES_U16)), pick((phase, *_EDGES_U16))
        return m.FocalPoint(x_um, y_um, z_um, level, phase)

    def _element(self) -> tuple[int, int]:
        """Return x and y of a random transducer in whole µm, from the centre of the grid."""
        identity, across = self._identity, self._across
        x_um, y_um = (
            (2 * across(n) - n + 1) * identity.pitch_um // 2
            for n in (identity.grid_nx, identity.grid_ny)
        )
        return x_um, y_um
