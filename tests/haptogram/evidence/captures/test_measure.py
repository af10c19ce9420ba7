"""Drives, latches and findings of captured pins, against the back door of the same board."""

import dataclasses
import math

import numpy as np
import pytest

from haptogram.evidence.captures.files import read_capture
from haptogram.evidence.captures.findings import findings_of_capture
from pin_captures import MAP, captured_run, measured

ROUNDING_RAD = math.tau * 1e-9 * 40e3  # of a time to a nanosecond, twice a half


def resolution_rad(found):
    return math.tau / found.record.samples


def worst_phase(found, weights, elements=None):
    rows = found.weights[1 : 1 + len(weights)]
    error = np.angle(rows * np.conj(weights))
    error[np.abs(weights) == 0] = 0.0
    return float(np.abs(error if elements is None else error[:, elements]).max())


def without_latch_pin(run):
    return measured(read_capture(run.path), {k: v for k, v in MAP.items() if k != "latch"})


@pytest.mark.parametrize("array", ["1x1", "1x7", "5x3", "16x16"])
@pytest.mark.parametrize("rate_hz", [24e6, 7.3e6])
def test_the_phases_are_those_of_the_back_door(array, rate_hz, tmp_path):
    run = captured_run(tmp_path / "pins.vcd", array=array, capture_rate_hz=rate_hz)
    found = run.measured()
    assert len(found.latches) == len(run.latches) + 1  # and the silence
    assert found.record.sample_rate_hz == pytest.approx(rate_hz, rel=1e-5)
    assert worst_phase(found, run.radiated()) <= resolution_rad(found) + ROUNDING_RAD
    assert np.abs(np.abs(found.weights[1:-1]) - 1.0).max() < 2.0 * math.pi / found.record.samples
    assert found.is_silent(len(run.latches) + 1)
    assert findings_of_capture(found) == []


def test_latches_show_without_a_latch_pin_and_relative_to_an_element(tmp_path):
    run = captured_run(tmp_path / "pins.vcd")
    found = without_latch_pin(run)
    assert len(found.latches) == len(run.latches) + 1
    assert worst_phase(found, run.radiated()) <= resolution_rad(found) + ROUNDING_RAD
    weights = run.radiated()
    relative = run.measured(reference="e5")
    assert relative.record.reference_element == 5
    turned = weights * np.conj(weights[:, 5:6])
    assert worst_phase(relative, turned) <= resolution_rad(found) + ROUNDING_RAD


def test_amplitudes_become_duties_and_leave_the_phases_alone(tmp_path):
    run = captured_run(tmp_path / "pins.vcd", mode="drives")
    found, radiated = run.measured(), run.radiated()
    assert worst_phase(found, radiated) <= resolution_rad(found) + ROUNDING_RAD
    duties = found.duties[1:-1]
    assert (
        np.abs(duties - np.arcsin(np.abs(radiated)) / math.pi).max()
        <= 1.0 / found.record.samples + 1e-4
    )
    assert (
        np.abs(np.abs(found.weights[1:-1]) - np.abs(radiated)).max()
        < math.pi / found.record.samples
    )


@pytest.mark.parametrize("ppm", [-400.0, 37.0, 400.0])
def test_the_clock_of_the_analyser_moves_no_phase(ppm, tmp_path):
    run = captured_run(tmp_path / "pins.vcd", frames=40, capture_ppm=ppm)
    found = run.measured()
    assert found.record.drift_ppm == pytest.approx(-ppm, abs=5.0)
    assert worst_phase(found, run.radiated()) <= resolution_rad(found) + ROUNDING_RAD


FAULTS = {
    "device.dead transducer=3": "element 3 (e3): dead: low all the time",
    "device.stuck transducer=3 code=77": None,  # only who knows the frames sees it
    "device.delayed transducer=3 code=128": None,
    "device.garbage column=1": None,
}


@pytest.mark.parametrize(("fault", "finding"), FAULTS.items())
def test_a_fault_of_the_virtual_board_is_at_its_pins(fault, finding, tmp_path):
    run = captured_run(tmp_path / "pins.vcd", faults=[fault])
    found = run.measured()
    assert worst_phase(found, run.radiated()) <= resolution_rad(found) + ROUNDING_RAD
    assert findings_of_capture(found) == ([] if finding is None else [finding])
    healthy = np.array([frame.drive.weights() for frame in run.intended])
    assert worst_phase(found, healthy) > math.radians(1.0) or finding is not None


@pytest.mark.parametrize("late_us", [75.0, 150.0])
def test_a_latch_of_which_a_bank_comes_late_is_torn(late_us, tmp_path):
    late = tuple(f"{pin}={late_us}" for pin in range(8, 16))
    run = captured_run(tmp_path / "pins.vcd", capture_late=late, capture_lingers=late)
    for found in (run.measured(), without_latch_pin(run)):
        torn = [latch for latch in found.latches if latch.is_torn]
        assert len(torn) == len(found.latches) > len(run.latches) - 1
        assert all(latch.skew * 25.0 <= late_us + 0.1 for latch in torn)
        assert "8 of " in findings_of_capture(found)[0]
        assert worst_phase(found, run.radiated()) <= resolution_rad(found) + ROUNDING_RAD


def test_pins_that_fall_silent_together_do_so_within_a_period(tmp_path):
    run = captured_run(tmp_path / "pins.vcd")
    found = run.measured()
    mute = found.latches[-1]
    assert found.is_silent(len(found.latches))
    assert len(mute.places) == 16
    assert mute.skew <= 1.0
    assert not mute.is_torn


def flipped(run, name, **change):
    """Return the capture with another channel of this name."""
    capture = read_capture(run.path)
    channel = dataclasses.replace(capture.channels[name], **change)
    return dataclasses.replace(capture, channels={**capture.channels, name: channel})


def test_stuck_and_inverted_pins_are_found(tmp_path):
    run = captured_run(tmp_path / "pins.vcd")
    inverted = flipped(run, "e4", first_level=True)
    high = flipped(run, "e4", first_level=True, times=np.zeros(0, np.int64))
    for capture, word in ((inverted, "inverted polarity"), (high, "stuck high")):
        (finding,) = findings_of_capture(measured(capture, MAP))
        assert finding.startswith("element 4 (e4)")
        assert word in finding


def test_pins_that_are_active_low_are_read_as_such(tmp_path):
    run = captured_run(tmp_path / "pins.vcd")
    capture = read_capture(run.path)
    levels = {
        name: dataclasses.replace(channel, first_level=name.startswith("e"))
        for name, channel in capture.channels.items()
    }
    low = dataclasses.replace(capture, channels=levels)
    again = measured(low, {**MAP, "active_low": True})
    assert worst_phase(again, run.radiated()) <= resolution_rad(again) + ROUNDING_RAD
    assert findings_of_capture(again) == []
