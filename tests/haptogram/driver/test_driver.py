import contextlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptogram.acoustics import AcousticModel, TransducerArray
from haptogram.driver.driver import Driver
from haptogram.driver.timing.schedule import Schedule
from haptogram.errors import ConfigurationError, DeviceError, LinkError, LinkLostError
from haptogram.records.frame import Evidence, Focus
from haptogram_protocol.messages import DriveKind, ErrorCode, Feature, MessageType, TraceMode
from haptogram_protocol.state import MuteReason, OutputState
from virtual_ports import BoardPort

ANGLE = np.linspace(0.0, 6.0, 200)
CIRCLE = np.column_stack((0.03 * np.cos(ANGLE), 0.03 * np.sin(ANGLE), np.full(200, 0.12)))
SMALL = AcousticModel.default(4, 4)


def small_board(**settings):
    return BoardPort(model=SMALL, **settings)


def drives_by_index(port):
    return {latch.key.index: latch.drive for latch in port.latches}


def delays_us(port, driver):
    """Times from due to latched."""
    both = zip(port.latches, driver.intended, strict=True)
    return {latch.t_latch_us - intended.t_apply_us for latch, intended in both}


@pytest.fixture
def port():
    return small_board()


@pytest.fixture
def driver(port):
    with Driver(port, seed=1) as driver:
        driver.arm()
        yield driver


# --- connecting ----------------------------------------------------------------------------------


@pytest.mark.parametrize("array", ["16x16", "32x4", "1x1"])
def test_the_model_is_the_boards_own_array(array):
    board_model = AcousticModel.default(*map(int, array.split("x")))
    with Driver(BoardPort(model=board_model)) as driver:
        assert driver.model.array.digest() == board_model.array.digest()
        assert driver.model.array.grid_shape == board_model.array.grid_shape
        assert driver.geometry().digest() == board_model.array.digest()
        assert driver.warnings == []


def test_an_array_that_is_no_grid_is_read_element_by_element():
    positions = np.random.default_rng(3).uniform(-0.1, 0.1, (300, 3)) * (1, 1, 0.05)
    array = TransducerArray.from_positions(np.round(positions, 6))
    model = AcousticModel(array, SMALL.medium, SMALL.transducer)
    with Driver(BoardPort(model=model)) as driver:
        np.testing.assert_allclose(driver.model.array.positions_m, array.positions_m, atol=1e-9)


@pytest.mark.parametrize("radius_m", [0.12, 0.122, 0.15, 0.2])
def test_a_bowl_is_read_with_normals_of_any_direction(radius_m):
    flat = AcousticModel.default(8, 8)
    x, y, _ = flat.array.positions_m.T
    places = np.column_stack([x, y, radius_m - np.sqrt(radius_m**2 - x * x - y * y)])
    array = TransducerArray.from_positions(places, [0.0, 0.0, radius_m] - places)
    with Driver(BoardPort(model=AcousticModel(array, flat.medium, flat.transducer))) as driver:
        assert driver.model.array.digest() == array.digest()
        assert driver.warnings == []


def test_a_model_of_another_size_is_refused_and_the_port_closed(port):
    with pytest.raises(ConfigurationError, match="256 transducers, the board 16"):
        Driver(port, model=AcousticModel.default())
    assert port.closed


def test_a_model_of_another_place_is_a_warning(port):
    with Driver(port, model=AcousticModel.default(4, 4, pitch_m=0.011)) as driver:
        assert len(driver.warnings) == 1
        assert "geometry hash" in driver.warnings[0]


def test_the_clock_is_known_to_a_microsecond_on_an_even_line(driver, port):
    now_ns = port.now_ns()
    assert driver.clock.uncertainty_us < 5
    assert abs(driver.clock.to_device_us(now_ns) - port.simulation.device_us(now_ns)) <= 2


@pytest.mark.parametrize("nonce", [0, 65_536, -1])
def test_a_session_that_cannot_be_is_refused(port, nonce):
    with pytest.raises(ConfigurationError, match="nonce"):
        Driver(port, nonce=nonce)


def test_sessions_are_random_unless_seeded():
    assert len({Driver(small_board()).session for _ in range(5)}) > 1
    assert Driver(small_board(), seed=4).session == Driver(small_board(), seed=4).session
    assert Driver(small_board(), nonce=77).session == 77


# --- life ----------------------------------------------------------------------------------------


def test_leaving_mutes_and_closes(port):
    with Driver(port) as driver:
        driver.arm()
        driver.focus((0, 0, 0.15))
    assert (port.board.output.state, port.board.output.reason) == (
        OutputState.MUTED,
        MuteReason.MUTE,
    )
    assert port.closed
    driver.close()


def test_leaving_by_an_error_mutes_too(port):
    with contextlib.suppress(KeyError), Driver(port) as driver:
        driver.arm()
        raise KeyError
    assert port.board.output.reason is MuteReason.MUTE


def test_an_interrupted_stream_mutes_before_anything_else_that_waits(port):
    def interrupt(done, _):
        if done >= 100:
            raise KeyboardInterrupt

    with contextlib.suppress(KeyboardInterrupt), Driver(port) as driver:
        driver.arm()
        driver.stream(CIRCLE, 1000, progress=interrupt)
    assert port.board.output.reason is MuteReason.MUTE
    assert 100 <= len(driver.intended) < 200


@pytest.mark.parametrize("lead_us", [5_000, 96_000])
def test_an_interrupted_stream_takes_no_frame_from_the_next_one(driver, lead_us):
    def interrupt(done, _):
        if done >= 100:
            raise ZeroDivisionError

    with contextlib.suppress(ZeroDivisionError):
        driver.stream(CIRCLE, 1000, loops=5, progress=interrupt)
    counters = driver.stream(CIRCLE, 1000, lead_us=lead_us).status.counters
    assert (counters.latched, counters.gap) == (len(driver.intended), 0)


def test_a_board_that_does_not_confirm_its_mute_is_an_error_in_bounded_time(port):
    driver = Driver(port)
    driver.arm()
    port.deaf = True
    before_ns = port.now_ns()
    with pytest.raises(
        LinkError, match="did not confirm that it is mute; it mutes itself after 500"
    ):
        driver.close()
    assert port.now_ns() - before_ns <= 1_100_000_000
    assert port.closed


def test_a_link_that_broke_keeps_its_error_and_notes_the_missing_mute(port):
    driver = Driver(port)
    driver.arm()
    port.lost = True
    with pytest.raises(LinkLostError, match="gone") as caught, driver:
        driver.status()
    assert "did not confirm" in caught.value.__notes__[0]
    assert port.closed


def test_a_port_that_takes_no_more_bytes_is_lost_and_never_hangs(driver, port):
    def stop(done, _):
        port.deaf = done >= 50

    with pytest.raises(LinkLostError, match="taken no byte for 2 s"):
        driver.stream(CIRCLE, 1000, progress=stop)
    assert 50 <= len(driver.intended) < 60
    port.deaf = False


# --- streaming -----------------------------------------------------------------------------------


@pytest.mark.parametrize("mode", ["phases", "drives", "points"])
@pytest.mark.parametrize("rate_hz", [1000, 333.3])
def test_every_frame_latches_at_its_time_with_the_drive_intended(driver, port, mode, rate_hz):
    report = driver.stream(CIRCLE, rate_hz, mode=mode)
    assert report.frames == report.sent == len(driver.intended) == 200
    assert (report.skipped, report.late_ticks, report.write_stalls) == ((), 0, 0)
    assert [latch.key.index for latch in port.latches] == [i.key.index for i in driver.intended]
    for latch, intended in zip(port.latches, driver.intended, strict=True):
        assert latch.drive == intended.drive
        assert 0 <= latch.t_latch_us - intended.t_apply_us < 25
    assert report.status.counters.latched == 200


@given(st.sampled_from([1000, 999, 750.5, 60, 1000 / 3, 40.1]), st.integers(0, 5000))
def test_the_grid_of_times_never_drifts(rate_hz, number):
    schedule = Schedule.at_rate(rate_hz, 20_000, queue_depth=128)
    exact_us = number * 1_000_000 / rate_hz
    assert -1 - 1e-5 * number <= schedule.offset_us(number) - exact_us <= 1e-5 * number


def test_a_long_stream_crosses_the_wrap_of_sequence_numbers_and_clock():
    port = small_board()
    with Driver(port) as driver:
        driver.arm()
        points = np.tile(CIRCLE, (15, 1))
        report = driver.stream(points, 250)
    assert report.status.counters.latched == 3_000
    assert driver.intended[0].t_apply_us < 2**32 < driver.intended[-1].t_apply_us
    assert driver.intended[0].key.index < 2**16 < driver.intended[-1].key.index
    assert delays_us(port, driver) == {0}


def test_several_foci_share_a_frame(driver, port):
    pairs = [(Focus.at(p), Focus.at(p * (-1, -1, 1), 0.5, 1.0)) for p in CIRCLE[:10]]
    driver.stream(pairs, 500, mode="points")
    driver.stream(pairs, 500, mode="drives")
    assert [latch.drive for latch in port.latches] == [i.drive for i in driver.intended]
    assert [i.board_computed for i in driver.intended] == [True] * 10 + [False] * 10
    assert all(len(i.foci) == 2 for i in driver.intended)


def test_a_stall_of_the_host_skips_what_cannot_be_in_time_and_names_it(driver, port):
    def stall(done, _):
        if done == 50:
            port.stall(30_000_000)

    report = driver.stream(CIRCLE, 1000, lead_us=20_000, progress=stall)
    assert report.frames == len(driver.intended) == 200
    assert 5 <= len(report.skipped) <= 15
    assert report.skipped[0] == 50
    assert report.late_ticks >= 10
    latched = drives_by_index(port)
    for intended in driver.intended:
        skipped = intended.number in report.skipped
        assert (intended.key.index not in latched) == skipped
    assert report.status.counters.gap == len(report.skipped)
    assert report.status.counters.dropped_late == 0


def test_a_short_stall_loses_nothing(driver, port):
    report = driver.stream(CIRCLE, 1000, progress=lambda *_: port.stall(8_000_000))
    assert report.skipped == ()
    assert report.status.counters.latched == 200


@pytest.mark.parametrize("writes", range(1, 8))
def test_a_mute_waits_for_no_more_than_two_frames(writes):
    """In the burst after a stall, too: what lies in the port cannot be overtaken."""
    burst = []

    def tamper(data):
        if burst and len(burst) <= writes:
            burst.append(data)
        if len(burst) == writes + 1:
            burst.append(port.now_ns())
            raise KeyboardInterrupt
        return data

    def stall(*_):
        port.stall(15_000_000)
        burst.append(b"")

    port = BoardPort(tamper=tamper)
    with contextlib.suppress(KeyboardInterrupt), Driver(port) as driver:
        driver.arm()
        driver.stream(CIRCLE, 1000, progress=stall)
    muted_us = next(n.t_us for n in port.notices if getattr(n, "reason", None) is MuteReason.MUTE)
    waited_us = muted_us - port.simulation.device_us(burst[-1])
    assert waited_us <= (2 * 276 + 26) * 10 / 3


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ({"rate_hz": 0}, "rate_hz is 0, must be 0.001 to 1000000"),
        ({"rate_hz": float("nan")}, "rate_hz is nan"),
        ({"lead_us": 0}, "lead_us is 0, must be 1"),
        ({"lead_us": 150_000}, "keeps 151 frames waiting; the board's queue holds 128"),
        ({"rate_hz": 1, "lead_us": 11_000_000}, "10000000 µs ahead"),
        ({"lead_us": 100}, "lead is 100 µs"),
        ({"mode": "colours"}, "mode is 'colours'"),
        ({"targets": []}, "0 targets"),
        ({"targets": [(0, 0, -0.1)]}, "frame 0: target: height z is -100 mm"),
        ({"targets": [(0, 0, 0.1), (0, 0, float("nan"))]}, "three finite"),
        ({"targets": 7}, "targets"),
        ({"targets": [Focus((0, 0, 0.1), 0.5)]}, "amplitude 0.5"),
        ({"targets": [[Focus((0, 0, 0.1))] * 9], "mode": "points"}, "9 foci; the board takes 8"),
        ({"rate_hz": 3}, "hold_ms"),
    ],
)
def test_what_cannot_be_is_refused_before_the_first_byte(driver, port, arguments, text):
    before = len(port.written)
    arguments = {"targets": CIRCLE, "rate_hz": 1000} | arguments
    with pytest.raises(ConfigurationError, match=text):
        driver.stream(arguments.pop("targets"), **arguments)
    assert len(port.written) == before
    assert driver.intended == []


def test_a_rate_that_the_line_cannot_carry_says_which_it_can():
    with Driver(BoardPort()) as driver:
        text = "rate_hz is 2000; 274 bytes a frame at 3000000 baud carry 1094 frames/s"
        with pytest.raises(ConfigurationError, match=text):
            driver.stream(CIRCLE, 2000)


def test_a_mode_that_the_board_lacks_is_refused():
    with (
        Driver(small_board(features=Feature.TRACE)) as driver,
        pytest.raises(ConfigurationError, match="mode points"),
    ):
        driver.stream(CIRCLE, 1000, mode="points")


def test_progress_counts_up_to_the_end(driver):
    seen = []
    driver.stream(CIRCLE, 1000, progress=lambda done, total: seen.append((done, total)))
    assert seen == sorted(seen)
    assert seen[-1] == (200, 200)


def test_pings_keep_the_clock_while_streaming(driver, port):
    driver.stream(np.tile(CIRCLE, (15, 1)), 1000)
    pings = sum(
        data.count(bytes([MessageType.PING])) > 0 and len(data) < 30 for data in port.written
    )
    assert pings >= 8 + 3


def test_damage_on_the_line_costs_the_frames_it_hits_and_no_more():
    damaged = []

    def tamper(data):
        if (
            len(data) > 30
            and data[0] == 0
            and len(damaged) < 3
            and port.board.output.counters.latched > 20
        ):
            damaged.append(data)
            return data[:12] + bytes([data[12] ^ 1 or 2]) + data[13:]
        return data

    port = small_board(tamper=tamper)
    with Driver(port) as driver:
        driver.arm()
        report = driver.stream(CIRCLE, 1000)
    assert report.status.counters.latched == 197
    assert report.status.counters.crc + report.status.counters.cobs == 3


# --- one focus -----------------------------------------------------------------------------------


def test_a_focus_is_latched_at_once_and_held(driver, port):
    intended = driver.focus((0.01, 0.0, 0.15))
    driver.hold(3.0)
    assert intended == driver.intended[0]
    assert intended.t_apply_us is None
    assert {latch.drive for latch in port.latches} == {intended.drive}
    assert port.board.output.state is OutputState.ARMED
    assert len(driver.intended) == len(port.latches)


def test_a_focus_that_is_not_held_falls_silent(driver, port):
    driver.focus((0.01, 0.0, 0.15))
    port.stall(1_000_000_000)
    assert driver.status().reason is MuteReason.HOLD_EXPIRED
    assert [event.message.reason for event in driver.events] == [MuteReason.HOLD_EXPIRED]


def test_a_focus_is_held_again_after_a_pause_and_after_a_stall_in_the_middle(driver, port):
    intended = driver.focus((0.01, 0.0, 0.15))
    port.stall(1_000_000_000)
    driver.hold(0.5)
    assert port.board.output.state is OutputState.ARMED
    read, turns = port.read_available, []

    def stalling_once(deadline_ns):
        turns.append(deadline_ns)
        if len(turns) == 5:
            port.stall(1_000_000_000)
        return read(deadline_ns)

    port.read_available = stalling_once
    driver.hold(2.0)
    assert port.board.output.state is OutputState.ARMED
    assert port.board.output.counters.timeouts == 2
    assert port.board.output.counters.dropped_state == 0
    assert port.board.output.radiated(port.board.output.now_us) == intended.drive


def test_nothing_is_held_on_a_board_that_was_muted(driver):
    driver.focus((0.01, 0.0, 0.15))
    driver.mute()
    with pytest.raises(ConfigurationError, match="arm it first"):
        driver.hold(1.0)


def test_nothing_to_hold(driver):
    with pytest.raises(ConfigurationError, match="call focus first"):
        driver.hold(1.0)


# --- evidence ------------------------------------------------------------------------------------


@pytest.mark.parametrize("mode", [TraceMode.CRC, TraceMode.DRIVE, TraceMode.RING])
def test_the_boards_own_word_joins_what_was_intended(port, mode):
    with Driver(port, trace=mode) as driver:
        driver.arm()
        driver.stream(CIRCLE, 500)
        driver.play(CIRCLE[:50], 500, loops=2)
    seen = {observation.key: observation for observation in driver.observations}
    assert list(seen) == [intended.key for intended in driver.intended]
    for intended in driver.intended:
        observation = seen[intended.key]
        assert observation.evidence is Evidence.SELF_REPORTED
        assert observation.drive_crc == intended.drive.digest()
        assert observation.t_latch_us == intended.t_apply_us
        assert (observation.drive == intended.drive) == (mode is TraceMode.DRIVE)


def test_latches_that_the_trace_ring_kept_no_longer_are_counted():
    with Driver(small_board(trace_ring=60), trace=TraceMode.RING) as driver:
        driver.arm()
        driver.stream(CIRCLE[:100], 500)
        assert (len(driver.observations), driver.observations.dropped) == (60, 40)
        driver.stream(CIRCLE[:30], 500)
        assert (len(driver.observations), driver.observations.dropped) == (90, 40)


@pytest.mark.parametrize("minutes", [1, 40, 69])
def test_a_latch_of_long_ago_is_read_back_with_its_own_time(port, minutes):
    with Driver(port, trace=TraceMode.RING) as driver:
        driver.arm()
        driver.focus((0.01, 0.0, 0.15))
        port.stall(minutes * 60_000_000_000)
        driver.collect_ring()
        told = driver.read_drive(), *driver.observations
    assert {latch.t_latch_us for latch in told} == {latch.t_latch_us for latch in port.latches}


def test_read_back_shows_latched_and_radiated(driver):
    intended = driver.focus((0.01, 0.0, 0.15))
    driver.correct_phases(bytes(range(16)))
    driver.focus((0.01, 0.0, 0.15))
    latched, radiated = driver.read_drive(), driver.read_drive(DriveKind.RADIATED)
    assert latched.drive == intended.drive
    shift = radiated.drive.phase_codes - latched.drive.phase_codes
    assert shift.tolist() == list(range(16))


def test_read_back_of_a_large_array_comes_in_parts():
    with Driver(BoardPort(model=AcousticModel.default(32, 32))) as driver:
        driver.arm()
        intended = driver.focus((0.0, 0.02, 0.2))
        assert driver.read_drive().drive == intended.drive


# --- sequences, configuration --------------------------------------------------------------------


@pytest.mark.parametrize("mode", ["phases", "points"])
def test_a_sequence_plays_on_the_boards_clock(driver, port, mode):
    report = driver.play(CIRCLE, 2000, loops=3, mode=mode)
    assert report.frames == report.latched == 600
    assert [latch.drive for latch in port.latches] == [i.drive for i in driver.intended]
    assert delays_us(port, driver) == {0}
    assert port.board.output.state is OutputState.ARMED


@pytest.mark.parametrize("unattended_ms", [None, 1000, 2000])
def test_a_playback_longer_than_its_lease_is_kept_alive(unattended_ms):
    allowed_ms = unattended_ms or 1000  # the least that a board may allow
    with Driver(small_board(max_unattended_ms=allowed_ms), seed=1) as driver:
        driver.arm()
        report = driver.play(CIRCLE, 40, unattended_ms=unattended_ms)
    assert report.latched == 200


def test_play_after_a_stream_arms_again_what_fell_silent_during_the_upload():
    port = BoardPort(baud=500_000)
    with Driver(port, baudrate=500_000) as driver:
        driver.arm()
        driver.focus((0, 0, 0.15))
        assert driver.play(CIRCLE, 1000).latched == 200


OUTPUTS = [
    lambda driver: driver.focus((0, 0, 0.15)),
    lambda driver: driver.stream(CIRCLE[:9], 1000),
    lambda driver: driver.play(CIRCLE[:9], 1000),
]


@pytest.mark.parametrize("output", OUTPUTS)
def test_only_the_caller_arms_a_board(port, output):
    with Driver(port) as driver:
        with pytest.raises(ConfigurationError, match=r"DISARMED \(NEVER_ARMED\); arm it first"):
            output(driver)
        driver.arm()
        driver.mute()
        with pytest.raises(ConfigurationError, match=r"MUTED \(MUTE\); arm it first"):
            output(driver)
    assert port.latches == []


@pytest.mark.parametrize("output", OUTPUTS)
@pytest.mark.parametrize("pause_ns", [300_000_000, 5_000_000_000])
def test_a_pause_of_the_host_does_not_disarm(driver, port, output, pause_ns):
    driver.focus((0, 0, 0.15))
    port.stall(pause_ns)
    assert port.board.output.state is OutputState.MUTED
    output(driver)
    driver.status()  # behind the last frame on the line
    assert len(port.latches) == len(driver.intended) > 1


@pytest.mark.parametrize("silence", [Driver.mute, Driver.disarm])
@pytest.mark.parametrize("output", OUTPUTS)
def test_a_board_that_the_caller_silenced_is_not_armed_by_a_later_pause(
    driver, port, output, silence
):
    driver.focus((0, 0, 0.15))
    port.stall(5_000_000_000)
    assert port.board.output.state is OutputState.MUTED
    silence(driver)
    latched = len(port.latches)
    with pytest.raises(ConfigurationError, match="arm it first"):
        output(driver)
    assert len(port.latches) == latched


def test_a_driver_that_does_not_come_up_mutes_the_board_and_closes_the_port(port, monkeypatch):
    monkeypatch.setattr(Driver, "_builder", lambda _: (_ for _ in ()).throw(RuntimeError("late")))
    with pytest.raises(RuntimeError, match="late"):
        Driver(port, seed=1)
    assert port.board.output.state is OutputState.MUTED
    assert port.closed


@pytest.mark.parametrize("output", OUTPUTS)
@given(pause_ms=st.integers(0, 300))
def test_no_pause_lets_the_hold_run_out_under_the_first_frames(output, pause_ms):
    port = small_board()
    with Driver(port, seed=1) as driver:
        driver.arm()
        driver.stream(CIRCLE[:5], 1000)
        port.stall(pause_ms * 1_000_000)
        output(driver)
        driver.status()  # behind the last frame on the line
        assert len(port.latches) == len(driver.intended) > 5


def test_a_stream_goes_round_as_often_as_is_said(driver, port):
    report = driver.stream(CIRCLE[:5], 1000, loops=3)
    assert report.frames == 15
    drives = [latch.drive for latch in port.latches]
    assert drives == drives[:5] * 3


def test_frames_made_ahead_are_sent_as_they_are(driver, port):
    frames = driver.frames(CIRCLE[:5])
    driver.stream(frames, 1000, loops=2)
    driver.play(frames, 1000)
    assert [latch.drive for latch in port.latches] == [frame.drive for frame in frames] * 3


@pytest.mark.parametrize(("hold_ms", "every_ms"), [(200, 185), (100, 90), (20, 5), (8, 2)])
def test_a_focus_in_good_time_inserts_no_silence(driver, port, hold_ms, every_ms):
    driver.configure(hold_ms=hold_ms)
    before = len(port.notices)
    for _ in range(10):
        driver.focus((0, 0, 0.15))
        port.stall(every_ms * 1_000_000)
    assert port.notices[before:] == []  # neither muted nor armed


@pytest.mark.parametrize("stall_ms", [70, 90, 99, 100, 101, 103, 150, 400])
def test_a_held_focus_sounds_again_after_any_stall(driver, port, stall_ms):
    driver.configure(hold_ms=100, ramp_ms=0)
    driver.focus((0, 0, 0.15))
    write, count = port.write_some, 0

    def stall_once(data):
        nonlocal count
        count += 1
        written = write(data)
        if count == 3:
            port.stall(stall_ms * 1_000_000)
        return written

    port.write_some = stall_once
    driver.hold(1.0)
    assert port.board.output.state is OutputState.ARMED
    assert port.latches[-1].t_latch_us > port.board.output.now_us - 60_000


def test_streams_that_follow_each_other_at_once_leave_no_silence(driver, port):
    driver.stream(CIRCLE[:5], 1000)
    driver.stream(CIRCLE[:5], 1000)
    assert port.board.output.counters.timeouts == 0
    assert driver.events == []  # neither muted nor armed anew


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ({"loops": 0}, "loops is 0"),
        ({"rate_hz": 300}, "3333 µs are 300.03"),
        ({"rate_hz": 20_000}, "the board plays up to 10000"),
        ({"rate_hz": -1}, "rate_hz is -1"),
        ({"mode": "drives"}, "hold phases or points, not drives"),
        ({"unattended_ms": 100}, "unattended_ms is 100"),
        ({"lead_us": 20_000_000}, "lead_us is 20000000, must be 1 to 9999000"),
        (
            {"targets": [[Focus((0, 0, 0.1))], [Focus((0, 0, 0.1))] * 2], "mode": "points"},
            "as many",
        ),
    ],
)
def test_what_cannot_be_played_is_refused_before_the_first_byte(driver, port, arguments, text):
    before = len(port.written)
    arguments = {"targets": CIRCLE, "rate_hz": 1000} | arguments
    with pytest.raises(ConfigurationError, match=text):
        driver.play(arguments.pop("targets"), **arguments)
    assert len(port.written) == before


def test_an_upload_that_the_board_cannot_hold_is_refused_before_the_first_byte():
    port = small_board(max_upload_bytes=1000, max_sequence_frames=100)
    with Driver(port) as driver:
        driver.arm()
        with pytest.raises(ConfigurationError, match="3200 bytes; the board takes 1000"):
            driver.play(CIRCLE, 1000)


def test_an_interrupted_playback_intends_what_was_due(driver, port):
    def interrupt(done, _):
        if done >= 100:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        driver.play(CIRCLE, 100, progress=interrupt)
    assert 100 <= len(driver.intended) < 150
    assert len(port.latches) == len(driver.intended)


def test_lost_requests_are_sent_again():
    count = 0

    def lossy(data):
        nonlocal count
        count += 1
        return b"" if count % 3 == 0 else data

    port = small_board(tamper=lossy)
    with Driver(port) as driver:
        driver.arm()
        assert driver.play(CIRCLE, 1000).latched == 200


def test_configuration_is_set_field_by_field(driver):
    assert driver.configure(hold_ms=300).hold_ms == 300
    config = driver.configure(ramp_ms=10)
    assert (config.hold_ms, config.ramp_ms) == (300, 10)
    assert driver.config() == config
    with pytest.raises(ConfigurationError, match="no 'holdms'"):
        driver.configure(holdms=3)
    with pytest.raises(ConfigurationError, match="does not fit"):
        driver.configure(hold_ms=70_000)
    with pytest.raises(DeviceError, match="SET_CONFIG was refused: BAD_VALUE") as caught:
        driver.configure(hold_ms=0)
    assert caught.value.code == ErrorCode.BAD_VALUE
    assert driver.config() == config


def test_a_correction_has_one_code_per_transducer(driver):
    with pytest.raises(ConfigurationError, match="15 phase corrections; the board has 16"):
        driver.correct_phases(bytes(15))


def test_states(driver):
    assert driver.arm() is OutputState.ARMED
    assert driver.mute() is OutputState.MUTED
    assert driver.arm() is OutputState.ARMED
    assert driver.disarm() is OutputState.DISARMED
    assert driver.ping() < 5
