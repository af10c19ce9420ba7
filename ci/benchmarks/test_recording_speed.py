"""A recording: what one frame costs, beside the board that does not record."""

import pytest
from board_at_hand import BoardAtHand
from test_wire_speed import CONTENTS

from haptogram.evidence.recordings.writer import RecordingWriter
from haptogram_protocol.cobs import fastest_cobs

GOAL = 0.7  # share of the time of a board step that a recorded one leaves


class RecordedBoard(BoardAtHand):
    """A board that is given a frame every millisecond; with a writer it is recorded."""

    def __init__(self, writer=None):
        super().__init__(fastest_cobs())
        self.writer = writer

    def show(self, message):
        simulation = self.simulation
        self.latches.clear()
        _, wire = self.host.stream_frame(message, t_apply_us=None)
        simulation.host_write(wire, simulation.now_ns)
        sent_ns = simulation.now_ns
        simulation.advance_to(sent_ns + 1_000_000)
        if self.writer is not None:
            self.writer.to_board(sent_ns, wire)
            self.writer.latch(self.latches[-1].record())
        return self.latches[-1]


@pytest.mark.row("board step, phases, recorded")
def test_recorded_board_step_against_one_that_is_not(compare, tmp_path):
    """A frame of 256 phases to its latch: bytes and latch written, and flushed every 50 frames."""
    with RecordingWriter(tmp_path / "run.mcap") as writer:
        recorded = RecordedBoard(writer).armed()
        plain = RecordedBoard().armed()
        frame = CONTENTS["random"]
        compare(GOAL, lambda: recorded.show(frame), lambda: plain.show(frame), repeats=20,
                reference_repeats=20)  # fmt: skip
        assert not writer.failure


@pytest.mark.row("recording of a frame and its latch")
def test_writing(measure, tmp_path):
    """The writer alone: 276 bytes and a latch of 256 elements."""
    frame = CONTENTS["random"]
    board = BoardAtHand(fastest_cobs()).armed()
    latch = board.show(frame).record()
    with RecordingWriter(tmp_path / "run.mcap") as writer:
        t_ns = 0

        def write():
            nonlocal t_ns
            t_ns += 1_000_000
            writer.to_board(t_ns, bytes(276))
            writer.latch(latch)

        measure(write, repeats=100)
