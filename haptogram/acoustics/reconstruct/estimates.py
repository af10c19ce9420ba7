"""Results of a reconstruction: one focus, no focus, or something else."""

from __future__ import annotations

import math
from typing import Final, Literal, TypeAlias

from haptogram.acoustics.arrays import FloatArray
from haptogram.settings.frozen import dataclass, fields

Vector: TypeAlias = tuple[float, float, float]


def as_vector(values: FloatArray) -> Vector:
    """Return a (3,) array as plain numbers."""
    x, y, z = values.tolist()
    return x, y, z


@dataclass(frozen=True, slots=True)
class SingleFocus:
    """The drive focuses on one point.

    Attributes
    ----------
    position_m, std_m, bound_m, observable : tuple
        Per axis of the world, as in :class:`PhaseFit`.
    residual_rms_rad : float
        RMS phase residual of the fit, in radians.
    coherence : float
        |sum w_n g_n| / sum |w_n g_n| at the focus.
    pressure_rms_pa, level_db_spl : float
        Pressure at the focus.
    force_n : float
        Force on a reflecting disc of 10 mm radius around the focus, parallel to the array's face:
        as of :func:`.force_on_disc_n`.
    acquired : str
        "warm": found from the focus before; "global": searched for.
    rivals_m : tuple
        Other places that explain the phases equally well, the best first: few steps, or few
        elements, do not tell which of them is meant.  Sought for steps of an eighth of a turn and
        more.

    Examples
    --------
    >>> found = Reconstructor(model).reconstruct(drive)
    >>> isinstance(found, SingleFocus), f"{1e3 * found.force_n:.0f} mN"
    (True, '13 mN')
    """

    position_m: Vector
    std_m: Vector
    bound_m: Vector
    observable: tuple[bool, bool, bool]
    residual_rms_rad: float
    coherence: float
    pressure_rms_pa: float
    level_db_spl: float
    force_n: float
    acquired: Literal["warm", "global"]
    rivals_m: tuple[Vector, ...] = ()

    @property
    def ambiguity_text(self) -> str:
        """A sentence that names all places which explain the phases; empty if there is one."""
        if not self.rivals_m:
            return ""
        one, other = (
            f"({', '.join(f'{1e3 * value:.1f}' for value in place)})"
            for place in (self.position_m, self.rivals_m[0])
        )
        count = "two" if len(self.rivals_m) == 1 else str(len(self.rivals_m) + 1)
        among = "" if len(self.rivals_m) == 1 else ", among them"
        return f"{count} places explain these phases equally{among}: {one} and {other} mm"

    def as_dict(self) -> dict[str, object]:
        """Return the fields for JSON; infinite values become None."""
        if not math.isfinite(sum(self.std_m) + sum(self.bound_m) + self.force_n):
            return _estimate_fields("single_focus", self)
        return {
            "kind": "single_focus",
            "position_m": [*self.position_m],
            "std_m": [*self.std_m],
            "bound_m": [*self.bound_m],
            "observable": [*self.observable],
            "residual_rms_rad": self.residual_rms_rad,
            "coherence": self.coherence,
            "pressure_rms_pa": self.pressure_rms_pa,
            "level_db_spl": self.level_db_spl,
            "force_n": self.force_n,
            "acquired": self.acquired,
            "rivals_m": [[*place] for place in self.rivals_m],
        }


@dataclass(frozen=True, slots=True)
class NoFocus:
    """Nothing steady is radiated; *reason* says why.

    Examples
    --------
    >>> silent = Drive.from_weights(np.zeros(256), phase_bits=8)
    >>> Reconstructor(model).reconstruct(silent)
    NoFocus(reason='muted')
    """

    reason: Literal["muted", "ramping", "zero amplitude"]

    def as_dict(self) -> dict[str, object]:
        """Return the fields for JSON."""
        return _estimate_fields("no_focus", self)


@dataclass(frozen=True, slots=True)
class NotSingle:
    """No point explains the phases of all elements.

    Attributes
    ----------
    residual_rms_rad : float
        RMS over all active elements, for the best point.
    position_m : tuple
        If `outliers` is not empty, the focus of the other elements; else the point of the highest
        pressure among those that were tried.
    pressure_rms_pa : float
        Pressure there.
    coherence : float
        |sum w_n g_n| / sum |w_n g_n| there.
    outliers : tuple of int
        The elements that are off by more than a phase step, where the others (more than half) agree
        on one focus; empty where they do not.

    Examples
    --------
    >>> foci = [(-0.03, 0.0, 0.15), (0.03, 0.0, 0.15)]
    >>> pair = superpose_foci(model, foci, [0.5, 0.5], [0.0, 0.0])
    >>> type(Reconstructor(model).reconstruct(Drive.from_weights(pair, phase_bits=8))).__name__
    'NotSingle'
    """

    residual_rms_rad: float
    position_m: Vector
    pressure_rms_pa: float
    coherence: float
    outliers: tuple[int, ...] = ()

    def as_dict(self) -> dict[str, object]:
        """Return the fields for JSON."""
        return _estimate_fields("not_single", self)


Reconstruction: TypeAlias = SingleFocus | NoFocus | NotSingle


_NAMES: Final = {
    kind: tuple(field.name for field in fields(kind)) for kind in (SingleFocus, NoFocus, NotSingle)
}


def _estimate_fields(kind: str, result: Reconstruction) -> dict[str, object]:
    """Return the fields of an estimate for JSON; the text *kind*, its type, comes first."""
    return {
        "kind": kind,
        **{name: plain_estimate(getattr(result, name)) for name in _NAMES[type(result)]},
    }


def plain_estimate(value: object) -> object:
    """Convert tuples to lists and non-finite floats to None, for JSON."""
    if isinstance(value, tuple):
        return [plain_estimate(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
