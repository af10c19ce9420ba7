"""The trials: they tell right from wrong, repeat, go on where they stopped, and find nothing."""

import dataclasses
import json

import numpy as np
import pytest
from tqdm import tqdm

from haptogram.verification.frame.verdict import FrameStatus
from trials import campaign, cases, chain, judging, layouts, results, wrongs

pytestmark = pytest.mark.nightly

ON_TARGET = FrameStatus.ON_TARGET
SEED = 10  # of the trials that run with every test
HONEST, WRONG = 160, 160


def lines_of(book, seed, wanted):
    return {g: campaign.trials_in(campaign.sessions(book, g, seed, wanted[g])[0]) for g in wanted}


def run_all(path, seed, wanted, jobs=1):
    book = campaign.Book(path, seed)
    try:
        campaign.run(book, seed, wanted, jobs, tqdm(disable=True))
        return lines_of(book, seed, wanted)
    finally:
        book.close()


def claimed(ran, status):
    """The same session, had the program said *status* of every frame."""
    frames = [
        dataclasses.replace(
            seen, verdict=dataclasses.replace(seen.verdict, status=status, smallest_miss_mm=0.05)
        )
        for seen in ran.frames
    ]
    return dataclasses.replace(ran, frames=frames, run=None)


# --- the verdict itself ----------------------------------------------------------------------


def test_no_verdict_of_a_minute_of_trials_is_wrong(tmp_path):
    found = run_all(tmp_path / "trials.jsonl", SEED, {"honest": HONEST, "wrong": WRONG})
    bad = [
        results.told(t) for group in found.values() for t in group if t["outcome"] in judging.BAD
    ]
    assert bad == []
    assert results.is_good(found)
    assert sum(map(results.counted, found["honest"])) >= HONEST
    assert sum(map(results.counted, found["wrong"])) >= WRONG


# --- the chain ---


@pytest.mark.parametrize("mode", ["phases", "drives", "sequence"])
def test_what_is_made_wrong_on_the_line_is_what_the_board_radiates(mode):
    ran, _ = frames_session("wrong", mode=mode)
    on_line = [seen for seen in ran.frames if seen.wrong and not seen.wrong.of_host]
    assert on_line
    assert all(np.array_equal(seen.radiated[0], seen.wrong.registers) for seen in on_line)


# --- the trials notice a wrong verdict -------------------------------------------------------


def frames_session(group, *, mode="phases"):
    """A session whose frames are altered one by one, on a large grid, with one focus each."""
    for seed in range(2000):
        session = cases.session_of(group, seed)
        grid = session.layout.grid
        if grid is None or min(grid) < 8 or session.mode != mode:
            continue
        if any(len(wanted.foci) > 1 for wanted in session.frames):
            continue
        ran, program = chain.run_session(session)
        if ran.error is None and ran.tags.get("how", "frames") == "frames":
            return ran, program
    raise AssertionError("no such session")


@pytest.mark.parametrize("mode", ["phases", "drives", "points", "sequence"])
def test_a_judge_that_passes_everything_is_caught(mode):
    ran, program = frames_session("wrong", mode=mode)
    trials = judging.judged(claimed(ran, FrameStatus.ON_TARGET), program)
    assert {trial.outcome for trial in trials} <= {"false pass", "below, passed", "passed"}
    assert sum(trial.outcome == "false pass" for trial in trials) >= 3


def test_a_judge_that_fails_everything_is_caught():
    ran, program = frames_session("honest")
    trials = judging.judged(claimed(ran, FrameStatus.OFF_TARGET), program)
    assert {trial.outcome for trial in trials} == {"false fail"}


def test_a_judge_that_says_nothing_of_a_large_array_is_caught():
    session = dataclasses.replace(
        cases.session_of("honest", 0),
        layout=layouts.grid(16, 16, 0.010),
        mode="phases",
        elements=None,
        allowance=None,
        host=cases.Host(),
        frames=[cases.Wanted((cases.Focus((0.01, 0.005 * n, 0.1)),)) for n in range(cases.FRAMES)],
    )
    ran, program = chain.run_session(session)
    trials = judging.judged(claimed(ran, FrameStatus.NOT_VERIFIED), program)
    assert all(text.startswith("silent") for trial in trials for text in trial.findings)
    assert [len(trial.findings) for trial in trials] == [1] * cases.FRAMES
    as_lines = [dataclasses.asdict(trial) for trial in trials]
    assert not results.is_good({"honest": as_lines, "wrong": []})


def with_one_element_inverted(slip, _):
    codes = slip.codes.astype(int)
    codes[5] += 128
    return wrongs.Wrong("inverted", slip.with_codes(codes), 1.0, of_host=True)


def test_a_judge_that_passes_a_broken_element_below_a_tolerance_is_caught(monkeypatch):
    monkeypatch.setattr(wrongs, "wrong_with", with_one_element_inverted)
    ran, program = frames_session("wrong")
    session = dataclasses.replace(ran.session, allowance=cases.Allowance(0.6, 1.0))
    trials = judging.judged(claimed(dataclasses.replace(ran, session=session), ON_TARGET), program)
    assert {trial.outcome for trial in trials} == {"false pass"}


def test_a_frame_that_nobody_radiated_must_not_pass():
    ran, program = frames_session("wrong")
    nobody = [dataclasses.replace(seen, radiated=[]) for seen in ran.frames]
    ran = claimed(dataclasses.replace(ran, frames=nobody), FrameStatus.ON_TARGET)
    assert {trial.outcome for trial in judging.judged(ran, program)} == {"false pass"}


def test_an_error_of_the_judge_is_a_crash_of_that_frame():
    ran, program = frames_session("honest")
    ran.frames[2].verdict = "ValueError: no"
    outcomes = [trial.outcome for trial in judging.judged(ran, program)]
    assert outcomes[2] == "crash"
    assert outcomes.count("crash") == 1


def test_what_a_small_array_cannot_show_must_not_pass():
    """The host is 70 degrees wrong, over four elements: nothing of it can be seen on the axis."""
    session = dataclasses.replace(
        cases.session_of("honest", 0),
        group="wrong",
        layout=layouts.grid(2, 2, 0.010),
        temperature_c=50.0,
        mode="phases",
        frames=[cases.Wanted((cases.Focus((0.0, 0.0, 0.1)),))] * cases.FRAMES,
    )
    ran, program = chain.run_session(dataclasses.replace(session, group="honest"))
    ran = dataclasses.replace(ran, session=session, tags={"host air": -70.0})
    trials = judging.judged(claimed(ran, FrameStatus.ON_TARGET), program)
    assert {trial.outcome for trial in trials} == {"false pass"}
    assert "cannot show" in trials[0].findings[0]


# --- cases -----------------------------------------------------------------------------------


def test_cases_reach_every_size_kind_and_pose():
    sessions = [cases.session_of("honest", seed) for seed in range(600)]
    drawn = [session.layout for session in sessions]
    sides = {side for layout in drawn if layout.grid for side in layout.grid}
    assert sides == set(range(1, 21))
    assert {layout.kind for layout in drawn} == set(layouts.KINDS)
    assert max(layout.count for layout in drawn) == 400
    assert min(np.diff([layout.frame[2] for layout in drawn])[:, 1]) < 0.0  # some face down
    assert {session.mode for session in sessions} == set(cases.MODES)
    frames = [wanted for session in sessions for wanted in session.frames]
    assert {wanted.aperture for wanted in frames} == set(cases.APERTURES)
    assert {len(wanted.foci) for wanted in frames} == set(range(1, 7))
    assert {w.solver for w in frames if len(w.foci) > 1} == set(cases.SOLVERS)
    assert any(session.elements is not None for session in sessions)
    hosts = [session.host for session in sessions if session.allowance is not None]
    assert any(host.scatter_m is not None for host in hosts)
    combined = [h.speed_ratio != 1.0 and h.away_m.any() for h in hosts]
    assert 0.2 < np.mean(combined) < 0.8


def test_every_kind_of_wrong_drive_and_of_fault_is_drawn():
    from haptogram.settings.faults.kinds import FAULT_KINDS

    random = np.random.default_rng(0)
    texts = [wrongs.fault_of(layouts.grid(8, 8, 0.01), random) for _ in range(3000)]
    names = {text.split()[0] for text in texts}
    assert names == set(FAULT_KINDS) - {"device.ok"}  # it undoes others


# --- replay and resume -----------------------------------------------------------------------


def test_a_case_by_itself_is_what_it_was_among_the_others(capsys):
    first = [dataclasses.asdict(t) for t in campaign.trials_of("wrong", 3)]
    assert [dataclasses.asdict(t) for t in campaign.trials_of("wrong", 3)] == first
    status = campaign.main(["--case", first[3]["case"]])
    said = capsys.readouterr().out
    assert f"outcome    {first[3]['outcome']}:" in said
    assert status == (1 if first[3]["outcome"] in judging.BAD else 0)


def test_another_host_of_six_foci_without_a_place_is_no_proof(capsys):
    """A solver makes the drive of a host within the tolerance for one beyond it, too."""
    assert campaign.main(["--case", "honest:4242000044:10"]) == 0
    assert "not verified; no pressure peak with a place of its own" in capsys.readouterr().out


@pytest.mark.parametrize("case", ["", "wrong", "wrong:1", "good:1:2", "wrong:1:99", "wrong:x:1"])
def test_a_case_that_is_none_is_refused(case, capsys):
    with pytest.raises(SystemExit, match=str(campaign.USAGE)):
        campaign.replay(case)
    assert f"ci/trials: --case is {case!r}, must be honest:SEED:FRAME" in capsys.readouterr().err


def test_a_campaign_goes_on_where_it_was_interrupted(tmp_path):
    wanted = {"honest": 24, "wrong": 0}
    whole = tmp_path / "whole.jsonl"
    found = run_all(whole, 3, wanted)
    texts = whole.read_text().splitlines(keepends=True)
    part = tmp_path / "part.jsonl"
    part.write_text("".join(texts[:2]) + texts[2][: len(texts[2]) // 2])
    assert run_all(part, 3, wanted) == found
    kept = part.read_text().splitlines()
    assert kept[:2] == [text.rstrip("\n") for text in texts[:2]]
    assert all(json.loads(text) for text in kept)


def test_a_seed_beyond_those_of_boards_is_refused(capsys):
    with pytest.raises(SystemExit, match=str(campaign.USAGE)):
        campaign.main(["--seed", "4294"])
    assert "'4294' is above 4293" in capsys.readouterr().err


def test_a_file_of_other_trials_is_refused(tmp_path, capsys):
    path = tmp_path / "trials.jsonl"
    campaign.Book(path, 3).close()
    with pytest.raises(SystemExit, match=str(campaign.USAGE)):
        campaign.Book(path, 4)
    assert f"{path} holds other trials: " in capsys.readouterr().err


def test_what_is_done_is_not_run_again(tmp_path, capsys):
    path, page = tmp_path / "trials.jsonl", tmp_path / "trials.md"
    arguments = ["--honest", "8", "--wrong", "0", "--seed", "3", "--resume", str(path)]
    campaign.main([*arguments, "--jobs", "1"])
    before = path.read_text()
    campaign.main([*arguments, "--jobs", "1", "--table", str(page)])
    assert path.read_text() == before
    assert "| **all** | 12 |" in page.read_text()
    assert "**all**" in capsys.readouterr().out


# --- what is told ----------------------------------------------------------------------------


def trial(outcome, case="honest:1:0", **numbers):
    return dataclasses.asdict(judging.Trial(case, "kind", outcome, "-", [], numbers))


def test_none_of_ten_thousand_means_below_three_in_ten_thousand():
    lines = results.summary("honest", [trial("passed")] * 10_000)
    assert "0 of 10000: with 95 % confidence below 0.03 % of such cases" in lines
    assert not any("0 of" in line for line in results.summary("honest", [trial("crash")]))


@pytest.mark.parametrize("outcome", judging.BAD)
def test_one_wrong_verdict_is_one_too_many(outcome):
    good = {"honest": [trial("passed")] * 99, "wrong": [trial("caught", "wrong:1:0")]}
    assert results.is_good(good)
    assert not results.is_good(good | {"wrong": [trial(outcome, "wrong:1:1")]})


def test_silence_about_more_than_two_in_a_hundred_is_too_much():
    silent = trial("not verified", observable=True)
    blind = trial("not verified", observable=False)
    assert results.is_good({"honest": [trial("passed")] * 98 + [silent] * 2, "wrong": []})
    assert not results.is_good({"honest": [trial("passed")] * 97 + [silent] * 3, "wrong": []})
    assert results.is_good({"honest": [trial("passed")] * 50 + [blind] * 50, "wrong": []})


def test_what_a_fault_left_alone_does_not_count():
    assert not results.counted(trial("passed", "wrong:1:0"))
    assert results.counted(trial("passed", "honest:1:0"))
    assert results.counted(trial("lost", "wrong:1:0"))


def test_findings_of_one_kind_come_once_with_what_replays_them():
    trials = [
        trial("passed", f"honest:1:{n}") | {"findings": [f"place is {n}.5 mm"]} for n in "123"
    ]
    first, *examples = results.findings(trials, shown=2)
    assert first == "3 x [passed] place is # mm"
    assert [line.split()[-1] for line in examples] == ["honest:1:1", "honest:1:2"]
