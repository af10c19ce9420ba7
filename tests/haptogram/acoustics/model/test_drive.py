"""Codes, weights and their rounding."""

import math
import zlib
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptogram.acoustics import (
    Drive,
    dequantise_phase,
    phase_step_rad,
    quantise_phase,
    saturated_weights,
)
from haptogram.errors import ConfigurationError
from strategies_acoustics import drives, phase_bits, seeds, weights_of


@given(drives())
def test_weights_go_round_to_the_same_drive(drive):
    back = Drive.from_weights(drive.weights(), drive.phase_bits)
    assert (back.amplitude_codes == drive.amplitude_codes).all()
    sounding = drive.amplitude_codes > 0
    assert (back.phase_codes[sounding] == drive.phase_codes[sounding]).all()
    assert (back.phase_codes[~sounding] == 0).all()


@given(drives())
def test_equal_drives_compare_hash_and_digest_equal(drive):
    twin = Drive(drive.phase_codes.astype(np.int64), list_of(drive), drive.phase_bits)
    assert twin == drive
    assert hash(twin) == hash(drive)
    size = 1 if drive.phase_bits <= 8 else 2
    phases = b"".join(int(code).to_bytes(size, "little") for code in drive.phase_codes)
    assert twin.digest() == zlib.crc32(phases + bytes(drive.amplitude_codes))
    assert Drive.from_bytes(phases, bytes(drive.amplitude_codes), drive.phase_bits) == drive


@given(drives(), phase_bits)
def test_codes_of_another_resolution_are_the_nearest(drive, bits):
    steps, other = 2**bits, drive.in_bits(bits)
    for code, found in zip(drive.phase_codes, other.phase_codes, strict=True):
        miss = (int(found) - int(code) * Fraction(steps, 2**drive.phase_bits)) % steps
        assert min(miss, steps - miss) <= Fraction(1, 2)
    assert (other.amplitude_codes == drive.amplitude_codes).all()
    assert other.phase_bits == bits


def list_of(drive):
    return np.array([int(code) for code in drive.amplitude_codes])


@given(drives(count=5), st.integers(0, 4), st.integers(1, 255))
def test_a_changed_amplitude_is_another_drive(drive, element, change):
    codes = drive.amplitude_codes.astype(np.int64)
    codes[element] = (codes[element] + change) % 256
    other = Drive(drive.phase_codes, codes, drive.phase_bits)
    assert other != drive
    assert other.digest() != drive.digest()
    assert drive != "a drive"


@given(drives(count=5), phase_bits)
def test_the_same_codes_of_another_resolution_are_another_drive(drive, bits):
    codes = drive.phase_codes & (1 << min(bits, drive.phase_bits)) - 1
    one, other = (Drive(codes, drive.amplitude_codes, size) for size in (bits, drive.phase_bits))
    assert (one == other) == (bits == drive.phase_bits)


@given(phase_bits, seeds)
def test_a_phase_is_rounded_by_at_most_half_a_step(bits, seed):
    phases = np.random.default_rng(seed).uniform(-300.0, 300.0, 64)
    error = dequantise_phase(quantise_phase(phases, bits), bits) - phases
    wrapped = np.angle(np.exp(1j * error))
    assert np.abs(wrapped).max() <= math.pi / 2**bits + 1e-12


@given(phase_bits, st.integers(-1000, 1000))
def test_the_tie_rule_rounds_up(bits, step):
    """Floor(x + 1/2): a phase exactly between two codes takes the upper one."""
    size = phase_step_rad(bits)
    codes = quantise_phase([(step + 0.499) * size, (step + 0.501) * size], bits)
    assert list(codes) == [step % 2**bits, (step + 1) % 2**bits]
    assert quantise_phase([0.5 * size], bits)[0] == 1 % 2**bits


@given(seeds)
def test_an_amplitude_between_two_codes_takes_the_upper_one_at_any_phase(seed):
    phases = np.random.default_rng(seed).uniform(0.0, 6.3, 255)
    weights = (np.arange(255) + 0.5) / 255.0 * np.exp(1j * phases)
    assert Drive.from_weights(weights).amplitude_codes.tolist() == list(range(1, 256))


@given(phase_bits)
def test_quantising_what_was_quantised_changes_nothing(bits):
    codes = np.arange(2**bits)
    assert (quantise_phase(dequantise_phase(codes, bits), bits) == codes).all()
    assert (quantise_phase(dequantise_phase(codes, bits) - 20 * math.pi, bits) == codes).all()


@given(st.integers(1, 40).flatmap(weights_of), phase_bits)
def test_a_weight_is_rounded_by_half_a_step_of_phase_and_amplitude(weights, bits):
    rounded = Drive.from_weights(weights, bits).weights()
    assert np.abs(np.abs(rounded) - np.abs(weights)).max() <= 0.5 / 255 + 1e-12
    limit = 2.0 * math.sin(math.pi / 2 ** (bits + 1)) + 0.5 / 255
    assert np.abs(rounded - weights).max() <= limit + 1e-12


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("bits", [1, 8, 16])
def test_bits_that_are_a_number_of_numpy_are_those_of_python(bits):
    codes = quantise_phase([1.0, -2.0, 3.0], bits)
    short = np.uint8(bits)
    assert quantise_phase([1.0, -2.0, 3.0], short).tolist() == codes.tolist()
    assert dequantise_phase(codes, short).tolist() == dequantise_phase(codes, bits).tolist()
    assert phase_step_rad(short) == phase_step_rad(bits)


def test_a_weight_above_one_is_refused_or_saturated_and_zero_has_phase_code_zero():
    weights = [3j, 0.0, complex(-0.0, -0.0), -0.25]
    with pytest.raises(ConfigurationError, match=r"weights\[0\] has the magnitude 3, must be 1"):
        Drive.from_weights(weights)
    drive = Drive.from_weights(saturated_weights(weights))
    assert list(drive.amplitude_codes) == [255, 0, 0, 64]
    assert list(drive.phase_codes) == [64, 0, 0, 128]


def test_a_positive_phase_is_a_lag():
    """Code 64 of 8 bits delays by a quarter of a period: with e^{-jwt} the weight is +j."""
    assert Drive(np.array([64]), np.array([255])).weights() == pytest.approx([1j], abs=1e-15)


def test_a_muted_drive_is_silent():
    drive = Drive.muted(7)
    assert drive.is_muted
    assert drive.count == 7
    assert (drive.weights() == 0.0).all()
    assert not Drive(np.array([0]), np.array([1])).is_muted


def test_codes_cannot_be_changed():
    drive = Drive.muted(3)
    with pytest.raises(ValueError, match="read-only"):
        drive.phase_codes[0] = 1


@pytest.mark.parametrize(
    ("make", "complaint"),
    [
        (lambda: Drive(np.array([256]), np.array([0])), "holds 256, must be 0 to 255"),
        (lambda: Drive(np.array([-1]), np.array([0])), "holds -1, must be 0 to 255"),
        (lambda: Drive(np.array([32]), np.array([0]), 5), "holds 32, must be 0 to 31"),
        (lambda: Drive(np.array([0]), np.array([0]), 17), "phase_bits is 17, must be 1 to 16"),
        (lambda: Drive(np.array([0]), np.array([0]), 0), "phase_bits is 0"),
        (lambda: Drive(np.array([0, 1]), np.array([0])), "2 phase codes and 1 amplitude codes"),
        (lambda: Drive(np.array([0.5]), np.array([0])), "float64"),
        (lambda: Drive(np.zeros((2, 2), int), np.array([0])), r"\(2, 2\)"),
        (lambda: Drive([[1], [1, 2]], [1, 2]), "phase_codes is not an array of numbers"),
        (lambda: Drive([0], [0], 8.0), "phase_bits is 8.0, must be a whole number"),
        (lambda: Drive([0], [0], np.array([8, 8])), "must be a whole number"),
        (lambda: Drive([], []), "0 codes|float64"),
        (lambda: Drive.muted(0), "count is 0, must be 1 to 1024"),
        (lambda: Drive.muted(-5), "count is -5"),
        (lambda: Drive.muted(10**13), "count is 10000000000000, must be 1 to 1024"),
        (lambda: Drive.from_weights([np.nan]), "nan"),
        (lambda: Drive.from_weights(["x"]), "not an array of numbers"),
        (lambda: quantise_phase([np.inf], 8), "inf"),
        (lambda: quantise_phase([1e12], 8), r"phases_rad\[0\] is 1e.12, must be 1e.09 at most"),
        (lambda: quantise_phase([0.0], 17), "phase_bits is 17"),
        (lambda: phase_step_rad(0), "phase_bits is 0"),
    ],
)
def test_a_bad_drive_is_refused_with_value_and_limit(make, complaint):
    with pytest.raises(ConfigurationError, match=complaint):
        make()


@pytest.mark.parametrize("wrong", ["ab", None, 2, [1, 2]])
def test_codes_that_are_no_bytes_are_refused(wrong):
    with pytest.raises(ConfigurationError, match=r"^phases is .*, must be bytes$"):
        Drive.from_bytes(wrong, b"cd")
    with pytest.raises(ConfigurationError, match=r"^amplitudes is .*, must be bytes$"):
        Drive.from_bytes(b"ab", wrong)


def test_codes_in_any_buffer_are_those_of_its_bytes():
    expected = Drive.from_bytes(b"ab", b"cd")
    assert Drive.from_bytes(bytearray(b"ab"), memoryview(b"cd")) == expected
