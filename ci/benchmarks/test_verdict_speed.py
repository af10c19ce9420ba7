"""Drives that all differ: their foci and verdicts many at once, and whole verifications."""

import contextlib
import io

import numpy as np
import pytest

from haptogram.acoustics import Drive, Reconstructor, focus_phases
from haptogram.acoustics.reconstruct.warm import DriveToFind
from haptogram.cli import main
from haptogram.records.frame import Evidence, Focus, FrameKey, Intended, Observation
from haptogram.verification import FrameJudge

COUNT = 256
VERIFY = ["verify", "--virtual-time", "--quiet", "--resolution-mm", "4"]


def jittered_frames(board):
    """Frames along a circle, each off it by its own 0.1 mm."""
    angles = np.linspace(0.0, 6.0, COUNT)
    circle = np.column_stack([0.04 * np.cos(angles), 0.04 * np.sin(angles), 0.1 + 0.01 * angles])
    for number, target in enumerate(
        circle + np.random.default_rng(1).normal(0, 1e-4, circle.shape)
    ):
        drive = Drive.from_weights(np.exp(1j * focus_phases(board, target)))
        key = FrameKey.of_stream(1, number)
        yield Intended(number, key, 1000 * number, (Focus.at(target),), drive, 8)


def judged(board, frames, finder, *, at_once):
    judge = FrameJudge(board, carrier_us=25)  # a new one: it would remember the drives
    asked = [DriveToFind(frame.drive, finder.step_rad(frame.drive.phase_bits)) for frame in frames]
    seen = [
        Observation(f.key, f.t_apply_us, False, Evidence.EXTERNAL, f.drive, reconstruction=focus)
        for f, focus in zip(frames, finder.reconstruct_all(asked), strict=True)
    ]
    pairs = list(zip(frames, seen, strict=True))
    verdicts = judge.judge_all(pairs) if at_once else (judge.judge(*pair) for pair in pairs)
    assert all(list(verdicts))


@pytest.mark.row("focus and verdict of 256 distinct drives")
def test_distinct_drives_against_one_by_one(compare, board):
    frames = list(jittered_frames(board))
    some, finder, other = frames[:32], Reconstructor(board), Reconstructor(board)
    vars(other)["_warm"] = None
    compare(
        None,
        lambda: judged(board, frames, finder, at_once=True),
        lambda: judged(board, some, other, at_once=False),
        share=len(some) / COUNT,
    )


@pytest.mark.row("verification in virtual time, 1041 distinct drives")
def test_verify_distinct_drives(measure, board):
    # So few frames take what is compiled already.
    judged(board, list(jittered_frames(board))[:2], Reconstructor(board), at_once=True)

    def verify():
        with contextlib.redirect_stdout(io.StringIO()) as said:
            assert main(VERIFY) == 0, said.getvalue()

    measure(verify, repeats=1)
