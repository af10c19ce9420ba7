"""Patterns that a drive can make, as they are found."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import ClassVar, TypeAlias

from haptogram.acoustics.reconstruct.estimates import Vector, plain_estimate


@dataclass(frozen=True, slots=True)
class Off:
    """No element radiates."""

    kind: ClassVar[str] = "off"


@dataclass(frozen=True, slots=True)
class Uniform:
    """All elements of a plane array radiate in phase: a beam straight ahead.

    Attributes
    ----------
    active : int
        Elements that radiate.
    """

    kind: ClassVar[str] = "uniform"
    active: int


@dataclass(frozen=True, slots=True)
class Placed:
    """Base of the patterns around one point.

    Attributes
    ----------
    position_m : tuple
        The point: its phases, less those of the pattern, focus there.
    std_m, bound_m : tuple
        Per axis of the world, standard deviation from the rounding of the phases, and the most that
        rounding can do; infinite where this array cannot tell.
    residual_rms_rad : float
        RMS phase that the pattern leaves, over all elements but the outliers.
    coherence : float
        |sum w_n g_n| / sum |w_n g_n| there, the pattern's own phases taken out.
    pressure_rms_pa : float
        Pressure there, the pattern's own phases taken out: for a focus, the pressure that it has.
    speed_share : float
        Relative difference of the speed of sound that suits the phases best from that of the model.
    outliers : tuple of int
        Elements whose phase does not belong to the pattern.
    outlier_rad : tuple of float
        How far off the phase of each of them is.
    """

    position_m: Vector
    std_m: Vector
    bound_m: Vector
    residual_rms_rad: float
    coherence: float
    pressure_rms_pa: float
    speed_share: float
    outliers: tuple[int, ...]
    outlier_rad: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class OneFocus(Placed):
    """All elements arrive in phase at one point."""

    kind: ClassVar[str] = "one focus"


@dataclass(frozen=True, slots=True)
class TwinTrap(Placed):
    """A focus with half of the elements, beyond a plane, in opposite phase.

    Attributes
    ----------
    normal : tuple
        Unit vector across the plane; its sign means nothing.
    """

    kind: ClassVar[str] = "twin trap"
    normal: Vector


@dataclass(frozen=True, slots=True)
class Vortex(Placed):
    """A focus whose phase turns around an axis.

    Attributes
    ----------
    charge : int
        Turns of the phase in one turn around the axis, right-handed around the array's z, as a lag.
    axis_m : tuple
        Where the axis crosses the plane through the elements' centre.
    """

    kind: ClassVar[str] = "vortex"
    charge: int
    axis_m: Vector


@dataclass(frozen=True, slots=True)
class SeveralFoci:
    """The waves of several points, added.

    Attributes
    ----------
    positions_m, bounds_m : tuple of tuple
        The points, the strongest first, and the most that rounding can move each.
    shares : tuple of float
        Pressure at each over that at the strongest.
    residual_rms_rad : float
        RMS phase that they leave.
    """

    kind: ClassVar[str] = "several foci"
    positions_m: tuple[Vector, ...]
    bounds_m: tuple[Vector, ...]
    shares: tuple[float, ...]
    residual_rms_rad: float


@dataclass(frozen=True, slots=True)
class Unnamed:
    """None of these patterns explains the phases.

    Attributes
    ----------
    loudest_m : tuple
        The loudest of the points that were looked at.
    coherence : float
        |sum w_n g_n| / sum |w_n g_n| there.
    """

    kind: ClassVar[str] = "none of these"
    loudest_m: Vector
    coherence: float


Pattern: TypeAlias = Off | Uniform | OneFocus | TwinTrap | Vortex | SeveralFoci | Unnamed
#: The names of all patterns.
KINDS = tuple(
    pattern.kind for pattern in (OneFocus, SeveralFoci, TwinTrap, Vortex, Off, Uniform, Unnamed)
)


def pattern_dict(pattern: Pattern) -> dict[str, object]:
    """Return a pattern for JSON; infinite values become None."""
    values = {field.name: plain_estimate(getattr(pattern, field.name)) for field in fields(pattern)}
    return {"kind": pattern.kind, **values}
