"""The picture of the README is that of today's view: `ci/readme-picture` draws it anew."""

from __future__ import annotations

import importlib.util
import shutil
from pathlib import Path

import numpy as np
import pytest

SCRIPT = Path(__file__).resolve().parents[2] / "ci" / "readme_picture.py"


@pytest.mark.nightly
def test_the_picture_is_that_of_the_view() -> None:
    image = pytest.importorskip("PIL.Image")
    spec = importlib.util.spec_from_file_location("readme_picture", SCRIPT)
    assert spec is not None
    assert spec.loader is not None
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    if not any(map(shutil.which, script.BROWSERS)):
        pytest.skip("needs Chromium: ci/browser")
    drawn, kept = script.draw(), image.open(script.PICTURE).convert("RGB")
    assert abs(drawn.width - kept.width) < 0.03 * kept.width
    # Another browser moves a letter; another style moves or colours everything.
    size = (96, 40)
    one, other = (np.asarray(each.resize(size), dtype=float) for each in (drawn, kept))
    assert np.abs(one - other).mean() < 3.0
