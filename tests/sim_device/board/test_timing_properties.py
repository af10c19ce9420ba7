"""What holds for every stream on every line: order, ticks, tolerance, accounting, silence.

In virtual time, over random stalls and jitter of the host, rates of the line, drift, step and wrap
of the device clock, frames lost, damaged and out of order.
"""

import binascii
import random
from dataclasses import dataclass
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptogram.settings.faults.plan import FaultPlan
from haptogram_protocol.connection import HostConnection, ReplyReceived
from haptogram_protocol.framing import encode_frame
from haptogram_protocol.messages import (
    Arm,
    Config,
    Flag,
    Phases,
    Play,
    SetConfig,
    TraceMode,
    UploadBegin,
    UploadChunk,
    UploadCommit,
    UploadKind,
    build_body,
)
from haptogram_protocol.state import OutputState
from sim_device.board.events import Counted, PowerDown, StateChange
from sim_device.board.settings import board_settings
from sim_device.simulation import Simulation

US, MS = 1_000, 1_000_000
NONCE = 0x5EED
CARRIER_US = 25
FRAMES = 30
START_NS = 60 * MS  # of the stream: at the slowest rate the requests before it take 40 ms
CONFIG = Config(hold_ms=20, ramp_ms=10, host_timeout_ms=30, status_period_ms=0)
DAMAGED = ("crc", "cobs", "short", "oversize", "bad_length", "bad_value", "unknown_type")
DROPPED = ("dropped_late", "dropped_future", "dropped_order", "dropped_full", "dropped_state")
FATES = ("latched", *DROPPED, "flushed", "duplicate", "stale_session")


@dataclass
class Run:
    """One stream: what was sent, and what came of it."""

    simulation: Simulation
    recorder: "Takes"
    sent: dict[int, tuple[int, int]]  # by index: t_apply and when it was written, device time
    written: int
    first: int  # index
    before: dict[str, int]

    @property
    def counted(self):
        after = self.simulation.dialect.counters
        return {name: count - self.before[name] for name, count in after.items()}


class Takes:
    """A recorder that keeps everything."""

    def __init__(self):
        self.latches, self.notices, self.all = [], [], []

    def latch(self, latch):
        self.latches.append(latch)
        self.all.append(latch)

    def notice(self, notice):
        self.notices.append(notice)
        self.all.append(notice)


def armed(simulation):
    """Open a session and arm the board, up to START_NS; return the host's end of the link."""
    link = HostConnection(nonce=NONCE)
    link.send_hello(0)
    for request in (None, SetConfig(CONFIG), Arm()):
        if request is not None:
            link.send_request(request, simulation.now_ns // US)
        simulation.host_write(link.data_to_send(), simulation.now_ns)
        while not isinstance(link.next_event(), ReplyReceived):
            simulation.advance_to(simulation.next_event_ns())
            assert simulation.now_ns < START_NS
            link.receive_data(simulation.host_read(), simulation.now_ns // US)
        if isinstance(request, SetConfig):
            simulation.advance_to(START_NS - 15 * MS)
    simulation.advance_to(START_NS)
    return link


def streamed(scenario):
    """Play *scenario* to its end, and on until everything has fallen silent."""
    chance = random.Random(scenario["seed"])
    plan = FaultPlan.parse(scenario["faults"], scenario["seed"])
    recorder = Takes()
    board = board_settings(array="4x4", baud=scenario["baud"], **scenario["line"])
    simulation = Simulation(board, recorder, faults=plan)
    link = armed(simulation)
    run = Run(simulation, recorder, {}, 0, 0, dict(simulation.dialect.counters))
    start_us = simulation.device_us(simulation.now_ns) + scenario["lead_us"]
    frames = []
    for k in range(FRAMES):
        jitter_us = chance.randrange(-scenario["jitter_us"], scenario["jitter_us"] + 1)
        t_apply_us = start_us + k * scenario["period_us"] + jitter_us
        codes = bytes(chance.randrange(256) for _ in range(16))
        index, wire = link.stream_frame(Phases(codes), t_apply_us=t_apply_us)
        frames.append((index, t_apply_us, wire))
    run.first = frames[0][0]
    for k in scenario["swaps"]:
        frames[k : k + 2] = reversed(frames[k : k + 2])
    for k, (index, t_apply_us, wire) in enumerate(frames):
        stall_us = scenario["stalls"].get(k, 0)
        simulation.advance_to(simulation.now_ns + (scenario["period_us"] + stall_us) * US)
        if k not in scenario["lost"]:
            assert simulation.host_write(wire, simulation.now_ns) == len(wire)
            run.sent[index] = t_apply_us, simulation.device_us(simulation.now_ns)
            run.written += 1
    last_ns = simulation.now_ns + (scenario["lead_us"] + 3 * scenario["jitter_us"]) * US
    simulation.advance_to(last_ns + 150 * MS)
    return run


def scenarios(**fixed):
    small = st.integers(0, FRAMES - 2)
    clocks = st.lists(
        st.one_of(
            st.integers(-500, 500).map("clock.ppm ppm={}".format),
            st.integers(50_000, 130_000).map("clock.wrap us={}".format),
            st.integers(0, 8_000).map("clock.step us={} from=70ms".format),
            st.integers(0, 900).map("line.delay us=200 jitter_us={} direction=down".format),
        ),
        max_size=3,
        unique_by=lambda text: text.split()[0],
    )
    values = {
        "seed": st.integers(0, 99),
        "baud": st.sampled_from([None, 115_200, 1_000_000, 3_000_000]),
        "period_us": st.sampled_from([100, 500, 1000, 3000]),
        "lead_us": st.integers(0, 20_000),
        "jitter_us": st.integers(0, 700),
        "stalls": st.dictionaries(small, st.integers(0, 12_000), max_size=3),
        "swaps": st.lists(small, max_size=3),
        "lost": st.sets(small, max_size=4),
        "line": st.just({}),
        "faults": clocks,
    }
    return st.fixed_dictionaries(values | fixed)


@given(scenarios())
def test_latches_are_in_order_on_ticks_of_their_own_and_within_the_tolerance(scenario):
    run = streamed(scenario)
    ticks = [latch.t_latch_us for latch in run.recorder.latches]
    assert all(later - earlier >= CARRIER_US for earlier, later in pairwise(ticks))
    assert all(tick % CARRIER_US == 0 for tick in ticks)
    for latch in run.recorder.latches:
        t_apply_us, written_us = run.sent[latch.key.index]
        assert latch.t_received_us >= written_us
        due_us = max(t_apply_us, latch.t_received_us)
        stepped_us = sum(
            int(fault.split("us=")[1].split()[0])
            for fault in scenario["faults"]
            if fault.startswith("clock.step")
        )
        assert due_us <= latch.t_latch_us <= due_us + CARRIER_US + stepped_us


@given(scenarios(), st.sampled_from([None, "frame.crc p=0.2", "frame.session p=0.2"]))
def test_every_frame_is_accounted_for_exactly_once(scenario, fault):
    faults = [*scenario["faults"], *([] if fault is None else [f"{fault} from=60ms"])]
    run = streamed(scenario | {"faults": faults})
    counted = run.counted
    assert run.simulation.dialect.board.queued == 0
    assert sum(counted[name] for name in (*FATES, *DAMAGED)) == run.written
    assert counted["latched"] == len(run.recorder.latches)
    fired = run.simulation.fault_counts
    assert counted["crc"] == fired.get("frame.crc", 0)
    assert counted["stale_session"] == fired.get("frame.session", 0)
    came = sum(counted[name] for name in FATES) - counted["duplicate"] - counted["stale_session"]
    if fault is None:  # what never came is a gap: of those up to the newest, all that are not new
        assert counted["gap"] == max(run.sent) + 1 - run.first - came


@given(scenarios())
def test_the_output_is_silent_within_hold_and_ramp_after_the_last_frame(scenario):
    run = streamed(scenario)
    board = run.simulation.dialect.board
    assert board.output.state is not OutputState.ARMED
    assert board.output.radiated(board.output.now_us).is_muted
    muted_us = [n.t_us for n in run.recorder.notices if isinstance(n, StateChange)][-1]
    if run.recorder.latches:
        last_us = run.recorder.latches[-1].t_latch_us
        longest_us = max(CONFIG.hold_ms, CONFIG.host_timeout_ms) + CONFIG.ramp_ms
        assert muted_us <= last_us + longest_us * 1000 + 8_000  # a step of the clock may lie in it


def test_a_board_that_was_idle_is_powered_down_at_the_time_it_is_and_not_at_its_last_event():
    recorder = Takes()
    simulation = Simulation(board_settings(array="4x4"), recorder)
    armed(simulation)
    idle_us = simulation.device_us(simulation.now_ns) + 5_000_000
    simulation.advance_to(simulation.now_ns + 5_000 * MS)
    simulation.power_down()
    assert [n.t_us for n in recorder.notices if isinstance(n, PowerDown)] == [idle_us]


def heard(config, play, rest_ms, recorder, plan):
    """Store three frames and play them; return what the host heard, when, and the counters."""
    board = board_settings(array="4x4", baud=3_000_000, max_playback_rate_hz=40_000)
    simulation = Simulation(board, recorder, faults=FaultPlan.parse(plan))
    armed(simulation)
    data = bytes(range(48))
    requests = [
        UploadBegin(UploadKind.PHASES, 0, 7, len(data), binascii.crc32(data)),
        UploadChunk(0, data),
        UploadCommit(7),
        SetConfig(config),
        Arm(),
        play,
    ]
    for seq, request in enumerate(requests, 100):
        flags = Flag.IMMEDIATE if request is play else 0
        body = build_body(request, flags=flags, seq=seq, time_us=0, session=NONCE)
        simulation.host_write(encode_frame(body), simulation.now_ns)
        simulation.advance_to(simulation.now_ns + 2 * MS)
    heard = []
    end_ns = simulation.now_ns + rest_ms * MS
    while simulation.now_ns < end_ns:
        simulation.advance_to_output(min(end_ns, simulation.now_ns + 7 * MS))
        heard.append((simulation.now_ns, simulation.host_read()))
    return heard, simulation.dialect.counters, simulation.device_us(simulation.now_ns)


@pytest.mark.sampled(13)
@pytest.mark.parametrize("trace", TraceMode)
@pytest.mark.parametrize("status_ms", [0, 11])
@pytest.mark.parametrize("hold_ms", [1, 200])
@pytest.mark.parametrize(
    ("period_us", "loops", "alone_ms"),
    [(25, 0, 1000), (100, 0, 1000), (100, 0, 25), (1999, 9, 1000)],
)
def test_a_playback_is_heard_and_recorded_alike_whether_its_latches_come_together_or_not(
    trace, status_ms, hold_ms, period_us, loops, alone_ms
):
    config = Config(
        hold_ms=hold_ms, ramp_ms=1, status_period_ms=status_ms, trace_mode=trace, trace_divider=30
    )
    play, one_by_one, together = Play(7, period_us, loops, alone_ms), Takes(), Takes()
    idle_fault = ["clock.ppm ppm=0"]  # with any fault latches come one by one
    assert heard(config, play, 80, one_by_one, idle_fault) == (
        found := heard(config, play, 80, together, [])
    )
    assert [one for one in one_by_one.all if not isinstance(one, Counted)] == together.all
    assert found[1]["latched"] == len(together.latches) > 0


def test_a_board_plays_a_frame_in_every_carrier_period():
    recorder = Takes()
    heard(CONFIG, Play(7, CARRIER_US, 1000, 1000), 80, recorder, [])
    times_us = [latch.t_latch_us for latch in recorder.latches]
    assert len(times_us) == 3000
    assert {after - before for before, after in pairwise(times_us)} == {CARRIER_US}


CROWDED = {"rx_fifo": 64, "rx_poll_us": 1000}


@given(
    scenarios(
        baud=st.sampled_from([1_000_000, 3_000_000]),
        period_us=st.sampled_from([100, 200, 500]),
        line=st.builds(
            lambda fifo, poll_us: {"rx_fifo": fifo, "rx_poll_us": poll_us},
            st.integers(64, 150),  # a request must get through
            st.integers(200, 1000),
        ),
    ),
    st.booleans(),
)
def test_a_fifo_never_overflows_in_silence(scenario, crowded):
    if crowded:
        scenario = scenario | {"baud": 3_000_000, "period_us": 100, "line": CROWDED}
    run = streamed(scenario)
    whole = sum(run.counted[name] for name in FATES)
    lost = run.simulation.line_counts["board_overrun"]
    assert (whole < run.written) == (lost > 0)
    assert lost > 0 or not crowded
