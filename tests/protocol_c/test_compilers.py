"""Codec and reference board under every C compiler of this machine, optimised and checked."""

import shutil

import pytest

from protocol_c.building import compilers, make, run
from protocol_vectors.vector_files import play, vectors
from vector_recorder.boards import CBoard


@pytest.fixture(scope="module", params=["gcc", "clang"])
def built(request, tmp_path_factory):
    """Every program as a user builds it, by one of the compilers."""
    if request.param not in compilers():
        pytest.skip(f"not run: no C compiler {request.param}")
    folder = tmp_path_factory.mktemp(request.param)
    status, output = make(folder, "all", CC=request.param, CFLAGS="-O1")
    assert (status, output) == (0, ""), output
    return folder


@pytest.mark.sampled(1)
def test_the_board_answers_as_every_dialogue_says(built):
    board = CBoard(built)
    for dialogue in vectors("dialogues.json"):
        board.reset()
        assert play(dialogue, board) == [], dialogue["id"]
    board.close()


def test_bad_input_is_survived(built):
    assert run(built / "fuzz", 300, 3) == (0, "300 inputs\n")


def test_the_fuzzer_guided_by_coverage_finds_nothing_in_a_bounded_number_of_inputs(tmp_path):
    if not shutil.which("clang"):
        pytest.skip("not run: no clang")
    status, output = make(tmp_path, "fuzzer")
    assert status == 0, output
    (tmp_path / "corpus").mkdir()
    limits = ("-runs=500", "-seed=1", "-max_len=6000", f"-artifact_prefix={tmp_path}/")
    status, output = run(tmp_path / "fuzzer", *limits, tmp_path / "corpus")
    assert status == 0, output
    assert "Done 500 runs" in output
