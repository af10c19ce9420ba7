"""Boards that compute the drive of focal points wrongly.  SPEC.md HG-5.4."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from haptogram.acoustics import Drive
from haptogram.records.frame import Evidence
from haptogram_protocol.messages import FocalPoint
from sim_device.board.registers import BoardFocuser, Content
from sim_device.dialects.haptogram import VirtualHaptogramDialect
from sim_device.mutants import Mutant

_FAR_UM: Final = 500_000
_MOST_POINTS: Final = 4


class PointsInTenths(VirtualHaptogramDialect):
    """Reads the coordinates of focal points in tenths of a millimetre."""

    def content(self, message: Any) -> Content:
        content = super().content(message)
        if isinstance(content, Drive):
            return content
        return [
            dataclasses.replace(p, x_um=p.x_um // 100, y_um=p.y_um // 100, z_um=p.z_um // 100)
            for p in content
        ]


class PointsTwoStepsOff(BoardFocuser):
    """Computes every fourth phase of focal points two steps too high."""

    def drive(self, points: Sequence[FocalPoint]) -> Drive:
        """Return codes of which every fourth is two steps too high."""
        exact = super().drive(points)
        phases = exact.phase_codes.copy()
        phases[::4] += np.uint8(2)
        return Drive(phases, exact.amplitude_codes)


class FarPointsClamped(BoardFocuser):
    """Takes a focal point more than 500 mm away for one at 500 mm."""

    def drive(self, points: Sequence[FocalPoint]) -> Drive:
        """Return the codes for points that are near."""
        near = [dataclasses.replace(point, z_um=min(point.z_um, _FAR_UM)) for point in points]
        return super().drive(near)


class SumOfPointsOverflows(BoardFocuser):
    """Adds focal points in a word that holds sums below 4: beyond them the sign is lost."""

    def drive(self, points: Sequence[FocalPoint]) -> Drive:
        """Return the codes, with the opposite phase where the points are many and loud."""
        exact = super().drive(points)
        overflows = sum(point.amplitude for point in points) >= _MOST_POINTS * 0xFFFF
        return Drive(exact.phase_codes + np.uint8(128 * overflows), exact.amplitude_codes)


_SELF: Final = Evidence.SELF_REPORTED

MUTANTS: Final = (
    Mutant.of(PointsInTenths, "HG-5.4/1", _SELF),
    Mutant.of(PointsTwoStepsOff, "HG-5.4/3", _SELF),
    Mutant.of(FarPointsClamped, "HG-5.4/3", _SELF),
    Mutant.of(SumOfPointsOverflows, "HG-5.4/2", _SELF),
)
