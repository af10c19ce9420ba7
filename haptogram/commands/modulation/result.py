"""Result of ``haptogram modulation`` as text, CSV and JSON."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final, Self

import numpy as np

from haptogram import acoustics
from haptogram.acoustics.levels.spot import measure_spot
from haptogram.objects.modulation import FeltSignal, FocusFrames, felt_signal_at
from haptogram.objects.run_frames import check_run_foci_in_reach
from haptogram.settings.shape import ModulationConfig

from ..shell.positions import position_text

FELT_UP_TO_HZ: Final = 1000.0  # skin feels vibration up to about 1 kHz
_LEAST_SHARE: Final = 0.01  # least strength of a spectral line, relative to the strongest
_MOST_LINES: Final = 12
_NOTEWORTHY: Final = 0.01  # least share of the vibration's power
_ORDERS_NAMED: Final = 4


@dataclass(frozen=True, slots=True)
class ModulationResult:
    """Frames, and what they make at a place.

    Attributes
    ----------
    object : str
        Shape or mesh file.
    modulation : ModulationConfig
        Modulation that was asked for.
    frames : FocusFrames
        One pass.
    frequency_hz : float or None
        Of the modulation in the frames; None where points are only held.
    place_m : (float, float, float)
        Where it is felt.
    signal : FocusSignal
        The radiation pressure there.
    force_n : float
        Force of a steady focus at the first point, on a disc of 20 mm diameter, parallel to the
        array's face.
    spot_m : float
        Width of that focus at -6 dB, where it is narrowest.
    """

    object: str
    modulation: ModulationConfig
    frames: FocusFrames
    frequency_hz: float | None
    place_m: tuple[float, float, float]
    signal: FeltSignal
    force_n: float
    spot_m: float

    @classmethod
    def of(
        cls,
        engine: acoustics.FieldEngine,
        object: str,
        modulation: ModulationConfig,
        frames: FocusFrames,
        lag: acoustics.Resonator,
        place_m: tuple[float, float, float] | None,
    ) -> Self:
        """Return the signal of *frames* at a place, by default at their first focus.

        Raises
        ------
        ConfigurationError
            A focus or a place out of reach.
        """
        check_run_foci_in_reach(engine.model, np.unique(frames.points_m, axis=0))
        x, y, z = frames.points_m[0].tolist()
        place = (x, y, z) if place_m is None else place_m
        steady = np.exp(1j * acoustics.focus_phases(engine.model, (x, y, z)))
        spot = measure_spot(engine, steady, (x, y, z))
        return cls(
            object,
            modulation,
            frames,
            _modulation_frequency_in(frames, modulation),
            place,
            felt_signal_at(engine, frames, place, lag),
            acoustics.force_on_disc_n(engine, steady, (x, y, z)),
            float(np.nanmin(spot.width_6db_m)),
        )


def _modulation_frequency_in(frames: FocusFrames, config: ModulationConfig) -> float | None:
    """Return the frequency in Hz, nearest the one asked for, that has whole periods in a pass.

    A pass is one run through *frames*; None if they are not modulated.
    """
    if config.modulation is None:
        return None
    return round(frames.duration_s * config.modulation_hz) / frames.duration_s


def describe_felt(felt: ModulationResult, bandwidth_hz: float) -> Iterator[str]:
    """Yield the result line by line, at most 100 columns wide."""
    yield from _describe_felt_frames(felt)
    signal = felt.signal
    yield (
        f"felt at ({position_text(felt.place_m, 2)}) mm, through transducers of "
        f"{bandwidth_hz:g} Hz "
        "bandwidth (at -6 dB):"
    )
    low, high = signal.pressure_pa.min(), signal.pressure_pa.max()
    yield (
        f"  radiation pressure {low:.1f} to {high:.1f} Pa, mean {signal.mean_pa:.1f} Pa: "
        f"swing {signal.swing:.0%}, vibration {signal.vibration_rms_pa:.1f} Pa RMS"
    )
    yield (
        f"  a steady focus: {felt.force_n * 1e3:.2f} mN on a reflecting disc of 20 mm diameter, "
        "parallel to the array's face"
    )
    yield from _describe_felt_spectrum(felt)
    for warning in felt_warnings(felt):
        yield from textwrap.wrap(warning, 98, initial_indent="warning: ", subsequent_indent="  ")


def _describe_felt_frames(felt: ModulationResult) -> Iterator[str]:
    """Yield lines on the frames: points or modulation, frequency, depth; the path if any."""
    frames, config = felt.frames, felt.modulation
    held = "" if config.dwell_ms is None else f", each point held {config.dwell_ms:g} ms"
    if felt.frequency_hz is None:
        yield f"points of a {felt.object}{held or ', each held one frame'}"
    else:
        depth = f", depth {config.depth:.0%} of the force" if config.modulation == "am" else ""
        yield (
            f"{str(config.modulation).upper()} at {felt.frequency_hz:.6g} Hz{depth}; "
            f"{felt.object}{held}"
        )
    periods = (
        "" if felt.frequency_hz is None else _modulation_periods_text(felt.frequency_hz, frames)
    )
    yield (
        f"frames: {frames.count} of {1e3 / frames.rate_hz:g} ms at {frames.rate_hz:g} frames/s"
        f"{periods}; a pass takes {frames.duration_s * 1e3:g} ms"
    )
    if frames.steps_m.max() > 0.0:
        travelled_m = float(frames.steps_m.sum())
        yield (
            f"path: {travelled_m * 1e3:.1f} mm in a pass, {travelled_m / frames.duration_s:.2f} "
            f"m/s; at most {frames.steps_m.max() * 1e3:.1f} mm from frame to frame (focus "
            f"{felt.spot_m * 1e3:.1f} mm wide at -6 dB)"
        )


def _modulation_periods_text(frequency_hz: float, frames: FocusFrames) -> str:
    """Return the number of periods and the frames in each, as text."""
    count = round(frequency_hz * frames.duration_s)
    return f", {count} period{'s' * (count != 1)}, {frames.rate_hz / frequency_hz:.4g} in each"


def _describe_felt_spectrum(felt: ModulationResult) -> Iterator[str]:
    """Yield a table of the 12 strongest spectral lines of the felt signal, from 1 % of the first.

    A text in its place says that nothing varies.
    """
    highest_hz = max(FELT_UP_TO_HZ, felt.frames.rate_hz + (felt.frequency_hz or 0.0))
    lines = felt.signal.lines(_LEAST_SHARE, highest_hz)
    if not lines:
        yield "  spectrum: nothing varies"
        return
    strongest = max(level for _, level in lines)
    shown = sorted(sorted(lines, key=lambda line: -line[1])[:_MOST_LINES])
    yield f"  spectrum: {'Hz':>10} {'Pa':>8} {'dB':>7}"
    for frequency, level in shown:
        level_db = 20.0 * math.log10(level / strongest)
        name = _felt_line_name(frequency, felt)
        yield f"            {frequency:>10.6g} {level:>8.2f} {level_db:>7.1f}   {name}".rstrip()
    if len(lines) > len(shown):
        yield f"            and {len(lines) - len(shown)} weaker lines up to {highest_hz:g} Hz"


def _felt_line_name(frequency_hz: float, felt: ModulationResult) -> str:
    """Return the cause of a spectral line: modulation or a multiple, frame rate, or an image.

    An image is the frame rate plus or minus the modulation or a multiple; "" if nothing fits.
    """
    if felt.frequency_hz is None:
        return ""
    order = frequency_hz / felt.frequency_hz
    if frequency_hz < felt.frames.rate_hz / 2.0 and math.isclose(order, round(order)):
        return "the modulation" if round(order) == 1 else f"{round(order)} x the modulation"
    if math.isclose(frequency_hz, felt.frames.rate_hz):
        return "the frame rate"
    order = abs(frequency_hz - felt.frames.rate_hz) / felt.frequency_hz
    if math.isclose(order, round(order), abs_tol=1e-9) and 1 <= round(order) <= _ORDERS_NAMED:
        sign = "-" if frequency_hz < felt.frames.rate_hz else "+"
        times = "" if round(order) == 1 else f"{round(order)} x "
        return f"image: frame rate {sign} {times}modulation"
    return ""


def felt_warnings(felt: ModulationResult) -> Iterator[str]:
    """Yield warnings for the designer of the sensation."""
    frames, config = felt.frames, felt.modulation
    if felt.frequency_hz is not None and felt.frequency_hz != config.modulation_hz:
        yield (
            f"{config.modulation_hz:g} Hz became {felt.frequency_hz:.9g} Hz, so that the frames "
            "repeat without a seam"
        )
    half_hz = frames.rate_hz / 2.0
    share = felt.signal.share_above(half_hz) if half_hz < FELT_UP_TO_HZ else 0.0
    if share > _NOTEWORTHY:
        yield (
            f"{share:.0%} of the power of the vibration is above {half_hz:g} Hz, half the frame "
            f"rate: steps between frames, and skin feels up to about {FELT_UP_TO_HZ:g} Hz; a "
            "higher frame rate moves them out of reach"
        )
    longest_m = float(frames.steps_m.max())
    if config.modulation == "stm" and longest_m > felt.spot_m:
        yield (
            f"{longest_m * 1e3:.1f} mm from frame to frame, and a focus is "
            f"{felt.spot_m * 1e3:.1f} mm wide: the path has gaps; fewer rounds per second or a "
            "higher frame rate close them"
        )


def felt_csv(frames: FocusFrames) -> str:
    """Return the frames as CSV."""
    rows = (
        f"{number / frames.rate_hz:.9g},{x:.6g},{y:.6g},{z:.6g},{amplitude:.6g}\n"
        for number, ((x, y, z), amplitude) in enumerate(
            zip((frames.points_m * 1e3).tolist(), frames.amplitudes.tolist(), strict=True)
        )
    )
    return "time_s,x_mm,y_mm,z_mm,amplitude\n" + "".join(rows)


def felt_dict(felt: ModulationResult, bandwidth_hz: float) -> dict[str, Any]:
    """Return plain values, for JSON."""
    signal, frames = felt.signal, felt.frames
    return {
        "modulation": felt.modulation.modulation,
        "frequency_hz": felt.frequency_hz,
        "depth": felt.modulation.depth if felt.modulation.modulation == "am" else None,
        "frames": frames.count,
        "rate_hz": frames.rate_hz,
        "bandwidth_hz": bandwidth_hz,
        "longest_step_mm": float(frames.steps_m.max()) * 1e3,
        "felt_at_mm": [value * 1e3 for value in felt.place_m],
        "mean_pa": signal.mean_pa,
        "swing": signal.swing,
        "vibration_rms_pa": signal.vibration_rms_pa,
        "spectrum": [
            {"frequency_hz": frequency, "amplitude_pa": level}
            for frequency, level in signal.lines(_LEAST_SHARE)
        ],
        "warnings": list(felt_warnings(felt)),
    }
