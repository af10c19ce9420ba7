"""One drive judged from Python: the verdict that a run gives the frame."""

import dataclasses
import math

import numpy as np
import pytest

from haptogram import judge
from haptogram.acoustics import (
    AcousticModel,
    CircularPiston,
    Drive,
    Transducer,
    focus_phases,
    pressure,
    superpose_foci,
)
from haptogram.acoustics.solvers.several import frame_weights
from haptogram.errors import ConfigurationError
from haptogram.records.frame import Focus, FrameKey
from haptogram.verification import (
    FrameJudge,
    RunConsequences,
    RunVerdict,
    Tolerance,
    Uncertainty,
    Verdict,
)
from haptogram.verification.frame.verdict import FrameStatus
from latched_drives import drive_of, intend, registers, seen

MODEL = AcousticModel.default(10, 12)
TARGET = (0.013, -0.021, 0.11)
PHASES = focus_phases(MODEL, TARGET)
PAIR = (Focus((-0.02, 0.0, 0.1), 0.5), Focus((0.02, 0.01, 0.12), 0.4, 1.0))
WEIGHTS = np.exp(1j * PHASES)
TAPER = np.linspace(0.2, 1.0, MODEL.array.count)

DRIVES = {
    "right": registers(PHASES),
    "five bits": Drive.from_weights(WEIGHTS, 5),
    "1 mm short": registers(focus_phases(MODEL, (0.013, -0.021, 0.109))),
    "sign": registers(-PHASES),
    "one inverted": registers(PHASES + np.pi * (np.arange(MODEL.array.count) == 7)),
    "other air": registers(focus_phases(MODEL.with_sound_speed(340.0), TARGET)),
    "one dead": drive_of(registers(PHASES).phase_codes, 255 * (np.arange(120) != 5)),
    "silent": drive_of(registers(PHASES).phase_codes, 0),
}


def without_board(frame):
    return dataclasses.replace(
        frame, key=FrameKey(0, 0, 0, 0), evidence=None, t_apply_us=None, t_latch_us=None
    )


@pytest.mark.sampled(4)
@pytest.mark.parametrize("tolerance", [None, Tolerance(miss_mm=0.6, temperature_c=2.0)])
@pytest.mark.parametrize("name", DRIVES)
def test_a_drive_has_the_verdict_of_its_frame(name, tolerance):
    drive, known = DRIVES[name], Uncertainty(temperature_c=1.0)
    bits = drive.phase_bits
    wanted = Drive.from_weights(WEIGHTS, bits)
    judged = FrameJudge(MODEL, carrier_us=25, tolerance=tolerance, uncertainty=known)
    found = judge(MODEL, TARGET, drive, tolerance=tolerance, uncertainty=known)
    # Within a tolerance it is the host's own drive; a board that sent another one has a fault.
    intended = intend(MODEL, TARGET, bits, drive=drive if found.passed else wanted)
    assert without_board(judged.judge(intended, seen(intended, drive))) == found
    assert bool(found) == found.passed == (str(found.status) == "on target")


def of_host(model, foci, solver, away_m, faster):
    """The drive of a host that has the foci elsewhere, in other air."""
    host = model.with_sound_speed(model.medium.sound_speed_m_s * (1.0 + faster))
    other = [Focus.at(np.add(f.position_m, away_m), f.amplitude, f.phase_rad) for f in foci]
    return frame_weights(host, other, solver)


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("foci", "solver"), [((Focus(TARGET),), "naive"), (PAIR, "naive"), (PAIR, "wgs")]
)
@pytest.mark.parametrize(("share", "passes"), [(0.97, True), (2.0, False)])
def test_a_drive_passes_up_to_the_tolerance(foci, solver, share, passes):
    """The drive of a place and air within it, all of both at once; nobody sent another one."""
    model = AcousticModel.default(12, 12)
    away_m = 0.5e-3 * share * np.array([0.6, -0.64, 0.48])
    drive = of_host(model, foci, solver, away_m, share * 0.0017)
    tolerance = Tolerance(miss_mm=0.5, temperature_c=1.0)
    found = judge(model, foci, drive, solver=solver, tolerance=tolerance)
    assert found.passed == passes
    assert found.status is not FrameStatus.NOT_VERIFIED


@pytest.mark.parametrize("known", [None, Uncertainty(phase_rad=0.1), Uncertainty(position_mm=0.1)])
@pytest.mark.parametrize("level", [0.0, 0.5, np.repeat([0.0, 1.0], 60), np.arange(120) != 7])
def test_no_tolerance_lets_silence_or_a_lower_level_pass(level, known):
    """A place and air within it change phases, and amplitudes only as far as these."""
    weights, tolerance = frame_weights(MODEL, PAIR, "naive"), Tolerance(miss_mm=0.5)
    assert judge(MODEL, PAIR, weights, tolerance=tolerance, uncertainty=known)
    assert not judge(MODEL, PAIR, level * weights, tolerance=tolerance, uncertainty=known)


@pytest.mark.parametrize(
    ("foci", "drive", "is_silence"),
    [(Focus(TARGET, 0.0), 0.0 * WEIGHTS, True), (PAIR, np.exp(2.0j * PHASES**2), False)],
)
def test_of_a_drive_of_no_foci_no_miss_shows_and_it_is_no_silence(foci, drive, is_silence):
    found = judge(MODEL, foci, drive, solver="wgs", tolerance=Tolerance(miss_mm=0.5))
    assert (found.is_silence, found.smallest_miss_mm) == (is_silence, None)
    right = judge(MODEL, TARGET, WEIGHTS)
    run = RunVerdict(Verdict.PASS, (), [right, found], [], 0.5)
    assert run.smallest_miss_mm == (right.smallest_miss_mm if is_silence else None)


def test_another_drive_whose_foci_do_not_show_is_wrong():
    """The focus is not known to be in its place: the drive is not just a damaged one."""
    drive = Drive.from_weights(np.exp(2.0j * PHASES**2))
    wanted = Drive.from_weights(frame_weights(MODEL, PAIR, "wgs"))
    frame = intend(MODEL, TARGET, drive=wanted, foci=PAIR, solver="wgs")
    found = FrameJudge(MODEL, carrier_us=25, tolerance=Tolerance(miss_mm=0.5)).judge(
        frame, seen(frame, drive)
    )
    assert found.criteria == {"S5": True}
    assert found.status is FrameStatus.WRONG_DRIVE
    assert RunConsequences.of([found, dataclasses.replace(found, t_apply_us=1000)]).away_ms > 0.0


def test_a_tolerance_of_nothing_is_none():
    weights = frame_weights(MODEL, PAIR, "naive")
    full = weights / np.abs(weights)  # as a board without amplitudes has it
    assert judge(MODEL, PAIR, full, tolerance=Tolerance()) == judge(MODEL, PAIR, full)


@pytest.mark.parametrize(("sign", "status"), [(1, "NOT_VERIFIED"), (-1, "WRONG_DRIVE")])
def test_a_tolerated_host_whose_foci_do_not_show_is_not_called_wrong(sign, status):
    """Foci a metre away share one peak; amplitudes of the host are others than of the targets."""
    model = AcousticModel.default()
    foci = tuple(map(Focus.at, [(0.188, 0.073, 0.978), (0.205, 0.095, 0.973)]))
    phases = np.angle(drive := of_host(model, foci, "naive", (-1e-4, -1e-4, 2e-4), 0.0))
    found = judge(
        model, foci, np.abs(drive) * np.exp(1j * sign * phases), tolerance=Tolerance(miss_mm=0.5)
    )
    assert found.status is FrameStatus[status]


@pytest.mark.parametrize("tolerance", [None, Tolerance(miss_mm=0.5), Tolerance(temperature_c=1.0)])
@pytest.mark.parametrize("solver", ["naive", "ibp"])
def test_phases_alone_are_a_drive_for_foci_that_ask_for_none_else(solver, tolerance):
    """Other amplitudes fail with a tolerance as without one, unless they are said to be meant."""
    weights = frame_weights(MODEL, PAIR, solver)
    full = weights / np.abs(weights)
    found = judge(MODEL, PAIR, full, solver=solver, tolerance=tolerance)
    assert (found.status, found.criteria["S5"]) == (FrameStatus.WRONG_DRIVE, False)
    meant = np.ones(len(full))
    assert judge(MODEL, PAIR, full, solver=solver, tolerance=tolerance, amplitudes=meant)


@pytest.mark.parametrize("count", [15, pytest.param(60, marks=pytest.mark.nightly)])
def test_a_tolerated_host_is_found_where_a_miss_hardly_shows(count):
    """A row tells nothing of one direction: the nearest host may be anywhere along it."""
    model, random = AcousticModel.default(1, 8, pitch_m=0.00747), np.random.default_rng(3)
    for _ in range(count):
        foci = (Focus.at(random.uniform((0.003, 0.0, 0.022), (0.01, 0.03, 0.05))),)
        away_m = random.normal(size=3)
        away_m *= 1.8e-3 * random.uniform(0.6, 0.99) / np.linalg.norm(away_m)
        drive = of_host(model, foci, "naive", away_m, 0.0)
        found = judge(model, foci, drive, tolerance=Tolerance(miss_mm=1.8))
        assert found.status is FrameStatus.NOT_VERIFIED, (foci, away_m)


@pytest.mark.sampled(4)
@pytest.mark.parametrize("bits", range(3, 17))
def test_every_resolution_is_judged_by_its_own_step(bits):
    """Codes are rounded here; the same fault is named whatever its size in radians."""
    steps = 2**bits
    codes = np.array([round(phase / math.tau * steps) % steps for phase in PHASES])
    drive = Drive(codes, np.full(120, 255), bits)
    found = judge(MODEL, TARGET, drive)
    assert found.passed
    assert found.phase_error_rad <= math.pi / steps
    codes[7] = (codes[7] + 2) % steps
    wrong = judge(MODEL, TARGET, Drive(codes, np.full(120, 255), bits))
    assert (wrong.passed, wrong.faults) == (False, ("element 7 (0, 7) off by +2 LSB",))
    if bits > 5:  # the error is in proportion to the step
        of_eight = judge(MODEL, TARGET, DRIVES["right"]).smallest_miss_mm
        assert found.smallest_miss_mm == pytest.approx(of_eight * 256 / steps, rel=0.05)


@pytest.mark.parametrize(
    ("target", "weights", "changes"),
    [
        (Focus(TARGET), WEIGHTS, {}),
        ([TARGET], WEIGHTS, {"phase_bits": 3}),
        (Focus(TARGET, amplitude=0.5), 0.5 * WEIGHTS, {}),
        (TARGET, TAPER * WEIGHTS, {"amplitudes": TAPER}),
        (
            PAIR,
            superpose_foci(
                MODEL,
                *zip(*((f.position_m, f.amplitude, f.phase_rad) for f in PAIR), strict=True),
            ),
            {},
        ),
    ],
)
def test_a_right_drive_passes_and_its_mirror_fails(target, weights, changes):
    assert judge(MODEL, target, weights, **changes)
    assert not judge(MODEL, target, weights.reshape(10, 12)[::-1].ravel(), **changes)


@pytest.mark.parametrize("radius_m", [0.0055, 0.007, 0.009])
@pytest.mark.parametrize("bits", [5, 8, 12])
def test_a_right_drive_passes_where_wide_pistons_have_their_side_lobes(radius_m, bits):
    """Their sound comes there with opposite sign: in step it is not, nor can it be."""
    flat = AcousticModel.default(8, 8)
    model = dataclasses.replace(flat, transducer=Transducer(CircularPiston(radius_m)))
    for target in ((0.06, 0.05, 0.05), (-0.1, 0.02, 0.06), (0.0, 0.0, 0.03), (0.02, 0.0, 0.12)):
        drive = np.exp(1j * focus_phases(model, target))
        verdict = judge(model, target, drive, phase_bits=bits)
        assert verdict.passed
        found = abs(complex(pressure(model, drive, [target])[0])) / math.sqrt(2.0)
        assert verdict.intended_pressure_rms_pa == pytest.approx(found, rel=1e-9)
        inverted = drive * np.where(np.arange(64) == 27, -1.0, 1.0)
        assert not judge(model, target, inverted, phase_bits=bits).passed


@pytest.mark.parametrize("code", [0, 31, 127, 128, 254])
def test_an_amplitude_between_two_codes_passes(code):
    """Half of full amplitude is one: what it rounds to does not hang on the phase."""
    levels = np.full(MODEL.array.count, (code + 0.5) / 255.0)
    for turn in np.linspace(0.0, 6.0, 5):
        verdict = judge(MODEL, TARGET, levels * np.exp(1j * (PHASES + turn)), amplitudes=levels)
        assert verdict.passed


@pytest.mark.parametrize(
    ("target", "drive", "changes", "message"),
    [
        ((0, 0, 2), WEIGHTS, {}, "distance is 2000 mm"),
        ((1, 2), WEIGHTS, {}, "three finite numbers"),
        (np.empty((0, 3)), WEIGHTS, {}, "0 foci"),
        ("abc", WEIGHTS, {}, "not an array of numbers"),
        ([Focus(TARGET), "abc"], WEIGHTS, {}, "three finite numbers"),
        (TARGET, PHASES, {}, r"np\.exp\(1j \* phases\)"),
        (TARGET, WEIGHTS[1:], {}, "drive of 119, array of 120 elements"),
        (TARGET, 2 * WEIGHTS, {}, "must be 1 at most"),
        (TARGET, WEIGHTS, {"amplitudes": [1.0]}, "amplitudes has shape"),
        (TARGET, WEIGHTS, {"amplitudes": TAPER - 0.5}, "amplitudes is -0.3, must be 0 to 1"),
        (TARGET, WEIGHTS, {"solver": "best"}, "solver"),
        (TARGET, WEIGHTS, {"tolerance": 0.5}, "tolerance is 0.5, must be a Tolerance"),
        (TARGET, WEIGHTS, {"uncertainty": 3}, "uncertainty is 3, must be an Uncertainty"),
        (TARGET, WEIGHTS, {"tolerance": Tolerance(miss_mm=10.0)}, "half of that at most"),
    ],
)
def test_what_cannot_be_judged_is_refused(target, drive, changes, message):
    with pytest.raises(ConfigurationError, match=message):
        judge(MODEL, target, drive, **changes)
