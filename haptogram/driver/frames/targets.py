"""The targets that a caller gives for frames, as foci."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from numbers import Real
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from haptogram.errors import ConfigurationError
from haptogram.records.frame import Focus
from haptogram.settings.arguments import shown_argument

Targets: TypeAlias = ArrayLike | Sequence[Focus] | Sequence[Sequence[Focus]]


def as_frame_foci(targets: Targets) -> list[tuple[Focus, ...]]:
    """Return the foci of every frame.

    Parameters
    ----------
    targets : (T, 3) array_like, sequence of Focus, or sequence of sequences of Focus
        One focus per frame, as a position in metres or a :class:`Focus`; or several.

    Raises
    ------
    ConfigurationError
        If there is no frame, a frame without a focus, or something that is no focus.
    """
    if _is_one_target_point(targets):
        raise ConfigurationError(
            f"targets are one point, {shown_argument(targets)}; they must be a sequence of points"
        )
    try:
        entries: Iterable[Any] = (
            targets if isinstance(targets, Sequence) else _as_target_rows(targets)
        )
        frames = [_frame_foci_of(entry) for entry in entries]
    except (TypeError, ValueError) as error:
        if isinstance(error, ConfigurationError):
            raise
        raise ConfigurationError(f"targets are not (T, 3) positions or foci: {error}") from error
    if not frames:
        raise ConfigurationError("0 targets; there must be 1 or more")
    return frames


def _as_target_rows(targets: Any) -> Iterable[Any]:
    """Return the targets as rows; refuse a single value."""
    rows = np.asarray(targets)
    if rows.ndim == 0:
        raise ConfigurationError(
            f"targets are {shown_argument(targets)}; they must be a sequence of points or foci"
        )
    return rows


def _is_one_target_point(targets: Any) -> bool:
    """Return True for three numbers: one point, not three targets."""
    if isinstance(targets, np.ndarray):
        return bool(targets.shape == (3,))
    is_row = isinstance(targets, tuple | list) and len(targets) == 3
    return is_row and all(isinstance(value, Real) for value in targets)


def _frame_foci_of(entry: Any) -> tuple[Focus, ...]:
    """Return the foci of one frame: of a point, a Focus, or a sequence of Focus."""
    if isinstance(entry, Focus):
        return (entry,)
    if isinstance(entry, Sequence) and entry and all(isinstance(f, Focus) for f in entry):
        return tuple(entry)
    return (Focus.at(entry),)
