"""Every kind of fault is counted as often as it acts, and two of a kind both act.

What acts is counted here by itself: by what goes into the line and comes out of it, by what is
radiated instead of what was latched, and by what the clock shows.
"""

from itertools import pairwise

import numpy as np
import pytest

from haptogram.errors import ConfigurationError
from haptogram.settings.faults.kinds import FAULT_KINDS
from haptogram.settings.faults.plan import FaultPlan
from haptogram_protocol.framing import encode_frame
from haptogram_protocol.messages import (
    FIRST_STREAM_SEQ,
    VERSION_MAJOR,
    VERSION_MINOR,
    Arm,
    GetStatus,
    Hello,
    Phases,
    Ping,
    build_body,
)
from sim_device.board.clock import BoardClock
from sim_device.board.settings import board_settings
from sim_device.faults.clock import faulty_clock
from sim_device.simulation import Simulation

pytestmark = pytest.mark.sampled(12)

MS = 1_000_000
NONCE = 0x5EED
END_MS = 100
FIRST, SECOND = (20, 40), (60, 80)
CODES = [bytes(range(k, k + 16)) for k in (0, 100)]

# Strong enough to act, in 20 ms of the traffic below, whatever the seed.
SURELY = {
    "line.flip": "ber=0.01",
    "line.drop": "p=0.05",
    "line.insert": "p=0.05",
    "line.burst": "p=0.02 bytes=3",
    "line.duplicate": "p=0.5",
    "line.truncate": "p=0.5",
    "line.overrun": "p=0.5 bytes=5",
    "line.break": "p=0.5",
    "line.baud": "ppm=90000",
    "line.half_open": "",
    "line.disconnect": "",
    "line.delay": "us=20 jitter_us=9",
    "line.slice": "bytes=7 gap_us=3",
    "line.coalesce": "us=300",
    "line.batch": "ms=0.7",
    "clock.offset": "us=-70",
    "clock.wrap": "us=50000",
    "clock.ppm": "ppm=20000",
    "clock.step": "us=900",
    "device.ok": "bank=0",
    "device.off": "bank=0",
    "device.dead": "column=1",
    "device.stuck": "transducer=3 code=77",
    "device.delayed": "column=0",
    "device.intermittent": "column=2",
    "device.garbage": "bank=0",
    "device.wrong": "column=3",
    "device.slow": "bank=0 us=2000",
    "device.clock": "us=5 jitter_us=3",
    "device.status": "",
} | {name: "p=0.5" for name in FAULT_KINDS if name.startswith("frame.")}
WITHOUT_WINDOW = ("clock.offset", "clock.wrap")


def faulty(name, window=None):
    times = [] if window is None else [f"from={window[0]}ms", f"until={window[1]}ms"]
    if name in WITHOUT_WINDOW:
        times = []
    elif name == "clock.step":
        times = times[:1]
    return " ".join(filter(None, [name, SURELY[name], *times]))


class Watched(Simulation):
    """Keeps what is handed to the line, and what the line is given instead."""

    def __init__(self, *arguments, **options):
        self.sent, self.latches, self.away = [], [], []
        super().__init__(*arguments, **options)
        for line in (self._down, self._up):
            line.send = self.watching(line.send)

    def watching(self, send):
        def watched(data, t_ns):
            if data and self.sent:
                self.sent[-1][3].append((t_ns, data))
            send(data, t_ns)

        return watched

    def _send(self, line, direction, data, t_ns, credit_ns=0):
        if data:
            self.sent.append((direction, t_ns, data, []))
        super()._send(line, direction, data, t_ns, credit_ns)


class Radiated:
    """Takes down what left the transducers, latch by latch."""

    def __init__(self):
        self.drives = []

    def latch(self, latch):
        self.drives.append((latch.key.index, latch.radiated))

    def notice(self, notice):
        pass


def wire(message, seq, *, session=NONCE, time_us=0):
    return encode_frame(build_body(message, flags=0, seq=seq, time_us=time_us, session=session))


def run(*faults, seed=1):
    """Send the same frames at the same times, whatever becomes of them; 4 x 4 transducers."""
    settings, radiated = board_settings(array="4x4", seed=seed), Radiated()
    simulation = Watched(settings, radiated, faults=FaultPlan.parse(faults, seed))
    hello = Hello(VERSION_MAJOR, VERSION_MINOR, NONCE)
    simulation.host_write(wire(hello, 1, session=0), MS)
    simulation.host_write(wire(Arm(), 2), 2 * MS)
    simulation.host_write(b"\x00\x02\x09\x00", 3 * MS)  # for a status that lies to hide
    for ms in range(5, END_MS):
        due_us = (simulation.device_us(ms * MS) + 1_500) & 0xFFFFFFFF
        frame = Phases(CODES[ms % 2])
        simulation.host_write(wire(frame, FIRST_STREAM_SEQ + ms - 5, time_us=due_us), ms * MS)
        asked = Ping(ms) if ms % 2 else GetStatus()
        simulation.host_write(wire(asked, ms), ms * MS + 500_100)
        simulation.away.append((ms, not simulation.is_connected))
    simulation.advance_to(END_MS * MS)
    simulation.radiated = radiated.drives
    return simulation


HEALTHY = run()


def acts(simulation, name):
    """Return when *name* acted, milliseconds, once for each time that it is to be counted."""
    layer = name.partition(".")[0]
    if name == "line.disconnect":
        looks = [(0, False), *simulation.away]
        return [ms for (_, before), (ms, now) in pairwise(looks) if now and not before]
    if layer == "clock":
        return on_clock(simulation, name)
    if name in ("device.clock", "device.status") or layer == "frame":
        return [t / MS for _, t, data, out in simulation.sent for _ in range(frames(data, out))]
    if layer == "device":
        return on_transducers(simulation)
    how_often = ON_LINE[name]
    return [t / MS for _, t, data, out in simulation.sent for _ in range(how_often(t, data, out))]


def bytes_of(out):
    return b"".join(data for _, data in out)


def bits(_, data, out):
    new = bytes_of(out)
    assert len(new) == len(data)
    return sum((a ^ b).bit_count() for a, b in zip(data, new, strict=True))


def bursts(_, data, out):
    """Return how many bursts of 3 there are at least where bytes differ."""
    new, count, free = bytes_of(out), 0, 0
    for place, (a, b) in enumerate(zip(data, new, strict=True)):
        if a != b and place >= free:
            count, free = count + 1, place + 3
    return count


ON_LINE = {
    "line.flip": bits,
    "line.drop": lambda _, data, out: len(data) - len(bytes_of(out)),
    "line.insert": lambda _, data, out: len(bytes_of(out)) - len(data),
    "line.burst": bursts,
    "line.duplicate": lambda _, __, out: len(out) - 1,
    "line.truncate": lambda _, data, out: int(bytes_of(out) != data),
    "line.overrun": lambda _, data, out: int(bytes_of(out) != data),
    "line.break": lambda _, data, out: int(bytes_of(out) != data),
    "line.baud": lambda _, data, out: int(bytes_of(out) != data),
    "line.half_open": lambda _, __, out: int(not out),
    "line.delay": lambda t_ns, _, out: int(out[0][0] > t_ns),
    "line.slice": lambda _, __, out: len(out) - 1,
    "line.coalesce": lambda t_ns, _, out: int(out[0][0] > t_ns),
    "line.batch": lambda t_ns, _, out: int(out[0][0] > t_ns),
}


def frames(data, out):
    """Return how many frames of a chunk are others on the line."""
    before, after = (piece.split(b"\x00") for piece in (data, bytes_of(out)))
    assert len(before) == len(after)
    return sum(a != b for a, b in zip(before, after, strict=True))


def on_transducers(simulation):
    healthy = dict(HEALTHY.radiated)
    return [
        5 + index - HEALTHY.radiated[0][0] + 1.5  # latched so long after it is sent
        for index, drive in simulation.radiated
        if not np.allclose(drive.weights(), healthy[index].weights(), atol=1e-3)
    ]


def on_clock(simulation, name):
    """Return when the clock does something else than before, in steps of 100 µs."""
    shown = [simulation.device_us(t_ns) for t_ns in range(0, END_MS * MS + 1, MS // 10)]
    rates = [later - earlier for earlier, later in pairwise(shown)]
    if name == "clock.offset":
        return [0] * (shown[0] != HEALTHY.device_us(0))
    if name == "clock.wrap":
        wire_us = [us & 0xFFFFFFFF for us in shown]
        return [k / 10 for k, (a, b) in enumerate(pairwise(wire_us)) if b < a]
    odd = [(k + 1) / 10 for k, rate in enumerate(rates) if abs(rate - 100) > 1]
    return [a for k, a in enumerate(odd) if k == 0 or a - odd[k - 1] > 0.11]


def counted(simulation):
    (count,) = simulation.fault_counts.values()
    return count


def test_there_is_a_telling_strength_of_every_fault():
    assert set(SURELY) == set(FAULT_KINDS)


@pytest.mark.parametrize("name", sorted(FAULT_KINDS))
def test_it_is_counted_as_often_as_it_acts(name):
    others = ["device.off bank=0"] if name == "device.ok" else []
    simulation = run(*others, faulty(name, FIRST))
    count = simulation.fault_counts[name]
    acted = acts(simulation, name)
    assert count > 0
    if name == "device.ok":  # where it acts the output is right again
        assert count == FIRST[1] - FIRST[0]
    elif name == "line.burst":
        assert len(acted) <= count <= 2 * len(acted)  # some lie upon each other
    else:
        assert count == len(acted)
    if name not in WITHOUT_WINDOW and name != "device.ok":
        assert all(FIRST[0] <= ms <= FIRST[1] for ms in acted)


@pytest.mark.parametrize("name", sorted(set(FAULT_KINDS) - {"clock.wrap", "device.ok"}))
def test_two_of_a_kind_both_act(name):
    simulation = run(faulty(name, FIRST), faulty(name, SECOND))
    acted = acts(simulation, name)
    if name == "clock.offset":
        assert simulation.device_us(0) - HEALTHY.device_us(0) == 2 * -70
        assert counted(simulation) == 2
        return
    assert {any(a <= ms <= b for ms in acted) for a, b in (FIRST, SECOND)} == {True}
    assert all(FIRST[0] <= ms <= FIRST[1] or SECOND[0] <= ms <= SECOND[1] for ms in acted)
    if name == "line.burst":
        assert len(acted) <= counted(simulation) <= 2 * len(acted)
    else:
        assert counted(simulation) == len(acted)


AT_ONCE = {
    "line.delay us=20": ["line.delay us=40"],
    "clock.offset us=30": ["clock.offset us=60"],
    "clock.step us=30 from=10ms": ["clock.step us=60 from=10ms"],
    "clock.ppm ppm=500 from=5ms until=50ms": ["clock.ppm ppm=1000 from=5ms until=50ms"],
    "frame.sequence p=1 by=2": ["frame.sequence p=1 by=4"],
    "frame.past p=1 us=20": ["frame.past p=1 us=40"],
    "device.clock us=7": ["device.clock us=14"],
    "device.delayed bank=0 code=9": ["device.delayed bank=0 code=18"],
}


@pytest.mark.parametrize(("once", "double"), AT_ONCE.items())
def test_two_of_a_kind_at_once_add_up(once, double):
    twice, strong = run(once, once), run(*double)
    assert [out for *_, out in twice.sent] == [out for *_, out in strong.sent]
    assert twice.radiated == strong.radiated
    assert counted(twice) == 2 * counted(strong)
    assert [twice.device_us(k * MS) for k in range(END_MS)] == [
        strong.device_us(k * MS) for k in range(END_MS)
    ]


@pytest.mark.parametrize(
    ("windows", "count", "leaves"),
    [
        (("from=20ms until=40ms", "from=60ms until=80ms"), 2, [20, 60]),
        (("from=20ms until=40ms", "from=40ms until=50ms"), 2, [20]),
        (("from=20ms until=40ms", "from=30ms until=50ms"), 2, [20]),
        (("from=20ms until=60ms", "from=30ms until=50ms"), 1, [20]),
        (("from=30ms until=50ms", "from=20ms until=60ms"), 1, [20]),
    ],
)
def test_absences_that_meet_are_one_and_each_that_makes_it_longer_counts(windows, count, leaves):
    simulation = run(*(f"line.disconnect {window}" for window in windows))
    assert acts(simulation, "line.disconnect") == leaves
    assert counted(simulation) == count


@pytest.mark.parametrize(
    "fault",
    [
        *("line.delay us=0", "line.slice bytes=60000", "line.batch ms=0", "line.baud ppm=100"),
        *("frame.length p=1 bytes=0", "frame.sequence p=1 by=0", "frame.flags p=1 bits=0"),
        *("clock.offset us=0", "clock.ppm ppm=0", "clock.step us=0", "clock.step from=2s"),
        *("clock.wrap us=2000000", "clock.ppm from=2s", "device.delayed bank=0 code=0"),
        *("device.clock us=0", "line.disconnect from=2s", "device.ok bank=0"),
    ],
)
def test_what_does_nothing_is_not_counted(fault):
    simulation = run(fault)
    assert counted(simulation) == 0
    assert [out for *_, out in simulation.sent] == [
        [(t, data)] for _, t, data, _ in simulation.sent
    ]
    assert simulation.radiated == HEALTHY.radiated


@pytest.mark.parametrize("second", ["line.duplicate p=1", "line.delay us=9", "line.slice bytes=3"])
def test_nothing_that_was_lost_meets_another_fault(second):
    simulation = run("line.drop p=1", second)
    assert simulation.fault_counts[second.split()[0]] == 0


def test_a_phase_that_is_wrong_where_nothing_is_radiated_is_not_counted():
    simulation = run("device.off bank=0", "device.stuck bank=0 code=9")
    assert simulation.fault_counts["device.stuck"] == 0
    assert simulation.fault_counts["device.off"] == len(simulation.radiated)


def test_an_offset_is_kept_beside_a_wrap_in_any_order():
    texts = ["clock.wrap us=1000", "clock.offset us=-7"]
    for order in (texts, texts[::-1]):
        assert faulty_clock(FaultPlan.parse(order), BoardClock(5)).boot_us == 2**32 - 1007


def test_a_rate_ends_with_its_window():
    clock = faulty_clock(FaultPlan.parse(["clock.ppm ppm=1000 from=1s until=2s"]), BoardClock(0))
    times_ns = (0, 1_000 * MS, 1_500 * MS, 2_000 * MS, 3_000 * MS)
    assert [clock.device_us(t_ns) - t_ns // 1000 for t_ns in times_ns] == [0, 0, 500, 1000, 1000]


@pytest.mark.parametrize(
    ("texts", "problem"),
    [
        (["clock.wrap us=5", "clock.wrap us=6"], "clock.wrap us=5 and clock.wrap us=6: the clock"),
        (["clock.ppm ppm=-600000"] * 2, "fast by -1200000 ppm, must be above -1000000"),
        (["clock.offset us=-1e9"] * 5, "clock.offset us=-1000000000 and .* at -7"),
    ],
)
def test_clocks_that_cannot_be(texts, problem):
    with pytest.raises(ConfigurationError, match=problem) as caught:
        run(*texts)
    assert "\n" not in str(caught.value)


def test_rates_that_follow_each_other_are_not_added():
    texts = ["clock.ppm ppm=-600000 until=1s", "clock.ppm ppm=-600000 from=1s"]
    clock = faulty_clock(FaultPlan.parse(texts), BoardClock(0))
    assert clock.device_us(2_000 * MS) == 800_000
