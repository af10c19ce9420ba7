"""The soak: every fault explained, every wrong board found, and no sitting tells from two."""

from __future__ import annotations

import functools
import gc
import json
import math
import random
import sys
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest

from haptogram.campaigns.soak import campaign
from haptogram.campaigns.soak.campaign import (
    GROWTH_LIMIT_BYTES,
    SoakCampaign,
    SoakMemory,
)
from haptogram.campaigns.soak.line import BAUD, KINDS
from haptogram.campaigns.soak.rig import SoakRig
from haptogram.campaigns.soak.segment import run_soak_segment
from haptogram.campaigns.soak.setup import SoakSetup
from haptogram.campaigns.soak.tally import DAMAGE, VIOLATIONS, SoakTally
from haptogram.cli import main
from haptogram.cli.boards import board_without_a_line
from haptogram.errors import ConfigurationError
from haptogram.machine.provenance import UNSTATED
from haptogram.report.formats.console import document_text
from haptogram.report.formats.html import write_document_page
from haptogram.report.formats.junit import write_document_junit
from haptogram.report.soak.document import soak_document
from haptogram.settings.faults.kinds import FAULT_KINDS
from haptogram.settings.faults.plan import FaultPlan
from haptogram_protocol.messages import Config, SetConfig, SetConfigReply
from mutants import MUTANTS

SHORT = SoakSetup(hours=1.2 / 3600, fault_rate=0.05, seed=7, segment_minutes=0.4 / 60)


def setup(seconds: float, seed: int, fault_rate: float = 0.05) -> SoakSetup:
    return SoakSetup(hours=seconds / 3600, fault_rate=fault_rate, seed=seed)


def segment(mutant: str | None = None, *, seed: int = 0, seconds: float = 1.5) -> SoakTally:
    make = board_without_a_line(mutant and MUTANTS[mutant].address)
    return run_soak_segment(make, setup(seconds, seed), 0)


# --- the account -------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def account() -> SoakTally:
    return segment(seed=4, seconds=3.0)


def test_a_healthy_board_is_found_healthy(account: SoakTally) -> None:
    assert account.violations == {}
    assert account.totals["frames"] > 2000
    assert account.totals["latched"] > 1500


def test_its_faults_have_the_names_of_the_fault_plan_but_for_two() -> None:
    assert {f"line.{kind}" for kind in KINDS} - FAULT_KINDS.keys() == {"line.lose", "line.junk"}


def test_every_fault_was_detected_or_harmless(account: SoakTally) -> None:
    assert {f"down.{kind}" for kind in KINDS} <= set(account.faults)
    for kind, counts in account.faults.items():
        assert counts["injected"] == counts["detected"] + counts["harmless"], kind


def test_what_must_show_is_never_harmless_and_what_must_not_is_never_detected(
    account: SoakTally,
) -> None:
    for kind in ("down.flip", "down.break", "down.lose", "down.duplicate", "down.junk"):
        assert account.faults[kind]["harmless"] == 0
        assert account.faults[kind]["detected"] > 0
    assert account.faults["down.slice"]["detected"] == 0


def test_the_counters_of_the_board_are_the_sums_of_what_was_found(account: SoakTally) -> None:
    for name in (*DAMAGE, "gap"):
        found = sum(
            count
            for kind, counts in account.faults.items()
            for as_name, count in counts.items()
            if kind.startswith("down.") and as_name == name
        )
        assert account.totals[f"counter {name}"] == found
    assert account.totals["counter crc"] > 0
    assert account.totals["counter gap"] > 0


def test_a_line_without_faults_has_none() -> None:
    quiet = run_soak_segment(board_without_a_line(None), setup(0.5, 1, 0.0), 0)
    assert quiet.violations == {}
    assert {kind.partition(".")[2] for kind in quiet.faults} <= {"outage"}
    assert quiet.totals["counter crc"] == 0


def test_it_follows_from_seed_and_number_alone() -> None:
    first, again, other = (segment(seed=seed, seconds=0.5) for seed in (5, 5, 6))
    assert first.as_dict() == again.as_dict()
    assert first.as_dict() != other.as_dict()


def test_an_account_comes_back_from_json(account: SoakTally) -> None:
    assert SoakTally.from_dict(json.loads(json.dumps(account.as_dict()))) == account


def test_the_course_adds_up_to_the_account() -> None:
    tally = run_soak_segment(board_without_a_line(None), setup(2.2, 2, 0.1), 0)
    course = tally.course.values()
    assert len(course) >= 3
    assert sum(one["frames"] for one in course) == tally.totals["frames"]
    assert sum(one["lost"] for one in course) == tally.totals["gap"] > 0
    late = tally.totals["late"] + tally.totals["dropped_late"]
    assert sum(one["late"] for one in course) == late > 0
    damage = [tally.totals[f"{end}: {n}"] for end in ("the board", "the host") for n in DAMAGE]
    assert sum(one["damaged"] for one in course) == sum(damage) > 0
    assert [one["latest_us"] > 0 for one in course] == [one["late"] > 0 for one in course]


def test_the_course_shows_when_something_was_wrong() -> None:
    tally = segment("watchdog-missing", seed=10)
    wrong = [number for number, one in tally.course.items() if one["violations"]]
    assert sum(one["violations"] for one in tally.course.values()) == tally.violations.total() > 0
    assert wrong
    assert min(wrong) >= 0


def test_intervals_are_fine_enough_for_a_picture_and_no_finer() -> None:
    assert SoakSetup(hours=0.01).interval_s == 1.0
    assert SoakSetup(hours=1.0).interval_s == 9.0


# --- what only a long soak meets ---------------------------------------------------------------


def test_an_event_that_leaves_just_before_a_new_session_is_one_of_the_old_session() -> None:
    board = board_without_a_line(None)(seed=0, baud=BAUD, plan=FaultPlan(), running_us=0)
    tally, met = SoakTally(), 0
    rig = SoakRig(board, setup(1.0, 0, 0.0), random.Random(0), tally)
    for number in range(40):  # the HELLO comes some time before or after a STATUS is due
        rig.new_session()
        met += rig.link.connection.counters["stale_session"]
        rig.link.request(SetConfig(Config(status_period_ms=50)), SetConfigReply)
        rig.link.run_until(rig.now_ns() + 50_000_000 - 10_000 * number)
    assert met > 0
    assert tally.violations == {}


def test_new_sessions_leave_no_memory_to_the_cycle_collector() -> None:
    board = board_without_a_line(None)(seed=0, baud=BAUD, plan=FaultPlan(), running_us=0)
    rig = SoakRig(board, setup(1.0, 0, 0.01), random.Random(0), SoakTally())
    blocks = []
    gc.disable()
    try:
        for _ in range(3):
            for _ in range(100):
                rig.new_session()
            blocks.append(sys.getallocatedblocks())
    finally:
        gc.enable()
    assert blocks[2] - blocks[1] < 100  # a link alone has some 200


def test_a_request_that_an_outage_outlasts_is_given_up_and_another_session_follows(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    place = f"{run_soak_segment.__module__}._SoakSegment._some_time_ns"
    monkeypatch.setattr(place, lambda _: 3_000_000_000)
    tally = run_soak_segment(board_without_a_line(None), setup(6.0, 3, 0.0), 0)
    assert (tally.totals["outages"], tally.totals["sessions"]) == (1, 2)
    found = tally.found()["down.outage"]
    assert found.keys() == {"asked again", "given up"}
    assert found["asked again"] == 4
    assert found["given up"] > 1000  # the frames of the session as well
    assert tally.violations == {}


# --- boards that are wrong ---------------------------------------------------------------------


@pytest.mark.parametrize(
    ("mutant", "violation", "seed"),
    [
        ("crc-unchecked", "damaged frame taken", 0),
        ("non-atomic", "torn latch", 0),
        ("watchdog-missing", "muted too late", 10),
        ("leaks-on-junk", "memory leak", 0),
        ("gaps-uncounted", "counter unexplained", 0),
        ("duplicates-applied", "copy taken", 0),
        ("latches-one-period-late", "latched at a wrong time", 0),
        ("status-never-sent", "unexplained", 0),
    ],
)
def test_a_board_that_is_wrong_fails_by_name(mutant: str, violation: str, seed: int) -> None:
    assert segment(mutant, seed=seed).violations[violation] > 0


def test_the_command_fails_for_a_board_that_is_wrong(capsys: pytest.CaptureFixture[str]) -> None:
    words = ["--hours", "0.0002", "--fault-rate", "0.05", "--mutant", "non-atomic", "--quiet"]
    assert main(["soak", *words]) == 1
    assert "FAIL: given up (1), torn latch" in capsys.readouterr().out


def test_a_process_that_grows_fails() -> None:
    memory = SoakMemory()
    memory.begin_sitting()
    for resident in (100 << 20, (100 << 20) + GROWTH_LIMIT_BYTES):
        memory.add(1, resident)
    assert SoakCampaign(SHORT, memory=memory).failures == {}
    memory.add(1, (101 << 20) + GROWTH_LIMIT_BYTES)
    assert SoakCampaign(SHORT, memory=memory).failures == {"memory grew": 1}


def test_a_violation_without_a_sentence_is_no_violation() -> None:
    with pytest.raises(KeyError):
        SoakTally().violate("unheard of", "")


# --- reports -----------------------------------------------------------------------------------


def cases(path: Path) -> dict[str, ElementTree.Element]:
    return {case.get("name", ""): case[0] for case in ElementTree.parse(path).iter("testcase")}


def test_the_reports_of_a_healthy_board_pass(uninterrupted: SoakCampaign, tmp_path: Path) -> None:
    document = soak_document(uninterrupted)
    write_document_junit(tmp_path / "soak.xml", document, UNSTATED)
    outcomes = cases(tmp_path / "soak.xml")
    assert outcomes.keys() == {*VIOLATIONS.values(), "the soak comes to its end"}
    assert {outcome.tag for outcome in outcomes.values()} == {"system-out"}
    write_document_page(tmp_path / "soak.html", document, UNSTATED)
    page = (tmp_path / "soak.html").read_text(encoding="utf-8")
    assert "<img" not in page
    (course,) = [section for section in document.sections if section.title == "Course"]
    frames = sum(int(row[1]) for row in course.blocks[0].rows)
    assert frames == uninterrupted.tally.totals["frames"]


def test_a_board_that_is_wrong_fails_its_case(tmp_path: Path) -> None:
    page, junit = tmp_path / "soak.html", tmp_path / "soak.xml"
    words = ["--hours", "0.0002", "--fault-rate", "0.05", "--mutant", "non-atomic", "--quiet"]
    assert main(["soak", *words, "--html", str(page), "--junit", str(junit)]) == 1
    suite = ElementTree.parse(junit).find("testsuite")
    assert suite is not None
    assert suite.get("timestamp")
    assert float(suite.get("time", 0)) > 0
    failed = {name for name, outcome in cases(junit).items() if outcome.tag == "failure"}
    assert failed == {VIOLATIONS["torn latch"], VIOLATIONS["given up"]}
    assert "is not the drive that was sent" in cases(junit)[VIOLATIONS["torn latch"]].text


def test_a_soak_of_which_nothing_ran_is_an_error(tmp_path: Path) -> None:
    document = soak_document(SoakCampaign(SHORT))
    write_document_junit(tmp_path / "soak.xml", document, UNSTATED)
    outcomes = cases(tmp_path / "soak.xml")
    assert outcomes.pop("the soak comes to its end").tag == "error"
    assert {outcome.tag for outcome in outcomes.values()} == {"skipped"}
    write_document_page(tmp_path / "soak.html", document, UNSTATED)
    assert "<img" not in (tmp_path / "soak.html").read_text(encoding="utf-8")


# --- sittings ----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def uninterrupted() -> SoakCampaign:
    whole = SoakCampaign(SHORT)
    whole.run(board_without_a_line(None))
    return whole


def interrupt_at(number: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let somebody press Ctrl-C while segment *number* runs."""

    def run(*arguments: Any, **options: Any) -> SoakTally:
        if arguments[2] == number:
            raise KeyboardInterrupt
        return run_soak_segment(*arguments, **options)

    monkeypatch.setattr(campaign, "run_soak_segment", run)


def test_two_sittings_give_what_one_gives(
    uninterrupted: SoakCampaign, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "soak.json"
    with monkeypatch.context() as first:
        interrupt_at(1, first)
        with pytest.raises(KeyboardInterrupt):
            SoakCampaign(SHORT).run(board_without_a_line(None), checkpoint=path)
    resumed = SoakCampaign.load(path, SHORT)
    assert (resumed.done, resumed.is_complete) == (1, False)
    resumed.run(board_without_a_line(None), checkpoint=path)
    assert resumed.is_complete
    assert resumed.tally == uninterrupted.tally
    assert SoakCampaign.load(path, SHORT).tally == uninterrupted.tally


def test_processes_give_what_one_gives(uninterrupted: SoakCampaign) -> None:
    parallel = SoakCampaign(SHORT)
    parallel.run(board_without_a_line(None), jobs=2)
    assert parallel.tally == uninterrupted.tally


def test_a_soak_says_how_long_it_takes(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("haptogram.commands.shell.progress._MEASURED_S", 0.0)
    assert main(["soak", "--hours", "0.0004", "--seed", "7"]) == 0
    assert 1 <= capsys.readouterr().err.count("the rest takes about ") <= 11


def test_an_interrupt_keeps_what_is_done_and_says_how_to_go_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path, result = tmp_path / "soak.json", tmp_path / "out.json"
    words = ["--hours", "0.0004", "--segment-minutes", "0.012", "--seed", "7"]
    command = ["soak", *words, "--resume", str(path), "--json", str(result)]
    with monkeypatch.context() as first:
        interrupt_at(1, first)
        assert main(command) == 130
    said = capsys.readouterr()
    assert "1 of 2 segments" in said.out
    assert "PASS, so far" in said.out
    assert f"the same command goes on from {path}" in said.err
    assert json.loads(result.read_bytes())["done"] == 1
    assert main([*command, "--quiet"]) == 0
    assert "2 of 2 segments" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("place", "value"),
    [
        *(("done", value) for value in (99, -1, "2", 1.5, True, None)),
        *(("spent_s", value) for value in ("x", -1, math.nan, math.inf)),
        *(("memory", value) for value in ([1], {"a": {}}, {"1/2": {"segments": 1, "first": 1}})),
        *(("examples", value) for value in (["abc"], "abc", [1])),
        *(("violations", value) for value in ({"torn latch": "x"}, {"no such one": 1}, [1])),
        *(("totals", value) for value in ({"frames": "x"}, {"frames": -1}, [["frames", 1]])),
        *(("course", value) for value in ([{"interval": "a"}], [{"interval": 0, "frames": 1}])),
        *(("faults", value) for value in ({"x": {"injected": 1}}, {"x": {"found": {}}})),
    ],
)
def test_a_checkpoint_that_was_changed_is_refused(place: str, value: Any, tmp_path: Path) -> None:
    state = SoakCampaign(SHORT).as_dict()
    (state if place in state else state["tally"])[place] = value
    path = tmp_path / "soak.json"
    path.write_text(json.dumps(state))
    with pytest.raises(ConfigurationError, match=r"soak\.json is no checkpoint of a soak"):
        SoakCampaign.load(path, SHORT)


def test_a_checkpoint_of_another_soak_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "soak.json"
    SoakCampaign(SHORT).save(path)
    other = functools.partial(SoakCampaign.load, path)
    with pytest.raises(ConfigurationError, match="another soak: seed 7, not 8"):
        other(SoakSetup(hours=SHORT.hours, fault_rate=0.05, seed=8, segment_minutes=0.4 / 60))
    path.write_text("[]")
    with pytest.raises(ConfigurationError, match="no checkpoint of a soak"):
        other(SHORT)
    with pytest.raises(ConfigurationError, match=f"^resume '{tmp_path}' cannot be read: it is a"):
        SoakCampaign.load(tmp_path, SHORT)


def test_the_account_counts_in_words() -> None:
    soak = SoakCampaign(SHORT)
    soak.tally.totals.update({"sessions": 1, "pauses": 2})
    said = document_text(soak_document(soak))
    assert " 1  session\n" in said
    assert " 2  pauses\n" in said
    assert "memory did not grow\n" in said


def test_segments_cover_the_whole_time() -> None:
    setup = SoakSetup(hours=1.0, segment_minutes=7 / 60)
    lengths = [setup.length_s(number) for number in range(setup.segments)]
    assert sum(lengths) == pytest.approx(3600.0)
    assert min(lengths) > 0


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--hours", "0"], "--hours is 0, must be"),
        (["--fault-rate", "0.5"], "--fault-rate is 0.5, must be 0 to 0.2"),
        (["--jobs", "0"], "--jobs is 0, must be"),
        (["--seed", "-1"], "--seed is -1, must be"),
        (["--segment-minutes", "0"], "--segment-minutes is 0, must be"),
        (["--hours", "1", "--mutant", "werewolf"], "--mutant is 'werewolf'"),
    ],
)
def test_a_wrong_argument_is_status_2(
    words: list[str], told: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["soak", *words]) == 2
    assert told in capsys.readouterr().err
