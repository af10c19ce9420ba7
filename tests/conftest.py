"""Settings that every test shares: one numerical thread, and the Hypothesis profiles."""

import os

from hypothesis import HealthCheck, settings

# Before the first import of numpy: the tests must not compete with themselves for cores.
for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

# The tests may run in a job of GitHub; those of its annotations set this themselves.
os.environ.pop("GITHUB_ACTIONS", None)

# A shared machine may stop for a while at any point, so slowness is no failure.
_UNHURRIED = {"deadline": None, "suppress_health_check": [HealthCheck.too_slow]}

settings.register_profile("ci", derandomize=True, **_UNHURRIED)
settings.register_profile("nightly", max_examples=1000, print_blob=True, **_UNHURRIED)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "ci"))
