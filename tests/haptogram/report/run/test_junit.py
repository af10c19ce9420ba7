from __future__ import annotations

import dataclasses
from pathlib import Path
from xml.etree import ElementTree

import pytest

from haptogram.acoustics import AcousticModel
from haptogram.machine.provenance import UNSTATED
from haptogram.records.frame import FrameKey
from haptogram.report.formats.document import Outcome
from haptogram.report.formats.junit import write_document_junit
from haptogram.report.run.checks import NAMED_FRAMES, run_checks
from haptogram.report.run.document import run_document
from haptogram.verification import Cut, RunVerdict, Verdict
from judged_runs import (
    Change,
    aim,
    damage,
    delay,
    hide,
    hurry,
    lose,
    make_result,
    make_run,
    targets,
)

OUTCOMES = {"failure", "error", "skipped", "system-out"}


def written(path: Path, run: RunVerdict, **changes: object) -> ElementTree.Element:
    """Write the run, read it back and check that it has the usual shape."""
    document = run_document(run, make_result(run, **changes), AcousticModel.default(8, 8))
    write_document_junit(path / "junit.xml", document, UNSTATED)
    root = ElementTree.parse(path / "junit.xml").getroot()
    assert root.tag == "testsuites"
    (suite,) = root
    assert suite.tag == "testsuite"
    assert [e.tag for e in suite if e.tag != "testcase"] == ["properties", "system-out"]
    cases = suite.findall("testcase")
    for attribute, tag in {"tests": ".", "failures": "failure", "errors": "error"}.items():
        number = sum(case.find(tag) is not None for case in cases)
        assert root.get(attribute) == suite.get(attribute) == str(number)
    assert suite.get("skipped") == str(len(suite.findall("testcase/skipped")))
    for case in cases:
        assert case.get("name")
        assert case.get("classname")
        assert len(case) <= 1
        assert {child.tag for child in case} <= OUTCOMES
    return suite


def outcome(suite: ElementTree.Element, name: str) -> ElementTree.Element:
    (case,) = suite.findall(f"testcase[@classname='haptogram.verify.{name}']")
    (child,) = case
    return child


def test_a_good_run_has_no_failure_and_names_its_configuration(
    tmp_path: Path, good_run: RunVerdict
) -> None:
    suite = written(tmp_path, good_run)
    assert suite.get("failures") == suite.get("errors") == suite.get("skipped") == "0"
    properties = {p.get("name"): p.get("value") for p in suite.iter("property")}
    assert properties["configuration.center_mm"] == "[0.0, 0.0, 100.0]"
    assert properties["configuration.object"] == "circle"
    assert properties["frames.verified"] == "12"
    assert properties["verdict"] == "pass"


@pytest.mark.parametrize(
    ("change", "name"), [(damage, "wrong_drive"), (hurry, "early")], ids=["wrong_drive", "early"]
)
def test_a_fault_fails_its_case_and_names_the_frame(
    tmp_path: Path, model: AcousticModel, change: Change, name: str
) -> None:
    suite = written(tmp_path, make_run(model, targets(5), {3: change}))
    failure = outcome(suite, name)
    assert failure.tag == "failure"
    assert "(stream index 3, due at 3000 µs)" in (failure.text or "")
    assert suite.get("failures") == "1"


def test_a_frame_off_target_fails(tmp_path: Path, model: AcousticModel) -> None:
    points = targets(3)
    run = make_run(model, points, {0: aim(model, points[0] + 2e-3)})
    failure = outcome(written(tmp_path, run), "off_target")
    assert failure.get("message") == "1 of 3 verified frames"
    assert "mm along" in (failure.text or "")


def test_a_wrong_drive_proves_nothing_of_foci(tmp_path: Path, model: AcousticModel) -> None:
    """Its focus may be off as well, and is counted under the wrong drive."""
    points = targets(3)
    run = make_run(model, points, {0: aim(model, points[0] + 2e-3), 1: damage})
    failure = outcome(written(tmp_path, run), "off_target")
    assert failure.get("message") == "1 of 2 verified frames, besides 1 with a faulty drive"
    suite = written(tmp_path, make_run(model, points, dict.fromkeys(range(3), damage)))
    skipped = outcome(suite, "off_target")
    assert skipped.tag == "skipped"
    assert skipped.get("message") == "none of 3 verified frames has a right drive"


def test_late_frames_and_those_held_up_are_named_but_decide_nothing(
    tmp_path: Path, model: AcousticModel
) -> None:
    run = make_run(model, targets(6), {4: delay}, min_verified=0.5, held_up=[2])
    suite = written(tmp_path, run)
    held_up, late = outcome(suite, "held_up"), outcome(suite, "late")
    assert held_up.tag == late.tag == "system-out"
    assert "frame 2" in (held_up.text or "")
    assert "mm away" in (held_up.text or "")
    assert "frame 4" in (late.text or "")
    assert "400 µs late" in (late.text or "")


def test_a_lost_frame_fails_and_too_few_that_are_verified_are_an_error(
    tmp_path: Path, model: AcousticModel
) -> None:
    suite = written(tmp_path, make_run(model, targets(6), {2: lose}))
    assert outcome(suite, "lost").tag == "failure"
    suite = written(tmp_path, make_run(model, targets(6), held_up=[2], min_verified=1.0))
    assert outcome(suite, "held_up").tag == "error"
    assert outcome(suite, "verified").tag == "error"
    assert suite.get("failures") == "0"


def test_what_nobody_saw_is_not_passed(tmp_path: Path, model: AcousticModel) -> None:
    suite = written(tmp_path, make_run(model, targets(3), dict.fromkeys(range(3), lose)))
    for name in ("off_target", "wrong_drive", "corrupt", "early", "duplicated", "unexpected"):
        assert outcome(suite, name).tag == "skipped"
    assert outcome(suite, "verified").tag == "error"


def test_a_run_that_was_cut_short_is_an_error(tmp_path: Path, model: AcousticModel) -> None:
    why = "the line went silent"
    run = make_run(model, targets(2), cut=Cut(why))
    suite = written(tmp_path, run, cut_short=why)
    assert outcome(suite, "complete").get("message") == why
    assert suite.get("errors") == "1"


def test_no_more_frames_are_named_than_a_person_reads(tmp_path: Path, model: AcousticModel) -> None:
    count = NAMED_FRAMES + 5
    lost = make_run(model, targets(count), dict.fromkeys(range(1, count), lose))
    text = outcome(written(tmp_path, lost), "lost").text or ""
    assert text.count("\nframe ") == NAMED_FRAMES
    assert "... and 4 more" in text


def test_characters_that_xml_cannot_hold_are_replaced(tmp_path: Path, good_run: RunVerdict) -> None:
    hostile = '/dev/\x00\x1b\ud800<&">\ufffe'
    suite = written(tmp_path, good_run, configuration={"port": hostile})
    properties = {p.get("name"): p.get("value") for p in suite.iter("property")}
    assert properties["configuration.port"] == '/dev/\ufffd\ufffd\ufffd<&">\ufffd'


def test_the_same_run_gives_the_same_bytes(tmp_path: Path, good_run: RunVerdict) -> None:
    written(tmp_path, good_run)
    first = (tmp_path / "junit.xml").read_bytes()
    written(tmp_path, good_run)
    assert (tmp_path / "junit.xml").read_bytes() == first


@pytest.mark.parametrize("change", [None, lose, delay, hurry, damage, hide])
@pytest.mark.parametrize("min_verified", [0.0, 0.8, 1.0])
def test_the_checks_agree_with_the_verdict(
    model: AcousticModel, min_verified: float, change: Change | None
) -> None:
    changes = {} if change is None else {1: change}
    for cut in (None, Cut("interrupted")):
        run = make_run(model, targets(2), changes, min_verified=min_verified, cut=cut)
        outcomes = {check.outcome for check in run_checks(run, None if cut is None else cut.reason)}
        assert (Outcome.FAILED in outcomes) == (run.verdict is Verdict.FAIL)
        if run.verdict is not Verdict.FAIL:
            assert (Outcome.INCONCLUSIVE in outcomes) == (run.verdict is Verdict.INCONCLUSIVE)


def test_a_latch_that_nobody_intended_fails(tmp_path: Path, model: AcousticModel) -> None:
    foreign = FrameKey(0xBAD, 2, 3, 4)
    run = make_run(model, targets(1), {0: lambda latch: dataclasses.replace(latch, key=foreign)})
    failure = outcome(written(tmp_path, run), "unexpected")
    assert "session 0xbad, sequence 2, loop 3, index 4" in (failure.text or "")
    assert run.verdict is Verdict.FAIL
