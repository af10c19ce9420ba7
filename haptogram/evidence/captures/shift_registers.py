"""Outputs of shift registers with a latch, such as the 74HC595, from their data, clock and latch.

A rising clock shifts the level of each data line into its chain; a rising latch shows what the
chain holds. A bit whose clock comes with the latch, or after it, is not shown before the next one.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final, Self

import numpy as np
from numpy.typing import NDArray

from haptogram.errors import ConfigurationError, refusals_of
from haptogram.settings.option import Settings, option

from .capture import Capture, ChannelEdges

_LAST: Final = "last"
_PLACEHOLDER: Final = "{}"
_MOST_OUTPUTS: Final = 256


@dataclass(frozen=True, kw_only=True)
class ShiftSettings(Settings):
    """The keys of the table ``[shift]`` of a map beside its chains."""

    clock: str | None = option(None, unit="CHANNEL", help="rises where a bit is shifted in")
    latch: str | None = option(None, unit="CHANNEL", help="rises where the outputs change")
    outputs: int = option(
        8, unit="N", low=1, high=_MOST_OUTPUTS, help="outputs of each chain, if data is a pattern"
    )
    order: str = option(
        _LAST,
        choices=(_LAST, "first"),
        help="output that the first bit behind a latch reaches",
    )
    steps: int | None = option(
        None,
        unit="N",
        low=2,
        high=4096,
        help="latches in a period of the carrier; the latch is the clock of the carrier then",
        absent="another reference",
    )


@dataclass(frozen=True, slots=True)
class ShiftRegisters:
    """Chains of shift registers with one clock and one latch.

    Attributes
    ----------
    clock, latch : str
        Their channels.
    settings : ShiftSettings
        What their table says beside the chains.
    chains : mapping of str to sequence of int
        Elements at the outputs of each chain, by its data line; -1: none.
    pattern : str or None
        Name of the data lines: chain n has the elements from n * outputs on.
    """

    clock: str
    latch: str
    settings: ShiftSettings
    chains: Mapping[str, list[int]]
    pattern: str | None

    @classmethod
    def of(cls, document: Mapping[str, Any]) -> Self:
        """Return the registers that the table ``[shift]`` describes.

        Raises
        ------
        ConfigurationError
            Names the key and what is wrong with it.
        """
        values = dict(document)
        data = values.pop("data", None)
        with refusals_of("[shift]:"):
            settings = ShiftSettings.of(**values)
        for name in ("clock", "latch"):
            if getattr(settings, name) is None:
                raise ConfigurationError(f"[shift] has no {name}; name its channel")
        pattern = data if isinstance(data, str) and data.count(_PLACEHOLDER) == 1 else None
        if pattern is None and not (isinstance(data, dict) and data):
            raise ConfigurationError(
                f'data of [shift] is {data!r}, must be "D{{}}", or a table of the '
                "elements at the outputs of each chain: D0 = [0, 1, 2, 3, 4, 5, 6, 7]"
            )
        chains = {} if pattern else {name: _checked_chain(name, data[name]) for name in data}
        return cls(str(settings.clock), str(settings.latch), settings, chains, pattern)

    @property
    def carrier(self) -> str | None:
        """Name of the channel that the latch makes as the clock of the carrier."""
        steps = self.settings.steps
        return None if steps is None else f"{self.latch}/{steps}"

    def chains_in(self, capture: Capture) -> dict[str, list[int]]:
        """Return the elements of each chain of a capture."""
        if self.pattern is None:
            return dict(self.chains)
        numbers = capture.numbered_channels(self.pattern)
        count = self.settings.outputs
        return {name: list(range(n * count, (n + 1) * count)) for name, n in numbers.items()}

    def expanded(self, capture: Capture) -> Capture:
        """Return *capture* with the outputs of all chains as channels: ``D0.0``, ``D0.1``, ...

        Raises
        ------
        ConfigurationError
            A line that is missing or does not move, or a chain that does not come out even.
        """
        shifts = _rising_edges(capture, self.clock)
        latches = _rising_edges(capture, self.latch)
        chains = self.chains_in(capture)
        if not chains:
            raise ConfigurationError(f"{capture.path} has no data line {self.pattern!r} of [shift]")
        before = np.searchsorted(shifts, latches)
        capture, latches, before = self._even_part(capture, chains, latches, before)
        channels = dict(capture.channels)
        for name, elements in chains.items():
            bits = capture.channel(name).levels_at(shifts)
            count = len(elements)
            held = before >= count
            for output in range(count):
                back = output + 1 if self.settings.order == _LAST else count - output
                levels = bits[before[held] - back]
                channels[f"{name}.{output}"] = _edges_of_levels(levels, latches[held])
        steps = self.settings.steps
        if self.carrier is not None and steps is not None:
            rises, falls = latches[::steps], latches[steps // 2 :: steps]
            channels[self.carrier] = ChannelEdges(np.sort(np.concatenate([rises, falls])), False)
        return dataclasses.replace(capture, channels=channels)

    def _even_part(
        self,
        capture: Capture,
        chains: Mapping[str, list[int]],
        latches: NDArray[np.int64],
        before: NDArray[np.int64],
    ) -> tuple[Capture, NDArray[np.int64], NDArray[np.int64]]:
        """Return the capture up to the last latch before one with too many or too few shifts.

        With it come the ticks of the *latches* (L,) and the numbers of shifts *before* them, both
        up to there. Usual is the median; raises ConfigurationError if a chain has another length.
        """
        counts = np.diff(before)
        usual = int(np.median(counts)) if len(counts) else int(before[-1])
        for name, elements in chains.items():
            if len(elements) != usual:
                raise ConfigurationError(
                    f"{capture.path}: between two edges of {self.latch} come {usual} shifts of "
                    f"{self.clock}, the chain {name} of the map has {len(elements)} outputs; it "
                    "must come out even: correct [shift], or capture at a higher rate"
                )
        uneven = np.flatnonzero(counts != usual)
        if not len(uneven):
            left = int(len(_rising_edges(capture, self.clock)) - before[-1])
            note = (
                f"the capture ends in a shift, {left} of {usual} bits behind the last edge of "
                f"{self.latch}: the outputs are known up to there"
            )
            return dataclasses.replace(capture, notes=(note,) if left else ()), latches, before
        first = int(uneven[0])
        why = (
            f"at {latches[first] * capture.tick_s * 1e3:.4g} ms come {counts[first]} shifts "
            f"between two edges of {self.latch}, not {usual}: edges are "
            "missing; capture at a higher rate"
        )
        end = int(latches[first])
        cut = dataclasses.replace(capture.until(end), cut=capture.cut or why)
        return cut, latches[: first + 1], before[: first + 1]


def _checked_chain(name: str, elements: object) -> list[int]:
    """Return *elements*, those at the outputs of the chain *name*, once they are checked.

    Raises ConfigurationError for none, or over 256.
    """
    if (
        not isinstance(elements, list)
        or not 1 <= len(elements) <= _MOST_OUTPUTS
        or any(isinstance(e, bool) or not isinstance(e, int) for e in elements)
    ):
        raise ConfigurationError(
            f"the chain {name} of [shift] is {elements!r}, must be a list of 1 to "
            f"{_MOST_OUTPUTS} elements, -1 for an output without one"
        )
    return list(elements)


def _rising_edges(capture: Capture, name: str) -> NDArray[np.int64]:
    """Return the (R,) ticks at which a line rises.

    Raises
    ------
    ConfigurationError
        It never does.
    """
    rises = capture.channel(name).rises
    if not len(rises):
        raise ConfigurationError(
            f"{capture.path}: {name} of [shift] never rises; check its probe, and its name"
        )
    return rises


def _edges_of_levels(levels: NDArray[np.bool_], ticks: NDArray[np.int64]) -> ChannelEdges:
    """Return the edges of an output that has *levels* (L,) from each of *ticks* (L,) on."""
    if not len(levels):
        return ChannelEdges(np.zeros(0, np.int64), False)
    changed = np.flatnonzero(levels[1:] != levels[:-1]) + 1
    return ChannelEdges(ticks[changed], bool(levels[0]), 0, int(ticks[0]))
