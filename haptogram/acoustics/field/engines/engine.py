"""The fastest engine for a model, held to the reference of :mod:`.field`."""

from __future__ import annotations

import logging
from typing import Literal, TypeAlias

from haptogram.acoustics.field.engines.compiled import load_kernels
from haptogram.acoustics.field.engines.numba_engine import NumbaEngine
from haptogram.acoustics.field.engines.numpy32_engine import Numpy32Engine
from haptogram.acoustics.field.engines.single_precision import SingleEngine
from haptogram.acoustics.field.reference import FieldEngine, NumpyEngine
from haptogram.acoustics.model.model import AcousticModel
from haptogram.errors import ConfigurationError

__all__ = ["NumbaEngine", "Numpy32Engine", "Preference", "choose_engine", "why_not_compiled"]

Preference: TypeAlias = Literal["auto", "numpy", "numpy32", "numba"]

_log = logging.getLogger(__name__)


def choose_engine(model: AcousticModel, *, prefer: Preference = "auto") -> FieldEngine:
    """Return the fastest engine for *model*, or the one asked for.

    Parameters
    ----------
    prefer : {"auto", "numpy", "numpy32", "numba"}
        "numpy" is the float64 reference. "auto" is compiled code where numba is installed, else
        numpy in single precision; one line in the log says so if it is not the first.

    Raises
    ------
    ConfigurationError
        An unknown preference; "numba" where it is not installed; single precision for a model that
        it does not serve.

    Examples
    --------
    >>> type(choose_engine(model, prefer="numpy")).__name__
    'NumpyEngine'
    """
    if prefer == "numpy":
        return NumpyEngine(model)
    if prefer == "numpy32":
        return Numpy32Engine(model)
    if prefer == "numba":
        return NumbaEngine(model)
    if prefer != "auto":
        raise ConfigurationError(f"engine is {prefer!r}, must be auto, numpy, numpy32 or numba")
    kind, why = _fastest_engine(model)
    if why is not None:
        _log.info("%s", why)
    return kind(model)


def why_not_compiled(model: AcousticModel) -> str | None:
    """Return the line that says which engine serves *model* and why, if it is not compiled."""
    return _fastest_engine(model)[1]


def _fastest_engine(model: AcousticModel) -> tuple[type[NumpyEngine | SingleEngine], str | None]:
    fastest = Numpy32Engine if load_kernels() is None else NumbaEngine
    reason = fastest.why_not(model)
    if reason is not None:
        return NumpyEngine, f"field engine: numpy in double precision, since {reason}"
    if fastest is Numpy32Engine:
        return fastest, "field engine: numpy in single precision, since numba is not installed"
    return fastest, None
