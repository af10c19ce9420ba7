"""A frame that the board loses fails the run; one that host or machine held up is excused.

All in virtual time: by every kind of evidence, for every way in which a frame can be lost.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import pytest

from haptogram import Driver
from haptogram.acoustics import AcousticModel
from haptogram.evidence.backdoor import (
    is_observed_latch_of,
    observations_of_backdoor,
    observed_losses_on_clock_of,
    why_observations_incomplete,
)
from haptogram.evidence.boards import InProcessBoardUnderTest, PortBoardUnderTest
from haptogram.evidence.run_record import measure_run
from haptogram.settings.faults.plan import FaultPlan
from haptogram.settings.run.verify import VerifyConfig
from haptogram.verification import FrameStatus, RunVerdict, Verdict, verify_run
from haptogram_protocol.messages import Config, Feature
from sim_device.assembly import BoardAssembly
from sim_device.backdoor.recorder import InlineReconstructionWorker
from sim_device.board.board import Board
from sim_device.board.counters import Drop
from sim_device.board.settings import ALL_FEATURES
from sim_device.board.stream_queue import StreamFrame
from sim_device.board.timers import BoardTimers
from virtual_ports import BAUD, BoardPort

EVERY = 20
MODEL = AcousticModel.default(4, 4)
CIRCLE = {"object": "circle", "radius_mm": 10, "resolution_mm": 10, "center_mm": (0.0, 0.0, 60.0)}
JOB: dict[str, Any] = {"array": "4x4", "repeat": 18, "seed": 3, **CIRCLE}


class Silent(Board):
    """Loses every 20th stream frame without a word."""

    def submit(self, frame: StreamFrame) -> Drop | None:
        return None if frame.index % EVERY == 0 else super().submit(frame)


class DropsAsLate(Board):
    """Finds every 20th frame late, although it is in time."""

    why = Drop.LATE

    def _refuse(self, frame: StreamFrame) -> Drop | None:
        dropped = super()._refuse(frame)
        return self.why if frame.index % EVERY == 0 else dropped


class DropsAsFull(DropsAsLate):
    """Finds its queue full."""

    why = Drop.FULL


class DropsAsFuture(DropsAsLate):
    """Finds frames too far ahead."""

    why = Drop.FUTURE


class SlowAtTimes(Board):
    """Takes longer than it says to make a frame ready."""

    def submit(self, frame: StreamFrame) -> Drop | None:
        if frame.index % EVERY == 0:
            self._computed_us = self.output.now_us + 200_000
        dropped = super().submit(frame)
        self._computed_us = min(self._computed_us, self.output.now_us)
        return dropped


class MutesItself(Board):
    """Goes off in mid-stream, for no reason."""

    def submit(self, frame: StreamFrame) -> Drop | None:
        if frame.index == 65_520 + 60:
            self.mute(requested=False)
        return super().submit(frame)


class StopsPlaying(Board):
    """Plays 20 frames of a sequence, and holds the last of them until a timer runs out."""

    def _latch_playback(self) -> None:
        if (playback := self._playback) is not None and playback.played == 20:
            self._playback = dataclasses.replace(playback, start_us=playback.start_us + 10_000_000)
        else:
            super()._latch_playback()


class ShortLease(Board):
    """Mutes itself when the host is silent for less than its lead."""

    def __init__(self, *arguments: Any, **more: Any) -> None:
        super().__init__(*arguments, **more)
        self.output.config = dataclasses.replace(self.output.config, host_timeout_ms=30)


def part(board: type[Board]) -> dict[str, Any]:
    return {"parts": BoardAssembly(board=board)}


def on_the_line(fault: str) -> dict[str, Any]:
    return {"faults": FaultPlan.parse([f"{fault} from=60ms"], seed=5)}


#: What loses frames, and the word for it in the headline.
CAUSES = {
    "silent": (part(Silent), ""),
    "late": (part(DropsAsLate), "dropped_late"),
    "full": (part(DropsAsFull), "dropped_full"),
    "future": (part(DropsAsFuture), "dropped_future"),
    "slow": (part(SlowAtTimes), "dropped_late"),
    "mute": (part(MutesItself), "dropped_state"),
    "crc": (on_the_line("frame.crc p=0.1"), "crc"),
    "gap": (on_the_line("line.drop p=1e-3 direction=down"), "gap"),
}
WITHOUT_CRC = {"features": ALL_FEATURES ^ Feature.TRACE}
RING = ALL_FEATURES ^ (Feature.TRACE | Feature.TRACE_DRIVE)
#: Whether there is a back door, what else the board can show, and what it is shown.
EVIDENCE: dict[str, tuple[bool, dict[str, Any], dict[str, Any]]] = {
    "back door": (True, {}, {}),
    "trace CRC": (False, {}, {}),
    "trace DRIVE": (False, WITHOUT_CRC, {}),
    "trace DRIVE, one in k": (
        False,
        WITHOUT_CRC,
        {"mode": "points", "rate_hz": 4000, "repeat": 80},
    ),
    "trace ring": (False, {"features": RING, "trace_ring": 16}, {}),
}
WHOLE = ("back door", "trace CRC", "trace DRIVE")


def verdict_on(
    *,
    backdoor: bool,
    job: dict[str, Any],
    hook: Callable[[BoardPort, int], None] | None = None,
    between: bool = False,
    baudrate: int | None = BAUD,
    **board: Any,
) -> RunVerdict:
    """Run the job on a board, and judge it; *hook* is called with each frame that is sent."""
    config = VerifyConfig.of(**(JOB | job))
    port = BoardPort(model=MODEL, **board)
    records: list[dict[str, Any]] = []
    under_test: Any
    if backdoor:
        recorder = InlineReconstructionWorker(port.board.settings, records.append)
        port.latch, port.notice = recorder.latch, recorder.notice
        under_test = InProcessBoardUnderTest(port, lambda: records, lambda _: None, MODEL)
    else:
        computes = config.frame_kind == "points"
        under_test = PortBoardUnderTest(
            "virtual://", baudrate=baudrate, rate_hz=config.pace.rate_hz, board_computes=computes
        )
        under_test.port = port
    sent = iter(range(10_000))
    sink = None if hook is None else lambda _: hook(port, next(sent))
    found = measure_run(config, under_test, None, sink=sink)
    if between:
        found.losses = observed_losses_on_clock_of(
            found.intended, records, is_machine_in_between=True
        )
    return found.verdict(min_verified=0.1)


@pytest.mark.sampled(14)
@pytest.mark.parametrize("evidence", EVIDENCE)
@pytest.mark.parametrize("cause", CAUSES)
def test_a_frame_that_the_board_loses_fails(evidence: str, cause: str) -> None:
    board, counter = CAUSES[cause]
    backdoor, features, job = EVIDENCE[evidence]
    run = verdict_on(backdoor=backdoor, job=job, **features, **board)
    headline = run.reasons[0]
    assert run.verdict is Verdict.FAIL, headline
    assert " lost by the board" in headline
    assert counter in headline
    if evidence in WHOLE:
        lost = [frame for frame in run.frames if frame.status is FrameStatus.LOST]
        assert headline.startswith(f"{len(lost)} of {len(run.frames)} frames were lost")
        assert f"since frame {lost[0].number}, " in headline
        assert run.counts["verified"] == len(run.frames) - len(lost)


@pytest.mark.parametrize("evidence", EVIDENCE)
def test_a_playback_that_stops_fails(evidence: str) -> None:
    backdoor, features, job = EVIDENCE[evidence]
    job = job | {"mode": "sequence"}
    run = verdict_on(backdoor=backdoor, job=job, **features, **part(StopsPlaying))
    assert run.verdict is Verdict.FAIL
    assert f"{len(run.frames) - 20} of {len(run.frames)} frames were lost" in run.reasons[0]


@pytest.mark.parametrize("evidence", EVIDENCE)
def test_a_healthy_board_loses_nothing(evidence: str) -> None:
    backdoor, features, job = EVIDENCE[evidence]
    run = verdict_on(backdoor=backdoor, job=job, **features)
    assert run.verdict is Verdict.PASS, run.reasons
    assert (run.counts["lost"], run.counts["held_up"]) == (0, 0)


#: How long the host is held up, what it does, and the board.
STALLS: dict[str, tuple[int, dict[str, Any], dict[str, Any]]] = {
    "above the lead, so that frames are skipped": (150, {}, {}),
    "above the timers, so that the board mutes itself": (900, {}, {}),
    "below the lead, above the lease, so that the queue is flushed": (95, {}, part(ShortLease)),
    "above the lease of a playback": (4000, {"mode": "sequence", "rate_hz": 100}, {}),
}


@pytest.mark.sampled(7)
@pytest.mark.parametrize("stall", STALLS)
@pytest.mark.parametrize("evidence", EVIDENCE)
def test_what_the_host_held_up_is_excused(evidence: str, stall: str) -> None:
    stall_ms, doing, board = STALLS[stall]

    def hold_up(port: BoardPort, number: int) -> None:
        if number == 60:
            port.stall(stall_ms * 1_000_000)

    backdoor, features, job = EVIDENCE[evidence]
    job = job | doing | ({"repeat": 100} if doing else {})
    run = verdict_on(backdoor=backdoor, job=job, hook=hold_up, **features, **board)
    assert run.verdict is not Verdict.FAIL, run.reasons
    assert run.counts["lost"] == 0
    assert run.counts["held_up"] > 0
    assert "held up" in str(run)


@pytest.mark.parametrize("cause", ["late", "full", "silent"])
def test_a_busy_machine_is_named_where_a_board_alone_says_that_frames_came_late(cause: str) -> None:
    board, _ = CAUSES[cause]
    run = verdict_on(backdoor=False, job={}, baudrate=None, **board)  # a pseudo-terminal
    assert run.verdict is Verdict.FAIL
    assert ("whose process waits for a processor" in run.reasons[0]) is (cause == "late")


class HiddenLeaseTimers(BoardTimers):
    """Does not wait for as long as the configuration says."""

    def renew_lease(self, now_us: int, config: Config, unattended_ms: int | None) -> None:
        super().renew_lease(now_us, dataclasses.replace(config, host_timeout_ms=30), unattended_ms)


def test_a_lease_that_is_shorter_than_the_board_says_is_no_excuse() -> None:
    def hold_up(port: BoardPort, number: int) -> None:
        if number == 60:
            port.stall(95_000_000)

    board = {"parts": BoardAssembly(timers=HiddenLeaseTimers)}
    run = verdict_on(backdoor=True, job={"repeat": 100}, hook=hold_up, **board)
    assert run.verdict is Verdict.FAIL
    assert run.counts["lost"] > 0


class LateReader:
    """A process in front of the board that reads nothing for a number of writes of the host."""

    def __init__(self, begin: int, end: int) -> None:
        self._asleep, self._waiting, self._count = range(begin, end), b"", 0

    def __call__(self, data: bytes) -> bytes:
        self._count += 1
        self._waiting += data
        if self._count in self._asleep:
            return b""
        taken, self._waiting = self._waiting, b""
        return taken


@pytest.mark.parametrize("board", [Board, Silent, DropsAsLate])
def test_what_the_machine_read_late_is_excused_and_nothing_else(board: type[Board]) -> None:
    late = LateReader(150, 280)  # a lead of 100 ms, and 130 frames that come together
    run = verdict_on(backdoor=True, between=True, tamper=late, job={"repeat": 100}, **part(board))
    assert 10 < run.counts["held_up"] < 60
    assert run.counts["lost"] == (0 if board is Board else pytest.approx(30, abs=4))
    assert run.verdict is (Verdict.PASS if board is Board else Verdict.FAIL)
    assert "the machine held up the process of the board" in str(run)


def shown_by_backdoor(board: type[Board], show: Callable[[Driver], Any]) -> tuple[Any, list[Any]]:
    """What a driver meant, and the records of the back door meanwhile."""
    records: list[dict[str, Any]] = []
    port = BoardPort(model=MODEL, **part(board))
    recorder = InlineReconstructionWorker(port.board.settings, records.append)
    port.latch, port.notice = recorder.latch, recorder.notice
    with Driver(port, model=MODEL, seed=1) as driver:
        driver.arm()
        show(driver)
    return driver.intended, records


@pytest.mark.parametrize("silent_after", [30, 45])
def test_a_back_door_that_falls_silent_hides_no_loss_before_its_last_latch(
    silent_after: int,
) -> None:
    points = [(0.0, 0.0, 0.06 + 1e-4 * number) for number in range(60)]
    intended, records = shown_by_backdoor(Silent, lambda driver: driver.stream(points, rate_hz=500))
    numbers = {frame.key: frame.number for frame in intended}
    observations = observations_of_backdoor(records)
    until = [o.key for o in observations if numbers[o.key] <= silent_after][-1]
    told = records[: 1 + next(n for n, r in enumerate(records) if is_observed_latch_of(r, until))]
    unseen = why_observations_incomplete(told, until.session, intended[-1].key)
    run = verify_run(
        intended,
        observations_of_backdoor(told),
        model=MODEL,
        unseen=unseen,
        losses=observed_losses_on_clock_of(intended, told, is_machine_in_between=True),
    )
    lost = {f.number for f in run.frames if f.status is FrameStatus.LOST}
    never = set(range(60)) - {numbers[o.key] for o in observations}
    assert unseen is not None
    assert lost == {number for number in never if number < numbers[until]}
    assert lost
    assert run.verdict is Verdict.FAIL
    assert run.counts["not_verified"] == 59 - numbers[until]


@pytest.mark.parametrize("board", [Board, Silent])
def test_a_frame_without_a_time_is_lost_like_any_other(board: type[Board]) -> None:
    """The next one cannot have replaced it: the driver asks for the status before each."""

    def show(driver: Driver) -> None:
        for number in range(60):
            driver.focus((0.0, 0.0, 0.06 + 1e-4 * number))

    intended, records = shown_by_backdoor(board, show)
    run = verify_run(
        intended,
        observations_of_backdoor(records),
        model=MODEL,
        losses=observed_losses_on_clock_of(intended, records, is_machine_in_between=True),
    )
    assert run.verdict is (Verdict.PASS if board is Board else Verdict.FAIL), run.reasons
    assert (run.counts["lost"], run.counts["held_up"]) == (0 if board is Board else 3, 0)
