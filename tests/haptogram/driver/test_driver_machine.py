"""Whatever a user asks of a driver, in whatever order and after whatever pause, is latched."""

import dataclasses

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from haptogram.acoustics import AcousticModel, Medium
from haptogram.driver.driver import Driver
from haptogram.records.frame import Focus
from haptogram_protocol.messages import DriveKind
from haptogram_protocol.state import MuteReason, OutputState
from virtual_ports import BoardPort

MODEL = AcousticModel.default(4, 4)
NS_PER_MS = 1_000_000
CARRIER_US = 25
TIMERS = (MuteReason.HOLD_EXPIRED, MuteReason.HOST_SILENT)

point = st.tuples(st.floats(-0.03, 0.03), st.floats(-0.03, 0.03), st.floats(0.05, 0.2))
few_points = st.lists(point, min_size=1, max_size=6)
mode = st.sampled_from(["phases", "drives", "points"])
#: Periods that are whole numbers of carrier periods, so that a sequence can have them.
rate_hz = st.sampled_from([100, 250, 1000])


def place_of(key):
    return key.sequence, key.loop, key.index


class AnyOrder(RuleBasedStateMachine):
    """A user of one driver on a healthy board, who may be slow, and the board's side of it."""

    def __init__(self):
        super().__init__()
        self.port = BoardPort(model=MODEL)
        self.driver = Driver(self.port, seed=1, medium=Medium.air(35.0))
        self.armed = False
        self.ready = self.driver.frames([(0.0, 0.0, 0.1)], mode="points")

    def teardown(self):
        self.driver.close()
        assert self.port.board.output.state is not OutputState.ARMED
        self.everything_intended_was_latched_once_at_its_time()

    # --- the user ------------------------------------------------------------------------------

    @rule()
    def arm(self):
        self.driver.arm()
        self.armed = True

    @rule()
    def mute(self):
        self.driver.mute()
        self.armed = False

    @rule()
    def disarm(self):
        self.driver.disarm()
        self.armed = False

    @rule(pause_ms=st.integers(0, 1500))
    def do_nothing(self, pause_ms):
        self.port.stall(pause_ms * NS_PER_MS)

    @rule(hold_ms=st.integers(30, 400), host_timeout_ms=st.integers(120, 600))
    def configure(self, hold_ms, host_timeout_ms):
        self.driver.configure(hold_ms=hold_ms, host_timeout_ms=host_timeout_ms)

    @rule(speed_mm_s=st.integers(300_000, 380_000))
    def configure_the_air(self, speed_mm_s):
        self.driver.configure(sound_speed_mm_s=speed_mm_s)

    @rule(temperature_c=st.floats(-10.0, 50.0))
    def assume_another_air(self, temperature_c):
        self.driver.model = dataclasses.replace(self.driver.model, medium=Medium.air(temperature_c))

    @rule(places=few_points, mode=mode)
    def make_frames(self, places, mode):
        self.ready = self.driver.frames(places, mode=mode)

    @precondition(lambda self: self.armed)
    @rule()
    def stream_what_is_ready(self):
        self.driver.stream(self.ready, 1000)

    @rule()
    def ask(self):
        self.driver.ping()
        assert (self.driver.status().state is OutputState.ARMED) <= self.armed

    @precondition(lambda self: self.armed)
    @rule(place=point, mode=mode)
    def focus(self, place, mode):
        intended = self.driver.focus(place, mode=mode)
        self.driver.status()  # behind the frame on the line
        assert self.driver.read_drive(DriveKind.LATCHED).drive == intended.drive

    @precondition(lambda self: self.armed)
    @rule(place=point, seconds=st.floats(0.0, 1.0))
    def focus_and_hold(self, place, seconds):
        self.driver.focus(place)
        self.driver.hold(seconds)
        assert self.port.board.output.state is OutputState.ARMED

    @precondition(lambda self: self.armed)
    @rule(places=few_points, rate_hz=rate_hz, mode=mode)
    def stream(self, places, rate_hz, mode):
        report = self.driver.stream(places, rate_hz, mode=mode)
        assert (report.frames, report.skipped) == (len(places), ())

    @precondition(lambda self: self.armed)
    @rule(pairs=st.lists(st.tuples(point, point), min_size=1, max_size=3))
    def stream_pairs(self, pairs):
        self.driver.stream([[Focus.at(a), Focus.at(b)] for a, b in pairs], 1000, mode="drives")

    @precondition(lambda self: self.armed)
    @rule(
        places=few_points,
        rate_hz=rate_hz,
        loops=st.integers(1, 3),
        mode=st.sampled_from(["phases", "points"]),
    )
    def play(self, places, rate_hz, loops, mode):
        report = self.driver.play(places, rate_hz, loops=loops, mode=mode)
        assert report.latched == loops * len(places)

    # --- what holds after each of them ---------------------------------------------------------

    @invariant()
    def everything_intended_was_latched_once_at_its_time(self):
        self.port.stall(2 * NS_PER_MS)  # a frame as soon as it is complete may still be on the line
        latches, intended = self.port.latches, self.driver.intended
        assert [place_of(latch.key) for latch in latches] == [place_of(f.key) for f in intended]
        for latch, frame in zip(latches, intended, strict=True):
            assert latch.drive == frame.drive
            if frame.t_apply_us is not None:
                assert 0 <= latch.t_latch_us - frame.t_apply_us < CARRIER_US

    @invariant()
    def only_who_armed_it_hears_it(self):
        board = self.port.board
        assert self.armed or board.output.state is not OutputState.ARMED
        assert (
            not self.armed
            or board.output.state is OutputState.ARMED
            or board.output.reason in TIMERS
        )


AnyOrder.TestCase.settings = settings(stateful_step_count=12)
test_any_order = AnyOrder.TestCase
