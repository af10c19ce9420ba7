"""The model of a soak, told of frames without their bytes, against one that hears every byte."""

from hypothesis import given
from hypothesis import strategies as st

from haptogram.campaigns.soak.line import Sent
from haptogram.settings.faults.plan import FaultPlan
from haptogram_protocol import NEED_DATA, HostConnection
from haptogram_protocol import messages as m
from haptogram_protocol.cobs import fastest_cobs
from sim_device.driven.soak_board import VirtualSoakBoard

SETTLED_NS = 3_000_000_000
#: Microseconds since the frame before; t_apply after the arrival, of some late or before that one.
STREAM = st.tuples(
    st.sampled_from([100, 1000, 1000, 1000, 7000, 60_000]),
    st.sampled_from([-5000, 40, 3000, 20_000, 20_000, 20_000, 300_000]),
    st.sampled_from(["came", "came", "came", "came", "lost", "twice", "status", "mute", "hello"]),
)


class Pair:
    """The same frames to a model that may be told without bytes, and to one that may not."""

    def __init__(self, hold_ms, status_ms):
        board = VirtualSoakBoard.power_up(seed=3, baud=3_000_000, plan=FaultPlan((), 3))
        self.models = board.model(), board.model()
        self.seen = ([], []), ([], [])  # latches, and frames for the line, of each model
        self.t_ns = 1_000_000
        self.config = m.Config(
            hold_ms=hold_ms, status_period_ms=status_ms, host_timeout_ms=400, late_window_us=2000
        )
        self.open(1)

    def open(self, nonce):
        self.host = HostConnection(nonce=nonce, cobs=fastest_cobs())
        self.host.send_hello(self.t_ns // 1000)
        self.carry()
        self.ask(m.SetConfig(self.config))
        self.ask(m.Arm())

    def ask(self, message):
        if isinstance(message, m.Mute):
            self.host.send_mute(self.t_ns // 1000)
        else:
            self.host.send_request(message, self.t_ns // 1000)
        self.carry()

    def carry(self):
        """Carry a request to both, and the answers back."""
        self.t_ns += 500_000
        self.hear(Sent(self.host.data_to_send(), 0))
        self.host.receive_data(b"".join(self.seen[1][1]), self.t_ns // 1000)
        while self.host.next_event() is not NEED_DATA:
            pass

    def hear(self, sent):
        told, heard = self.models
        verdict = heard.hear(Sent(sent.wire, sent.session), self.t_ns, self.t_ns)
        assert told.hear(sent, self.t_ns, self.t_ns) == verdict
        self.collect()

    def stream(self, wait_us, ahead_us, fate):
        self.t_ns += 1000 * wait_us
        due_us = self.models[0].device_us(self.t_ns) + ahead_us
        drive = m.Phases(bytes([self.t_ns // 1000 % 251]) * self.models[0].transducers)
        index, wire = self.host.stream_frame(drive, t_apply_us=due_us)
        sent = Sent(wire, self.host.session, True, index, due_us, drive)
        for _ in range({"lost": 0, "twice": 2}.get(fate, 1)):
            self.hear(sent)
        if fate in ("status", "mute"):
            self.ask(m.GetStatus() if fate == "status" else m.Mute())
        if fate == "mute":
            self.ask(m.Arm())
        if fate == "hello":
            self.open(self.t_ns // 1000 % 60_000 + 2)

    def collect(self):
        for model, (latches, frames) in zip(self.models, self.seen, strict=True):
            frames += model.take_frames()
            latches += [
                (d.session, d.index, d.t_latch_us, d.late, d.drive) for d in model.take_due()
            ]

    def settle(self):
        self.t_ns += SETTLED_NS
        for model in self.models:
            model.advance_to(self.t_ns)
        self.collect()


@given(
    st.lists(STREAM, min_size=1, max_size=60),
    st.sampled_from([20, 100, 400, 5000]),
    st.sampled_from([0, 50]),
)
def test_a_model_that_is_told_foresees_what_one_that_hears_latches(frames, hold_ms, status_ms):
    pair = Pair(hold_ms, status_ms)
    for frame in frames:
        pair.stream(*frame)
    pair.settle()
    told, heard = pair.models
    assert pair.seen[0] == pair.seen[1]
    assert told.counters == heard.counters
    assert told.is_silent == heard.is_silent
    assert told.session == heard.session
