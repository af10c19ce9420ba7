from __future__ import annotations

import importlib.metadata
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from haptogram.acoustics import AcousticModel
from haptogram.errors import ConfigurationError
from haptogram.report.run import result as report
from haptogram.report.run import wording
from haptogram.verification import Cut, RunVerdict, Verdict
from judged_runs import lose, make_result, make_run, targets


def test_the_same_run_gives_the_same_bytes(tmp_path: Path, model: AcousticModel) -> None:
    for name in ("first", "second"):
        run = make_run(model, targets(4), {2: lose})
        report.write_run_json(tmp_path / name, make_result(run))
    first, second = ((tmp_path / name).read_bytes() for name in ("first", "second"))
    assert first == second
    assert first.endswith(b"}\n")


def test_the_file_holds_what_the_result_says(tmp_path: Path, good_run: RunVerdict) -> None:
    result = make_result(good_run, warnings=["port '\udc80\u2028<b>' is odd"])
    report.write_run_json(tmp_path / "result.json", result)
    read = json.loads((tmp_path / "result.json").read_text(encoding="utf-8"))
    assert read == result
    assert next(iter(read.items())) == ("format", 2)
    assert read["verdict"] == "pass"
    assert read["frames"]["verified"] == read["frames"]["sent"] == 12
    assert read["seed"] == 7


def test_in_virtual_time_the_result_knows_neither_when_nor_where(good_run: RunVerdict) -> None:
    assert not {"host", "environment"} & set(make_result(good_run))


def test_on_the_wall_clock_it_tells_the_versions(good_run: RunVerdict) -> None:
    result = make_result(good_run, host={"sent": 12}, environment=report.run_environment())
    assert result["environment"]["numpy"] == np.__version__
    assert result["environment"]["pyserial"] == importlib.metadata.version("pyserial")
    assert result["host"] == {"sent": 12}


def test_a_package_without_metadata_has_no_version(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def missing(name: str) -> str:
        raise importlib.metadata.PackageNotFoundError(name)

    monkeypatch.setattr(importlib.metadata, "version", missing)
    assert report.run_environment()["scipy"] is None


@pytest.mark.parametrize(("source", "known"), [(None, True), ("run.mcap", False)])
def test_the_options_beside_a_recording_are_not_shown_as_those_of_its_run(
    good_run: RunVerdict, model: AcousticModel, source: str | None, known: bool
) -> None:
    options = {"object": "circle", "center_mm": (0.0, 0.0, 100.0), "baud": 3_000_000}
    result = make_result(
        good_run,
        configuration=options | {"mode": "phases", "from_recording": source},
        board={"is": "the board"},
    )
    rows = dict(wording.run_tested_rows(result, model))
    assert rows["link"] == "the board" + ", 3000000 Bd" * known
    assert ("object" in rows) == ("frames" in rows) == known


def test_every_value_becomes_one_that_json_knows(good_run: RunVerdict) -> None:
    odd = {
        "nan": float("nan"),
        "numpy": np.float64("inf"),
        "whole": np.int64(3),
        "flag": np.bool_(True),
        "row": np.arange(2),
        "names": {"b", "a"},
        "path": Path("x"),
        "verdict": Verdict.PASS,
        5: (1, 2),
    }
    assert make_result(good_run, board=odd)["board"] == {
        "nan": None,
        "numpy": None,
        "whole": 3,
        "flag": True,
        "row": [0, 1],
        "names": ["a", "b"],
        "path": "x",
        "verdict": "pass",
        "5": [1, 2],
    }


def test_nan_is_never_written(tmp_path: Path) -> None:
    report.write_run_json(tmp_path / "result.json", {"value": float("nan")})
    assert (tmp_path / "result.json").read_bytes() == b'{\n  "value": null\n}\n'


def test_a_run_that_was_cut_short_does_not_pass(model: AcousticModel) -> None:
    why = "interrupted after 2 frames"
    result = make_result(make_run(model, targets(2), cut=Cut(why)), cut_short=why)
    assert result["verdict"] == "inconclusive"
    assert result["cut_short"] == why
    assert why in result["reasons"]


def test_a_pass_that_was_cut_short_is_refused(good_run: RunVerdict) -> None:
    with pytest.raises(ValueError, match="cannot pass"):
        make_result(good_run, cut_short="interrupted")


def test_a_path_that_cannot_be_written_is_named(tmp_path: Path, good_run: RunVerdict) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(ConfigurationError, match=r"file/result\.json"):
        report.write_run_json(tmp_path / "file" / "result.json", make_result(good_run))


def test_a_host_that_was_held_up_says_so(model: AcousticModel) -> None:
    run = make_run(model, targets(3), held_up=[1])
    host = {"tick_lateness_us_max": 2_003_000.0}
    result = make_result(run, host=host)
    said = "this machine, not the board, was held up, its loop by up to 2003 ms (1 frame: the host"
    (line,) = wording.run_faults_wording(result)
    assert line.startswith(f"host: {said} ")
    assert any(said[1:] in sentence for sentence in wording.run_summary_sentences(result))
    lost = make_result(make_run(model, targets(3), {1: lose}), host=host)
    assert list(wording.run_faults_wording(lost)) == []


def test_a_run_that_a_busy_machine_left_inconclusive_says_what_to_do(model: AcousticModel) -> None:
    run = make_run(model, targets(3), held_up=[0, 1], min_verified=0.9)
    host = {"tick_lateness_us_max": 101_000.0}
    virtual, real = {"port": None}, {"port": "/dev/ttyACM0"}

    def told(**result: Any) -> list[str]:
        lines = wording.run_faults_wording(make_result(run, **result))
        return [line for line in lines if line.startswith("to do: ")]

    assert told(host=host, configuration=real) == [
        "to do: run it again while this machine has less to do, with a longer --lead-ms or at a "
        "lower --rate-hz"
    ]
    (line,) = told(host=host, configuration=virtual)
    assert line.endswith("; with --virtual-time its load does not count")
    sentences = wording.run_summary_sentences(make_result(run, host=host))
    assert any(sentence.startswith("run it again while ") for sentence in sentences)
    assert told(configuration=virtual) == []  # in virtual time nothing is held up
    planned = {"plan": ["line.drop p=1"], "seed": 0, "fired": None}
    assert told(host=host, configuration=virtual, faults=planned) == []
