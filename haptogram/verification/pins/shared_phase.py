"""The phase that several captures of one array share, frame by frame."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from haptogram.acoustics.arrays import FloatArray
from haptogram.acoustics.solvers.focus_fit import wrapped_phases
from haptogram.records.frame import Intended

from .pin_verdict import PinVerdict


def why_pin_phases_are_apart(
    pins: Sequence[PinVerdict],
    frames: Sequence[Intended],
    passes: Sequence[Sequence[int]],
) -> str:
    """Return why captures do not show the phases of their elements against each other.

    The common phase of a capture tells nothing about the elements of another one. Two captures
    share the phase of a drive if an element that sounds is right in both of them, or if their
    common phases against the clock of the carrier agree within the limits of both.

    Parameters
    ----------
    pins : sequence of PinVerdict
        The verdict on each capture.
    frames : sequence of Intended
        Frames of the run.
    passes : sequence of sequences of int
        Places of the frames that have one drive.

    Returns
    -------
    str
        The reason in words; empty: all captures share the phase of every drive.
    """
    turns = [one.turns_rad for one in pins]
    apart: dict[tuple[int, int], int] = {}
    worst_rad: dict[tuple[int, int], float] = {}
    for same in passes:
        seen = [[place for place in same if one.judged[place]] for one in pins]
        amplitudes = frames[same[0]].drive.amplitude_codes
        waiting = [
            number
            for number, one in enumerate(pins)
            if seen[number] and amplitudes[list(one.elements)].any()
        ]
        joined, waiting = waiting[:1], waiting[1:]
        while waiting:
            found = next(
                (
                    b
                    for b in waiting
                    for a in joined
                    if _share_pin_element(pins[a], pins[b], seen[a], seen[b], amplitudes)
                    or _pin_phase_difference_rad(turns[a], turns[b], seen[a], seen[b])
                    <= pins[a].limits.phase_rad + pins[b].limits.phase_rad
                ),
                None,
            )
            if found is None:
                pair = a, b = joined[0], waiting[0]
                difference = _pin_phase_difference_rad(turns[a], turns[b], seen[a], seen[b])
                apart[pair] = apart.get(pair, 0) + len(same)
                worst_rad[pair] = max(worst_rad.get(pair, 0.0), difference)
                found = waiting[0]
            joined.append(found)
            waiting.remove(found)
    return "; ".join(_pin_phase_lines(pins, len(frames), apart, worst_rad))


def _share_pin_element(
    a: PinVerdict,
    b: PinVerdict,
    seen_a: Sequence[int],
    seen_b: Sequence[int],
    amplitudes: np.ndarray,
) -> bool:
    """Return True if captures *a* and *b* share an element that sounds and is right in all frames.

    *seen_a*, *seen_b* are the frames of one drive in each, *amplitudes* (N,) its codes.
    """
    return any(
        amplitudes[element] / 255.0 > max(a.limits.amplitude, b.limits.amplitude)
        and a.right[seen_a, a.elements.index(element)].all()
        and b.right[seen_b, b.elements.index(element)].all()
        for element in set(a.elements) & set(b.elements)
    )


def _pin_phase_difference_rad(
    a: FloatArray | None, b: FloatArray | None, seen_a: Sequence[int], seen_b: Sequence[int]
) -> float:
    """Return the largest difference of common phases *a*, *b* (F,) in the frames seen.

    Infinite if a capture has none (None), or one is not known (NaN).
    """
    if a is None or b is None:
        return math.inf
    turns = np.concatenate([a[seen_a], b[seen_b]])
    away = wrapped_phases(turns - turns[0])
    return float(np.ptp(away)) if np.isfinite(away).all() else math.inf


def _pin_phase_lines(
    pins: Sequence[PinVerdict],
    count: int,
    apart: dict[tuple[int, int], int],
    worst_rad: dict[tuple[int, int], float],
) -> Iterator[str]:
    """Yield a line for each pair of captures whose common phases differ.

    By pair, *apart* has the number of such frames (of *count*), *worst_rad* the largest difference.
    """
    for (a, b), frames in apart.items():
        names = f"{pins[a].name} and {pins[b].name}"
        if math.isfinite(worst := worst_rad[a, b]):
            limit = pins[a].limits.phase_rad + pins[b].limits.phase_rad
            degrees = math.degrees(min(worst, 2.0 * math.pi - worst))
            yield (
                f"{names} are {degrees:.1f} degrees apart against the clock of the carrier in "
                f"{frames} of {count} frames, {math.degrees(limit):.1f} pass: the elements of one "
                "are off, or the clock is not that of the other; an element in both tells"
            )
        else:
            yield (
                f"{names} share no phase in {frames} of {count} frames: capture the clock of the "
                "carrier, or one element, in both"
            )
