"""Plans of faults: their syntax, what they do to line, clock and transducers, and their counts."""

import base64

import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptogram.errors import ConfigurationError
from haptogram.settings.faults.plan import Fault, FaultPlan
from haptogram_protocol.messages import GetStatus, Ping
from haptogram_protocol.state import OutputState
from sim_device.board.clock import BoardClock, ClockChange
from sim_device.command.command import main
from sim_device.faults.clock import faulty_clock
from sim_device.faults.injector import inject_on_line

VIRTUAL = "haptogram://?clock=virtual&array=4x4&reconstruct=0"
CODES = bytes(range(3, 19))
DATA = bytes(range(1, 201))
LINE = [
    "line.flip ber=1e-2",
    "line.drop p=0.05",
    "line.insert p=0.05",
    "line.burst p=0.05 bytes=4",
    "line.duplicate p=1",
    "line.truncate p=1",
    "line.break p=1",
]


def act(text, data=DATA, t_ns=0, seed=1):
    chunks, fired = inject_on_line(FaultPlan.parse([text], seed), "down", t_ns, data)
    return chunks, sum(fired.values())


@pytest.mark.parametrize("least", ["5e-324", "1e-310", "1e-300"])
@pytest.mark.parametrize("fault", ["flip ber", "drop p", "insert p", "burst p"])
def test_the_least_chance_hits_nothing(fault, least):
    chunks, fired = act(f"line.{fault}={least}")
    assert ([chunk.data for chunk in chunks], fired) == ([DATA], 0)


def record_of(open_host, fault, name="latch"):
    host = open_host(f"{VIRTUAL}&fault={fault.replace(' ', '+')}")
    host.arm()
    host.stream(CODES)
    host.port.wait_until_ns(host.now_ns() + 1_000_000)
    host.port.close()
    return [record for record in host.port.records if record["kind"] == name][-1]


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("line.flop", "'line.flop' is no fault; did you mean line.flip?"),
        ("", "'' is no fault; docs/faults.md"),
        ("line.flip bear=1", "line.flip has no parameter 'bear'; known: ber, from, until"),
        ("line.flip ber=2", "ber=2, must be 0 to 1"),
        ("line.flip ber=x", "ber=x, must be a number, 0 to 1"),
        ("line.flip ber=nan", "must be 0 to 1"),
        ("line.flip from=2", "must be a time such as 2s"),
        ("line.slice bytes=0", "bytes=0, must be 1"),
        ("device.dead", "must have either transducer=N, column=N or bank=N"),
        ("device.dead column=1 transducer=1", "must have either"),
    ],
)
def test_what_makes_no_sense_is_refused_with_what_is_known(text, problem):
    with pytest.raises(ConfigurationError) as caught:
        Fault.parse(text)
    assert problem in str(caught.value)


def test_the_command_line_and_the_url_refuse_them_too(capsys, open_host, tmp_path):
    assert main(["--link", str(tmp_path / "b"), "--fault", "line.flop"]) == 2
    assert "did you mean line.flip?" in capsys.readouterr().err
    with pytest.raises(ConfigurationError, match=r"must be 0 to \d+ \(16 transducers"):
        open_host(f"{VIRTUAL}&fault=device.dead+column=4")
    with pytest.raises(ConfigurationError, match=r"clock.step us=-5, must be 0 to 1000000000"):
        open_host(f"{VIRTUAL}&fault=clock.step+us=-5")


@pytest.mark.parametrize("text", LINE)
def test_a_fault_of_the_line_changes_the_bytes_counts_itself_and_replays(text):
    chunks, fired = act(text)
    assert fired > 0
    assert b"".join(chunk.data for chunk in chunks) != DATA
    assert act(text) == (chunks, fired)
    assert any(act(text, seed=seed)[0] != chunks for seed in range(2, 9)) or "p=1" in text
    assert act(f"{text} from=1s", t_ns=9**9)[0][0].data == DATA
    assert act(f"{text} until=1s", t_ns=10**9)[1] == 0


@given(st.binary(min_size=1, max_size=60), st.integers(0, 10**10))
def test_what_only_moves_bytes_in_time_loses_none_and_is_never_early(data, t_ns):
    for text in ("line.delay us=50 jitter_us=20", "line.slice bytes=7", "line.batch ms=16"):
        chunks, _ = act(text, data, t_ns)
        assert b"".join(chunk.data for chunk in chunks) == data
        assert all(chunk.t_ns >= t_ns for chunk in chunks)
    assert chunks[0].t_ns % 16_000_000 == 0
    assert act("line.coalesce us=16000", data, t_ns)[0] == chunks


def test_the_share_of_flipped_bits_is_the_one_asked_for():
    flipped = sum(act("line.flip ber=1e-2", bytes(1000), t_ns)[1] for t_ns in range(100))
    assert 7_600 < flipped < 8_400  # 8000 are expected, 89 is their standard deviation


@pytest.mark.parametrize(
    ("fault", "phases", "amplitudes"),
    [
        ("device.dead transducer=2", CODES[2:3], b"\x00"),
        ("device.stuck transducer=2 code=9", b"\x09", b"\xff"),
        ("device.delayed transducer=2 code=255", bytes([CODES[2] - 1]), b"\xff"),
        ("device.intermittent transducer=2 p=1", CODES[2:3], b"\x00"),
    ],
)
def test_a_faulty_transducer_is_in_the_radiated_drive_and_not_in_the_latched(
    open_host, fault, phases, amplitudes
):
    record = record_of(open_host, fault)
    assert base64.b64decode(record["phase_codes"]) == CODES
    radiated = {k: base64.b64decode(v) for k, v in record["radiated"].items() if "codes" in k}
    assert radiated["phase_codes"] == CODES[:2] + phases + CODES[3:]
    assert radiated["amplitude_codes"] == b"\xff" * 2 + amplitudes + b"\xff" * 13


def test_a_column_fails_whole_and_only_in_its_time(open_host):
    record = record_of(open_host, "device.dead column=1")
    amplitudes = base64.b64decode(record["radiated"]["amplitude_codes"])
    assert amplitudes == b"\xff" * 4 + bytes(4) + b"\xff" * 8
    assert record_of(open_host, "device.dead column=1 from=2s")["radiated"] is None


def test_the_last_record_says_how_often_each_fault_fired(open_host):
    assert record_of(open_host, "device.dead column=1", "end")["faults"] == {"device.dead": 1}
    assert record_of(open_host, "line.flip ber=0", "end")["faults"] == {"line.flip": 0}


def test_a_session_survives_a_bad_line_and_every_flip_is_counted(open_host):
    runs = []
    for _ in range(2):
        host = open_host(f"{VIRTUAL}&seed=8&fault=line.flip+ber=3e-4")
        host.arm()
        for number in range(100):
            host.ask(Ping(echo=number))
        assert host.ask(GetStatus()).message.state is OutputState.ARMED
        counters = host.port.simulation.dialect.counters
        assert sum(counters[name] for name in ("crc", "cobs", "short")) > 0
        runs.append((counters, host.port.simulation.fault_counts, host.now_ns()))
    assert runs[0] == runs[1]
    assert runs[0][1]["line.flip"] > 0


def test_a_plan_changes_the_clock_of_the_board(open_host):
    plan = FaultPlan.parse(["clock.ppm ppm=200", "clock.offset us=-7", "clock.step us=9 from=1s"])
    changes = (ClockChange(0, ppm=200), ClockChange(1_000_000_000, step_us=9))
    assert faulty_clock(plan, BoardClock(100)) == BoardClock(93, 0, changes)
    host = open_host(f"{VIRTUAL}&fault=clock.ppm+ppm=1000&fault=clock.offset+us=-500")
    start_us = host.greet().t_device_us
    host.port.wait_until_ns(host.now_ns() + 1_000_000_000)
    reply = host.ask(Ping(echo=1))
    assert reply.message.t_rx_us - start_us == 1_001_000
