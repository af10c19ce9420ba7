"""Streams in virtual time, over random stalls, jitter, baud rates, drift and wrap."""

import contextlib
import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from haptogram.acoustics import AcousticModel
from haptogram.driver.driver import Driver
from haptogram.driver.timing.lead import default_lead_us
from haptogram.driver.timing.realtime import STAMPS
from haptogram.errors import ConfigurationError, LinkError
from haptogram_protocol.state import MuteReason
from sim_device.board.settings import BOOT_US
from virtual_ports import BoardPort

MODEL = AcousticModel.default(4, 4)
BYTES = 35  # of a frame of 16 phases on the line, at most
CARRIER_US = 25
ANGLE = np.linspace(0.0, 6.0, 120)
CIRCLE = np.column_stack((0.02 * np.cos(ANGLE), 0.02 * np.sin(ANGLE), np.full(120, 0.1)))


class Jittery(BoardPort):
    """A host that is stopped for a while after some of its looks at the port, by a script."""

    def __init__(self, stalls_us=(), ppm=0, **settings):
        super().__init__(model=MODEL, **settings)
        self._stalls = iter(stalls_us)
        self._ppm = ppm
        self.streaming = False

    def now_ns(self):
        """Return host time; its clock runs *ppm* slower than the board's."""
        true_ns = self.simulation.now_ns
        return true_ns - true_ns * self._ppm // 1_000_000 + 10**10

    def _true_ns(self, host_ns):
        return self.simulation.now_ns + max(0, host_ns - self.now_ns())

    def read_available(self, deadline_ns):
        data = super().read_available(self._true_ns(deadline_ns))
        if self.streaming and not data:
            self.stall(1000 * next(self._stalls, 0))
        return data

    def write_some(self, data):
        self._check()
        self.written.append(data)
        self.simulation.host_write(data, self.simulation.now_ns)
        return len(data)

    def stall(self, duration_ns):
        self.simulation.advance_to(self.simulation.now_ns + duration_ns)


def stream(port, points=CIRCLE, rate_hz=1000, baudrate=3_000_000, **options):
    with Driver(port, seed=1, baudrate=baudrate) as driver:
        driver.arm()
        port.streaming = True
        report = driver.stream(points, rate_hz, **options)
        port.streaming = False
    return driver, report


def assert_the_laws_hold(port, driver, report):
    """What no stall, jitter, baud rate or drift may break."""
    times = [latch.t_latch_us for latch in port.latches]
    assert all(after - before >= CARRIER_US for before, after in itertools.pairwise(times))
    intended = {i.key.index: i for i in driver.intended}
    latched = {latch.key.index: latch for latch in port.latches}
    assert len(latched) == len(port.latches)
    for index, latch in latched.items():
        assert 0 <= latch.t_latch_us - intended[index].t_apply_us < CARRIER_US
        assert latch.t_received_us <= latch.t_latch_us
        assert latch.drive == intended[index].drive
    # every frame is accounted for exactly once
    counters = report.status.counters
    skipped = {driver.intended[number].key.index for number in report.skipped}
    assert not skipped & set(latched)
    dropped = counters.dropped_late + counters.dropped_state + counters.flushed
    assert len(latched) + len(skipped) + dropped == len(driver.intended) == report.frames
    assert counters.gap == len(skipped - {max(intended)} if report.skipped else ())  # none after it
    # the log has its stamps in order
    ticks = [report.ticks.stamp_ns(name) for name in STAMPS]
    for before, after in itertools.pairwise(ticks[2:-1]):
        assert (before <= after).all()
    assert len(ticks[0]) == report.frames


@given(
    stalls_us=st.lists(
        st.one_of(st.integers(0, 300), st.integers(0, 40_000), st.just(0)), max_size=150
    ),
    rate_hz=st.sampled_from([200, 333.3, 1000, 1999.9, 4000, 10_000]),
    baud=st.sampled_from([1_000_000, 3_000_000, 12_000_000]),
    ppm=st.integers(-50, 50),
    before_wrap_us=st.integers(30_000, 400_000),
    spin_us=st.sampled_from([0, 50]),
)
def test_no_stall_breaks_the_laws(stalls_us, rate_hz, baud, ppm, before_wrap_us, spin_us):
    if rate_hz * BYTES * 10 > baud:
        return
    port = Jittery(stalls_us, ppm, baud=baud, boot_us=2**32 - before_wrap_us)
    driver, report = stream(port, rate_hz=rate_hz, baudrate=baud, spin_us=spin_us)
    assert_the_laws_hold(port, driver, report)


@given(
    stalls_us=st.lists(st.integers(0, 15_000), max_size=16),
    lead_us=st.integers(16_500, 40_000),
    spin_us=st.sampled_from([0, 100]),
)
def test_a_stall_below_the_lead_does_not_reach_the_output(stalls_us, lead_us, spin_us):
    """Stalls that the host has time to recover from: each is followed by as long a rest."""
    script = [us for stall in stalls_us for us in (stall, *[0] * 30)]
    port = Jittery(script)
    driver, report = stream(port, np.tile(CIRCLE, (2, 1)), lead_us=lead_us, spin_us=spin_us)
    assert_the_laws_hold(port, driver, report)
    assert report.skipped == ()
    delays = {
        latch.t_latch_us - intended.t_apply_us
        for latch, intended in zip(port.latches, driver.intended, strict=True)
    }
    assert delays == {0}


@pytest.mark.nightly
@given(stall_us=st.integers(1, 90_000), lead_us=st.integers(2_000, 40_000))
def test_a_longer_stall_costs_exactly_the_frames_that_it_covers(stall_us, lead_us):
    class Once(Jittery):
        """Stalls before the 40th frame."""

        begin_ns = end_ns = None

        def write_some(self, data):
            taken = super().write_some(data)
            if self.streaming and len(self.written) == before + 40:
                self.begin_ns = self.now_ns()
                self.stall(1000 * stall_us)
                self.end_ns = self.now_ns()
            return taken

    port = Once()
    with Driver(port, seed=1) as driver:
        driver.arm()
        before = len(port.written) + 1  # the question how the board is
        port.streaming = True
        report = driver.stream(CIRCLE, 1000, lead_us=lead_us)
        to_host_ns = driver.clock.to_host_ns
        due_ns = [to_host_ns(i.t_apply_us) for i in driver.intended]
    assert_the_laws_hold(port, driver, report)
    line_ns = BYTES * 10 * 10**9 // 3_000_000
    # Covered: frames that had to leave, for all their lead, before the stall was over.  The 40th
    # was on its way already; behind the burst after it the line is busy for a frame or more.
    leave_ns = [t - line_ns for t in due_ns]
    sure = {n for n in range(40, 120) if leave_ns[n] < port.end_ns - 2000}
    assert (
        sure <= set(report.skipped) <= {n for n in range(40, 120) if n <= max(sure, default=0) + 1}
    )


def test_back_on_the_grid_after_a_stall():
    port = Jittery([0] * 60 + [130_000])
    _, report = stream(port, np.tile(CIRCLE, (4, 1)), lead_us=20_000)
    late = report.ticks.lateness_us()
    assert late.max() > 100_000
    assert late[-100:].max() == 0


@pytest.mark.parametrize("rate_hz", [100, 1000, 4000])
def test_the_default_lead_is_what_three_quarters_of_the_queue_hold(rate_hz):
    _, report = stream(Jittery(), rate_hz=rate_hz)
    assert report.lead_us == min(100_000, 96 * 1_000_000 // rate_hz)
    assert report.lead_moves == 0


def test_the_default_lead_lets_a_stall_of_90_ms_pass():
    port = Jittery([0] * 30 + [90_000])
    driver, report = stream(port, np.tile(CIRCLE, (3, 1)))
    assert report.skipped == ()
    assert_the_laws_hold(port, driver, report)


# --- trim ----------------------------------------------------------------------------------------


def test_the_trim_finds_the_smallest_lead_that_meets_the_target_and_stays():
    port = Jittery([*[0] * 40, 3_000] * 200)
    driver, report = stream(port, np.tile(CIRCLE, (16, 1)), trim=True)
    assert_the_laws_hold(port, driver, report)
    assert report.skipped == ()
    assert 3_000 < report.lead_us < 6_500
    assert report.lead_moves <= 4


def test_a_steady_host_needs_no_lead_but_the_line_and_the_guard():
    port = Jittery()
    _, report = stream(port, np.tile(CIRCLE, (12, 1)), trim=True)
    assert report.lead_us < 120 + 200 + 300
    assert report.lead_moves == 1
    assert report.status.counters.latched == report.frames


@settings(max_examples=4)
@given(st.lists(st.integers(0, 8000), min_size=300, max_size=900), st.sampled_from([0.0, 0.01]))
def test_a_trimmed_lead_stays_in_its_limits_and_keeps_the_laws(stalls_us, share):
    stalls_us = [us if n % 7 == 0 else 0 for n, us in enumerate(stalls_us)]
    port = Jittery(stalls_us)
    driver, report = stream(port, np.tile(CIRCLE, (10, 1)), trim=True, miss_share=share)
    assert_the_laws_hold(port, driver, report)
    assert report.lead_us <= default_lead_us(128_000)
    assert report.lead_moves <= 12


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"miss_share": 1.5}, "miss_share is 1.5"),
        ({"status_period_ms": 0}, "status_period_ms is 0"),
    ],
)
def test_a_trim_that_cannot_work_is_refused(options, text):
    with Driver(Jittery()) as driver:
        driver.arm()
        if period := options.pop("status_period_ms", None) is not None:
            driver.configure(status_period_ms=0 if period else 100)
        with pytest.raises(ConfigurationError, match=text):
            driver.stream(CIRCLE, 1000, trim=True, **options)


# --- clocks --------------------------------------------------------------------------------------


@pytest.mark.parametrize("lead_us", [None, 99_000])
@pytest.mark.parametrize("way", ["stream", "play"])
def test_no_lead_is_beyond_what_a_board_looks_ahead(way, lead_us):
    """The least that a board may, by a clock that the host knows to some microseconds."""
    port = Jittery(ppm=-50, baud=50_000_000, queue_depth=256, max_horizon_us=100_000)
    with Driver(port, seed=1, baudrate=50_000_000) as driver:
        driver.arm()
        show = getattr(driver, way)
        with pytest.raises(ConfigurationError, match=r"lead.* 99000"):
            show(CIRCLE, 500, lead_us=99_001)
        assert show(CIRCLE, 500, lead_us=lead_us).status.counters.latched == len(CIRCLE)


@pytest.mark.parametrize("rate_hz", [1000, 1003.7, 3999])
def test_the_longest_lead_fills_no_queue(rate_hz):
    """On a line that takes no time, as a pseudo-terminal."""
    settings = {"ppm": -50, "baud": 50_000_000, "queue_depth": 16}
    options = {"rate_hz": rate_hz, "baudrate": 50_000_000}
    longest_us = int(15e6 / rate_hz)
    with pytest.raises(ConfigurationError, match=f"lead up to {longest_us} µs"):
        stream(Jittery(**settings), **options, lead_us=longest_us + 1)
    _, report = stream(Jittery(**settings), **options, lead_us=longest_us)
    assert report.status.counters.latched == report.frames


@pytest.mark.parametrize("ppm", [-100, 30, 100])
@pytest.mark.parametrize("way", ["stream", "play"])
def test_a_host_that_did_nothing_for_an_hour_knows_the_time_again(way, ppm):
    port = Jittery(ppm=ppm)
    with Driver(port, seed=1) as driver:
        driver.arm()
        port.stall(3_600_000_000_000)
        getattr(driver, way)(CIRCLE, 1000, lead_us=5_000)
    for latch, intended in zip(port.latches, driver.intended, strict=True):
        assert 0 <= latch.t_latch_us - intended.t_apply_us < CARRIER_US


@pytest.mark.parametrize("ppm", [-100, 37, 100])
def test_the_estimate_stays_within_its_bound(ppm):
    port = Jittery(ppm=ppm)
    with Driver(port, seed=1) as driver:
        driver.arm()
        driver.focus((0.0, 0.0, 0.1))
        for _ in range(12):
            driver.hold(1.7)
            now_ns = port.now_ns()
            error_us = driver.clock.to_device_us(now_ns) - port.simulation.device_us(
                port.simulation.now_ns
            )
            assert abs(error_us) <= driver.clock.uncertainty_at_us(now_ns) + 2
        assert abs(driver.clock.drift_ppm - ppm) <= driver.clock.drift_uncertainty_ppm
        assert driver.clock.drift_uncertainty_ppm < 2
        assert (driver.clock.rejected, driver.clock.jumps) == (0, 0)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("jump_us", [-40_000_000, -150_000, 60_000, 3_000_000])
def test_a_clock_that_jumps_ends_the_stream_with_an_error_and_never_hangs(jump_us, monkeypatch):
    port = Jittery()
    driver = Driver(port, seed=1)
    add = driver.clock.add
    monkeypatch.setattr(
        driver.clock,
        "add",
        lambda sent, rx, tx, received: add(sent, rx + jump_us, tx + jump_us, received),
    )
    driver.arm()
    with pytest.raises(LinkError, match=r"clock jumped by -?\d+ µs, noticed after"), driver:
        driver.stream(np.tile(CIRCLE, (60, 1)), 1000)
    assert abs(driver.clock.jump_us - jump_us) < 100
    assert len(driver.intended) < 1500
    assert port.board.output.reason is MuteReason.MUTE
    assert port.closed


# --- a port that stops ---------------------------------------------------------------------------


def test_a_port_that_is_slow_is_counted_and_costs_frames_by_the_rule():
    class Slow(Jittery):
        """Takes 10 bytes at a time."""

        def write_some(self, data):
            return super().write_some(data[:10] if self.streaming else data)

    port = Slow()
    driver, report = stream(port)
    assert report.write_stalls > 100
    assert_the_laws_hold(port, driver, report)


def test_output_is_silent_within_hold_and_ramp_after_the_last_frame():
    port = Jittery()
    with contextlib.suppress(KeyError), Driver(port) as driver:
        driver.arm()
        driver.stream(CIRCLE, 1000)
        config = driver.config()
        port.stall(2_000_000_000)
        raise KeyError
    last_us = port.latches[-1].t_latch_us
    muted_us = next(n.t_us for n in port.notices if getattr(n, "reason", 0) in SILENCED)
    assert last_us < muted_us <= last_us + 1000 * (config.hold_ms + config.ramp_ms)


SILENCED = (MuteReason.HOLD_EXPIRED, MuteReason.HOST_SILENT)


def test_the_clock_of_every_run_crosses_its_wrap():
    assert 2**32 - BOOT_US == 10_000_000


def test_a_lead_longer_than_the_lease_costs_no_frame():
    port = Jittery(queue_depth=128)
    _, report = stream(port, CIRCLE[:100], rate_hz=50, lead_us=2_000_000)  # the lease: 500 ms
    assert (report.status.reason, report.status.counters.timeouts) == (MuteReason.NONE, 0)
    assert len(port.latches) == 100


def test_a_board_that_needs_time_latches_every_frame_at_its_time():
    port = Jittery(latch_lead_us=400, point_time_us=900)
    driver, report = stream(port, CIRCLE, rate_hz=1000, mode="points")
    assert_the_laws_hold(port, driver, report)
    assert (len(port.latches), report.status.counters.late) == (120, 0)
    assert report.status.counters.accepted == 120


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ({"rate_hz": 1200, "mode": "points"}, "computes these focal points in 900 µs a frame"),
        ({"rate_hz": 1000, "lead_us": 1400, "mode": "points"}, "1300 µs to make them ready"),
        ({"rate_hz": 1000, "lead_us": 500}, "400 µs to make them ready"),
    ],
)
def test_a_stream_that_a_board_cannot_make_ready_is_refused(options, told):
    port = Jittery(latch_lead_us=400, point_time_us=900)
    with pytest.raises(ConfigurationError, match=told):
        stream(port, **options)


def test_a_playback_that_a_board_cannot_make_ready_is_refused():
    with Driver(Jittery(latch_lead_us=400, point_time_us=900), seed=1) as driver:
        driver.arm()
        with pytest.raises(ConfigurationError, match="takes 1300 µs to make a frame ready"):
            driver.play(CIRCLE, 500, mode="points", lead_us=1300)
        with pytest.raises(ConfigurationError, match="takes 900 µs to compute a frame"):
            driver.play(CIRCLE, 1250, mode="points")
        assert driver.play(CIRCLE, 1000, mode="points").latched == 120
