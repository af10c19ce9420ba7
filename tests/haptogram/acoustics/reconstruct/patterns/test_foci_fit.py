"""Several foci, fitted from the phases of one drive: places, bounds, and what is lost."""

import dataclasses
import math

import numpy as np
import pytest

from haptogram.acoustics import AcousticModel, TransducerArray
from haptogram.acoustics.reconstruct.patterns.foci_fit import fit_foci, waves_of_foci_pattern
from haptogram.acoustics.solvers.several import METHODS, weights_for_foci
from latched_drives import registers

MODEL = AcousticModel.default()
EVERY = np.ones(256, dtype=bool)
LIMIT = math.pi / 256


def places(rng, count):
    while True:
        found = rng.uniform((-0.04, -0.04, 0.09), (0.04, 0.04, 0.13), (count, 3))
        apart = np.linalg.norm(found[:, None] - found, axis=2)
        if (apart + np.eye(count) > 0.015).all():
            return found


def drive_for(points, lags, solver, model=MODEL, bits=8):
    weights = weights_for_foci(
        model, points, np.ones(len(points)) / len(points), lags, method=solver
    )
    return registers(np.angle(weights), bits).weights()


def fitted(points, lags, solver, drive, model=MODEL):
    superposed = solver == "naive"
    known = np.exp(1j * lags) / len(points) if superposed else None
    active = np.ones(model.array.count, dtype=bool)
    return fit_foci(
        model,
        waves_of_foci_pattern(model, superposed=superposed),
        points,
        drive,
        active,
        LIMIT,
        known,
    )


@pytest.mark.parametrize("solver", [method for method in METHODS if method != "gradient"])
@pytest.mark.parametrize("count", [2, 3, 5])
def test_the_foci_of_a_drive_are_found_within_their_bounds(solver, count):
    rng = np.random.default_rng(count)
    for _ in range(6):
        points, lags = places(rng, count), rng.uniform(-3.0, 3.0, count)
        found = fitted(points, lags, solver, drive_for(points, lags, solver))
        assert found is not None
        assert (np.abs(found.offsets_m) <= found.bound_m).all()
        assert found.residual_rad <= LIMIT


@pytest.mark.parametrize("solver", ["naive", "gs", "wgs", "gspat", "ibp"])
def test_foci_that_are_displaced_are_found_where_they_are(solver):
    rng = np.random.default_rng(3)
    for _ in range(6):
        points, lags = places(rng, 3), rng.uniform(-3.0, 3.0, 3)
        away = 5e-4 * rng.standard_normal((3, 3))
        found = fitted(points, lags, solver, drive_for(points + away, lags, solver))
        assert found is not None
        assert (np.abs(found.offsets_m - away) <= 1.1 * found.bound_m).all()


def test_other_air_moves_every_focus_along_its_beam():
    points, lags = places(np.random.default_rng(4), 3), np.array([0.0, 1.0, 2.0])
    host = AcousticModel.default(temperature_c=22.0)
    found = fitted(points, lags, "wgs", drive_for(points, lags, "wgs", host))
    along = np.einsum("ij,ij->i", found.offsets_m, points / np.linalg.norm(points, axis=1)[:, None])
    assert (along > 3e-4).all()


def test_fewer_elements_than_unknowns_lose_the_places():
    model = AcousticModel.default(4, 3)
    points = places(np.random.default_rng(5), 3)
    drive = drive_for(points, np.zeros(3), "gs", model)
    found = fitted(points, np.zeros(3), "gs", drive, model)
    assert found is None or np.isinf(found.bound_m).any()


def test_random_phases_are_no_foci():
    points = places(np.random.default_rng(6), 3)
    drive = np.exp(1j * np.random.default_rng(7).uniform(0.0, 6.28, 256))
    found = fitted(points, np.zeros(3), "wgs", drive)
    assert found is None or found.residual_rad > 10.0 * LIMIT


def test_a_moved_model_moves_the_fit():
    points, lags = places(np.random.default_rng(8), 2), np.zeros(2)
    shift = np.array([0.1, -0.2, 0.3])
    array = MODEL.array.moved(np.eye(3), shift)
    there = dataclasses.replace(MODEL, array=array)
    drive = drive_for(points, lags, "wgs")
    here, moved = (
        fitted(points, lags, "wgs", drive),
        fitted(points + shift, lags, "wgs", drive, there),
    )
    assert moved.offsets_m == pytest.approx(here.offsets_m, abs=1e-8)


@pytest.mark.parametrize("solver", ["naive", "wgs"])
def test_phases_that_lead_a_fit_behind_the_array_give_no_foci(solver):
    array = TransducerArray.grid(12, 1, pitch_m=0.007)
    model = dataclasses.replace(MODEL, array=array)
    rng = np.random.default_rng(1)
    lost = 0
    for _ in range(60):
        points = rng.uniform((-0.02, -0.02, 0.003), (0.02, 0.02, 0.02), (4, 3))
        drive = np.exp(1j * rng.uniform(0.0, math.tau, array.count))
        lost += fitted(points, rng.uniform(0.0, math.tau, 4), solver, drive, model) is None
    assert lost > 0
