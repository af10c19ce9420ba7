"""The virtual board: one frame to its latch, and a whole verification in virtual time."""

import contextlib
import io

import pytest
from board_at_hand import BoardAtHand
from test_wire_speed import CONTENTS

from haptogram.cli import main
from haptogram_protocol.cobs import fastest_cobs
from haptogram_protocol.messages import FocalPoint, Points

FRAMES = {
    "phases": CONTENTS["random"],
    "phases and amplitudes": CONTENTS["muted"],
    "focal point": Points((FocalPoint(12_345, -23_456, 150_000, 65_535, 0),)),
}
CIRCLE = ["--object", "circle", "--radius-mm", "20", "--resolution-mm", "5"]
VERIFY = ["verify", "--virtual-time", "--quiet", *CIRCLE]


@pytest.mark.row("board step, {frame}")
@pytest.mark.parametrize("frame", FRAMES)
def test_board_step(frame, measure):
    """From the bytes of one frame to the latch: line, connection, dialect, queue and output."""
    board = BoardAtHand(fastest_cobs()).armed()
    first = board.show(FRAMES[frame])
    assert board.show(FRAMES[frame]).t_latch_us > first.t_latch_us
    measure(lambda: board.show(FRAMES[frame]))


@pytest.mark.row("verification in virtual time, {mode}")
@pytest.mark.parametrize("mode", ["phases", "sequence"])
def test_verify_in_virtual_time(mode, measure):
    """The main job, for a circle of 26 points: driver, board, verdict and report."""

    def verify():
        with contextlib.redirect_stdout(io.StringIO()) as said:
            status = main([*VERIFY, "--mode", mode])
        assert status == 0, said.getvalue()

    measure(verify, repeats=1)
