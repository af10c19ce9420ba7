"""One latch of a board whose client does not say what it means."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Final

import numpy as np

from haptogram.acoustics.arrays import ComplexArray
from haptogram.records.frame import Evidence

POWER_UP: Final = "power-up"
MODULATED: Final = "modulation"
UPLOAD: Final = "upload"
#: Counter of latches whose pins pulse in every second period.
HALVED: Final = "pins_at_half_carrier"
#: Causes of latches without a client.
OWN_CAUSES: Final = frozenset({POWER_UP, "off-frame", MODULATED, UPLOAD})
#: Counters of codecs for incomplete frames: bytes were lost or changed.
TORN_KINDS: Final = frozenset(
    {
        "frames_short",
        "frames_cut_short",
        "codes_beyond_array",
        "codes_outside_frame",
        "bytes_outside_frame",
        "start_bits_in_frame",
        "bytes_strange",
        "halves_beyond_memory",
        "operations_truncated",
        "links_undecodable",
    }
)
_PLURAL: Final = re.compile(r"\b(frame|code|byte|bit|link|operation)s\b")


@dataclass(frozen=True, eq=False, slots=True)
class SeenLatch:
    """An observed latch, without knowledge of the intended focus.

    Attributes
    ----------
    number : int
        Count of latches since power-up, from 0.
    weights : (N,) numpy.ndarray of complex
        Radiated weight of each element; not finite: nothing is known.
    steps : int
        Phase steps of the board in a period.
    t_us : int or None
        Device time, microseconds; None without timing.
    cause : str
        Cause of the latch; ``power-up`` is not the client's doing.
    counted : mapping of str to int
        Counts since the latch before of what board and codec could not understand, by kind.
    stray : tuple of int
        Channels that are driven and have no element.
    evidence : Evidence
        Who saw it.

    Examples
    --------
    >>> SeenLatch(1, np.ones(64), steps=32).cause
    'swap'
    """

    number: int
    weights: ComplexArray
    steps: int
    t_us: int | None = None
    cause: str = "swap"
    counted: Mapping[str, int] = field(default_factory=lambda: MappingProxyType({}))
    stray: tuple[int, ...] = ()
    evidence: Evidence = Evidence.EXTERNAL

    @property
    def is_of_client(self) -> bool:
        """True if a client made the board latch."""
        return self.cause not in OWN_CAUSES

    @property
    def is_sample(self) -> bool:
        """True if the amplitude changed, and no frame came: by a modulation, or as bytes arrive."""
        return self.cause in (MODULATED, UPLOAD)

    @property
    def level(self) -> float:
        """Amplitude of the strongest element."""
        return float(np.abs(np.nan_to_num(self.weights)).max(initial=0.0))

    @property
    def torn(self) -> dict[str, int]:
        """Counts of a frame that is not whole; empty if there are none."""
        return {kind: count for kind, count in self.counted.items() if kind in TORN_KINDS}

    @property
    def torn_text(self) -> str:
        """Counts of a frame that is not whole, in words: "1 frame short"."""
        return ", ".join(
            _watched_count_text(kind, count) for kind, count in sorted(self.torn.items())
        )


def _watched_count_text(kind: str, count: int) -> str:
    """Return a count with its noun, in the singular for 1."""
    words = kind.replace("_", " ")
    if count == 1:
        words = _PLURAL.sub(r"\1", words, count=1)
    return f"{count} {words}"
