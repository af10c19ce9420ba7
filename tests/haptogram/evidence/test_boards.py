"""A board at a port, judged by what it shows: which trace is asked for, and what it leaves out."""

from __future__ import annotations

import pytest

from haptogram.cli.boards import board_in_virtual_time
from haptogram.commands.verify.boards import baud_of_verified_port
from haptogram.evidence.boards import PortBoardUnderTest
from haptogram.evidence.run_record import RunRecord, measure_run
from haptogram.records.frame import Evidence
from haptogram.settings.run.verify import VerifyConfig
from haptogram.verification import RunVerdict
from haptogram_protocol.messages import Feature
from sim_device.board.settings import ALL_FEATURES
from virtual_ports import BAUD, BoardPort

CONFIG = VerifyConfig.of(object="circle", radius_mm=20, resolution_mm=2, seed=3)  # 63 frames
TRACES = Feature.TRACE | Feature.TRACE_DRIVE | Feature.TRACE_RING


def run_on(port: BoardPort) -> tuple[RunRecord, RunVerdict]:
    """Run the job on *port*, and judge it by the board's own word."""
    board = PortBoardUnderTest("virtual://", baudrate=BAUD, rate_hz=1000, board_computes=False)
    board.port = port
    found = measure_run(CONFIG, board, None)
    return found, found.verdict()


@pytest.mark.parametrize("trace", [Feature.TRACE, Feature.TRACE_RING])
def test_any_one_trace_is_enough(trace: Feature) -> None:
    found, run = run_on(BoardPort(features=(ALL_FEATURES ^ TRACES) | trace, trace_ring=64))
    assert found.unseen is None
    assert run.counts["verified"] == run.counts["on_target"] == 63
    assert {o.evidence for o in found.observations} == {Evidence.SELF_REPORTED}


@pytest.mark.parametrize(("baudrate", "verified"), [(BAUD, 16), (None, 63)])
def test_a_line_without_a_rate_carries_every_drive(baudrate: int | None, verified: int) -> None:
    config = VerifyConfig.of(object="circle", radius_mm=20, resolution_mm=2, seed=3, mode="points")
    board = PortBoardUnderTest("virtual://", baudrate=baudrate, rate_hz=1000, board_computes=True)
    board.port = BoardPort(baud=baudrate)
    run = measure_run(config, board, None).verdict()
    assert run.counts["verified"] == run.counts["on_target"] == verified


@pytest.mark.parametrize(
    ("port", "is_named", "rate"),
    [
        ("socket://localhost:1", False, None),
        ("socket://localhost:1", True, BAUD),  # the default, and named all the same
        ("haptogram://?clock=virtual", False, None),
        ("haptogram://?clock=virtual&baud=921600", False, 921_600),
        ("haptogram://?clock=virtual&baud=921600", True, BAUD),
        ("/dev/ttyUSB0", False, BAUD),
    ],
)
def test_which_ports_have_a_rate(port: str, is_named: bool, rate: int | None) -> None:
    assert baud_of_verified_port(port, BAUD, is_named=is_named) == rate


def test_a_trace_that_cannot_be_switched_on_is_not_waited_for() -> None:
    found, run = run_on(BoardPort(features=ALL_FEATURES ^ Feature.CONFIG))
    assert found.unseen is not None
    assert "read back" in found.unseen
    assert (run.counts["verified"], run.counts["not_verified"], run.counts["lost"]) == (1, 62, 0)


def test_what_a_ring_no_longer_holds_is_not_verified_rather_than_lost() -> None:
    features = ALL_FEATURES ^ (Feature.TRACE | Feature.TRACE_DRIVE)
    found, run = run_on(BoardPort(features=features, trace_ring=16))
    assert found.unseen == "the board's trace ring keeps the last 16 latches"
    assert (run.counts["verified"], run.counts["not_verified"], run.counts["lost"]) == (16, 47, 0)


def test_an_interrupt_cancels_what_is_on_its_way_and_loses_nothing() -> None:
    def interrupt(done: int, total: int) -> None:
        if 2 * done > total:
            raise KeyboardInterrupt

    config = VerifyConfig.of(
        object="circle", radius_mm=20, resolution_mm=2, repeat=8, virtual_time=True
    )
    with board_in_virtual_time(config.virtual_board()) as board:
        found = measure_run(config, board, interrupt)
    assert found.interrupted
    run = found.verdict()
    assert run.reasons == (f"interrupted after {len(found.intended)} of 504 frames",)
    assert run.counts["sent"] + run.counts["not_sent"] == 504
    assert run.counts["lost"] == 0
    assert run.counts["on_target"] + run.counts["cancelled"] == run.counts["sent"]
    assert 90 <= run.counts["cancelled"] <= 110  # a lead of 100 ms at 1 kHz


@pytest.mark.parametrize("frame", [150, 151, 152])
def test_a_frame_that_is_due_at_the_mute_is_not_lost(frame: int) -> None:
    def interrupt(done: int, _: int) -> None:
        if done == frame:
            raise KeyboardInterrupt

    config = VerifyConfig.of(object="circle", radius_mm=20, repeat=10, virtual_time=True)
    with board_in_virtual_time(config.virtual_board()) as board:
        found = measure_run(config, board, interrupt)
    run = found.verdict()
    assert (run.counts["lost"], run.effect) == (0, None)


def test_the_ring_is_read_after_an_interrupt() -> None:
    def interrupt(done: int, total: int) -> None:
        if 2 * done > total:
            raise KeyboardInterrupt

    features = ALL_FEATURES ^ (Feature.TRACE | Feature.TRACE_DRIVE)
    config = VerifyConfig.of(object="circle", radius_mm=20, resolution_mm=2, repeat=4)
    board = PortBoardUnderTest("virtual://", baudrate=BAUD, rate_hz=1000, board_computes=False)
    board.port = BoardPort(features=features, trace_ring=1024)
    found = measure_run(config, board, interrupt)
    assert found.cut is not None
    assert found.cut.reason.startswith("interrupted after")
    assert len(found.observations) > 20
