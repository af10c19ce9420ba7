"""What each test costs: wall and processor time, kept with every run in `out/durations.json`."""

import json
import os
from collections import defaultdict

import pytest

FILES_SHOWN = 12
_BEGIN = pytest.StashKey[float]()


def _cpu_s():
    """Return the processor time of this process and of its children that have ended."""
    return sum(os.times()[:4])


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_setup(item):
    item.stash[_BEGIN] = _cpu_s()
    return (yield)


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_teardown(item):
    try:
        return (yield)
    finally:
        item.user_properties.append(("cpu_s", round(_cpu_s() - item.stash[_BEGIN], 3)))


class Costs:
    """The costs of a run, collected by the process that reports it."""

    def __init__(self, path):
        self._path = path
        self._wall_s = defaultdict(float)
        self._cpu_s = {}

    def pytest_runtest_logreport(self, report):
        self._wall_s[report.nodeid] += report.duration
        if report.when == "teardown":
            self._cpu_s[report.nodeid] = dict(report.user_properties)["cpu_s"]

    def pytest_sessionfinish(self):
        if not self._cpu_s:  # collected alone
            return
        rows = {
            test: {"wall_s": round(self._wall_s[test], 3), "cpu_s": cpu_s}
            for test, cpu_s in sorted(self._cpu_s.items())
        }
        self._path.parent.mkdir(exist_ok=True)
        self._path.write_text(json.dumps(rows, indent=0))

    def pytest_terminal_summary(self, terminalreporter):
        files = defaultdict(float)
        for test, cpu_s in self._cpu_s.items():
            files[test.partition("::")[0]] += cpu_s
        terminalreporter.section(f"processor time: {sum(files.values()):.0f} s")
        for name in sorted(files, key=files.__getitem__, reverse=True)[:FILES_SHOWN]:
            terminalreporter.write_line(f"{files[name]:7.1f} s  {name}")
