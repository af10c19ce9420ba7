"""The view of recordings: of a judged run, of a board, and of what is none."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from haptogram.cli import main
from haptogram.errors import ConfigurationError
from haptogram.evidence.recordings.writer import RecordingWriter
from haptogram.report.viewer.frames import STATUSES
from haptogram.report.viewer.recorded import RecordedScene, viewer_scene_of_recording
from haptogram.report.viewer.scene import ViewerScene

from .test_scene import unpack

pytest.importorskip("mcap")


def scene_and_lead(recorded: RecordedScene) -> tuple[ViewerScene, list[str]]:
    return recorded.scene, recorded.lead


SMALL = ["--virtual-time", "--array", "6x6", "--object", "circle", "--quiet"]


def test_verdicts_of_a_run_are_shown(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    main(["verify", *SMALL, "--fault", "line.flip ber=3e-4", "--record", str(path)])
    assert viewer_scene_of_recording(path).verdict == "fail"
    scene, lead = scene_and_lead(viewer_scene_of_recording(path))
    header, columns = unpack(scene.pack())
    statuses = [STATUSES[code] for code in columns["status"]]
    assert {"on target", "lost"} <= set(statuses)
    lost = np.array([status == "lost" for status in statuses])
    np.testing.assert_array_equal(columns["seen"], ~lost)
    found, target = columns["found_mm"][~lost], columns["target_mm"][~lost]
    np.testing.assert_allclose(found, target, atol=1.0)
    assert header["counters"]["lost"] == lost.sum()
    numbers = columns["number"][lost].tolist()
    assert list(header["texts"]) == [str(number) for number in numbers]
    assert all("lost" in text for text in header["texts"].values())
    assert lead[0] == f"verify: 36 transducers, {len(statuses)} judged frames."
    assert re.fullmatch(r"Recorded with haptogram \S+, python \S+\.", lead[1])


def test_recording_that_was_cut_off_is_shown_as_far_as_it_goes(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    main(["verify", *SMALL, "--record", str(path)])
    whole = unpack(viewer_scene_of_recording(path).scene.pack())[1]
    content = path.read_bytes()
    shown = []
    for tenths in range(2, 10):
        path.write_bytes(content[: len(content) * tenths // 10])
        scene, lead = scene_and_lead(viewer_scene_of_recording(path))
        shown.append(len(unpack(scene.pack())[1]["number"]))
        assert lead[-1] == "The recording was cut off."
    assert shown == sorted(shown)
    assert 0 < shown[-1] <= len(whole["number"])


def test_no_more_drives_are_kept_than_frames_are_shown(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "run.mcap"
    main(["verify", *SMALL, "--record", str(path)])
    whole = unpack(viewer_scene_of_recording(path).scene.pack())[1]
    monkeypatch.setattr("haptogram.report.viewer.recorded._MOST_FRAMES", 5)
    scene, lead = scene_and_lead(viewer_scene_of_recording(path))
    first = unpack(scene.pack())[1]
    np.testing.assert_array_equal(first["phases"], whole["phases"][:5])
    assert lead[0] == "verify: 36 transducers, 5 judged frames, the first 5 of run.mcap."


@pytest.fixture(scope="module")
def at_a_port(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run on a board at a port, whose recording has bytes and verdicts, and no back door."""
    path = tmp_path_factory.mktemp("port") / "run.mcap"
    port = ["--port", "haptogram://?array=6x6&clock=virtual&seed=3"]
    assert main(["verify", *port, "--object", "circle", "--quiet", "--record", str(path)]) == 0
    return path


def test_a_recording_of_a_port_shows_verdicts_and_the_drives_that_were_sent(
    at_a_port: Path, tmp_path: Path
) -> None:
    seen = tmp_path / "seen.mcap"
    main(["verify", *SMALL, "--record", str(seen)])
    scene, lead = scene_and_lead(viewer_scene_of_recording(at_a_port))
    header, columns = unpack(scene.pack())
    expected = unpack(viewer_scene_of_recording(seen).scene.pack())[1]
    for name in ("phases", "amplitudes", "positions_mm", "target_mm", "status"):
        np.testing.assert_array_equal(columns[name], expected[name])
    assert header["counters"] == {"on target": len(columns["number"])}
    assert lead[0].startswith(f"verify: 36 transducers, {len(columns['number'])} judged frames. D")
    assert lead[0].endswith("nobody recorded what was radiated.")


def test_frames_of_a_port_that_nobody_judged_are_those_that_were_sent(
    at_a_port: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    judged = unpack(viewer_scene_of_recording(at_a_port).scene.pack())[1]
    monkeypatch.setattr("haptogram.report.viewer.recorded.VERDICT", "/none")
    scene, lead = scene_and_lead(viewer_scene_of_recording(at_a_port))
    header, columns = unpack(scene.pack())
    assert header["counters"] == {"sent": len(judged["number"])}
    np.testing.assert_array_equal(columns["phases"], judged["phases"])
    np.testing.assert_array_equal(np.diff(columns["due_us"]), np.diff(judged["due_us"]))
    np.testing.assert_allclose(columns["found_mm"], judged["target_mm"], atol=1.0)
    assert header["texts"] == {}
    assert " frames. Drives are those that the host sent" in lead[0]


def test_a_recording_that_does_not_tell_the_array_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with RecordingWriter(path) as writer:
        writer.to_board(0, b"frames of somebody")
    with pytest.raises(ConfigurationError, match="neither a record of its board nor an answer"):
        viewer_scene_of_recording(path)


def test_what_is_no_recording_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    path.write_bytes(b"nothing of the kind")
    with pytest.raises(ConfigurationError) as refused:
        viewer_scene_of_recording(path)
    assert str(path) in str(refused.value)
    assert main(["view", str(path), "--html", str(tmp_path / "page.html")]) == 2
    assert not (tmp_path / "page.html").exists()
