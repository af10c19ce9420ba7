"""One run: a stream to a board, a control loop beside it, and the stages of every frame."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from haptogram.campaigns.bench import attribution
from haptogram.campaigns.bench.config import BenchConfig
from haptogram.campaigns.bench.control import NoiseFloorLoop
from haptogram.campaigns.bench.percentiles import TimingPercentiles
from haptogram.driver.driver import Driver
from haptogram.driver.line.budget import frame_bytes_on_line, line_transmission_ns
from haptogram.driver.line.port import Transport, open_transport
from haptogram.driver.stream import StreamReport
from haptogram.evidence.boards import PortBoardUnderTest
from haptogram.evidence.recordings.tap import RecordingTransport
from haptogram.evidence.virtual_board import VirtualBoard
from haptogram.machine.fingerprint import (
    fingerprint_cpu_share,
    fingerprint_cpu_times,
    machine_fingerprint,
)
from haptogram.records.frame import Intended
from haptogram_protocol.messages import unwrap

if TYPE_CHECKING:
    from haptogram.evidence.recordings.writer import RecordingWriter

_RADIUS_M: Final = 0.03
_HEIGHT_M: Final = 0.12
_REVOLUTIONS_HZ: Final = 5.0
_SETTLING_S: Final = 5.0  # the control outlasts the stream by this at most

#: Device time of arrival (None: not known) and of the latch, by unwrapped sequence number.
Latches: TypeAlias = dict[int, tuple[int | None, int]]


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
    with _bench_board(config, writer) as (label, port, prepare, collect):
        with Driver(port, baudrate=config.baud, keep=len(targets_m)) as driver:
            prepare(driver)
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
        latches = collect(driver)
    return _bench_run_of(config, label, driver, report, control, latches, processors)


_Collect: TypeAlias = Callable[[Driver], Latches]
_Board: TypeAlias = tuple[str, str | Transport, Callable[[Driver], None], _Collect]


@contextlib.contextmanager
def _bench_board(config: BenchConfig, writer: RecordingWriter | None) -> Iterator[_Board]:
    """Yield a board: its name, its port, how it is prepared, and how its latches are read."""
    if config.port is not None:
        told = PortBoardUnderTest(
            config.port, baudrate=config.baud, rate_hz=config.rate_hz, board_computes=False
        )
        tap = None if writer is None else _tapped_bench_url(config.port, config, writer)
        yield config.port, tap or config.port, told.prepare, _self_reported_bench_latches
        return
    with VirtualBoard(reconstruct=False, clock="wall") as board:
        tap = None if writer is None else _tapped_bench_url(board.url, config, writer, {})

        def collect(driver: Driver) -> Latches:
            board.wait_idle(driver.intended)
            if tap is not None:
                tap.tell(board.records())
            return {
                record["index"]: (record["t_received_us"], record["t_latch_us"])
                for record in board.records()
                if record["kind"] == "latch" and record["session"] == driver.session
            }

        label = "virtual board, on a pty without a baud rate, in a process of its own"
        yield label, tap or board.url, lambda _: None, collect


def _tapped_bench_url(
    url: str, config: BenchConfig, writer: RecordingWriter, board: dict[str, Any] | None = None
) -> RecordingTransport:
    """Return an open port, written down; *board* has the options of a virtual board."""
    writer.opened(0, board, None, paced=board is not None)
    transport = open_transport(url, baudrate=config.baud)
    return RecordingTransport(transport, writer, offset_ns=-transport.now_ns())  # from 0 on


def _self_reported_bench_latches(driver: Driver) -> Latches:
    return {seen.key.index: (None, seen.t_latch_us) for seen in driver.observations}


def _bench_run_of(
    config: BenchConfig,
    label: str,
    driver: Driver,
    report: StreamReport,
    control: NoiseFloorLoop,
    latches: Latches,
    processors: dict[str, float],
) -> BenchRun:
    ticks, paced = report.ticks, config.port is not None
    due_us = np.array([i.t_apply_us for i in driver.intended], dtype=np.int64)
    received_us, latched_us = _bench_device_times(driver.intended, latches)
    sent = np.ones(report.frames, dtype=bool)
    sent[list(report.skipped)] = False
    line_transmission_ns = np.where(sent, _bench_transmission_ns(config, driver), 0)
    left_ns = ticks.stamp_ns("line_free" if paced else "done")
    received_ns = _bench_host_times(driver, received_us)
    board_ns = received_ns - left_ns
    parts = attribution.split_bench_lateness(
        ticks, line_transmission_ns, np.nan_to_num(board_ns).astype(np.int64)
    )
    stages = _bench_stages(parts, ticks.lateness_us(), line_transmission_ns, sent)
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
    line_transmission_ns: NDArray[np.int64],
    sent: NDArray[np.bool_],
) -> dict[str, NDArray[np.float64]]:
    """Return the host's stages of every frame; those of a skipped frame are nan after its wake."""
    unsent = np.where(sent, 0.0, np.nan)
    return {
        "wake": lateness_us,
        "overslept": parts.scheduling / 1e3,
        "work": parts.work / 1e3 + unsent,
        "at_port": parts.at_port_ns / 1e3,
        "line": (parts.line + line_transmission_ns) / 1e3 + unsent,
    }


def _bench_misses(
    parts: attribution.BenchLatenessParts, stalled: NDArray[np.bool_]
) -> dict[str, list[attribution.LatenessMisses]]:
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
    intended: Sequence[Intended], latches: Latches
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return (n,) device times of arrival and latch; NaN if not observed."""
    received, latched = np.full((2, len(intended)), np.nan)
    for place, wanted in enumerate(intended):
        seen = latches.get(wanted.key.index)
        if seen is None or wanted.t_apply_us is None:
            continue
        latched[place] = unwrap(seen[1] & 0xFFFFFFFF, wanted.t_apply_us, 32)
        if seen[0] is not None:
            received[place] = unwrap(seen[0] & 0xFFFFFFFF, wanted.t_apply_us, 32)
    return received, latched


def _bench_host_times(driver: Driver, device_us: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.array(
        [np.nan if np.isnan(us) else driver.clock.to_host_ns(int(us)) for us in device_us]
    )


def _bench_transmission_ns(config: BenchConfig, driver: Driver) -> int:
    return line_transmission_ns(frame_bytes_on_line(driver.identity.transducers), config.baud)
