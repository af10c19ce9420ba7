"""Elements that are off together, and what they have in common: a port, a remainder, a block."""

from __future__ import annotations

import math
import re
from collections import defaultdict
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Final

import numpy as np

from haptogram.acoustics.solvers.focus_fit import wrapped_phases
from haptogram.settings.frozen import dataclass

_MODULI: Final = (2, 4, 8, 16, 32)
_BLOCKS: Final = (64, 32, 16, 8)
_FEWEST: Final = 3  # elements that make a group
_OTHERS: Final = "the others"
_NUMBERED: Final = re.compile(r"(.*?)[._\[ -]*[0-9]+\]?")

_Classes = dict[str, list[int]]


@dataclass(frozen=True, slots=True)
class ElementGroup:
    """Elements that lag together.

    Attributes
    ----------
    members : tuple of int
        The elements.
    lag_rad : float
        Their lag.
    text : str
        The same in words, with figures.
    """

    members: tuple[int, ...]
    lag_rad: float
    text: str


def groups_of_elements(
    lags_rad: Mapping[int, float],
    shifted: Collection[int],
    limit_rad: float,
    steps: int,
    channels: Mapping[int, str] | None = None,
    spread_rad: float | None = None,
) -> tuple[list[ElementGroup], set[int]]:
    """Return the groups of *shifted* elements, and all elements that they explain.

    Parameters
    ----------
    lags_rad : mapping of int to float
        Lag of each element; NaN: unknown.
    shifted : collection of int
        Elements that are off.
    limit_rad : float
        Lag that may be none.
    steps : int
        Steps of the board's phases in a period.
    channels : mapping of int to str, optional
        Names of their pins, which tell ports.
    spread_rad : float, optional
        By how much the members of a group may differ from its lag; by default twice the limit.
    """
    spread_rad = 2.0 * limit_rad if spread_rad is None else spread_rad
    left = set(shifted)
    found: list[ElementGroup] = []
    noun = "" if channels is None else " pins"
    for classes in _classes_of_elements(tuple(lags_rad), channels or {}):
        lags = {
            name: lag
            for name, members in classes.items()
            if len(members) >= _FEWEST
            and (lag := _shared_lag(members, lags_rad, spread_rad)) is not None
        }
        shared = [name for name in lags if left.issuperset(classes[name])]
        base, zero = _OTHERS, 0.0
        if 2 * len(shared) > len(classes) and len(lags) == len(classes):
            base = next(iter(lags))  # no class is as most are: all lag behind the first
            zero, shared = lags[base], list(lags)
        for name in shared:
            lag = float(wrapped_phases(np.array([lags[name] - zero]))[0])
            many = f"{name} ({len(classes[name])} of {len(lags_rad)}{noun})"
            if name != base and abs(lag) > limit_rad:
                text = f"{many}: {_lag_text(lag, limit_rad, steps, base)}"
                found.append(ElementGroup(tuple(classes[name]), lag, text))
            elif base == _OTHERS:
                continue  # its members differ from what they should be, but not together
            left -= set(classes[name])
        if not left:
            break
    return found, set(shifted) - left


def _shared_lag(
    members: Sequence[int], lags_rad: Mapping[int, float], spread_rad: float
) -> float | None:
    """Return the mean lag of *members* if all lie within *spread_rad* of it.

    None if they do not, or if the lags of fewer than 3 are known.
    """
    lags = np.array([lags_rad[element] for element in members])
    lags = lags[np.isfinite(lags)]
    if len(lags) < _FEWEST:
        return None
    middle = float(np.angle(np.exp(1j * lags).sum()))
    near = np.abs(wrapped_phases(lags - middle)).max() <= spread_rad
    return middle if near else None


def _classes_of_elements(
    elements: Sequence[int], channels: Mapping[int, str]
) -> Iterator[_Classes]:
    """Yield ways to group the elements; each maps the name of a group to its elements.

    By port (the channel's name without its number), by number mod 2, 4, 8, 16 and 32, and by blocks
    of 64, 32, 16 and 8 consecutive numbers.
    """
    by_port: _Classes = defaultdict(list)
    for element, channel in channels.items():
        stem = _NUMBERED.fullmatch(channel)
        by_port[f"port {channel if stem is None else stem[1]}"].append(element)
    if 1 < len(by_port) < len(elements):
        yield by_port
    for modulus in _MODULI:
        yield _classes(elements, [f"elements n mod {modulus} = {n % modulus}" for n in elements])
    for size in _BLOCKS:
        firsts = [n // size * size for n in elements]
        lasts = [min(n + size - 1, max(elements)) for n in firsts]
        names = [f"elements {n} to {end}" for n, end in zip(firsts, lasts, strict=True)]
        yield _classes(elements, names)


def _classes(elements: Sequence[int], names: Sequence[str]) -> _Classes:
    """Return a mapping of each name to its elements; *names* has one for each of *elements*."""
    found: _Classes = defaultdict(list)
    for element, name in zip(elements, names, strict=True):
        found[name].append(element)
    return found


def _lag_text(lag_rad: float, limit_rad: float, steps: int, base: str) -> str:
    """Return a phase lag in words: inverted, in steps late or early, or in degrees from *base*.

    A positive lag is late (behind). It is inverted within *limit_rad* of half a turn, and counts as
    whole steps (*steps* in a turn) within twice that, at most a quarter of a step.
    """
    degrees = math.degrees(lag_rad)
    count = round(lag_rad * steps / math.tau)
    step_rad = math.tau / steps
    if math.pi - abs(lag_rad) <= limit_rad:
        return "inverted"
    if count and abs(lag_rad - count * step_rad) <= min(2.0 * limit_rad, step_rad / 4.0):
        many = "one step" if abs(count) == 1 else f"{abs(count)} steps"
        return f"{many} of {steps} {'late' if count > 0 else 'early'}, {degrees:+.1f} degrees"
    return f"{abs(degrees):.1f} degrees {'behind' if degrees > 0 else 'ahead of'} {base}"
