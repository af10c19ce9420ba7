"""A transducer in time: how fast its amplitude follows.

A piezoelectric transducer is a narrow resonator.  Near its resonance the complex envelope of what
it radiates follows the commanded one as a first-order lag,

    tau dA/dt = u - A,    tau = Q / (pi f0),    Q = sqrt(3) f0 / B,

where B is the full bandwidth at -6 dB (a resonance falls to half its amplitude where
2 Q |f - f0| / f0 = sqrt(3)).  So tau = sqrt(3) / (pi B): 0.28 ms for B = 2.0 kHz.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, Self

import numpy as np
from numpy.typing import ArrayLike

from haptogram.acoustics.arrays import ComplexArray
from haptogram.acoustics.memory import check_array_memory
from haptogram.acoustics.model.drive import as_weights
from haptogram.errors import ConfigurationError
from haptogram.settings.arguments import check_number, check_positive, check_whole

DEFAULT_BANDWIDTH_HZ: Final = 2000.0  # -6 dB width of a common 10 mm part: ProWave 400PT120
_MAX_BANDWIDTH_HZ: Final = 1e6
_MOST_SAMPLES: Final = 1_000_000  # of a frame


@dataclass(frozen=True, slots=True)
class Resonator:
    """The first-order envelope of a transducer that is driven at its resonance.

    Attributes
    ----------
    time_constant_s : float
        tau; 0 makes it follow at once.

    Examples
    --------
    >>> lag = Resonator.from_bandwidth(2000.0)
    >>> f"{1e6 * lag.time_constant_s:.0f} µs"
    '276 µs'
    """

    time_constant_s: float

    def __post_init__(self) -> None:
        check_number("time_constant_s", self.time_constant_s, 0.0, 1.0)

    @classmethod
    def from_bandwidth(cls, bandwidth_hz: float = DEFAULT_BANDWIDTH_HZ) -> Self:
        """Return the resonator of a full -6 dB bandwidth: tau = sqrt(3) / (pi B)."""
        check_number("bandwidth_hz", bandwidth_hz, 1.0, _MAX_BANDWIDTH_HZ)
        return cls(math.sqrt(3.0) / (math.pi * bandwidth_hz))

    def decay(self, duration_s: float) -> float:
        """Return the share of the difference of envelope and command that is left after a time."""
        check_number("duration_s", duration_s, 0.0, math.inf)
        if self.time_constant_s == 0.0:
            return 1.0 if duration_s == 0.0 else 0.0
        return math.exp(-duration_s / self.time_constant_s)

    def modulation_response(self, modulation_hz: float) -> float:
        """Return |H| = 1 / sqrt(1 + (2 pi f tau)^2), the amplitude of one sideband."""
        check_number("modulation_hz", modulation_hz, 0.0, math.inf)
        return 1.0 / math.hypot(1.0, 2.0 * math.pi * modulation_hz * self.time_constant_s)

    def dwell_mean_square(self, dwell_s: float) -> float:
        """Return the mean of A^2 over a dwell of full command that starts from rest.

        1 - 2 (1 - e) / x + (1 - e^2) / (2 x), with x = T / tau and e = exp(-x): the share of the
        static radiation force that the dwell delivers.
        """
        check_positive("dwell_s", dwell_s)
        if self.time_constant_s == 0.0:
            return 1.0
        ratio = dwell_s / self.time_constant_s
        # expm1 keeps the difference of nearly equal terms for a dwell far below tau.
        once, twice = -math.expm1(-ratio), -math.expm1(-2.0 * ratio)
        return 1.0 - 2.0 * once / ratio + twice / (2.0 * ratio)

    def envelope(
        self, commands: ArrayLike, frame_s: float, samples_per_frame: int, start: ArrayLike = 0.0
    ) -> ComplexArray:
        """Return the envelope under commands that are held for a frame each.

        Exact between frames, so the number of samples changes no value.

        Parameters
        ----------
        commands : (F, ...) array_like of complex
            One commanded amplitude, or array of them, per frame.
        frame_s : float
            Duration of a frame.
        samples_per_frame : int
            Samples at the ends of as many equal parts of each frame.
        start : array_like of complex
            Envelope before the first frame.

        Returns
        -------
        (F * samples_per_frame, ...) numpy.ndarray of complex128

        Raises
        ------
        ConfigurationError
            No frame, another shape of *start*, samples that are not 1 to a million, or a result of
            more than half of the memory.
        """
        targets, before = as_weights(commands), as_weights(start)
        if not targets.ndim or not len(targets):
            raise ConfigurationError(
                f"commands have shape {targets.shape}, must be (F, ...), F at least 1"
            )
        try:
            state = np.broadcast_to(before, targets.shape[1:])
        except ValueError as error:
            raise ConfigurationError(
                f"start has shape {before.shape}, must be that of one command, {targets.shape[1:]}"
            ) from error
        check_whole("samples_per_frame", samples_per_frame, 1, _MOST_SAMPLES)
        shape = (len(targets) * samples_per_frame, *targets.shape[1:])
        check_array_memory("an envelope", shape, 16)
        step_s = check_positive("frame_s", frame_s) / samples_per_frame
        left = np.array([self.decay(step_s * (i + 1)) for i in range(samples_per_frame)])
        left = left.reshape(-1, *(1,) * (targets.ndim - 1))
        parts = []
        for target in targets:
            parts.append(target + left * (state - target))
            state = parts[-1][-1]
        return np.concatenate(parts)
