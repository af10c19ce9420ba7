"""Single precision against the reference, in every layout, and what happens without numba."""

import hashlib
import importlib.util
import logging
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptogram.acoustics import (
    AcousticModel,
    CircularPiston,
    Medium,
    NumpyEngine,
    PointSource,
    Transducer,
    TransducerArray,
    force_on_disc_n,
    points_in_front,
    propagators,
)
from haptogram.acoustics.field.engines import numba_engine
from haptogram.acoustics.field.engines.compiled import compiled_kernels
from haptogram.acoustics.field.engines.engine import NumbaEngine, choose_engine
from haptogram.acoustics.field.engines.polynomials import fit_gain_polynomial
from haptogram.acoustics.field.engines.stored import StoredKernels, read_stored, store_kernels
from haptogram.acoustics.reconstruct.tracking import FocusTracker
from haptogram.errors import ConfigurationError
from strategies_acoustics import Pose, grids, models, seeds

ROOT = Path(__file__).resolve().parents[4]
TOLERANCE = 2e-5  # of the sum of magnitudes: what the engines promise
ENGINES = [NumbaEngine]


def assert_agrees(engine, weights, points):
    matrix = propagators(engine.model, points)
    expected = np.atleast_2d(weights) @ matrix.T
    magnitudes = np.abs(np.atleast_2d(weights)) @ np.abs(matrix).T
    error = np.abs(np.atleast_2d(engine.pressure(weights, points)) - expected)
    assert (error <= TOLERANCE * magnitudes).all(), (error / magnitudes).max()


def some_points(rng, model, count=40):
    """Points in front of the array: near and far, in the axis and out of it."""
    half = model.array.half_extent_m.max() + 0.05
    lateral = rng.uniform(-half, half, (count, 2))
    height = np.exp(rng.uniform(np.log(0.002), np.log(1.2), count))
    return np.column_stack([lateral, height])


@pytest.mark.parametrize("kind", ENGINES)
@given(model=models(grids(1, 12)), seed=seeds, drives=st.integers(1, 3))
def test_grids_anywhere_agree_with_the_reference(kind, model, seed, drives):
    rng = np.random.default_rng(seed)
    pose = Pose.any(rng, reach_m=3.0)
    points = pose.points(some_points(rng, model))
    weights = rng.normal(size=(drives, model.array.count, 2)) @ [1, 1j]
    assert_agrees(kind(pose.model(model)), weights[0] if drives == 1 else weights, points)


@pytest.mark.parametrize("kind", ENGINES)
@given(seed=seeds, count=st.integers(1, 40), omni=st.booleans(), loss=st.sampled_from([0.0, 0.15]))
def test_elements_with_any_normals_agree_with_the_reference(kind, seed, count, omni, loss):
    rng = np.random.default_rng(seed)
    array = TransducerArray.from_positions(
        rng.uniform(-0.1, 0.1, (count, 3)) + 5.0, rng.normal(size=(count, 3))
    )
    directivity = PointSource() if omni else CircularPiston(rng.uniform(2e-3, 4.7e-3))
    model = AcousticModel(array, Medium(343.2, 1.2, loss), Transducer(directivity))
    points = 5.0 + rng.uniform(-0.4, 0.4, (30, 3))
    points = points[points_in_front(model, points)]
    drives = rng.normal(size=(2, count, 2)) @ [1, 1j]
    assert_agrees(kind(model), drives[0], points)
    assert_agrees(kind(model), drives, points)


@pytest.mark.parametrize("kind", ENGINES)
@given(seed=seeds, count=st.integers(64, 200), loss=st.sampled_from([0.0, 0.15]))
def test_many_elements_of_a_small_bowl_agree_with_the_reference(kind, seed, count, loss):
    """Near by and many: the loop that does without double precision for each pair."""
    rng = np.random.default_rng(seed)
    places = rng.uniform(-0.03, 0.03, (count, 3)) * [1.0, 1.0, 0.3]
    normals = [0.0, 0.0, 0.06] - places
    array = TransducerArray.from_positions(places + 5.0, normals)
    model = AcousticModel(array, Medium(343.2, 1.2, loss), Transducer(CircularPiston(2e-3)))
    points = 5.0 + rng.uniform([-0.04, -0.04, 0.02], [0.04, 0.04, 0.06], (300, 3))
    weights = np.exp(2j * np.pi * rng.random(count))
    assert_agrees(kind(model), weights, points)


@pytest.mark.parametrize("kind", ENGINES)
@given(seed=seeds, side=st.integers(2, 12), omni=st.booleans())
def test_elements_anywhere_in_a_plane_agree_with_the_reference(kind, seed, side, omni):
    rng = np.random.default_rng(seed)
    grid = TransducerArray.grid(side, side, pitch_m=0.01)
    off = rng.uniform(-0.004, 0.004, (side * side, 3)) * [1.0, 1.0, 0.0]
    directivity = PointSource() if omni else CircularPiston(4.5e-3)
    array = TransducerArray.from_positions(grid.positions_m + off)
    model = AcousticModel(array, Medium.air(), Transducer(directivity))
    pose = Pose.any(rng, reach_m=3.0)
    points = pose.points(some_points(rng, model, 300))
    weights = np.exp(2j * np.pi * rng.random(array.count))
    assert_agrees(kind(pose.model(model)), weights, points)


@given(
    seed=seeds,
    side=st.integers(1, 7),
    width=st.floats(0.05, 1.2),
    bent=st.booleans(),
    omni=st.booleans(),
)
def test_compiled_loops_serve_wide_arrays_and_far_points(seed, side, width, bent, omni):
    """Few elements, so that nothing averages out; and the reference is not asked."""
    rng = np.random.default_rng(seed)
    flat = TransducerArray.grid(side, side, pitch_m=width / side)
    normals = flat.normals + bent * rng.uniform(-0.3, 0.3, flat.normals.shape)
    array = TransducerArray.from_positions(flat.positions_m, normals)
    model = AcousticModel(
        array, Medium.air(), Transducer(PointSource() if omni else CircularPiston(4.5e-3))
    )
    points = np.column_stack([rng.uniform(-width, width, (40, 2)), rng.uniform(0.02, 0.9, 40)])
    points = points[points_in_front(model, points)]
    offsets = points[:, None] - array.positions_m
    points = points[np.linalg.norm(offsets, axis=2).max(axis=1) < 1.5]  # served by compiled loops
    weights = rng.normal(size=(side * side, 2)) @ [1, 1j]
    engine = NumbaEngine(model)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(numba_engine, "propagators", None)
        matrix, field = engine.propagators(points), engine.pressure(weights, points)
    exact = propagators(model, points)
    assert (np.abs(matrix - exact) <= 5e-6 * np.abs(exact)).all()
    assert (np.abs(field - exact @ weights) <= 5e-6 * (np.abs(exact) @ np.abs(weights))).all()


@pytest.mark.parametrize("kind", ENGINES)
@pytest.mark.parametrize("count", [64, 256])
def test_elements_at_one_distance_have_one_rounding_error_that_does_not_average_out(kind, count):
    angle = 2.0 * np.pi * np.arange(count) / count + 0.1
    ring = 0.043 * np.column_stack([np.cos(angle), np.sin(angle), 0.0 * angle])
    model = AcousticModel(TransducerArray.from_positions(ring), Medium.air(), Transducer())
    points = np.zeros((400, 3))
    points[:, 2] = np.linspace(0.1, 0.6, 400)
    assert_agrees(kind(model), np.ones(count), points)


@given(seed=seeds)
def test_a_point_in_the_plane_of_a_wide_turned_array_hears_all_of_it(seed):
    rng = np.random.default_rng(seed)
    places = np.column_stack([rng.uniform(-0.6, 0.6, (30, 2)), np.zeros(30)])
    flat = AcousticModel(TransducerArray.from_positions(places), Medium.air(), Transducer())
    angle = rng.uniform(0.0, 2.0 * np.pi, 30)
    near = places + 0.003 * np.column_stack([np.cos(angle), np.sin(angle), 0.0 * angle])
    pose = Pose.any(rng)
    assert_agrees(NumbaEngine(pose.model(flat)), np.eye(30), pose.points(near))


@pytest.mark.parametrize("kind", ENGINES)
def test_the_nearest_place_is_that_of_the_reference_at_any_frequency(kind):
    transducer = Transducer(PointSource(), frequency_hz=120e3)
    model = AcousticModel(TransducerArray.grid(4, 4), Medium.air(), transducer)
    with pytest.raises(ConfigurationError, match="from element 5"):
        kind(model).pressure(np.ones(16), [model.array.positions_m[5] + [0.0, 0.0, 0.9e-3]])


@pytest.mark.parametrize("kind", ENGINES)
def test_blocks_and_chunks_have_no_seam(kind):
    model = AcousticModel.default(5, 3)
    rng = np.random.default_rng(1)
    points = np.column_stack([rng.uniform(-0.1, 0.1, (40_000, 2)), np.full(40_000, 0.15)])
    weights = rng.normal(size=15) + 1j
    field = kind(model).pressure(weights, points)
    for part in (slice(0, 5), slice(505, 520), slice(32_760, 32_775), slice(39_990, None)):
        assert_agrees(kind(model), weights, points[part])
        assert kind(model).pressure(weights, points[part]) == pytest.approx(field[part], rel=1e-4)


@pytest.mark.parametrize("kind", ENGINES)
def test_propagators_are_those_of_the_reference(kind):
    model = AcousticModel.default(6, 4)
    points = some_points(np.random.default_rng(2), model, 300)
    expected = propagators(model, points)
    error = np.abs(kind(model).propagators(points) - expected)
    assert (error <= TOLERANCE * np.abs(expected)).all()


@pytest.mark.parametrize("kind", ENGINES)
def test_silent_and_missing_elements_of_a_lattice_add_nothing(kind):
    full = AcousticModel.default(6, 6)
    keep = np.delete(np.arange(36), [7, 20, 35])
    holes = AcousticModel(
        TransducerArray.from_positions(full.array.positions_m[keep]), full.medium, full.transducer
    )
    points = some_points(np.random.default_rng(3), full)
    weights = np.zeros(36, dtype=complex)
    weights[keep] = np.exp(1j * np.arange(33))
    assert_agrees(kind(holes), weights[keep], points)
    assert_agrees(kind(full), weights, points)


@pytest.mark.parametrize("kind", ENGINES)
def test_few_active_elements_of_many_are_served_as_well(kind):
    """The errors of one element do not average out."""
    model = AcousticModel.default(12, 12)
    rng = np.random.default_rng(5)
    points = np.column_stack([rng.uniform(-0.3, 0.3, (400, 2)), rng.uniform(0.1, 0.8, 400)])
    for active in (1, 3, 31, 144):
        weights = np.zeros(144, dtype=complex)
        weights[rng.choice(144, active, replace=False)] = np.exp(2j * np.pi * rng.random(active))
        assert_agrees(kind(model), weights, points)
        assert_agrees(kind(model), np.stack([weights, np.ones(144)]), points)


def test_read_only_and_strided_points_are_taken():
    engine = NumbaEngine(AcousticModel.default(4, 4))
    table = np.random.default_rng(4).uniform(0.05, 0.2, (20, 6))
    points = table[:, ::2]
    expected = engine.pressure(np.ones(16), points.copy())
    frozen = points.copy()
    frozen.flags.writeable = False
    assert (engine.pressure(np.ones(16), points) == expected).all()
    assert (engine.pressure(np.ones(16), frozen) == expected).all()
    assert engine.pressure(np.ones(16), np.empty((0, 3))).shape == (0,)


def test_an_engine_serves_whoever_takes_one():
    model = AcousticModel.default()
    weights = np.exp(-1j * model.wavenumber * np.linalg.norm(
        model.array.positions_m - [0.0, 0.0, 0.2], axis=1))  # fmt: skip
    reference = force_on_disc_n(model, weights, [0.0, 0.0, 0.2])
    engine = NumbaEngine(model)
    engine.warm_up()
    assert force_on_disc_n(engine, weights, [0.0, 0.0, 0.2]) == pytest.approx(reference, rel=1e-5)


class Cardioid:
    baffled = False

    def gain(self, cos_theta, wavenumber):  # noqa: ARG002  (Directivity)
        return 0.5 * (1.0 + cos_theta)


@pytest.mark.parametrize(
    ("model", "reason"),
    [
        (AcousticModel(TransducerArray.grid(2, 2), Medium.air(), Transducer(Cardioid())), "polyn"),
        (
            AcousticModel(
                TransducerArray.grid(2, 2), Medium.air(), Transducer(CircularPiston(0.009))
            ),
            "polynomial",
        ),
        (AcousticModel.default(2, 2, pitch_m=4.0), "from the array's centre"),
        (
            AcousticModel(TransducerArray.grid(9, 9), Medium(343.2, 1.2, 50.0), Transducer()),
            "absorption",
        ),
    ],
)
def test_a_model_beyond_single_precision_takes_the_reference(model, reason, caplog):
    with caplog.at_level(logging.INFO):
        assert isinstance(choose_engine(model), NumpyEngine)
    assert [reason in record.getMessage() for record in caplog.records] == [True]
    for kind in ENGINES:
        with pytest.raises(ConfigurationError, match=reason):
            kind(model)


@pytest.mark.parametrize("kind", ENGINES)
@pytest.mark.parametrize(
    ("weights", "points", "message"),
    [
        (np.ones(4), [[0.0, 0.0, np.nan]], "nan"),
        (np.ones(4), [[0.0, 0.0, np.inf]], "inf"),
        (np.ones(4), [[0.005, 0.005, 0.0005]], "0.5 mm from element 3"),
        (np.ones(3), [[0.0, 0.0, 0.1]], "must end in 4"),
        (np.full(4, np.nan), [[0.0, 0.0, 0.1]], "weights"),
        (np.ones(4), [0.0, 0.0, 0.1], "shape"),
    ],
)
def test_bad_input_is_refused(kind, weights, points, message):
    with pytest.raises(ConfigurationError, match=message):
        kind(AcousticModel.default(2, 2)).pressure(weights, points)


@pytest.mark.parametrize("kind", ENGINES)
def test_a_result_that_would_not_fit_is_refused_before_the_work(kind, monkeypatch):
    engine = kind(AcousticModel.default(2, 2))
    monkeypatch.setattr("os.sysconf", lambda _: 1 << 8)  # a machine of 64 kB
    with pytest.raises(ConfigurationError, match="half of the memory"):
        engine.pressure(np.ones((100, 4)), np.full((1000, 3), 0.1))
    with pytest.raises(ConfigurationError, match="half of the memory"):
        engine.propagators(np.full((2000, 3), 0.1))


def test_the_polynomials_of_the_kernels_are_the_fitted_ones():
    from haptogram.acoustics.field.engines import kernels as _kernels

    def sine(w):
        return np.pi * np.sinc(np.sqrt(w))

    def cosine(w):
        return np.cos(np.pi * np.sqrt(w))

    def arctangent(w):
        t = np.sqrt(np.maximum(w, 1e-300))
        return np.arctan(t) / (np.pi * t)

    for constants, function, end, limit in (
        (_kernels.SINE, sine, 0.25, 2.5e-6),
        (_kernels.COSINE, cosine, 0.25, 5e-8),
        (_kernels.ARCTANGENT, arctangent, 1.0, 6e-9),
    ):
        coefficients, error = fit_gain_polynomial(function, len(constants) - 1, 0.0, end)
        assert constants == pytest.approx(coefficients, rel=1e-6)
        assert error < limit


def run_python(code, **environment):
    done = subprocess.run(
        [sys.executable, "-c", code],
        env=os.environ | {"PYTHONPATH": f"{ROOT}:{ROOT / 'protocol'}"} | environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done


def test_without_numba_everything_works_and_one_line_says_so():
    code = """
import sys, logging
sys.modules["numba"] = None
logging.basicConfig(level=logging.INFO, format="%(message)s")
import numpy as np
from haptogram.acoustics import AcousticModel, pressure
from haptogram.acoustics.field.engines.engine import NumbaEngine, choose_engine
from haptogram.acoustics.solvers.several import solve_foci
from haptogram.acoustics.reconstruct.tracking import FocusTracker
from haptogram.errors import ConfigurationError
model = AcousticModel.default(8, 8)
points = np.array([[0.0, 0.01, 0.2], [0.02, 0.0, 0.15]])
exact = pressure(model, np.ones(64), points)
engine = choose_engine(model)
assert type(engine).__name__ == "NumpyEngine"
assert np.allclose(engine.pressure(np.ones(64), points), exact, rtol=1e-3)
levels = np.abs(pressure(model, solve_foci(model, points), points))
assert levels.min() > 0.99 * levels.max()
for needs_numba in (NumbaEngine, FocusTracker):
    try:
        needs_numba(model)
    except ConfigurationError as error:
        assert str(error) == "numba is not installed: pip install numba"
    else:
        raise SystemExit("numba was not missed")
"""
    lines = run_python(code).stderr.splitlines()
    assert set(lines) == {"field engine: numpy in double precision, since numba is not installed"}


def test_the_kernels_say_the_same_as_plain_python():
    """Uncompiled, the loops run as written; a compiler that broke them would differ."""
    code = """
import numpy as np
from haptogram.acoustics import AcousticModel, TransducerArray, focus_phases, quantise_phase
from haptogram.acoustics import propagators, superpose_foci
from haptogram.acoustics.field.engines.engine import NumbaEngine
from haptogram.acoustics.solvers.several import solve_foci, weighted_gerchberg_saxton
from haptogram.acoustics.reconstruct.tracking import FocusTracker
np.seterr(over="ignore")
flat = AcousticModel.default(3, 2).with_sound_speed(343.2)
free = AcousticModel(TransducerArray.from_positions(
    flat.array.positions_m, flat.array.normals + [[0.1 * n, 0, 0] for n in range(6)]),
    flat.medium, flat.transducer)
points = np.array([[0.01, 0.02, 0.1], [0.0, 0.0, 0.05], [0.001, 0.0, 0.003]])
for model in (flat, free):
    matrix = propagators(model, points)
    for drive in (np.exp(1j * np.arange(6)), np.ones((2, 6))):
        error = np.abs(NumbaEngine(model).pressure(drive, points) - drive @ matrix.T)
        assert (error <= 2e-5 * np.abs(matrix).sum(axis=1)).all(), error
    codes = quantise_phase(focus_phases(model, points), 8).astype(np.uint8)
    fix = FocusTracker(model).fit(codes[0], (0.011, 0.019, 0.098))
    assert np.linalg.norm(np.array(fix.position_m) - points[0]) < 2e-3, fix
matrix, ones = propagators(flat, points[:2]), np.ones(2)
start = superpose_foci(flat, points[:2], ones, np.zeros(2))
expected = weighted_gerchberg_saxton(matrix, ones, start, 5)
assert np.allclose(solve_foci(flat, points[:2], rounds=5), expected, atol=1e-4)
"""
    run_python(code, NUMBA_DISABLE_JIT="1")


def test_compiled_code_is_cached_even_where_no_usual_folder_can_be_written(tmp_path):
    code = """
import sys
import numba.core.caching as caching
caching.CacheImpl._locator_classes = [
    kind for kind in caching.CacheImpl._locator_classes
    if kind.__name__ == "UserProvidedCacheLocator"]
from haptogram.acoustics.field.engines.compiled import compiled_kernels, load_kernels
kernels = compiled_kernels()
assert load_kernels() is kernels
print(kernels.fit_phases_kernel.stats.cache_path)
"""
    environment = {"TMPDIR": str(tmp_path)}
    if "NUMBA_CACHE_DIR" in os.environ:
        environment["NUMBA_CACHE_DIR"] = ""
    path = Path(run_python(code, **environment).stdout.strip())
    assert tmp_path in path.parents
    assert path.parent.stat().st_mode & 0o077 == 0


def test_no_other_error_of_the_import_is_swallowed(monkeypatch):
    from haptogram.acoustics.field.engines import compiled as _compiled

    def broken(name):
        raise RuntimeError(f"{name} is broken")

    monkeypatch.delitem(sys.modules, "haptogram.acoustics.field.engines.kernels", raising=False)
    monkeypatch.setattr(_compiled, "import_module", broken)
    monkeypatch.setattr(_compiled, "_stored_kernels", lambda: None)
    with pytest.raises(RuntimeError, match="is broken"):
        _compiled.load_kernels()
    assert numba_engine.load_kernels is _compiled.load_kernels


# --- machine code that is stored


@pytest.fixture
def stored_file(tmp_path):
    """The code of the loops that fit one focus to phases and find it anywhere."""
    FocusTracker(AcousticModel.default(8, 8)).warm_up()
    path = tmp_path / "loops"
    store_kernels(compiled_kernels(), path)
    return path


def test_stored_loops_answer_as_those_of_numba(stored_file):
    model, compiled = AcousticModel.default(8, 8), compiled_kernels()
    stored = StoredKernels(read_stored(stored_file), compiled_kernels)
    assert stored.JUDGED_MEASURES == compiled.JUDGED_MEASURES
    tracker, codes = FocusTracker(model), np.arange(model.array.count, dtype=np.uint8) * 7
    order, places, lags, frame, most = tracker.kernel_arguments
    for start in ((0.0, 0.0, 0.1), (0.01, -0.02, 0.12)):
        given = (codes, order, places, lags, frame, start, 256, len(order), most)
        answers = [kernels.fit_phases_kernel(*given) for kernels in (stored, compiled)]
        assert answers[0] == answers[1]
        assert list(map(type, answers[0])) == list(map(type, answers[1]))


def test_other_types_than_the_stored_ones_go_to_numba(stored_file):
    stored = StoredKernels(read_stored(stored_file), compiled_kernels)
    score = np.array([1.0, 3.0, 2.0, 0.0], np.float32)
    cells, apart = np.zeros((3, 8)), np.zeros(8)
    whole = cells[:, :4].copy(), apart[:4].copy()
    assert stored.best_cell_kernel(score.copy(), *whole) == 1
    assert stored.best_cell_kernel(score.copy(), cells[:, ::2], apart[::2]) == 1
    assert stored.fit_phases_kernel is not None


def test_stored_loops_need_no_numba(stored_file):
    code = f"""
import sys
from pathlib import Path
import numpy as np
from haptogram.acoustics.field.engines.stored import StoredKernels, read_stored
kernels = StoredKernels(read_stored(Path({str(stored_file)!r})), lambda: 1 / 0)
score = np.array([1.0, 3.0, 2.0], np.float32)
assert kernels.best_cell_kernel(score, np.zeros((3, 3)), np.zeros(3)) == 1, score
assert list(score) == [-1.0, -1.0, -1.0]
assert "numba" not in sys.modules
"""
    run_python(code)


def test_compiled_and_stored_loops_have_the_same_bits(tmp_path):
    """And no loop has code in it that another one's would replace, where both are loaded."""
    code = """
import sys
from haptogram.acoustics import AcousticModel, NumbaEngine, force_on_disc_n, superpose_foci
model = AcousticModel.default(6, 6)
for x in (-0.01, 0.0, 0.02):
    target = (x, 0.005, 0.1)
    weights = superpose_foci(model, [target], [1.0], [0.0])
    print(force_on_disc_n(NumbaEngine(model), weights, target).hex())
print("numba" in sys.modules)
"""
    compiled, stored = (run_python(code, NUMBA_CACHE_DIR=str(tmp_path)).stdout for _ in range(2))
    assert compiled.split() == [*stored.split()[:-1], "True"]
    assert stored.split()[-1] == "False"
    (path,) = tmp_path.rglob("*.loops")
    loops = read_stored(path)["loops"]
    assert "disc_stress_kernel" in loops
    for machine_code, symbol, *_ in loops.values():
        functions = set(re.findall(rb"\0(_ZN[0-9]+haptogram\w+)", machine_code))
        assert functions <= {symbol.encode()}


def test_code_that_another_process_has_cached_is_stored_under_its_name(tmp_path):
    """Two programs that compile at once: numba keeps the code of the later one."""
    source = tmp_path / "loops.py"
    source.write_text(
        "from numba import njit\n__all__ = ['twice']\n"
        "@njit(cache=True)\ndef twice(x):\n    return 2.0 * x\n"
    )

    def compiled_anew():
        for file in source.parent.glob("__pycache__/*.nb?"):
            file.unlink()
        spec = importlib.util.spec_from_file_location("loops", source)
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        assert module.twice(1.0) == 2.0
        return module

    first, _ = compiled_anew(), compiled_anew()
    store_kernels(first, tmp_path / "kept")
    kept = read_stored(tmp_path / "kept")
    assert StoredKernels(kept, lambda: 1 / 0).twice(3.0) == 6.0
    code, symbol, *kinds = kept["loops"]["twice"]
    kept["loops"]["twice"] = (code, f"{symbol}_of_another_program", *kinds)
    assert StoredKernels(kept, lambda: first).twice(3.0) == 6.0  # by numba


def test_what_is_no_stored_code_is_left_alone(tmp_path):
    for content in (b"", b"not a pickle", bytes(40), hashlib.sha256(b"").digest()[:31]):
        (tmp_path / "loops").write_bytes(content)
        assert read_stored(tmp_path / "loops") is None
    assert read_stored(tmp_path / "none") is None
