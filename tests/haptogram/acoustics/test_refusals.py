"""Bad input: one line that says what is wrong and what would be right, and never a warning."""

import math

import numpy as np
import pytest

from haptogram.acoustics import (
    AcousticModel,
    Drive,
    Medium,
    NumbaEngine,
    NumpyEngine,
    RectangularPiston,
    Resonator,
    TransducerArray,
    exposure_at,
    find_pressure_peak,
    fit_focus,
    focus_phases,
    largest_secondary_lobe,
    mean_square_pressure,
    measure_spot,
    quantise_phase,
    radiation_pressure_pa,
    solve_foci,
    worst_exposure,
)
from haptogram.acoustics.reconstruct.reconstruction import Reconstructor
from haptogram.errors import ConfigurationError

pytestmark = pytest.mark.filterwarnings("error")

MODEL = AcousticModel.default(4, 4)
ENGINE = NumpyEngine(MODEL)
LAG = Resonator.from_bandwidth()
ONE, PLACE = np.ones(16), [0.0, 0.0, 0.1]
TWO = np.ones((2, 16))
HALVES = np.sign(MODEL.array.positions_m[:, 0])  # in antiphase: nothing in the middle
IN_TAR = NumpyEngine(MODEL.with_sound_speed(1e-3))


@pytest.mark.parametrize("kind", [NumpyEngine, NumbaEngine])
@pytest.mark.parametrize(
    ("weights", "points", "message"),
    [
        (ONE, [[0.0, 0.0, math.nan]], r"points_m\[0, 2\] is nan, must be finite"),
        (ONE, [[0.0, math.inf, 0.1]], r"points_m\[0, 1\] is inf"),
        (ONE, [[0.0, 0.0, 0.1], [1e200, 0.0, 0.1]], r"points_m\[1, 0\] is 1e\+200, .* 1e\+06"),
        (ONE, PLACE, r"shape \(3,\), must be \(M, 3\)"),
        (ONE, [["a", "b", "c"]], "not an array of numbers"),
        (ONE, [[0.0, 0.0, 0.1j]], "not an array of numbers"),
        (ONE, [[0.005, 0.005, 0.0]], r"point 0 is 0 mm from element 10, must be at least 1 mm"),
        (ONE, [[0.0, 0.0, -0.1]], "point 0 is 100 mm behind the baffle"),
        (np.ones(15), [PLACE], r"shape \(15,\), must end in 16 elements"),
        (np.full(16, math.nan), [PLACE], r"weights\[0\] is .*nan.*, must be finite"),
        (np.full(16, 1e155), [PLACE], r"weights\[0\] is 1e\+155.*, must be 1e\+06 at most"),
        (np.full(16, 1e39j), [PLACE], r"weights\[0\] is 0\+1e\+39j, must be 1e\+06 at most"),
        (None, [PLACE], r"weights"),
    ],
)
def test_what_has_no_field_is_refused_by_every_engine(kind, weights, points, message):
    with pytest.raises(ConfigurationError, match=message):
        kind(MODEL).pressure(weights, points)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: Drive.from_weights(1.1 * ONE), r"weights\[0\] has the magnitude 1\.1.* 1 at most"),
        (lambda: Drive.from_weights(ONE, 2.5), "phase_bits is 2.5, must be a whole number"),
        (lambda: quantise_phase([0.0], None), "phase_bits is None, must be a whole number"),
        (lambda: Medium.air(-300), "temperature_c is -300, must be -20 to 50"),
        (lambda: Medium.air(1000), "temperature_c is 1000, must be -20 to 50"),
        (lambda: Medium.air("warm"), "temperature_c is 'warm', must be a number"),
        (lambda: Medium.air(None), "temperature_c is None, must be a number"),
        (lambda: Medium.air(20, 5), "humidity_percent is 5, must be 10 to 100"),
        (lambda: Medium.air(20, 50, 0), "pressure_pa is 0, must be 50000 to 200000"),
        (lambda: Medium.air(frequency_hz=2e6), "is 19.7 Hz/Pa, must be 0.0004 to 10"),
        (lambda: TransducerArray.grid(2, 2.5), "side of the grid is 2.5, must be a whole number"),
        (lambda: TransducerArray.grid(0, 4), "side of the grid is 0, must be 1 to 1024"),
        (lambda: TransducerArray.grid(64, 64), "4096 transducers, must be 1 to 1024"),
        (lambda: TransducerArray.from_positions(np.zeros((2, 3))), "are 0 mm apart"),
        (lambda: TransducerArray.from_positions([PLACE], [[0, 0, 0]]), "has no direction"),
        (lambda: TransducerArray.from_positions([PLACE], [[0, 0, 1e300]]), "must be 1e.06 at most"),
        (lambda: RectangularPiston(1e-3, 1e-3, (0, 0, 0)), "width_axis is 0"),
        (lambda: focus_phases(MODEL, [1e300, 0, 0]), r"target_m.* is 1e\+300, must be 1e\+06"),
        (
            lambda: solve_foci(MODEL, [PLACE], [1e-300]),
            "amplitude is 1e-300, must be 1e-06 to 1000000",
        ),
        (
            lambda: solve_foci(MODEL, [PLACE], [1e300]),
            r"amplitude is 1e\+300, must be 1e-06 to 1000000",
        ),
        (lambda: solve_foci(MODEL, [PLACE], rounds=2.5), "rounds is 2.5, must be a whole number"),
        (lambda: fit_focus(MODEL, np.zeros(16), PLACE, step_rad=-0.1), "step_rad is -0.1, must be"),
        (lambda: radiation_pressure_pa("loud", MODEL.medium), "not an array of numbers"),
        (lambda: mean_square_pressure(ENGINE, ONE, [PLACE], 1e-3), r"must be \(F, 16\)"),
        (lambda: exposure_at(ENGINE, np.empty((0, 16)), [PLACE], 1e-3), "F at least 1"),
        (
            lambda: worst_exposure(ENGINE, TWO, 1.0, 1e-3, 10**13),
            "directions is 1.*, must be 10 to",
        ),
        (lambda: find_pressure_peak(ENGINE, TWO, PLACE), r"must be \(16,\)"),
        (lambda: find_pressure_peak(ENGINE, 0 * ONE, PLACE), "no sound"),
        (lambda: measure_spot(ENGINE, TWO, PLACE), r"must be \(16,\)"),
        (lambda: measure_spot(ENGINE, 0 * ONE, PLACE), "no sound"),
        (lambda: measure_spot(ENGINE, ONE, [0, 0, -0.1]), "100 mm behind"),
        (lambda: largest_secondary_lobe(ENGINE, TWO, PLACE), r"must be \(16,\)"),
        (lambda: largest_secondary_lobe(ENGINE, ONE, [0, 0, -0.1]), "100 mm behind"),
        (lambda: largest_secondary_lobe(ENGINE, HALVES, PLACE), "no sound"),
        (
            lambda: largest_secondary_lobe(IN_TAR, ONE, PLACE, 0.5),
            "the grid of a search .* at most",
        ),
        (lambda: mean_square_pressure(ENGINE, TWO, [PLACE], 1e-25, LAG), "frame_s is 1e-25, must"),
        (lambda: LAG.envelope([1.0], 1e-3, 1.5), "samples_per_frame is 1.5, must be a whole"),
        (lambda: LAG.envelope([1.0], 1e-3, 10**12), "samples_per_frame is 1000000000000, must be"),
        (lambda: LAG.envelope(np.ones((10**5, 10)), 1e-3, 10**6), "an envelope of .* must be at"),
        (lambda: LAG.envelope([], 1e-3, 2), r"commands have shape \(0,\), must be"),
        (lambda: LAG.envelope(1.0, 1e-3, 2), r"commands have shape \(\), must be"),
        (lambda: LAG.envelope(TWO, 1e-3, 2, ONE[:3]), r"start has shape \(3,\), must be .*16"),
        (lambda: LAG.modulation_response("fast"), "modulation_hz is 'fast', must be a number"),
        (lambda: TransducerArray.parse("x" * 5000), "the name is too long; a grid is written"),
        (lambda: TransducerArray.parse("x" * 5000 + ".csv"), "the name is too long"),
        (
            lambda: Reconstructor(MODEL).reconstruct(Drive.muted(3)),
            "drive of 3, array of 16 elements",
        ),
    ],
)
def test_bad_input_is_refused_with_the_value_and_the_limit(call, message):
    with pytest.raises(ConfigurationError, match=message):
        call()


def test_a_fit_may_start_on_an_element():
    target = np.array([0.01, 0.0, 0.1])
    fit = fit_focus(MODEL, focus_phases(MODEL, target), [0.005, 0.005, 0.0], phase_bits=8)
    assert np.isfinite(fit.position_m).all()
