"""Elements that differ: what takes a drive acts as if the drive were what they make of it.

`placed` is the array with its elements where they really are, all equal; a drive `w` on the
calibrated model is the drive `w h` on it, and phases that focus there are those less `arg h`.
"""

import dataclasses
import inspect
import math

import numpy as np
import pytest

import haptogram.acoustics as package
from haptogram.acoustics import (
    AcousticModel,
    Calibration,
    Drive,
    FocusTracker,
    NoFocus,
    NumbaEngine,
    NumpyEngine,
    PointSource,
    Reconstructor,
    RectangularPiston,
    Resonator,
    SingleFocus,
    Transducer,
    TransducerArray,
    choose_engine,
    dequantise_phase,
    exposure_at,
    find_pressure_peak,
    fit_focus,
    focus_phases,
    force_on_disc_n,
    largest_secondary_lobe,
    mean_square_pressure,
    measure_spot,
    predict_focal_shift,
    pressure,
    propagators,
    quantise_phase,
    shock_lengths,
    solve_foci,
    superpose_foci,
    weights_for_foci,
    worst_exposure,
)
from haptogram.acoustics.model.calibration import HEADER
from haptogram.acoustics.reconstruct import reconstruction, tracking
from haptogram.acoustics.reconstruct.acquisition import FocusAcquisition
from haptogram.acoustics.solvers.several import METHODS
from haptogram.errors import ConfigurationError
from strategies_acoustics import Pose

pytestmark = pytest.mark.sampled(12)

LAG = Resonator.from_bandwidth()
FRAME_S = 1e-3


def bowl():
    """37 elements on a sphere of 150 mm, each facing its centre."""
    turns = np.concatenate([[0.0], *(np.arange(6 * n) / (6 * n) for n in (1, 2, 3))])
    rings = np.repeat([0, 1, 2, 3], [1, 6, 12, 18]) * 0.011 / 0.150
    x, y = 2.0 * math.pi * turns, rings
    inward = -np.stack([np.sin(y) * np.cos(x), np.sin(y) * np.sin(x), -np.cos(y)], axis=1)
    return TransducerArray.from_positions([0.0, 0.0, 0.150] - 0.150 * inward, inward)


def model_of(array, directivity=None):
    transducer = Transducer() if directivity is None else Transducer(directivity)
    return AcousticModel(array, AcousticModel.default(1, 1).medium, transducer)


MODELS = {
    "grid": model_of(TransducerArray.grid(8, 7)),
    "points": model_of(TransducerArray.grid(6, 6), PointSource()),
    "rectangles": model_of(TransducerArray.grid(5, 9), RectangularPiston(7e-3, 4e-3, (1, 0, 0))),
    "bowl": model_of(bowl()),
}
POSES = {
    "upright": Pose.about(2, 0.7, (0.30, -0.20, 0.10)),
    "tilted": Pose.about(0, 0.35, (-0.10, 0.05, 0.20)),
}
TARGET = np.array([0.011, -0.007, 0.105])
OTHER = np.array([-0.016, 0.012, 0.118])


def measured(array, seed=1, dead=(), gain=0.3, phase_rad=2.0, away_m=0.3e-3):
    rng = np.random.default_rng(seed)
    gains = rng.uniform(1.0 - gain, 1.0 + gain, array.count)
    gains[list(dead)] = 0.0
    phases = rng.uniform(-phase_rad, phase_rad, array.count)
    return Calibration(
        gains, phases, array.positions_m + rng.uniform(-away_m, away_m, (array.count, 3))
    )


@dataclasses.dataclass
class Case:
    """One array in one pose, calibrated and merely placed, and a drive that focuses."""

    real: AcousticModel
    placed: AcousticModel
    h: np.ndarray
    target: np.ndarray
    other: np.ndarray
    points: np.ndarray
    drives: np.ndarray

    @classmethod
    def of(cls, name, pose, **changes):
        nominal = POSES[pose].model(MODELS[name])
        found = measured(nominal.array, **changes)
        real = nominal.calibrated(found)
        array = nominal.array.measured(found.positions_m)
        placed = dataclasses.replace(nominal, array=array)
        target, other = POSES[pose].points([TARGET, OTHER])
        rng = np.random.default_rng(7)
        points = target + rng.uniform(-0.02, 0.02, (9, 3))
        levels = rng.uniform(0.7, 1.0, (2, nominal.array.count))
        drives = levels * np.exp(1j * focus_phases(real, [target, other]))
        return cls(real, placed, found.response, target, other, points, drives)


@pytest.fixture(scope="module", params=[(m, p) for m in MODELS for p in POSES], ids="-".join)
def case(request):
    return Case.of(*request.param)


def values(result):
    """Everything that a result holds, as one vector."""
    if dataclasses.is_dataclass(result):
        return values([getattr(result, f.name) for f in dataclasses.fields(result)])
    if isinstance(result, list | tuple):
        return np.concatenate([np.empty(0), *map(values, result)])
    if isinstance(result, str):
        return np.frombuffer(result.encode(), np.uint8).astype(complex)
    return np.atleast_1d(np.asarray(result, dtype=complex)).ravel()


# What follows takes a model and drives: f(real, w) must be f(placed, w h). (call, tolerance)
OF_A_DRIVE = {
    "pressure": (lambda m, w, c: pressure(m, w[0], c.points), 1e-12),
    "propagators": (lambda m, w, c: propagators(m, c.points) @ w[0], 1e-12),
    "NumpyEngine": (lambda m, w, c: NumpyEngine(m).pressure(w, c.points), 1e-12),
    "choose_engine": (lambda m, w, c: choose_engine(m).pressure(w, c.points), 1e-6),
    "mean_square_pressure": (
        lambda m, w, c: mean_square_pressure(choose_engine(m), w, c.points, FRAME_S, LAG),
        1e-5,
    ),
    "force_on_disc_n": (lambda m, w, c: force_on_disc_n(m, w[0], c.target), 1e-12),
    "exposure_at": (
        lambda m, w, c: exposure_at(NumpyEngine(m), w, c.points, FRAME_S, LAG),
        1e-12,
    ),
    "worst_exposure": (lambda m, w, _: worst_exposure(NumpyEngine(m), w, 0.5, FRAME_S, 500), 1e-9),
    "shock_lengths": (lambda m, w, c: shock_lengths(NumpyEngine(m), w[0], c.target), 1e-9),
    "find_pressure_peak": (
        lambda m, w, c: find_pressure_peak(NumpyEngine(m), w[0], c.target),
        1e-6,
    ),
    "measure_spot": (lambda m, w, c: measure_spot(NumpyEngine(m), w[0], c.target), 1e-9),
    "largest_secondary_lobe": (
        lambda m, w, c: largest_secondary_lobe(NumpyEngine(m), w[0], c.target, 0.35),
        1e-9,
    ),
    "predict_focal_shift": (
        lambda m, w, c: predict_focal_shift(m, c.target, np.abs(w[0])),
        1e-6,
    ),
}


@pytest.mark.parametrize("name", OF_A_DRIVE)
def test_a_drive_is_what_the_elements_make_of_it(case, name):
    call, tolerance = OF_A_DRIVE[name]
    found = values(call(case.real, case.drives, case))
    expected = values(call(case.placed, case.drives * case.h, case))
    equal = call(case.placed, case.drives, case)
    scale = np.nanmax(np.abs(expected))
    assert np.allclose(found, expected, rtol=0.0, atol=tolerance * scale, equal_nan=True)
    assert not np.allclose(
        values(equal), expected, rtol=0.0, atol=tolerance * scale, equal_nan=True
    )


@pytest.mark.parametrize("kind", [NumbaEngine])
@pytest.mark.parametrize("pose", POSES)
@pytest.mark.parametrize("name", ["grid", "points", "bowl"])
@pytest.mark.parametrize("away_m", [0.0, 0.3e-3], ids=["lattice", "scattered"])
def test_the_fast_engines_follow_near_and_far(kind, name, pose, away_m):
    """One drive, several, and the matrix; points of which some go the reference way."""
    c = Case.of(name, pose, away_m=away_m)
    near = c.placed.array.positions_m[:3] + 2e-3 * c.placed.array.normals[:3]
    points = np.concatenate([c.points, near, c.target[None] + np.array([0.0, 0.0, 20.0])])
    matrix = propagators(c.placed, points)
    limit = 2e-5 * np.abs(matrix) @ np.abs(c.h)
    engine, expected = kind(c.real), matrix @ (c.drives * c.h).T
    for number, drive in enumerate(c.drives):
        assert (np.abs(engine.pressure(drive, points) - expected[:, number]) <= limit).all()
    assert (np.abs(engine.pressure(c.drives, points).T - expected).max(axis=1) <= limit).all()
    assert (np.abs(engine.propagators(points) @ c.drives.T - expected).max(axis=1) <= limit).all()


# --- from targets to drives --------------------------------------------------------------------


def test_what_focuses_takes_the_phases_of_the_elements_off(case):
    lags = np.angle(case.h)
    targets = [case.target, case.other]
    exact = focus_phases(case.placed, targets)
    turn = focus_phases(case.real, targets) - (exact - lags)
    assert np.abs(turn - 2.0 * np.pi * np.rint(turn / (2.0 * np.pi))).max() <= 1e-9
    arguments = targets, [1.0, 0.5], [0.0, 0.8]
    assert superpose_foci(case.real, *arguments) == pytest.approx(
        superpose_foci(case.placed, *arguments) * np.exp(-1j * lags), abs=1e-9
    )


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("pose", POSES)
@pytest.mark.parametrize("name", MODELS)
def test_every_solver_takes_the_phases_of_the_elements_off(name, pose, method):
    """Exactly so where no gain differs; then all that a solver sees is turned with the drive.

    The descent of the gradient solver stops at a misfit, some digits before the phases agree.
    """
    c = Case.of(name, pose, gain=0.0)
    points = [c.target, c.other]
    found = solve_foci(c.real, points, [1.0, 0.6], method=method, rounds=20)
    expected = solve_foci(c.placed, points, [1.0, 0.6], method=method, rounds=20) * np.conj(c.h)
    assert found == pytest.approx(expected, abs=2e-2 if method == "gradient" else 1e-3)
    same = weights_for_foci(c.real, points, [1.0, 0.6], [0.0, 0.0], method=method)
    again = weights_for_foci(c.placed, points, [1.0, 0.6], [0.0, 0.0], method=method)
    heard = np.abs(pressure(c.real, same, points)) / [1.0, 0.6]
    meant = np.abs(pressure(c.placed, again, points)) / [1.0, 0.6]
    assert heard / heard.max() == pytest.approx(meant / meant.max(), abs=1e-2)


def test_a_solver_evens_out_the_foci_of_elements_of_unequal_gain(case):
    points = [case.target, case.other]
    knowing, guessing = (
        np.abs(pressure(case.placed, solve_foci(model, points, method="gradient") * case.h, points))
        for model in (case.real, case.placed)
    )
    assert knowing.min() >= 0.98 * knowing.max()
    assert knowing.min() >= 1.3 * guessing.min()


# --- from drives to the focus ------------------------------------------------------------------


@pytest.mark.sampled(4)
@pytest.mark.parametrize("dead", [(), (0, 3, 17)], ids=["all", "some dead"])
@pytest.mark.parametrize("pose", POSES)
@pytest.mark.parametrize("name", MODELS)
def test_a_focus_is_found_from_the_phases_that_are_radiated(name, pose, dead):
    """Reference, compiled search, search without a start; rounding is all that is left."""
    c = Case.of(name, pose, dead=dead)
    phases = dequantise_phase(quantise_phase(focus_phases(c.real, c.target), 8), 8)
    heard = np.abs(c.h) > 0.0
    start = c.target + np.array([1e-3, -1e-3, 1.5e-3])
    fit = fit_focus(c.real, phases, start, phase_bits=8)
    same = fit_focus(c.placed, phases + np.angle(c.h), start, phase_bits=8, active=heard)
    assert fit.position_m == pytest.approx(same.position_m, abs=1e-9)
    assert fit.bound_m == pytest.approx(same.bound_m, rel=1e-6)
    assert fit.residual_rms_rad == pytest.approx(same.residual_rms_rad, abs=1e-9)
    assert (np.abs(fit.position_m - c.target) <= fit.bound_m).all()
    tracker, codes = FocusTracker(c.real), quantise_phase(phases, 8)
    for fix in (tracker.fit(codes, tuple(start)), tracker.acquire(codes)):
        assert np.array(fix.position_m) == pytest.approx(fit.position_m, abs=5e-6)
        assert tracker.explains(fix)
    fits = FocusAcquisition(c.real, heard).fits(phases, heard, math.tau / 256, 12)
    found = min(fits, key=lambda one: one.residual_rms_rad)
    assert found.position_m == pytest.approx(fit.position_m, abs=1e-6)


@pytest.mark.sampled(4)
@pytest.mark.parametrize("silent", [(), (2,)], ids=["compiled search", "step by step"])
@pytest.mark.parametrize("dead", [(), (5,)], ids=["all", "one dead"])
def test_what_is_reconstructed_is_what_the_placed_elements_would_make(case, silent, dead):
    model = case.real.calibrated(
        dataclasses.replace(
            case.real.calibration, gain=np.where(np.isin(np.arange(len(case.h)), dead), 0.0, 1.1)
        )
    )
    weights = np.exp(1j * focus_phases(model, case.target))
    weights[list(silent)] = 0.0
    found = Reconstructor(model).reconstruct_weights(weights)
    expected = Reconstructor(case.placed).reconstruct_weights(weights * model.response)
    assert isinstance(found, SingleFocus)
    assert isinstance(expected, SingleFocus)
    assert found.position_m == pytest.approx(case.target, abs=2e-6)
    assert values(found) == pytest.approx(values(expected), rel=1e-3, abs=1e-6)


@pytest.mark.parametrize("name", MODELS)
def test_the_compiled_search_scores_places_by_what_is_radiated(name, monkeypatch):
    """A few of its 48 places are enough, as they are for equal elements."""
    monkeypatch.setattr(tracking, "_RIVALS", 6)
    c = Case.of(name, "upright", phase_rad=3.0)
    for model in (c.real, c.placed):
        tracker = FocusTracker(model)
        fix = tracker.acquire(quantise_phase(focus_phases(model, c.target), 8))
        assert tracker.explains(fix)
        assert np.array(fix.position_m) == pytest.approx(c.target, abs=2e-3)


@pytest.mark.parametrize("pose", POSES)
def test_elements_that_are_always_dead_do_not_slow_the_search_down(pose, monkeypatch):
    monkeypatch.setattr(reconstruction, "FocusAcquisition", None)
    c = Case.of("grid", pose, dead=[0, 9])
    for _ in range(2):
        found = Reconstructor(c.real).reconstruct_weights(c.drives[0])
        assert isinstance(found, SingleFocus)


def test_a_fit_of_fewer_than_four_elements_that_radiate_is_left_to_the_reference():
    nominal = AcousticModel.default(5, 1)
    real = nominal.calibrated(measured(nominal.array, dead=[1, 3], away_m=0.0))
    Reconstructor(real).reconstruct_weights(np.ones(5))
    with pytest.raises(ConfigurationError, match="3 elements, a fit needs at least 4"):
        FocusTracker(real)


def test_a_drive_of_dead_elements_alone_makes_no_focus():
    c = Case.of("grid", "upright", dead=[0, 1])
    drive = Drive(np.zeros(56, np.uint8), np.where(np.arange(56) < 2, 255, 0))
    assert Reconstructor(c.real).reconstruct(drive) == NoFocus("zero amplitude")
    with pytest.raises(ConfigurationError, match="0 of 56 elements are active"):
        fit_focus(c.real, np.zeros(56), c.target, phase_bits=8, active=np.arange(56) < 2)


def test_the_host_that_does_not_know_the_elements_misses():
    """The same drive on equal elements: what a judge without a calibration would believe."""
    c = Case.of("grid", "upright", phase_rad=0.4)
    drive = np.exp(1j * focus_phases(MODELS["grid"], TARGET))
    assert isinstance(Reconstructor(MODELS["grid"]).reconstruct_weights(drive), SingleFocus)
    nominal = np.exp(1j * focus_phases(POSES["upright"].model(MODELS["grid"]), c.target))
    assert not isinstance(Reconstructor(c.real).reconstruct_weights(nominal), SingleFocus)


GEOMETRY_ALONE = {
    "check_focus_target",
    "points_in_front",
}
OTHERWISE_ABOVE = {
    "FocusTracker", "NumbaEngine", "Reconstructor",
    "fit_focus", "focus_phases",
    "solve_foci", "superpose_foci", "weights_for_foci",
}  # fmt: skip


def test_nothing_that_takes_a_model_is_left_out():
    public = {name: getattr(package, name) for name in package.__all__}
    takes = {
        name
        for name, value in public.items()
        if (inspect.isfunction(value) or (inspect.isclass(value) and "__init__" in vars(value)))
        and {"model", "engine", "source"} & inspect.signature(value).parameters.keys()
    }
    assert takes == OF_A_DRIVE.keys() | GEOMETRY_ALONE | OTHERWISE_ABOVE


# --- the model ---------------------------------------------------------------------------------


def test_equal_elements_in_their_places_change_nothing(case):
    nominal = dataclasses.replace(case.placed)
    count = nominal.array.count
    same = nominal.calibrated(
        Calibration(np.ones(count), np.zeros(count), nominal.array.positions_m)
    )
    assert (propagators(same, case.points) == propagators(nominal, case.points)).all()
    assert (focus_phases(same, case.target) == focus_phases(nominal, case.target)).all()
    assert choose_engine(same).pressure(case.drives, case.points) == pytest.approx(
        choose_engine(nominal).pressure(case.drives, case.points), rel=1e-12
    )


def test_a_calibrated_model_keeps_what_the_array_is():
    nominal = MODELS["grid"]
    found = measured(nominal.array)
    real = nominal.calibrated(found)
    assert (real.array.grid_shape, real.array.pitch_m) == ((8, 7), 0.010)
    assert (real.array.normals == nominal.array.normals).all()
    assert (real.array.positions_m == found.positions_m).all()
    assert (real.medium, real.transducer) == (nominal.medium, nominal.transducer)
    assert nominal.response is None
    assert real.response == pytest.approx(found.gain * np.exp(1j * found.phase_rad))
    again = real.calibrated(found)
    assert (again.response == real.response).all()
    assert real.radiated(np.ones(56)) == pytest.approx(found.response)
    for array in (found.gain, found.phase_rad, found.positions_m, found.response):
        assert not array.flags.writeable
    hash(real)


def test_a_phase_above_0_is_a_delay():
    """Re(w h e^{-j w t}): what is heard of an element comes later by its phase."""
    nominal = AcousticModel.default(1, 1)
    late = nominal.calibrated(Calibration([0.5], [0.6], nominal.array.positions_m))
    ratio = pressure(late, [1.0], [TARGET]) / pressure(nominal, [1.0], [TARGET])
    assert ratio == pytest.approx([0.5 * np.exp(0.6j)], rel=1e-12)
    further = pressure(nominal, [1.0], [[0.0, 0.0, 0.101]]) / pressure(
        nominal, [1.0], [[0.0, 0.0, 0.100]]
    )
    assert np.angle(further[0]) == pytest.approx(nominal.wavenumber * 1e-3, rel=1e-6)


# --- the file ----------------------------------------------------------------------------------


def rows_of(array=MODELS["grid"].array, **changes):
    """Return the lines of a good file, header first, but for those in *changes* (l3=...)."""
    lines = [",".join(HEADER)]
    lines += [f"{n},1,0,{x},{y},{z}" for n, (x, y, z) in enumerate(1e3 * array.positions_m)]
    for name, text in changes.items():
        lines[int(name[1:])] = text
    return lines


def written(folder, lines):
    path = folder / "elements.csv"
    path.write_text("\n".join(lines), encoding="utf-8")
    return path


@pytest.mark.parametrize("name", MODELS)
def test_a_file_holds_what_was_written(tmp_path, name):
    found = measured(MODELS[name].array, dead=[1])
    found.to_file(tmp_path / "c.csv")
    same = Calibration.from_file(tmp_path / "c.csv")
    assert (same.gain == found.gain).all()
    assert (same.phase_rad == found.phase_rad).all()
    assert same.positions_m == pytest.approx(found.positions_m, abs=1e-15)
    assert (same.name, same.lines[0]) == (str(tmp_path / "c.csv"), 2)
    assert (Calibration.of(str(tmp_path / "c.csv")).gain == found.gain).all()
    assert Calibration.of(found) is found


def test_rows_come_in_any_order_between_comments_and_blank_lines(tmp_path):
    header, *rows = rows_of()
    rows[3] = "3, 0.8 ,-0.5,-35,5,1"
    lines = ["# measured in May", "", header, *reversed(rows), "  # the end", ""]
    found = Calibration.from_file(written(tmp_path, lines))
    assert found.count == 56
    assert (found.gain[3], found.phase_rad[3]) == (0.8, -0.5)
    assert found.positions_m[3] == pytest.approx([-0.035, 0.005, 0.001])
    assert found.lines[55] == 4


PLACE, PLACES_M = "1,0,-35,-30,0", MODELS["grid"].array.positions_m
BAD = {
    "empty": ([], "the file is empty, must begin with element,gain,phase_rad,x_mm,y_mm,z_mm"),
    "comments alone": (["# nothing"], "the file is empty"),
    "header alone": (rows_of()[:1], "0 elements, must be 1 to 1024"),
    "no header": (rows_of()[1:], ":1: the header is '0,1,0,.*', must be 'element,gain,phase_rad"),
    "degrees": (
        rows_of(l0="element,gain,phase_deg,x_mm,y_mm,z_mm"),
        ":1: the header is .*phase_deg.*must be .*phase_rad.*: phases are in radians",
    ),
    "metres": (
        rows_of(l0="element,gain,phase_rad,x_m,y_m,z_m"),
        ":1: the header is .*x_m,.*must be .*x_mm.*positions in mm",
    ),
    "missing inside": (rows_of()[:5] + rows_of()[6:], "element 4 is missing; each from 0 to 55"),
    "missing at the end": (
        rows_of()[:-1],
        r"elements.csv: element 55 is missing; the array has the elements 0 to 55",
    ),
    "twice": (rows_of(l9=f"2,{PLACE}"), ":10: element 2 is given twice, first in line 4"),
    "one too many": (
        [*rows_of(), f"56,{PLACE}"],
        ":58: element 56 is too many; the array has the elements 0 to 55",
    ),
    "far beyond": ([*rows_of(), f"1024,{PLACE}"], ":58: element is '1024', .* 0 to 1023"),
    "negative": (rows_of(l1=f"-1,{PLACE}"), ":2: element is '-1', must be a whole number"),
    "no number": (rows_of(l1=f"first,{PLACE}"), ":2: element is 'first', must be a whole number"),
    "part of one": (rows_of(l1=f"0.0,{PLACE}"), ":2: element is '0.0', must be a whole number"),
    "endless": (rows_of(l1=f"{'9' * 5000},{PLACE}"), ":2: element is '9{40}', must be"),
    "nan": (rows_of(l3="2,nan,0,0,0,0"), ":4: gain is nan, must be 0 to 10"),
    "nan phase": (rows_of(l3="2,1,nan,0,0,0"), ":4: phase_rad is nan, must be -6.283185307 to"),
    "inf": (rows_of(l3="2,1,0,0,inf,0"), r":4: y_mm is inf, must be -100000 to 100000"),
    "below 0": (rows_of(l3="2,-0.1,0,0,0,0"), ":4: gain is -0.1, must be 0 to 10"),
    "too loud": (rows_of(l3="2,10.1,0,0,0,0"), ":4: gain is 10.1, must be 0 to 10"),
    "degrees in radians": (rows_of(l3="2,1,120,0,0,0"), ":4: phase_rad is 120, must be -6.28"),
    "text": (rows_of(l3="2,loud,0,0,0,0"), ":4: gain is 'loud', must be a number"),
    "short": (rows_of(l3="2,1,0,0,0"), ":4: 5 values, must be 6"),
    "long": (rows_of(l3="2,1,0,0,0,0,7"), ":4: 7 values, must be 6"),
    "all dead": (
        [rows_of()[0], *(row.replace(",1,0,", ",0,0,", 1) for row in rows_of()[1:])],
        "the gain of all 56 elements is 0, must be above 0 for one",
    ),
    "elsewhere": (
        rows_of(l1="0,1,0,-35,-30,10.1"),
        r":2: element 0 is 10.1 mm from its place in the array, \(-35, -30, 0\) mm, must be",
    ),
    "metres as mm": (
        rows_of()[:1] + [f"{n},1,0,{x},{y},{z}" for n, (x, y, z) in enumerate(PLACES_M)],
        r":\d+: element \d+ is 46.05 mm from its place",
    ),
    "on each other": (
        rows_of(l1="0,1,0,-35,-25,0", l2="1,1,0,-35,-25.05,0"),
        "elements.csv: elements 0 and 1 are 0.05 mm apart, must be more than 0.1 mm",
    ),
}


@pytest.mark.parametrize("name", BAD)
def test_a_bad_file_is_refused_in_one_line_that_names_it(tmp_path, name):
    lines, message = BAD[name]
    path = written(tmp_path, lines)
    with pytest.raises(ConfigurationError, match=message) as caught:
        MODELS["grid"].calibrated(Calibration.from_file(path))
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


def test_what_cannot_be_read_or_written_is_named(tmp_path):
    binary = tmp_path / "binary"
    binary.write_bytes(bytes(range(256)))
    for path in (tmp_path, tmp_path / "absent", binary):
        with pytest.raises(ConfigurationError, match=r"calibration '.*' cannot be read: .") as one:
            Calibration.from_file(path)
        assert str(path) in str(one.value)
    with pytest.raises(ConfigurationError, match="cannot be written"):
        measured(MODELS["grid"].array).to_file(tmp_path)
    with pytest.raises(ConfigurationError, match="calibration is 5, must be a Calibration or the"):
        Calibration.of(5)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([1.0], [0.0, 0.0], np.zeros((1, 3))), r"phase_rad has shape \(2,\), must be \(1,\)"),
        (([1.0, 1.0], [0.0], np.zeros((1, 3))), r"gain has shape \(2,\), must be \(1,\)"),
        (([math.nan], [0.0], np.zeros((1, 3))), r"gain\[0\] is nan, must be finite"),
        (([11.0], [0.0], np.zeros((1, 3))), "calibration: gain is 11, must be 0 to 10"),
        (([1.0], [7.0], np.zeros((1, 3))), "calibration: phase_rad is 7, must be -6.28"),
        (([0.0], [0.0], np.zeros((1, 3))), "gain of all 1 elements is 0"),
        (([], [], np.zeros((0, 3))), "0 elements, must be 1 to 1024"),
        (([1.0], [0.0], np.zeros(3)), r"positions_m has shape \(3,\)"),
    ],
)
def test_a_calibration_that_cannot_be_is_refused(arguments, message):
    with pytest.raises(ConfigurationError, match=message):
        Calibration(*arguments)


def test_a_calibration_belongs_to_an_array_of_its_size():
    small, model = measured(TransducerArray.grid(2, 2)), MODELS["grid"]
    with pytest.raises(ConfigurationError, match="calibration: element 4 is missing; the array"):
        model.calibrated(small)
    with pytest.raises(ConfigurationError, match="calibration of 4, array of 56 elements"):
        dataclasses.replace(model, calibration=small)
