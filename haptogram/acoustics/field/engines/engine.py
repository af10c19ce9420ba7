"""The fastest engine for a model, held to the reference of :mod:`.field`."""

from __future__ import annotations

import logging
from typing import Literal, TypeAlias

from haptogram.acoustics.field.engines.numba_engine import NumbaEngine
from haptogram.acoustics.field.reference import FieldEngine, NumpyEngine
from haptogram.acoustics.model.model import AcousticModel
from haptogram.errors import ConfigurationError

__all__ = ["NumbaEngine", "Preference", "choose_engine", "why_not_compiled"]

Preference: TypeAlias = Literal["auto", "numpy", "numba"]

_log = logging.getLogger(__name__)


def choose_engine(model: AcousticModel, *, prefer: Preference = "auto") -> FieldEngine:
    """Return the fastest engine for *model*, or the one asked for.

    Parameters
    ----------
    prefer : {"auto", "numpy", "numba"}
        "numpy" is the float64 reference. "auto" is compiled code where numba is installed and
        serves the model, else the reference; one line in the log says so.

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
    if prefer == "numba":
        return NumbaEngine(model)
    if prefer != "auto":
        raise ConfigurationError(f"engine is {prefer!r}, must be auto, numpy or numba")
    if (why := why_not_compiled(model)) is None:
        return NumbaEngine(model)
    _log.info("%s", why)
    return NumpyEngine(model)


def why_not_compiled(model: AcousticModel) -> str | None:
    """Return the line that says which engine serves *model* and why, if it is not compiled."""
    reason = NumbaEngine.why_not(model)
    return None if reason is None else f"field engine: numpy in double precision, since {reason}"
