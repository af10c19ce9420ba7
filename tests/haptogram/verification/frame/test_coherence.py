"""S3 by itself: what it is a share of, and how much of it rounding may cost."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptogram.acoustics import AcousticModel, focus_phases
from haptogram.verification.frame import criteria
from latched_drives import field_of, intend, registers, working_volume

MODEL = AcousticModel.default()


@given(working_volume(), st.integers(0, 255), st.sampled_from([8, 6, 5]))
def test_a_dead_element_is_missing_from_the_coherence(target, element, bits):
    """It is measured by the intended amplitudes: what is silent takes its share away."""
    field = field_of(MODEL, target, bits)
    ideal = np.exp(1j * focus_phases(MODEL, target))
    dead = ideal * (np.arange(256) != element)
    loudness = np.abs(field.arrivals)
    share = loudness[element] / loudness.sum()
    assert criteria.frame_coherence_at_target(field, ideal) == pytest.approx(1.0, abs=1e-12)
    assert criteria.frame_coherence_at_target(field, dead) == pytest.approx(1.0 - share, abs=1e-12)
    intended = intend(MODEL, target, bits)
    limit = criteria.least_frame_coherence(field, criteria.allowed_frame_codes(intended))
    assert limit == pytest.approx(math.cos(math.pi / 2**bits), abs=2e-9)
    rounded = registers(focus_phases(MODEL, target), bits).weights()
    assert criteria.frame_coherence_at_target(field, rounded) >= limit
