"""The fastest engine for a model, held to the reference of :mod:`.field`."""

from __future__ import annotations

import logging

from haptogram.acoustics.field.engines.numba_engine import NumbaEngine
from haptogram.acoustics.field.reference import FieldEngine, NumpyEngine
from haptogram.acoustics.model.model import AcousticModel

__all__ = ["NumbaEngine", "choose_engine", "why_not_compiled"]

_log = logging.getLogger(__name__)


def choose_engine(model: AcousticModel) -> FieldEngine:
    """Return the fastest engine for *model*: compiled code, or the reference.

    One line in the log says why it is the reference.

    Examples
    --------
    >>> type(choose_engine(model)).__name__
    'NumbaEngine'
    """
    if (why := why_not_compiled(model)) is None:
        return NumbaEngine(model)
    _log.info("%s", why)
    return NumpyEngine(model)


def why_not_compiled(model: AcousticModel) -> str | None:
    """Return the line that says which engine serves *model* and why, if it is not compiled."""
    reason = NumbaEngine.why_not(model)
    return None if reason is None else f"field engine: numpy in double precision, since {reason}"
