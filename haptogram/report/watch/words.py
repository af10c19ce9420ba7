"""Patterns in words, with places in the axes of the board's own programs."""

from __future__ import annotations

from typing import Final

import numpy as np

from haptogram.acoustics.arrays import FloatArray
from haptogram.acoustics.reconstruct.patterns.found import Pattern, Placed, SeveralFoci, Vortex
from haptogram.evidence.dialects.watched_board import WatchedBoard

_MM: Final = 1e3


def watched_client_places_mm(pattern: Pattern, board: WatchedBoard) -> list[list[float]]:
    """Return the places of a pattern in mm, in the axes of the client; empty for one without."""
    if isinstance(pattern, SeveralFoci):
        places: list[list[float]] = (board.clients_m(np.array(pattern.positions_m)) * _MM).tolist()
        return places
    if isinstance(pattern, Placed):
        return [(board.clients_m(np.array(pattern.position_m)) * _MM).tolist()]
    return []


def watched_pattern_text(pattern: Pattern, board: WatchedBoard) -> str:
    """Return kind, places, limits and coherence of a pattern."""
    if isinstance(pattern, SeveralFoci):
        places = board.clients_m(np.array(pattern.positions_m))
        return f"{len(places)} foci at " + ", ".join(map(watched_place_text, places))
    if not isinstance(pattern, Placed):
        return pattern.kind
    charge = f" of charge {pattern.charge:+d}" if isinstance(pattern, Vortex) else ""
    place = board.clients_m(np.array(pattern.position_m))
    bound = np.array(pattern.bound_m)[np.abs(board.client_axes).argmax(axis=0)]
    limits = "/".join(f"{_MM * b:.1f}" if np.isfinite(b) else "?" for b in bound)
    text = f"{pattern.kind}{charge} at {watched_place_text(place)} mm, ±{limits} mm"
    if pattern.outliers:
        count = len(pattern.outliers)
        text += f", {count} element{'' if count == 1 else 's'} out of step"
    return f"{text}, coherence {pattern.coherence:.4f}"


def watched_place_text(place_m: FloatArray) -> str:
    """Return a place in mm: "(0.0, 120.0, 0.0)"."""
    values = np.round(np.asarray(place_m) * _MM, 1) + 0.0
    return "(" + ", ".join(f"{value:.1f}" for value in values) + ")"
