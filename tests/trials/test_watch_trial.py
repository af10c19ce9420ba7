"""The labelled trial of a verdict without intent, in short; ci/watch-trial is the long form."""

import pytest

from trials.watch_trial import trial

pytestmark = pytest.mark.nightly

CASES = 24


def test_no_name_is_wrong() -> None:
    tally = trial(CASES, seed=2)
    assert tally.wrong == []
    outcomes = [sum(found[n] for found in tally.counts.values()) for n in ("right", "not named")]
    assert sum(outcomes) == CASES
    assert outcomes[0] > 0.7 * CASES
