"""ci/fuzz where atheris is missing, and what it demands of any bytes."""

import importlib.util
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptogram_protocol.connection import BoardConnection

ROOT = Path(__file__).resolve().parent.parent


def load():
    spec = importlib.util.spec_from_file_location("fuzz_decoder", ROOT / "ci" / "fuzz_decoder.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


FUZZ = load()


@pytest.mark.parametrize(
    ("words", "told"),
    [([], "ci/fuzz: atheris is not installed"), (["ten"], "usage: ci/fuzz [INPUTS [SEED]]")],
)
def test_it_says_what_is_missing(tmp_path, words, told):
    # Another atheris comes first, and is none.
    (tmp_path / "atheris.py").write_text("raise ImportError")
    command = [sys.executable, str(ROOT / "ci" / "fuzz_decoder.py"), *words]
    done = subprocess.run(
        command, env={"PYTHONPATH": str(tmp_path)}, capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith(told)


@given(st.binary(max_size=200))
def test_what_it_demands_holds(data):
    FUZZ.check(data)


def test_it_finds_a_frame_that_is_not_counted(monkeypatch):
    monkeypatch.setattr(BoardConnection, "count", lambda *_: None)
    with pytest.raises(AssertionError):
        FUZZ.check(b"\x01" + bytes(10))
