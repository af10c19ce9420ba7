"""Makes the boards of this folder importable: its tests are imported by their path."""

import sys
from pathlib import Path

import pytest

import dialogue_models

sys.path.insert(0, str(Path(__file__).parent))
model_here = pytest.fixture(dialogue_models.model_here, autouse=True)
