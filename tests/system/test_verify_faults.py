"""Faults on purpose, through the whole chain: the summary tells millimetres, pascals and frames."""

from __future__ import annotations

import json
import random
from pathlib import Path
from typing import Any

import pytest

from haptogram.cli import main
from haptogram.settings.faults.kinds import FAULT_KINDS, PLACES, Parameter, fault_words
from sim_device.simulation import Simulation

_CIRCLE = ["--object", "circle", "--radius-mm", "20", "--resolution-mm", "2", "--quiet"]
_FEW = ["--resolution-mm", "20"]
_IN_VIRTUAL_TIME = [*_CIRCLE, "--virtual-time", "--seed", "1"]


def _faulty(words: list[str], *faults: str) -> list[str]:
    return ["verify", *words, *(f"--fault={fault}" for fault in faults)]


def _result(tmp_path: Path, words: list[str]) -> dict[str, Any]:
    path = tmp_path / "result.json"
    main([*words, "--json", str(path)])
    result: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return result


def test_lost_frames_are_told_in_milliseconds_millimetres_and_pascals(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = _faulty([*_IN_VIRTUAL_TIME, "--repeat", "2"], "line.drop p=1e-4 from=10ms")
    result = _result(tmp_path, words)
    said = capsys.readouterr().out
    lost = result["frames"]["lost"]
    assert lost > 0
    assert result["faults"]["plan"] == ["line.drop p=1e-4 from=10ms"]
    assert result["faults"]["seed"] == 1
    assert result["faults"]["fired"]["line.drop"] >= lost
    assert result["configuration"]["fault"] == result["faults"]["plan"]
    assert result["effect"]["away_ms"] == pytest.approx(lost)
    assert 1.5 < result["effect"]["farthest_mm"] < 5.0
    assert result["troubles"]["board"]["gap"] == lost
    assert f"not as intended for {lost}.0 ms" in said
    assert f"faults on purpose: line.drop {result['faults']['fired']['line.drop']} times" in said


def test_a_run_with_faults_repeats_byte_for_byte(tmp_path: Path) -> None:
    words = _faulty(
        [*_IN_VIRTUAL_TIME, *_FEW], "line.flip ber=1e-4", "device.intermittent column=3"
    )
    assert _result(tmp_path, words) == _result(tmp_path, words)


def test_a_stuck_column_is_named_with_what_it_costs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    result = _result(tmp_path, _faulty([*_IN_VIRTUAL_TIME, *_FEW], "device.stuck column=3"))
    assert "column 3 stuck at phase 0, at the output" in capsys.readouterr().out
    effect = result["effect"]
    assert 0.05 < effect["farthest_mm"] < 2.0
    pressure = effect["pressure_rms_pa"]
    # One of 16 columns works for or against the others: 2/16 at the most.
    assert 0.87 < pressure["radiated"] / pressure["intended"] < 1.0


def test_a_delayed_column_is_named_as_a_column(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(_faulty([*_IN_VIRTUAL_TIME, *_FEW], "device.delayed column=3")) == 1
    assert "column 3 off by +64 LSB, at the output" in capsys.readouterr().out


@pytest.mark.nightly
def test_the_report_shows_the_plan_and_how_often_it_fired(tmp_path: Path) -> None:
    page, junit = tmp_path / "page.html", tmp_path / "result.xml"
    faults = ("device.dead transducer=5", "line.drop p=2e-3 from=10ms")
    words = _faulty([*_IN_VIRTUAL_TIME, *_FEW], *faults)
    main([*words, "--html", str(page), "--junit", str(junit)])
    html = page.read_text(encoding="utf-8")
    assert "device.dead transducer=5" in html
    assert "Faults on purpose" in html
    assert "Damage on the line" in html
    assert "faults.fired.device.dead" in junit.read_text(encoding="utf-8")
    assert faults[1] in junit.read_text(encoding="utf-8")


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--fault", "line.magic"], "'line.magic' is no fault; did you mean"),
        (["--fault", "line.flip speed=3"], "'speed'"),
        (["--virtual-time", "--fault", "device.dead column=99"], "column"),
        (["--port", "/dev/absent", "--fault", "line.flip"], "--fault is for the virtual board"),
        (["--repeat", "1000000"], "a run keeps them all, and can have 200000"),
    ],
)
def test_what_cannot_be_is_refused_before_anything_starts(
    words: list[str], told: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["verify", *_CIRCLE, *words]) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert told in said.err
    assert said.err.count("\n") == 1


def test_a_board_inside_the_program_is_a_port_like_any_other(tmp_path: Path) -> None:
    url = "haptogram://?clock=virtual&seed=5&baud=3000000&fault=line.drop+p=1e-3+from=10ms+direction=up"
    result = _result(tmp_path, ["verify", *_CIRCLE, "--port", url, "--min-verified", "0.5"])
    assert result["evidence"] == "self-reported"
    assert "faults" not in result  # the port has them, and does not say
    # A trace event that the line lost is not a frame that the board lost.
    assert result["frames"]["not_verified"] > 0
    assert result["frames"]["lost"] == 0


def test_virtual_time_in_a_file_can_be_undone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "run.toml"
    path.write_text('[verify]\nvirtual_time = true\nfault = ["line.drop p=0"]\n')
    words = [*_CIRCLE, "--config", str(path), "--port", "/dev/absent"]
    assert main(["verify", *words]) == 2
    assert "virtual_time runs on the board inside this program" in capsys.readouterr().err
    assert main(["verify", *words, "--no-virtual-time"]) == 2
    assert "fault is for the virtual board" in capsys.readouterr().err


@pytest.mark.parametrize("fault", ["line.drop p=1", "line.flip ber=0.5"])
def test_a_line_that_breaks_for_good_ends_the_run_with_what_was_seen(
    fault: str, tmp_path: Path
) -> None:
    result = _result(tmp_path, _faulty([*_IN_VIRTUAL_TIME], f"{fault} from=50ms"))
    assert result["verdict"] == "inconclusive"
    assert result["cut_short"] == (
        "virtual board, in virtual time: PING was sent 5 times and not answered"
    )
    assert result["frames"]["verified"] > 10
    assert any("did not confirm that it is mute" in warning for warning in result["warnings"])


def test_noise_from_power_up_on_does_not_keep_the_session_from_coming_up(tmp_path: Path) -> None:
    for seed in ("1", "2", "3"):
        words = ["verify", "--quiet", "--object", "point", "--virtual-time", "--seed", seed]
        result = _result(tmp_path, [*words, "--fault", "line.flip ber=3e-4"])
        assert result["frames"]["sent"] == 1


def test_a_board_that_is_unplugged_still_latches_what_it_was_sent(tmp_path: Path) -> None:
    result = _result(tmp_path, _faulty(_IN_VIRTUAL_TIME, "line.disconnect from=50ms"))
    assert result["verdict"] == "inconclusive"
    assert result["cut_short"].endswith("unplugged, by line.disconnect")
    frames = result["frames"]
    assert 30 < frames["sent"] < 63
    assert frames["lost"] <= 1  # the one that was on the line


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    "virtual", [True, pytest.param(False, marks=pytest.mark.pty)], ids=["virtual time", "pty"]
)
def test_a_plan_in_a_file_is_that_of_the_board(tmp_path: Path, virtual: bool) -> None:
    plan = tmp_path / "plan.toml"
    plan.write_text('seed = 7\n\n[[fault]]\nname = "device.stuck"\ncolumn = 3\n', encoding="utf-8")
    words = ["--virtual-time"] if virtual else []
    more = ["--fault-plan", str(plan), "--rate-hz", "100"]
    result = _result(
        tmp_path, _faulty([*_CIRCLE, *_FEW, *words, *more], "device.dead transducer=9")
    )
    assert result["faults"]["plan"] == ["device.stuck column=3", "device.dead transducer=9"]
    assert result["faults"]["seed"] == 7
    assert set(result["faults"]["fired"]) == {"device.stuck", "device.dead"}
    assert result["configuration"]["fault_plan"] == str(plan)
    assert result["frames"]["wrong_drive"] > 0


def test_a_plan_is_read_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    plan = tmp_path / "plan.toml"
    plan.write_text('[[fault]]\nname = "device.stuck"\ncolumn = 3\n', encoding="utf-8")
    reads, opened = [], Path.open

    def counting(path: Path, *words: Any, **named: Any) -> Any:
        reads.append(path)
        return opened(path, *words, **named)

    monkeypatch.setattr(Path, "open", counting)
    _result(tmp_path, [*_faulty([*_IN_VIRTUAL_TIME, *_FEW]), "--fault-plan", str(plan)])
    assert reads.count(plan) == 1


def test_a_plan_that_cannot_be_read_is_told_before_anything_starts(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    absent = tmp_path / "absent.toml"
    assert main(["verify", "--fault-plan", str(absent)]) == 2
    told = f"--fault-plan '{absent}' cannot be read: there is no such file"
    assert capsys.readouterr().err == f"haptogram verify: {told}\n"


# --- what a plan does is never an error of usage -------------------------------------------------

_SMALL = ["--array", "8x8", "--object", "circle", "--radius-mm", "10", "--resolution-mm", "5"]
_JOB = [*_SMALL, "--center-mm", "0,0,80", "--seed", "1", "--quiet"]
_HARD = {
    "line.flip": "ber=0.2",
    "line.baud": "ppm=150000",
    "line.half_open": "",
    "line.disconnect": "ms=60000",
    "line.delay": "us=5e6",
    "line.slice": "bytes=1 gap_us=1e5",
    "line.coalesce": "us=4e6",
    "line.batch": "ms=4000",
}
_TO_THE_LINE = [name for name in FAULT_KINDS if name.startswith(("line.", "frame."))]


def _hard(name: str) -> str:
    return f"{name} {_HARD.get(name, 'p=0.9')}".strip()


def _run(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    words: list[str],
    *,
    with_page: bool = False,
) -> tuple[int, str, dict[str, Any] | None]:
    """Return exit status, what was said to the user, and the result, if there is one.

    All files are there, or none.
    """
    names = {"--json": "a.json", "--junit": "a.xml"} | ({"--html": "a.html"} if with_page else {})
    files = {option: tmp_path / name for option, name in names.items()}
    for path in files.values():
        path.unlink(missing_ok=True)
    given = [word for option, path in files.items() for word in (option, str(path))]
    status = main([*words, *given])
    said = capsys.readouterr()
    assert "Traceback" not in said.err
    assert len({path.exists() for path in files.values()}) == 1
    is_told = files["--json"].exists()
    result = json.loads(files["--json"].read_text(encoding="utf-8")) if is_told else None
    return status, said.out if is_told else said.err, result


@pytest.mark.sampled(4)
@pytest.mark.parametrize("name", _TO_THE_LINE)
def test_a_hard_fault_from_power_up_on_is_inconclusive_or_loses_frames(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = _faulty([*_JOB, "--virtual-time"], _hard(name))
    status, said, result = _run(tmp_path, capsys, words)
    assert status in (0, 1, 3)
    assert f"{name} " in said
    assert status != 1 or " lost by the board" in said
    if result is None:
        assert status == 3
        assert said.startswith("haptogram verify: inconclusive: the fault plan broke the session (")
        assert "another device" not in said
        assert said.endswith("seed 1\n")
        assert said.count("\n") == 1
    else:
        assert result["faults"]["fired"][name] > 0


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", _TO_THE_LINE)
def test_a_hard_fault_in_mid_run_leaves_what_was_measured(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = _faulty([*_JOB, "--virtual-time", "--repeat", "8"], f"{_hard(name)} from=60ms")
    with_page = name in ("line.drop", "line.disconnect", "frame.crc")
    status, said, result = _run(tmp_path, capsys, words, with_page=with_page)
    assert status in (0, 1, 3)
    # frame.sequence: one in place of another
    assert status != 1 or " lost by the board" in said or name == "frame.sequence"
    assert result is not None
    assert result["faults"]["fired"][name] > 0
    assert f"faults on purpose: {name} " in said
    assert result["frames"]["verified"] > 10


@pytest.mark.nightly
@pytest.mark.pty
@pytest.mark.parametrize("fault", ["line.drop p=0.3", "line.half_open", "line.disconnect ms=60000"])
def test_over_a_pty_the_plan_is_blamed_too(
    fault: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    status, said, result = _run(tmp_path, capsys, _faulty(_JOB, fault))
    assert (status, result) == (3, None)
    assert "the fault plan broke the session (" in said
    assert f"faults on purpose: {fault.split()[0]} " in said


def test_in_a_url_the_plan_is_blamed_too(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    url = "haptogram://?clock=virtual&fault=line.half_open"
    status, said, _ = _run(tmp_path, capsys, ["verify", *_SMALL, "--quiet", "--port", url])
    assert status == 3
    assert "faults on purpose: line.half_open; the board did not report how often" in said


@pytest.mark.parametrize("fault", ["line.drop p=0", "line.half_open from=9s", ""])
def test_a_plan_that_did_nothing_is_not_blamed(
    fault: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    read = Simulation.host_read

    def silent(simulation: Simulation, *_: object) -> bytes:
        read(simulation)  # and the bytes are lost
        return b""

    monkeypatch.setattr(Simulation, "host_read", silent)
    words = [*_JOB, "--virtual-time"]
    assert main(_faulty(words, *([fault] if fault else []))) == 2
    said = capsys.readouterr().err
    assert said == (
        "haptogram verify: virtual board, in virtual time: nothing came back within 2 s\n"
    )


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    ("fault", "count"),
    [
        ("clock.offset us=50", 1),
        ("clock.offset us=0", 0),
        ("clock.wrap us=120000", 1),
        ("clock.wrap us=20000000", 0),
        ("clock.ppm ppm=-100", 1),
        ("clock.step us=300 from=110ms", 1),
        ("clock.step us=300 from=20s", 0),
    ],
)
def test_the_result_counts_what_the_clock_did(fault: str, count: int, tmp_path: Path) -> None:
    name, *_ = fault.split()
    result = _result(tmp_path, _faulty([*_JOB, "--virtual-time"], fault))
    assert result["faults"]["fired"] == {name: count}
    twice = [fault, fault] if name != "clock.wrap" else [fault]
    result = _result(tmp_path, _faulty([*_JOB, "--virtual-time"], *twice))
    assert result["faults"]["fired"] == {name: count * len(twice)}


# --- plans at random ------------------------------------------------------------------------------

_TIMES_MS = (0, 5, 10, 50, 100, 110, 120)


def _value(limits: Parameter, source: random.Random) -> float:
    drawn = source.choice([limits.default, limits.least, limits.most, 10 ** source.uniform(-5, 6)])
    value = min(max(drawn, limits.least), limits.most)
    return round(value) if limits.whole else value


def _at_random(source: random.Random) -> str:
    name = source.choice(list(FAULT_KINDS))
    kind, known = FAULT_KINDS[name], fault_words(name)
    numbers = [key for key in kind if key not in PLACES and source.random() < 0.7]
    words = [f"{key}={_value(kind[key], source)!r}" for key in numbers]
    if PLACES[0] in kind:
        words.append(source.choice(["transducer=7", "column=2", "bank=0"]))
    from_ms = source.choice(_TIMES_MS)
    if "from" in known:
        words.append(f"from={from_ms}ms")
        if "until" in known and "ms" not in numbers and source.random() < 0.5:
            words.append(f"until={from_ms + source.choice([1, 20, 100])}ms")
    if "direction" in known and source.random() < 0.5:
        words.append(f"direction={source.choice(['up', 'down'])}")
    return " ".join([name, *words])


@pytest.mark.sampled(4)
@pytest.mark.parametrize("seed", range(15))
def test_no_plan_at_random_breaks_the_program(
    seed: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = random.Random(seed)
    plan = [_at_random(source) for _ in range(source.choice([1, 2, 3]))]
    plan = [f for k, f in enumerate(plan) if f.split()[0] not in {g.split()[0] for g in plan[:k]}]
    status, said, result = _run(tmp_path, capsys, _faulty([*_JOB, "--virtual-time"], *plan))
    assert status in (0, 1, 3), plan
    if result is None:
        assert "the fault plan broke the session (" in said, plan
        return
    fired = result["faults"]["fired"]
    assert set(fired) == {fault.split()[0] for fault in plan}
    assert all(count >= 0 for count in fired.values())
    if not any(fired.values()):
        assert result["verdict"] == "pass", plan
