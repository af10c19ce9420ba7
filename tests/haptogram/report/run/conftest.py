"""What the tests of the report share."""

from __future__ import annotations

import pytest

from haptogram.acoustics import AcousticModel
from haptogram.verification import RunVerdict
from judged_runs import make_run, targets


@pytest.fixture(scope="session")
def model() -> AcousticModel:
    return AcousticModel.default(8, 8)


@pytest.fixture(scope="session")
def good_run(model: AcousticModel) -> RunVerdict:
    return make_run(model, targets(12), min_verified=1.0)
