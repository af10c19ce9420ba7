"""The field against values computed with 50 digits by another program."""

import math

import numpy as np
import pytest

import oracles
from haptogram.acoustics import (
    AcousticModel,
    CircularPiston,
    Medium,
    PointSource,
    Transducer,
    TransducerArray,
    dequantise_phase,
    focus_phases,
    pressure,
    propagators,
    quantise_phase,
)

REFERENCE = oracles.reference_fields()
CONFIGS = [config for config in REFERENCE["configs"] if config["model"] == "physical"]


def model_of(config):
    directivity = PointSource() if config["a"] is None else CircularPiston(float(config["a"]))
    strength = float(config["Pref"]) / math.sqrt(2.0)
    return AcousticModel(
        TransducerArray.grid(int(config["nx"]), int(config["ny"]), pitch_m=float(config["pitch"])),
        Medium(float(config["c"]), 1.2, float(config["alpha"])),
        Transducer(directivity, strength, float(config["f"])),
    )


def weights_of(config, model):
    if config["phase"] == "explicit":
        n = np.arange(model.array.count)
        amplitudes = (1 + (7 * n) % 10) / 10
        return amplitudes * np.exp(2j * np.pi * ((37 * n) % 100) / 100)
    if config["phase"] == "quant":
        codes = np.array(config["phase_index"], dtype=np.uint8)
        return np.exp(1j * dequantise_phase(codes, int(config["bits"])))
    return np.exp(1j * focus_phases(model, [float(v) for v in config["target"]]))


def test_the_reference_holds_what_this_file_expects():
    assert [config["name"][:2] for config in CONFIGS] == ["A1", "A2", "B1", "B2", "D1", "D2", "E1"]
    assert sum(len(config["values"]) for config in CONFIGS) == 34


@pytest.mark.parametrize("config", CONFIGS, ids=lambda config: config["name"])
def test_the_field_agrees_with_50_digits(config):
    model = model_of(config)
    points = [[float(v) for v in value["point"]] for value in config["values"]]
    expected = [complex(float(value["re"]), float(value["im"])) for value in config["values"]]
    sums = np.array([float(value["sum_abs"]) for value in config["values"]])
    weights = weights_of(config, model)
    assert model.wavenumber == pytest.approx(float(config["k_rad_per_m"]), rel=1e-14)
    error = np.abs(pressure(model, weights, points) - expected) / sums
    assert error.max() <= 1e-12
    magnitudes = np.abs(propagators(model, points) * weights).sum(axis=1)
    assert magnitudes == pytest.approx(sums, rel=1e-12)


@pytest.mark.parametrize(
    "config", [c for c in CONFIGS if c["phase"] == "quant"], ids=lambda config: config["name"]
)
def test_phase_codes_agree_with_50_digits(config):
    phases = focus_phases(model_of(config), [float(v) for v in config["target"]])
    assert list(quantise_phase(phases, int(config["bits"]))) == config["phase_index"]
