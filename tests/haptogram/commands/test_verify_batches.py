"""``haptogram verify --virtual-time``: how many frames go at a time changes no byte."""

import shlex

import pytest

from haptogram.acoustics.reconstruct import reconstruction
from haptogram.cli import main
from haptogram.verification.frame import judge
from sim_device.backdoor import recorder

JOB = (
    "verify --virtual-time --quiet --object circle --array 8x8 --resolution-mm 12 --repeat 2 "
    "--fault 'line.flip ber=2e-4' --fault 'device.dead transducer=9 from=10ms'"
)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("mode", ["phases", "sequence"])
def test_the_result_does_not_depend_on_how_many_go_at_a_time(tmp_path, monkeypatch, mode):
    results = []
    for size in (512, 1, 7):
        for module in (reconstruction, recorder, judge):
            monkeypatch.setattr(module, "_AT_ONCE", size)
        files = [tmp_path / f"{size}.json", tmp_path / f"{size}.jsonl"]
        words = [*shlex.split(JOB), "--mode", mode, f"--json={files[0]}", f"--frames={files[1]}"]
        main(words)
        results.append([file.read_bytes() for file in files])
    assert results[0] == results[1] == results[2]
    assert b"wrong drive" in results[0][0] or b"lost" in results[0][0]
