"""The pins of a capture, counted by the board's own carrier: the evidence of a verdict."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from haptogram.acoustics.model.calibration import Calibration
from haptogram.errors import ConfigurationError
from haptogram.records.pins import CarrierPeriods, LineBytes, PinPulses, PinRecord

from .capture import Capture, ChannelEdges
from .carrier_clock import CarrierClock, capture_to_first_splice, checked_capture_period
from .channel_map import ChannelMap
from .uart import LEAST_SAMPLES_A_BIT, decoded_uart_bytes

_Floats: TypeAlias = NDArray[np.float64]
#: A pulse alone that is shorter is taken for a disturbance of the capture, and so is a gap.
_SPIKE_SAMPLES: Final = 2.5
_SPIKE_PERIODS: Final = 0.004
_NEIGHBOUR: Final = 0.1  # periods by which a pulse of the same drive may be off its place
_ESTIMATED: Final = 0.99  # accuracy of a rate that is estimated from edges
_FULL_DUTY: Final = 0.5
_DRIVEN_PERIODS: Final = 2.0  # periods on end: a latch may join two pulses to one of a period
_WIDER: Final = 0.1  # excess of a duty over half a period from which a pin counts as inverted


def pin_record_of_capture(capture: Capture, mapped: ChannelMap) -> PinRecord:
    """Return the pulses of the mapped channels of *capture*, in periods of its reference.

    Raises
    ------
    ConfigurationError
        A channel that is missing, a reference without a carrier, too low a sampling rate for the
        carrier or for the lines of the UART.
    """
    settings = mapped.settings
    capture = mapped.expanded(capture)
    elements = mapped.joined(capture)
    rate_hz = settings.sample_rate_hz or capture.sample_rate_hz
    sample = 1.0 / (rate_hz * capture.tick_s)
    nominal = 1.0 / (settings.carrier_hz * capture.tick_s)
    reference = elements.get(mapped.reference)
    if reference is not None and len(elements) == 1:
        raise ConfigurationError(
            f"{mapped.path}: {mapped.reference} is the only element and its own reference, which "
            "shows no phase; capture the clock of the carrier, or another element"
        )
    active_low = settings.active_low and reference is not None
    pulses = capture.channel(mapped.reference).pulses(active_low=active_low)
    rises, falls = _captured_edges_without_spikes(*pulses, sample, nominal)
    all_rises = rises if len(rises) > 2 else pulses[0]  # no rate of samples tells spikes apart
    period = checked_capture_period(capture, mapped, all_rises, sample, rate_hz)
    clock = CarrierClock(rises, period, sample, is_clock=reference is None)
    if reference is None and clock.is_steady:
        capture = capture_to_first_splice(capture, rises, sample)
        clock = CarrierClock(rises[rises <= capture.end], period, sample, is_clock=True)
    responses = _calibrated_responses(mapped, elements)
    pins = {}
    silent = all(len(capture.channel(name).times) == 0 for name in elements)
    for name, element in elements.items():
        edges = capture.channel(name)
        edge_pairs = edges.pulses(active_low=settings.active_low)
        begins, ends = _captured_edges_without_spikes(*edge_pairs, sample, nominal)
        pulses = clock.periods(begins), clock.periods(ends)
        longest = (
            _longest_captured_drive_ticks(edges, settings.active_low, capture.end) / clock.period
        )
        defects = tuple(_edge_defects(edges, *pulses, settings.active_low, longest))
        defects = () if silent else defects
        begin = 0.0
        if edges.defined_from:
            begin = float(clock.periods(np.array([float(edges.defined_from)]))[0])
        is_dead = not len(edges.times) and edges.first_level is settings.active_low
        every = round(float(np.median(np.diff(pulses[0])))) if len(begins) > 1 else 1
        pins[element] = PinPulses(
            name,
            *pulses,
            defects,
            begin,
            is_dead,
            max(every, 1),
            len(edges.times),
            responses[element],
        )
    latches = None
    if settings.latch is not None:
        latches = clock.periods(capture.channel(settings.latch).pulses()[0])
    return PinRecord(
        name=str(capture.path),
        pins=pins,
        end=float(clock.periods(np.array([float(capture.end)]))[0]),
        period_s=clock.period * capture.tick_s,
        carrier_hz=settings.carrier_hz,
        sample_rate_hz=rate_hz,
        reference=mapped.reference,
        reference_element=reference,
        tolerance_ppm=settings.carrier_tolerance_ppm,
        latches=latches,
        reference_rad=_clock_phase(clock.periods(rises), clock.periods(falls)),
        latch_window=settings.latch_window_us * 1e-6 * settings.carrier_hz,
        skew_rad=math.tau * settings.skew_ns * 1e-9 * settings.carrier_hz,
        cut=capture.cut,
        notes=capture.notes,
        to_board=_read_uart_line(capture, mapped, settings.to_board, rate_hz, clock),
        to_host=_read_uart_line(capture, mapped, settings.to_host, rate_hz, clock),
        carrier=CarrierPeriods(
            *clock.marks(capture.tick_s),
            jitter_s=clock.jitter * capture.tick_s,
            shortest_s=clock.shortest * capture.tick_s,
            longest_s=clock.longest * capture.tick_s,
            is_steady=clock.is_steady,
        ),
    )


def _calibrated_responses(mapped: ChannelMap, elements: Mapping[str, int]) -> dict[int, complex]:
    """Return gain e^{+j lag} by element, of the calibration that the map names.

    1 without a calibration, and for an element of which it has 0.
    """
    if mapped.settings.calibration is None:
        return dict.fromkeys(elements.values(), 1.0)
    known = Calibration.from_file(mapped.path.parent / mapped.settings.calibration)
    for name, element in elements.items():
        if element >= known.count:
            raise ConfigurationError(
                f"{known.name}: element {element} ({name}) is missing, which {mapped.path} names"
            )
    return {element: complex(known.response[element]) or 1.0 for element in elements.values()}


def _clock_phase(rises: _Floats, falls: _Floats) -> float:
    """Return the mean phase in rad, -pi to pi, of the middle of the carrier clock's pulses.

    *rises* and *falls* are their edges in periods; the phase counts from whole periods.
    """
    return float(np.angle(np.exp(1j * math.pi * (rises + falls)).sum()))


def _read_uart_line(
    capture: Capture, mapped: ChannelMap, name: str | None, rate_hz: float, clock: CarrierClock
) -> LineBytes | None:
    """Return the bytes on the UART line *name*, with times in periods; None without a name.

    Raises
    ------
    ConfigurationError
        Too low a sampling rate.
    """
    if name is None:
        return None
    baud = mapped.settings.baud
    if rate_hz < LEAST_SAMPLES_A_BIT * baud * _ESTIMATED:
        raise ConfigurationError(
            f"{capture.path}: {rate_hz:.6g} samples/s are {rate_hz / baud:.3g} in a bit of {name} "
            f"at {baud} baud, must be {LEAST_SAMPLES_A_BIT:g} at least: sample at "
            f"{LEAST_SAMPLES_A_BIT * baud:g} Hz or more, or leave the line out of {mapped.path}"
        )
    bit = 1.0 / (baud * capture.tick_s)
    values, ends, damaged = decoded_uart_bytes(capture.channel(name), bit)
    return LineBytes(values, clock.periods(ends), damaged)


def _captured_edges_without_spikes(
    rises: _Floats, falls: _Floats, sample: float, period: float
) -> tuple[_Floats, _Floats]:
    """Return pulses without dips and spikes of up to 2.5 samples or 0.1 µs; times in ticks.

    Pulses of a small amplitude are as short, but each has a neighbour as short a period away.
    *sample* and *period* are in ticks.
    """
    spike = max(_SPIKE_SAMPLES * sample, _SPIKE_PERIODS * period)
    apart = np.concatenate([[True], rises[1:] - falls[:-1] > spike])
    lasting = np.concatenate([apart[1:], [True]])
    if not len(rises):
        return rises, falls
    rises, falls = rises[apart], falls[lasting]
    widths = falls - rises
    narrow = widths <= spike + sample
    near = np.abs(np.diff(rises + falls) / 2.0 - period) < _NEIGHBOUR * period
    near &= narrow[1:] & narrow[:-1]
    kept = widths > spike
    kept[1:] |= near
    kept[:-1] |= near
    return rises[kept], falls[kept]


def _edge_defects(
    edges: ChannelEdges, rises: _Floats, falls: _Floats, active_low: bool, longest: float
) -> list[str]:
    """Return what is wrong with a pin: stuck, dead, inverted, undefined; [] if nothing.

    *longest* is the most periods for which it is driven without a break: over 2 is a defect. A duty
    over 0.6 is inverted. *rises* and *falls* are in periods.
    """
    found = []
    if not len(edges.times):
        level = "high" if edges.first_level else "low"
        is_driven = edges.first_level is not active_low
        found.append(f"stuck {level}" if is_driven else f"dead: {level} all the time")
    elif len(rises) and np.median(falls - rises) > _FULL_DUTY + _WIDER:
        found.append(f"duty of {np.median(falls - rises):.2f}: inverted polarity")
    elif longest > _DRIVEN_PERIODS:
        level = "low" if active_low else "high"
        found.append(f"{level} for {longest:.0f} periods on end: inverted polarity, or stuck")
    if edges.undefined:
        found.append(f"{edges.undefined} times undefined (x or z)")
    return found


def _longest_captured_drive_ticks(edges: ChannelEdges, active_low: bool, end: int) -> float:
    """Return the most ticks for which a pin stays at its driven level; 0 if it never is."""
    bounds = np.concatenate([[edges.defined_from], edges.times, [end]])
    skipped = int(edges.first_level is active_low)
    return float(np.diff(bounds)[skipped::2].max(initial=0))
