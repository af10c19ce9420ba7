"""One run: a stream to a board, a control loop beside it, and the stages of every frame."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from haptogram.campaigns.bench import attribution
from haptogram.campaigns.bench.config import BenchConfig
from haptogram.campaigns.bench.control import NoiseFloorLoop
from haptogram.campaigns.bench.percentiles import TimingPercentiles
from haptogram.driver.driver import Driver
from haptogram.driver.line.budget import frame_bytes_on_line, line_transmission_ns
from haptogram.driver.stream import StreamReport
from haptogram.evidence.boards import BoardUnderTest, PortBoardUnderTest, ProcessBoardUnderTest
from haptogram.evidence.run_record import beginning_sink, recorded_port_of_run
from haptogram.evidence.virtual_board import VirtualBoard
from haptogram.machine.fingerprint import (
    fingerprint_cpu_share,
    fingerprint_cpu_times,
    machine_fingerprint,
)
from haptogram.records.frame import Intended, Observation
from haptogram_protocol.messages import unwrap

if TYPE_CHECKING:
    from haptogram.evidence.recordings.writer import RecordingWriter

_RADIUS_M: Final = 0.03
_HEIGHT_M: Final = 0.12
_REVOLUTIONS_HZ: Final = 5.0
_SETTLING_S: Final = 5.0  # the control outlasts the stream by this at most


@dataclass(frozen=True, slots=True)
class BenchRun:
    """The stages of every frame of a run, and the circumstances.

    Attributes
    ----------
    board : str
        The board, in words.
    stages_us : dict of str to (n,) numpy.ndarray
        Microseconds of every frame by stage, nan where a stage was not observed.
    misses : dict of str to list of Misses
        Misses of each limit, ``at_port`` and ``at_board``.
    latched, late : int
        Number of frames that were latched, and of those among them that were late: by a carrier
        period or more.
    """

    config: BenchConfig
    board: str
    report: StreamReport
    stages_us: dict[str, NDArray[np.float64]]
    misses: dict[str, list[attribution.LatenessMisses]]
    latched: int
    late: int
    environment: dict[str, Any]
    processors: dict[str, float]
    warnings: list[str]

    def percentiles(self) -> dict[str, TimingPercentiles]:
        """Return the percentiles of every stage."""
        return {name: TimingPercentiles.of(values) for name, values in self.stages_us.items()}


def bench_circle(frames: int, rate_hz: float) -> NDArray[np.float64]:
    """Return (frames, 3) points in metres: a bench_circle of 30 mm, five times a second."""
    angle = 2.0 * np.pi * _REVOLUTIONS_HZ * np.arange(frames) / rate_hz
    height = np.full(frames, _HEIGHT_M)
    return np.column_stack([_RADIUS_M * np.cos(angle), _RADIUS_M * np.sin(angle), height])


def run_bench(config: BenchConfig, writer: RecordingWriter | None = None) -> BenchRun:
    """Measure a stream, and write its bytes and latches into a recording if *writer* is given.

    Raises
    ------
    ConfigurationError
        If line or board cannot carry the rate; raised before the first frame.
    LinkError
        If the link broke.
    """
    targets_m = bench_circle(max(1, round(config.rate_hz * config.seconds)), config.rate_hz)
    with contextlib.ExitStack() as parts:
        board = _bench_board(config, parts)
        tap = None
        if writer is not None:
            virtual: dict[str, Any] | None = {} if config.port is None else None
            writer.opened(0, virtual, None, paced=virtual is not None)
            tap = recorded_port_of_run(board, config.baud, writer)
        sink = None if writer is None else beginning_sink(writer)
        with Driver(
            tap or board.port, baudrate=config.baud, keep=len(targets_m), sink=sink
        ) as driver:
            board.prepare(driver)
            driver.arm()
            control = NoiseFloorLoop(round(1e9 / config.rate_hz), config.seconds + _SETTLING_S)
            before = fingerprint_cpu_times()
            with control:
                report = driver.stream(
                    targets_m,
                    config.rate_hz,
                    lead_us=config.lead_us,
                    trim=config.trim,
                    spin_us=config.spin_us,
                    realtime=config.realtime,
                )
            processors = fingerprint_cpu_share(before, fingerprint_cpu_times())
        board.settle(driver)
        seen = {one.key.index: one for one in board.observations(driver)}
        if tap is not None:
            tap.tell(board.records())
    return _bench_run_of(config, board.label, driver, report, control, seen, processors)


def _bench_board(config: BenchConfig, parts: contextlib.ExitStack) -> BoardUnderTest:
    """Return the board at the port, else a virtual one, which ends with *parts*."""
    if config.port is not None:
        return PortBoardUnderTest(
            config.port, baudrate=config.baud, rate_hz=config.rate_hz, board_computes=False
        )
    virtual = parts.enter_context(VirtualBoard(reconstruct=False, clock="wall"))
    board = ProcessBoardUnderTest(virtual)
    board.label = "virtual board, on a pty without a baud rate, in a process of its own"
    return board


def _bench_run_of(
    config: BenchConfig,
    label: str,
    driver: Driver,
    report: StreamReport,
    control: NoiseFloorLoop,
    seen: Mapping[int, Observation],
    processors: dict[str, float],
) -> BenchRun:
    """Return the stages (µs) of every frame of a stream, from host stamps and latches.

    *seen*: the observed latch of each frame index. *control*: a loop beside the stream that only
    wakes, at the same rate.
    """
    ticks, paced = report.ticks, config.port is not None
    due_us = np.array([i.t_apply_us for i in driver.intended], dtype=np.int64)
    received_us, latched_us = _bench_device_times(driver.intended, seen)
    sent = np.ones(report.frames, dtype=bool)
    sent[list(report.skipped)] = False
    size = frame_bytes_on_line(driver.identity.transducers)
    transmission_ns = np.where(sent, line_transmission_ns(size, config.baud), 0)
    left_ns = ticks.stamp_ns("line_free" if paced else "done")
    received_ns = _bench_host_times(driver, received_us)
    board_ns = received_ns - left_ns
    parts = attribution.split_bench_lateness(
        ticks, transmission_ns, np.nan_to_num(board_ns).astype(np.int64)
    )
    stages = _bench_stages(parts, ticks.lateness_us(), transmission_ns, sent)
    stages["board"] = np.maximum(0.0, board_ns) / 1e3
    stages["complete"] = np.where(np.isnan(board_ns), np.nan, parts.total_ns / 1e3)
    stages["margin"] = due_us - received_us
    stages["latch"] = latched_us - due_us
    stages["control"] = control.lateness_us
    stalled = control.stalled(ticks.stamp_ns("deadline"), ticks.stamp_ns("done"))
    return BenchRun(
        config=config,
        board=label,
        report=report,
        stages_us=stages,
        misses=_bench_misses(parts, stalled),
        latched=int((~np.isnan(latched_us)).sum()),
        late=int((latched_us - due_us >= 1_000_000 // driver.identity.carrier_hz).sum()),
        environment=machine_fingerprint(),
        processors=processors,
        warnings=list(driver.warnings),
    )


def _bench_stages(
    parts: attribution.BenchLatenessParts,
    lateness_us: NDArray[np.float64],
    transmission_ns: NDArray[np.int64],
    sent: NDArray[np.bool_],
) -> dict[str, NDArray[np.float64]]:
    """Return (n,) times in µs by stage of the host: wake, overslept, work, at_port, line.

    Work and line are NaN for frames that were not *sent* (n,).
    """
    unsent = np.where(sent, 0.0, np.nan)
    return {
        "wake": lateness_us,
        "overslept": parts.scheduling / 1e3,
        "work": parts.work / 1e3 + unsent,
        "at_port": parts.at_port_ns / 1e3,
        "line": (parts.line + transmission_ns) / 1e3 + unsent,
    }


def _bench_misses(
    parts: attribution.BenchLatenessParts, stalled: NDArray[np.bool_]
) -> dict[str, list[attribution.LatenessMisses]]:
    """Return the late frames at port and board, by cause, for each of MISS_LIMITS_US.

    *stalled* (n,): frames in whose time the control loop stalled too.
    """
    return {
        place: [
            attribution.count_late_bench_frames(
                some.total_ns,
                attribution.attribute_bench_lateness(some),
                limit_us=limit_us,
                stalled=stalled,
            )
            for limit_us in attribution.MISS_LIMITS_US
        ]
        for place, some in (("at_port", parts.at_port()), ("at_board", parts))
    }


def _bench_device_times(
    intended: Sequence[Intended], seen: Mapping[int, Observation]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return (n,) unwrapped device times (µs) of arrival and latch; NaN if not observed."""
    received, latched = np.full((2, len(intended)), np.nan)
    for place, wanted in enumerate(intended):
        latch = seen.get(wanted.key.index)
        if latch is None or wanted.t_apply_us is None:
            continue
        latched[place] = unwrap(latch.t_latch_us & 0xFFFFFFFF, wanted.t_apply_us, 32)
        if latch.t_received_us is not None:
            received[place] = unwrap(latch.t_received_us & 0xFFFFFFFF, wanted.t_apply_us, 32)
    return received, latched


def _bench_host_times(driver: Driver, device_us: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the host times (n,), in ns, of device times; NaN stays NaN."""
    return np.array(
        [np.nan if np.isnan(us) else driver.clock.to_host_ns(int(us)) for us in device_us]
    )
