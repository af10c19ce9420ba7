import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptogram.acoustics import (
    AcousticModel,
    Drive,
    focus_phases,
    saturated_weights,
    superpose_foci,
)
from haptogram.acoustics.solvers.several import METHODS, solve_foci
from haptogram.driver.driver import Driver
from haptogram.driver.frames.builder import FrameBuilder, frame_sound_speed_mm_s
from haptogram.driver.frames.targets import as_frame_foci
from haptogram.errors import ConfigurationError
from haptogram.records.frame import Focus
from virtual_ports import BoardPort

MODEL = AcousticModel.default(5, 4)
POSITION = st.tuples(st.floats(-0.1, 0.1), st.floats(-0.1, 0.1), st.floats(0.05, 0.3))
FOCUS = st.builds(Focus, POSITION, st.floats(0.0, 1.0), st.floats(-20.0, 20.0))


@pytest.fixture(scope="module")
def identity():
    with Driver(BoardPort(model=MODEL)) as driver:
        return driver.identity


@given(st.lists(POSITION, min_size=1, max_size=5))
def test_phases_are_the_conjugate_ones_rounded_to_the_wire(identity, positions):
    frames = FrameBuilder(MODEL, identity).build(as_frame_foci(positions), "phases")
    for frame, position in zip(frames, positions, strict=True):
        turns = focus_phases(MODEL, position) / math.tau
        codes = np.floor(turns * 256 + 0.5).astype(int) % 256
        assert list(frame.message.data) == codes.tolist()
        assert frame.drive.phase_codes.tolist() == codes.tolist()
        assert set(frame.drive.amplitude_codes) == {255}
        assert not frame.board_computed


@given(st.lists(FOCUS, min_size=1, max_size=4))
def test_points_expect_what_the_rounded_foci_give(identity, foci):
    (frame,) = FrameBuilder(MODEL, identity).build([tuple(foci)], "points")
    for focus, rounded, point in zip(foci, frame.foci, frame.message.points, strict=True):
        assert np.abs(np.subtract(focus.position_m, rounded.position_m)).max() <= 0.5001e-6
        assert abs(focus.amplitude - rounded.amplitude) <= 0.5001 / 65535
        turn = (focus.phase_rad - rounded.phase_rad) / math.tau
        assert abs(turn - round(turn)) <= 0.5001 / 65536
        assert rounded.position_m == (point.x_um / 1e6, point.y_um / 1e6, point.z_um / 1e6)
    weights = superpose_foci(
        MODEL.with_sound_speed(frame.sound_speed_mm_s / 1000),
        [f.position_m for f in frame.foci],
        [f.amplitude for f in frame.foci],
        [f.phase_rad for f in frame.foci],
    )
    assert frame.drive == Drive.from_weights(saturated_weights(weights))
    assert frame.board_computed


@given(st.lists(FOCUS, min_size=1, max_size=4))
def test_drives_carry_phases_then_amplitudes(identity, foci):
    (frame,) = FrameBuilder(MODEL, identity).build([tuple(foci)], "drives")
    codes = np.frombuffer(frame.message.data, dtype=np.uint8)
    assert codes[:20].tolist() == frame.drive.phase_codes.tolist()
    assert codes[20:].tolist() == frame.drive.amplitude_codes.tolist()


@given(st.lists(FOCUS, min_size=2, max_size=3), POSITION)
def test_phases_of_several_foci_are_those_of_their_sum(identity, foci, position):
    frames = FrameBuilder(MODEL, identity).build(
        [tuple(foci), *as_frame_foci([position])], "phases"
    )
    weights = superpose_foci(
        MODEL,
        [f.position_m for f in foci],
        [f.amplitude for f in foci],
        [f.phase_rad for f in foci],
    )
    ideal = Drive.from_weights(weights / max(1e-30, np.abs(weights).max()))
    audible = np.abs(weights) > 1e-9
    same = frames[0].drive.phase_codes == ideal.phase_codes
    assert same[audible].all()
    assert set(frames[0].drive.amplitude_codes) == {255}


@pytest.mark.parametrize("mode", ["phases", "drives", "points"])
def test_the_payload_is_as_long_as_announced(identity, mode):
    frames = FrameBuilder(MODEL, identity).build(as_frame_foci([(0, 0, 0.1)]), mode)
    assert frames[0].payload_bytes == len(frames[0].message.serialize())


def test_a_common_phase_turns_every_element(identity):
    builder = FrameBuilder(MODEL, identity)
    plain, turned = builder.build(
        [(Focus((0.0, 0.01, 0.1)),), (Focus((0.0, 0.01, 0.1), 1.0, math.pi / 2),)], "phases"
    )
    assert set(turned.drive.phase_codes - plain.drive.phase_codes) == {64}


@pytest.mark.parametrize(
    "targets",
    [
        np.zeros((2, 3)) + 0.1,
        [(0.1, 0.1, 0.1)] * 2,
        [Focus((0.1, 0.1, 0.1))] * 2,
        [[Focus((0.1, 0.1, 0.1))]] * 2,
    ],
)
def test_targets_come_in_several_forms(targets):
    assert as_frame_foci(targets) == [(Focus((0.1, 0.1, 0.1)),)] * 2


@pytest.mark.parametrize("targets", [[], np.zeros((0, 3)), 3, (0, 0, 0.1), [[]], None, "abc"])
def test_what_are_no_targets(targets):
    with pytest.raises(ConfigurationError):
        as_frame_foci(targets)


@given(st.integers(300_000, 380_000))
def test_the_speed_of_sound_survives_the_wire(speed_mm_s):
    assert frame_sound_speed_mm_s(MODEL.with_sound_speed(speed_mm_s / 1000)) == speed_mm_s


# --- Several foci by a solver --------------------------------------------------------------------

PAIR = (Focus((0.02, 0.0, 0.1), 0.8), Focus((-0.02, 0.01, 0.12), 0.4))


@pytest.mark.parametrize("solver", METHODS)
@pytest.mark.parametrize("mode", ["phases", "drives"])
def test_several_foci_get_the_drive_of_the_solver(identity, solver, mode):
    (frame,) = FrameBuilder(MODEL, identity).build([PAIR], mode, solver)
    positions, levels = [f.position_m for f in PAIR], [f.amplitude for f in PAIR]
    wanted = (
        superpose_foci(MODEL, positions, levels, [0.0, 0.0])
        if solver == "naive"
        else solve_foci(MODEL, positions, levels, method=solver)
    )
    if mode == "phases":
        wanted = np.exp(1j * np.angle(wanted))
    assert frame.drive == Drive.from_weights(saturated_weights(wanted))
    assert frame.solver == solver


def test_one_focus_needs_no_solver(identity):
    builder = FrameBuilder(MODEL, identity)
    (alone,) = builder.build([PAIR[:1]], "drives", "wgs")
    (plain,) = builder.build([PAIR[:1]], "drives")
    assert alone.drive == plain.drive


@pytest.mark.parametrize(
    ("foci", "mode", "solver", "text"),
    [
        (PAIR, "phases", "best", "solver is 'best'; known are naive, ibp"),
        (PAIR, "points", "wgs", "in the mode points the board computes"),
        ((PAIR[0], Focus(PAIR[1].position_m, 0.5, 1.0)), "phases", "gs", "frame 0: a focus with"),
        ((PAIR[0], Focus(PAIR[1].position_m, 0.0)), "phases", "gs", "must be 1e-06 to"),
    ],
)
def test_what_a_solver_cannot_do_is_refused(identity, foci, mode, solver, text):
    with pytest.raises(ConfigurationError, match=text):
        FrameBuilder(MODEL, identity).build([foci], mode, solver)
