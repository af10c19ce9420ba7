"""Drive pins as an analyser saw them: the pulses of each element, in periods of the carrier.

Times in periods of the board's own carrier have no analyser's clock in them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


#: Samples of a period of which one is half a step of 8 bits.
SAMPLES_OF_8_BITS: Final = 512.0


@dataclass(frozen=True, slots=True, eq=False, weakref_slot=True)
class PinPulses:
    """The pulses of one pin.

    Attributes
    ----------
    channel : str
        Channel of the capture.
    rises, falls : (P,) numpy.ndarray of float
        Begin and end of each whole pulse, in periods of the carrier, ascending.
    defects : tuple of str
        Defects of the pin, whatever was intended: dead, stuck, inverted.
    begin : float
        Period from which on the capture knows the level of the pin.
    is_dead : bool
        Whether the pin is at the silent level all the time, which is a defect while others pulse.
    every : int
        Periods from one pulse to the next, usually: 2 if every second one is left out.
    edges : int
        Edges of the channel.
    response : complex
        Gain e^{+j lag} between the drive and the pin that is known, and taken off.
    """

    channel: str
    rises: NDArray[np.float64]
    falls: NDArray[np.float64]
    defects: tuple[str, ...] = ()
    begin: float = 0.0
    is_dead: bool = False
    every: int = 1
    edges: int = 0
    response: complex = 1.0

    def between(self, begin: float, end: float) -> PinPulses:
        """Return the whole pulses from *begin* to *end*, in periods."""
        kept = (self.rises >= begin) & (self.falls <= end)
        later = max(self.begin, begin)
        return replace(self, rises=self.rises[kept], falls=self.falls[kept], begin=later)


@dataclass(frozen=True, slots=True, eq=False)
class LineBytes:
    """The bytes of one direction of the line.

    Attributes
    ----------
    values : (B,) numpy.ndarray of uint8
        The bytes.
    times : (B,) numpy.ndarray of float
        When each has been received, in periods of the carrier, ascending.
    damaged : int
        Characters that were left out: without a stop bit.
    """

    values: NDArray[np.uint8]
    times: NDArray[np.float64]
    damaged: int = 0

    def between(self, begin: float, end: float) -> LineBytes:
        """Return the bytes from *begin* to *end*, in periods."""
        kept = (self.times >= begin) & (self.times <= end)
        return replace(self, values=self.values[kept], times=self.times[kept])


@dataclass(frozen=True, slots=True, eq=False)
class CarrierPeriods:
    """The periods of the carrier on the analyser's clock.

    Attributes
    ----------
    periods, times_s : (K,) numpy.ndarray of float
        Periods since the capture began, and their times, ascending.
    jitter_s : float
        Root mean square of the distances of pulses from the usual one.
    shortest_s, longest_s : float
        Extremes of these distances.
    is_steady : bool
        Whether the periods are of one length: no board that draws them out while it is busy.
    """

    periods: NDArray[np.float64]
    times_s: NDArray[np.float64]
    jitter_s: float
    shortest_s: float
    longest_s: float
    is_steady: bool


@dataclass(frozen=True, slots=True, eq=False)
class PinRecord:
    """A capture of drive pins.

    Attributes
    ----------
    name : str
        The capture, for messages.
    pins : mapping of int to PinPulses
        By element.
    end : float
        Periods of the carrier in the capture.
    period_s : float
        Period of the carrier on the analyser's clock, in seconds.
    carrier_hz : float
        Carrier that is meant.
    sample_rate_hz : float
        Sampling rate of the analyser.
    reference : str
        Channel that the times are counted by.
    reference_element : int or None
        Its element; None: it is the clock of the carrier.
    tolerance_ppm : float
        By how much the carrier may differ from the one that is meant.
    latches : (L,) numpy.ndarray of float or None
        Times of the latch pin, in periods; None: it was not captured.
    reference_rad : float
        Phase of the clock of the carrier, by the centres of its pulses.
    latch_window : float
        Periods within which changes that follow each other belong to one latch.
    skew_rad : float
        Largest difference of the delays of two channels, as a phase of the carrier.
    cut : str
        Why the capture ends early; empty: it does not.
    notes : tuple of str
        Its limits, in words.
    to_board, to_host : LineBytes or None
        Bytes on the lines of the UART; None: the line was not captured.
    carrier : CarrierPeriods or None
        Spread of its periods; None: they are all alike.
    """

    name: str
    pins: Mapping[int, PinPulses]
    end: float
    period_s: float
    carrier_hz: float
    sample_rate_hz: float
    reference: str
    reference_element: int | None = None
    tolerance_ppm: float = 1000.0
    latches: NDArray[np.float64] | None = None
    reference_rad: float = 0.0
    latch_window: float = 8.0
    skew_rad: float = 0.0
    cut: str = ""
    notes: tuple[str, ...] = field(default=())
    to_board: LineBytes | None = None
    to_host: LineBytes | None = None
    carrier: CarrierPeriods | None = None

    @property
    def samples(self) -> float:
        """Samples in a period of the carrier."""
        return self.period_s * self.sample_rate_hz

    @property
    def coarse_note(self) -> str:
        """Why the samples cannot show one step of 8 bits; empty: they can."""
        needed_hz = self.carrier_hz * SAMPLES_OF_8_BITS
        if self.sample_rate_hz >= needed_hz * 0.999:
            return ""
        return (
            f"{self.sample_rate_hz / 1e6:g} Msamples/s cannot show an error of one step of 8 bits; "
            f"{needed_hz / 1e6:g} Msamples/s can"
        )

    @property
    def duration_s(self) -> float:
        """Length in seconds of the analyser's clock."""
        if self.carrier is None or self.carrier.is_steady:
            return self.end * self.period_s
        behind = (self.end - float(self.carrier.periods[-1])) * self.period_s
        return float(self.carrier.times_s[-1]) + behind

    @property
    def drift_ppm(self) -> float:
        """Carrier against the one that is meant, on the analyser's clock."""
        return (1.0 / (self.period_s * self.carrier_hz) - 1.0) * 1e6

    def seconds(self, periods: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return times in periods of the carrier in seconds of the analyser's clock."""
        if self.carrier is None or self.carrier.is_steady:
            return periods * self.period_s
        known, times_s = self.carrier.periods, self.carrier.times_s
        places = known.searchsorted(periods).clip(1, len(known) - 1)
        slopes = (times_s[1:] - times_s[:-1]) / (known[1:] - known[:-1])
        seconds: NDArray[np.float64] = times_s[places - 1] + slopes[places - 1] * (
            periods - known[places - 1]
        )
        return seconds

    def between(self, begin: float, end: float, cut: str) -> PinRecord:
        """Return the part of the capture from *begin* to *end*, in periods counted as before.

        *cut* says why it is shortened. The lines of the UART and the latch pin end with it.
        """
        pins = {element: pin.between(begin, end) for element, pin in self.pins.items()}
        latches = self.latches
        if latches is not None:
            latches = latches[(latches >= begin) & (latches <= end)]
        return replace(
            self,
            pins=pins,
            end=end,
            latches=latches,
            cut=cut,
            to_board=self.to_board and self.to_board.between(begin, end),
            to_host=self.to_host and self.to_host.between(begin, end),
        )
