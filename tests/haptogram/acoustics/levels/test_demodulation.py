"""The audible sound of a modulated array, against closed forms and the law in the time domain."""

import math

import numpy as np
import pytest

from haptogram.acoustics import (
    AcousticModel,
    Medium,
    NumpyEngine,
    PointSource,
    Resonator,
    Transducer,
    TransducerArray,
    a_weighting_db,
    demodulated_level_db_a,
    demodulated_lines,
    focus_phases,
    radiated_power_w,
)
from haptogram.errors import ConfigurationError

LAG = Resonator(2e-4)
FRAME_S = 1e-3


def engine_of(nx=1, ny=1, directivity=None, temperature_c=20.0):
    medium = Medium.air(temperature_c, frequency_hz=40e3)
    transducer = Transducer() if directivity is None else Transducer(directivity)
    return NumpyEngine(AcousticModel(TransducerArray.grid(nx, ny), medium, transducer))


def modulated(count, frames=5):
    """Return a drive at 200 Hz: (1 + cos) / 2."""
    envelope = 0.5 * (1.0 + np.cos(2.0 * np.pi * np.arange(frames) / frames))
    return envelope[:, None] * np.ones(count)


def test_the_power_of_a_point_source_is_that_of_its_strength():
    engine = engine_of(directivity=PointSource())
    medium, strength = engine.model.medium, engine.model.transducer.source_strength_pa_m
    expected = 2.0 * np.pi * strength**2 / medium.impedance  # into half the space
    assert radiated_power_w(engine, [[1.0], [0.5j]]) == pytest.approx(
        [expected, expected / 4.0], rel=1e-6
    )


def test_a_focus_radiates_less_than_the_sum_of_coherent_sources_and_does_not_depend_on_phase():
    engine = engine_of(8, 8)
    drive = np.exp(1j * focus_phases(engine.model, [0.0, 0.0, 0.1]))
    power = radiated_power_w(engine, [drive, drive * 1j, drive / 2.0])
    assert power[1] == pytest.approx(power[0], rel=1e-9)
    assert power[2] == pytest.approx(power[0] / 4.0, rel=1e-9)
    coarse = radiated_power_w(engine, [drive], directions=8_000)
    assert coarse[0] == pytest.approx(power[0], rel=0.02)


@pytest.mark.parametrize("temperature_c", [-10.0, 35.0])
def test_the_lines_are_those_of_the_law_in_the_time_domain(temperature_c):
    engine, samples = engine_of(temperature_c=temperature_c), 400
    drives = modulated(1)
    turns = 40  # rounds until the start is forgotten
    envelope = np.abs(LAG.envelope(np.tile(drives, (turns, 1)), FRAME_S, samples))[:, 0]
    period_s = len(drives) * FRAME_S
    square = envelope[-len(drives) * samples :] ** 2
    lines = np.fft.rfft(square)[1:8] / len(square)
    medium = engine.model.medium
    power_w = radiated_power_w(engine, [[1.0]])[0]
    rate = 2.0 * np.pi * np.arange(1, 8) / period_s
    factor = 1.2 * power_w / (8.0 * np.pi * medium.sound_speed_m_s**3 * medium.absorption_np_m)
    expected = factor / 0.5 * rate**2 * np.sqrt(2.0) * np.abs(lines)
    frequency_hz, pressure_pa = demodulated_lines(engine, drives, 0.5, FRAME_S, LAG)
    assert frequency_hz[:3] == pytest.approx([200.0, 400.0, 600.0])
    assert pressure_pa[:7] == pytest.approx(expected, rel=2e-2)
    weighted = pressure_pa * 10.0 ** (a_weighting_db(frequency_hz) / 20.0)
    level = 20.0 * math.log10(math.sqrt(np.sum(weighted**2)) / 20e-6)
    assert demodulated_level_db_a(engine, drives, 0.5, FRAME_S, LAG) == pytest.approx(level)


def test_steady_power_is_silent_and_half_the_drive_is_a_quarter():
    engine = engine_of(2, 2)
    steady = np.exp(2j * np.pi * np.arange(5) / 5)[:, None] * np.ones(4)
    still = np.ones((5, 4))
    full = demodulated_lines(engine, modulated(4), 0.5, FRAME_S, LAG)[1]
    half = demodulated_lines(engine, 0.5 * modulated(4), 1.0, FRAME_S, LAG)[1]
    assert half == pytest.approx(full / 8.0)
    assert demodulated_lines(engine, still, 0.5, FRAME_S, LAG)[1].max() < 1e-9 * full.max()
    assert radiated_power_w(engine, steady) == pytest.approx(radiated_power_w(engine, still))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"weights": np.ones(1)}, "shape"),
        ({"distance_m": 0.0}, "distance_m is 0"),
        ({"frame_s": -1.0}, "frame_s is -1"),
        ({"resonator": Resonator(0.0)}, "time_constant_s is 0"),
    ],
)
def test_what_makes_no_sense_is_refused(change, message):
    arguments = {
        "weights": modulated(1), "distance_m": 0.5, "frame_s": FRAME_S, "resonator": LAG,
    }  # fmt: skip
    with pytest.raises(ConfigurationError, match=message):
        demodulated_lines(engine_of(), **(arguments | change))
    lossless = AcousticModel(TransducerArray.grid(1, 1), Medium(343.0, 1.2), Transducer())
    with pytest.raises(ConfigurationError, match="absorption_np_m is 0"):
        demodulated_lines(NumpyEngine(lossless), **arguments)
