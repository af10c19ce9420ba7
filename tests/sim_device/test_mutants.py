"""Every mutant differs from the healthy board in what it names, and the healthy board does not."""

import binascii
import dataclasses
import functools
import importlib.util
import random
import re
from pathlib import Path

import pytest

from haptogram.cli.boards import access_in_program
from haptogram.conformance.cases import all_cases
from haptogram.conformance.run.runner import SuiteOptions, SuiteRunner
from haptogram.conformance.verdict import Behaviour
from haptogram.errors import ConfigurationError
from haptogram.records.frame import Evidence
from mutants import MUTANTS
from sim_device.board.clock import BoardClock, ClockChange
from sim_device.command.command import main
from sim_device.mutants import MUTANTS as SHOWN
from sim_device.mutants import mutant_parts

ROOT = Path(__file__).parents[2]
SPEC = ROOT / "protocol" / "SPEC.md"
DOCS = ROOT / "docs"
VISIBLE = sorted(n for n, m in MUTANTS.items() if m.evidence is not Evidence.EXTERNAL)
HIDDEN = sorted(MUTANTS.keys() - VISIBLE)
CODES = bytes(range(3, 19))
#: Judged with every commit, drawn anew when the text changes; the others every night.
DRAWN = random.Random(binascii.crc32(SPEC.read_bytes())).sample(VISIBLE, 10)


def behaviours(clause, array, mutant=""):
    """Yield how a board does in the cases of one clause, one after the other, in virtual time."""
    url = f"haptogram://?clock=virtual&array={array}&baud=3000000" + (
        f"&mutant={MUTANTS[mutant].address}" if mutant else ""
    )
    access = access_in_program(url, baudrate=3_000_000, seed=0)
    cases = [case for case in all_cases() if case.clause == clause]
    with SuiteRunner(access, SuiteOptions()) as runner:
        for case in sorted(cases, key=lambda case: case.judges_all):  # as a suite runs them
            yield runner.result(case).behaviour


@functools.cache
def healthy(clause, array):
    return tuple(behaviours(clause, array))


def latch_of(open_host, url):
    """Return the back door's record of one drive."""
    host = open_host(url)
    host.arm()
    host.stream(CODES)
    host.port.wait_until_ns(host.now_ns() + 1_000_000)
    return [record for record in host.port.records if record["kind"] == "latch"][-1]


@pytest.mark.parametrize(
    "name",
    [pytest.param(n, marks=[] if n in DRAWN else pytest.mark.nightly) for n in VISIBLE],
)
def test_a_mutant_fails_its_clause_and_the_healthy_board_does_not(name):
    clause, array = MUTANTS[name].clause, MUTANTS[name].array or "4x4"
    assert Behaviour.OK in healthy(clause, array)
    assert Behaviour.FAILED not in healthy(clause, array)
    assert Behaviour.FAILED in behaviours(clause, array, name)


@pytest.mark.parametrize("name", HIDDEN)
def test_what_only_a_measurement_shows_is_in_the_radiated_drive_alone(open_host, name):
    url = "haptogram://?clock=virtual&array=4x4&reconstruct=0"
    right, wrong = (
        latch_of(open_host, url),
        latch_of(open_host, f"{url}&mutant={MUTANTS[name].address}"),
    )
    assert wrong["drive_crc"] == right["drive_crc"]
    assert right["radiated"] is None
    assert wrong["radiated"] is not None


def test_there_are_at_least_forty_and_each_names_a_requirement_that_exists():
    clauses = set(re.findall(r"^- \*\*(HG-[\d.]+/\d+)\*\*", SPEC.read_text(), re.MULTILINE))
    assert len(MUTANTS) >= 40
    assert {mutant.clause for mutant in MUTANTS.values()} <= clauses


def test_each_says_in_its_own_words_what_is_wrong_and_changes_one_part():
    words = [mutant.docstring for mutant in MUTANTS.values()]
    assert all(words)
    assert len(set(words)) == len(words)
    for mutant in MUTANTS.values():
        parts, healthy_parts = mutant_parts(mutant.address), mutant_parts(None)
        fields = [field.name for field in dataclasses.fields(parts)]
        changed = [f for f in fields if getattr(parts, f) is not getattr(healthy_parts, f)]
        assert len(changed) == 1


def test_an_unknown_mutant_is_refused_with_what_is_like_it(capsys, tmp_path):
    with pytest.raises(ConfigurationError, match=r"mutant is 'x'; known are crc-unchecked, "):
        mutant_parts("x")
    with pytest.raises(ConfigurationError, match="did you mean crc-unchecked"):
        mutant_parts("crc-uncheckd")
    assert main(["--link", str(tmp_path / "b"), "--mutant", "x"]) == 2
    assert "known are crc-unchecked, " in capsys.readouterr().err


def test_those_to_show_are_the_product_s_own_and_have_an_address_too():
    assert {name: SHOWN[name] for name in SHOWN} == {name: MUTANTS[name] for name in SHOWN}
    page = (DOCS / "faults.md").read_text("utf-8")
    for name, mutant in SHOWN.items():
        assert mutant_parts(name) == mutant_parts(mutant.address)
        assert f"| `{name}` | {mutant.docstring} | {mutant.clause} |\n" in page


@pytest.mark.parametrize(
    ("address", "says"),
    [
        ("no_such_module:Wrong", "No module named 'no_such_module'"),
        ("mutants.framing:Wrong", "has no attribute 'Wrong'"),
        (":Wrong", "Empty module name"),
        ("mutants.framing:BLOCK", "mutants.framing:BLOCK is no part of a board; derive it"),
        ("mutants.framing:Any", "is no part of a board"),
    ],
)
def test_a_class_that_is_no_part_of_a_board_is_refused(address, says):
    with pytest.raises(ConfigurationError, match=says):
        mutant_parts(address)


@pytest.mark.parametrize(
    "clock",
    [
        BoardClock(7),
        BoardClock(7, ppm=500),
        BoardClock(7, ppm=-999),
        BoardClock(7, changes=(ClockChange(300_000, step_us=50), ClockChange(300_500, ppm=9_000))),
        BoardClock(7, -300, (ClockChange(0, step_us=5), ClockChange(900_001, -900_000, 70))),
        mutant_parts(MUTANTS["clock-steps"].address).clock(7),
    ],
)
def test_a_clock_and_its_inverse_agree(clock):
    for device_us in range(7, 3000, 13):
        t_ns = clock.reached_ns(device_us)
        assert clock.device_us(t_ns) >= device_us
        assert t_ns == 0 or clock.device_us(t_ns - 1) < device_us


def test_the_published_kill_matrix_counts_the_mutants():
    page = (DOCS / "kill-matrix.md").read_text("utf-8")
    assert f"chapter_table -->\n{_kill_matrix().chapter_table()}<!-- end -->" in page


def _kill_matrix():
    spec = importlib.util.spec_from_file_location("kill_matrix", ROOT / "ci" / "kill_matrix.py")
    command = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(command)
    return command


def test_the_kill_matrix_tells_killed_from_missed_and_lists_what_is_left():
    command = _kill_matrix()
    every = [case for case in all_cases() if case.body]
    failed = command.failed_cases("hello-always-anew", full=False)
    found = {"hello-always-anew": failed, "crc-half": [], "dead-element": [], "crc-16": every[1:]}
    assert {case.clause for case in failed} == {"HG-4.6/1"}
    assert {"HG-4.6/1", "HG-4.6/1-reply"} <= {case.id for case in failed}
    assert command.missed(found) == ["crc-half"]
    verdicts = re.findall(r"\| (killed|MISSED|not on the line) \|", command.short_page(found))
    assert verdicts == ["killed", "MISSED", "not on the line", "killed"]
    page = command.full_page(found)
    assert f"| all but {every[0].id.removeprefix('HG-')} |" in page
    assert "| 4.6/1 | 2 | hello-always-anew, crc-16 |" in page
