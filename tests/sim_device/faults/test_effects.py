"""The effects of planned faults on frames, reports, port and transducers; refusals of a plan."""

import base64
import tomllib

import pytest
import serial
from hypothesis import given
from hypothesis import strategies as st

from haptogram.cli import main as verify
from haptogram.errors import ConfigurationError
from haptogram.settings.faults.plan import FaultPlan, faults_of_toml
from haptogram_protocol.framing import FrameDecoder, encode_frame
from haptogram_protocol.messages import (
    MESSAGES,
    RESPONSE_RANGE,
    Counters,
    GetStatus,
    Ping,
    StatusReply,
    build_body,
    parse_body,
)
from haptogram_protocol.state import OutputState
from sim_device.board.clock import BoardClock
from sim_device.command.command import main
from sim_device.faults.clock import faulty_clock
from sim_device.faults.injector import inject_on_line
from sim_device.faults.line import FaultChunk
from strategies_protocol import records

VIRTUAL = "haptogram://?clock=virtual&array=4x4&reconstruct=0"
MS = 1_000_000


def url_of(*faults):
    return VIRTUAL + "".join(f"&fault={fault.replace(' ', '+')}" for fault in faults)


# --- plans in a URL, on a command line, in the last record ----------------------------------------


def test_a_url_takes_a_file_as_well(tmp_path, open_host):
    file = tmp_path / "plan.toml"
    file.write_text('[[fault]]\nname = "frame.crc"\np = 1\nuntil = "1ms"\n')
    host = open_host(f"{VIRTUAL}&fault_plan={file}")
    host.greet()
    assert host.port.simulation.fault_counts == {"frame.crc": 1}


def test_a_plan_that_is_not_there_is_one_line(tmp_path, capsys):
    absent = str(tmp_path / "absent.toml")
    assert main(["--link", str(tmp_path / "b"), "--fault-plan", absent]) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_the_last_record_repeats_the_run(open_host):
    faults = ["line.flip ber=1e-3", "frame.crc p=0.2"]
    ends = []
    for url in (url_of(*faults) + "&seed=11", None, f"{url_of(*faults)}&seed=9"):
        if url is None:
            again, seed = faults_of_toml(tomllib.loads(ends[0]["fault_plan"]))
            url = f"{url_of(*map(str, again))}&seed={seed}"
        host = open_host(url)
        host.arm()
        for number in range(40):
            host.ask(Ping(echo=number))
        host.port.close()
        ends.append(host.port.records[-1])
    assert ends[0] == ends[1]
    assert ends[0]["faults"] != ends[2]["faults"]


# --- frames ------------------------------------------------------------------------------------

COUNTED_AS = {
    "frame.crc p=1": "crc",
    "frame.length p=1": "bad_length",
    "frame.length p=1 bytes=-2": "bad_length",
    "frame.session p=1": "stale_session",
    "frame.flags p=1": "unsupported",
    "frame.type p=1": "unknown_type",
    "frame.past p=1 us=20000": "dropped_late",
    "frame.future p=1": "dropped_future",
    "frame.sequence p=1 by=-20": "duplicate",
}


@pytest.mark.parametrize(("fault", "counter"), COUNTED_AS.items())
def test_a_wrong_frame_is_found_by_the_board_under_its_name(open_host, fault, counter):
    host = open_host(url_of(f"{fault} from=20ms"))
    start_us = host.arm()
    host.stream(bytes(16), start_us + 1_000)
    host.port.wait_until_ns(20 * MS)
    before = dict(host.port.simulation.dialect.counters)
    for k in range(3):
        host.stream(bytes(16), start_us + 22_000 + 1000 * k)
    host.port.wait_until_ns(40 * MS)
    after = host.port.simulation.dialect.counters
    assert after[counter] - before[counter] == 3
    assert after["latched"] == before["latched"]
    assert host.port.simulation.fault_counts == {fault.split()[0]: 3}


@given(st.binary(min_size=1, max_size=200), st.sampled_from(sorted(COUNTED_AS)))
def test_what_is_no_frame_is_left_alone(noise, fault):
    plan = FaultPlan.parse([fault])
    noise = noise.replace(b"\x00", b"\x01")
    assert inject_on_line(plan, "down", 0, noise)[0] == [FaultChunk(0, noise)]
    frame = encode_frame(build_body(Ping(1), flags=0, seq=9, time_us=0, session=5))
    assert inject_on_line(plan, "up", 0, frame)[0][0].data == frame


def test_only_one_field_changes_and_the_crc_is_right():
    frame = encode_frame(build_body(Ping(77), flags=0, seq=9, time_us=3, session=5))
    for fault, change in (("sequence", {"seq": 8}), ("session", {"session": 6})):
        chunks, fired = inject_on_line(FaultPlan.parse([f"frame.{fault} p=1"]), "down", 0, frame)
        (body,) = FrameDecoder().feed(chunks[0].data)
        header, message = parse_body(body)
        assert message == Ping(77)
        values = {"seq": header.seq, "session": header.session}
        assert values == {"seq": 9, "session": 5} | change
        assert fired == {f"frame.{fault}": 1}


# --- what a board reports ----------------------------------------------------------------------


def test_a_status_that_lies_says_armed_and_no_errors(open_host):
    host = open_host(url_of("device.status", "frame.crc p=1 until=1ms", "line.delay us=2000"))
    host.link.send_hello(host.now_us())  # damaged, and sent again
    host.wait()
    told = host.ask(GetStatus()).message
    assert told.state is OutputState.ARMED
    assert host.port.simulation.dialect.board.output.state is OutputState.DISARMED
    assert told.counters.crc == 0
    assert host.port.simulation.dialect.counters["crc"] > 0
    assert host.port.simulation.fault_counts["device.status"] > 0


def reported(fault, message):
    """Return time and message of a frame of the board, at 7 us, behind a fault of its reports."""
    frame = encode_frame(build_body(message, flags=0, seq=9, time_us=7, session=5))
    chunks, _ = inject_on_line(FaultPlan.parse([fault]), "up", 0, frame)
    header, found = parse_body(*FrameDecoder().feed(chunks[0].data))
    return header.time_us, found


def times_told(record):
    """Return the times that a record and those in it tell, by what the specification says."""
    for name, form in type(record).WIRE.items():
        if form.doc.startswith("device time"):
            yield getattr(record, name)
    tail = type(record).TAIL
    for inner in getattr(record, tail.name) if tail and tail.record else ():
        yield from times_told(inner)


@pytest.mark.parametrize("number", [n for n in MESSAGES if n >= RESPONSE_RANGE.start])
@given(data=st.data())
def test_a_clock_that_is_told_wrong_is_wrong_in_every_time_and_nowhere_else(number, data):
    message = data.draw(records(MESSAGES[number]))
    by_us = data.draw(st.sampled_from([-(10**9), -1, 1, 10**9]))
    time_us, found = reported(f"device.clock us={by_us}", message)
    wrong = [time_us, *times_told(found)]
    assert wrong == [(t_us + by_us) % 2**32 for t_us in [7, *times_told(message)]]
    again = reported(f"device.clock us={-by_us}", found)[1]
    assert again == message


@given(records(StatusReply))
def test_a_status_that_lies_counts_what_grows_when_all_is_well_and_nothing_else(status):
    lie = reported("device.status", status)[1]
    told = {name for name in Counters.WIRE if getattr(lie.counters, name)}
    growing = ("frames", "accepted", "latched", "requests")
    assert told == {name for name in growing if getattr(status.counters, name)}
    assert lie.last_latch_us == status.last_latch_us


def test_a_clock_that_is_told_wrong_while_the_board_latches_right(open_host):
    records = {}
    for faults in ((), ("device.clock us=5000",)):
        host = open_host(url_of(*faults))
        shown_us = host.greet().t_device_us
        pong = host.ask(Ping(1)).message
        board_us = host.port.simulation.dialect.board.output.now_us & 0xFFFFFFFF
        records[faults] = (shown_us, pong.t_rx_us, pong.t_tx_us, board_us)
    healthy, faulty = records.values()
    assert [f - h for f, h in zip(faulty, healthy, strict=True)] == [5000, 5000, 5000, 0]


def test_the_clock_may_wrap_soon(open_host):
    assert (
        faulty_clock(FaultPlan.parse(["clock.wrap us=1000"]), BoardClock(5)).boot_us == 2**32 - 1000
    )
    host = open_host(url_of("clock.wrap us=500000"))
    start_us = host.greet().t_device_us
    host.port.wait_until_ns(1_000 * MS)
    reply = host.ask(Ping(1)).message
    assert reply.t_rx_us < start_us
    assert (reply.t_rx_us - start_us) & 0xFFFFFFFF == 1_000_000


# --- the port ----------------------------------------------------------------------------------


def test_a_port_vanishes_loses_what_was_on_it_and_comes_back(open_host):
    host = open_host(url_of("line.disconnect ms=50 from=10ms"))
    host.greet()
    host.port.wait_until_ns(9 * MS)
    host.link.send_request(Ping(1), host.now_us())
    host.port.write(host.link.data_to_send())
    host.port.wait_until_ns(10 * MS)
    for use in (
        lambda: host.port.in_waiting,
        lambda: host.port.read(1),
        lambda: host.port.write(b"x"),
    ):
        with pytest.raises(serial.SerialException, match=r"by line\.disconnect"):
            use()
    host.port.wait_until_ns(60 * MS)
    assert host.port.in_waiting == 0
    assert host.wait().message.echo == 1  # asked again by the link
    assert host.port.simulation.fault_counts == {"line.disconnect": 1}


@pytest.mark.parametrize(("direction", "arrived"), [("down", 0), ("up", 1)])
def test_half_open_is_one_direction_dead(open_host, direction, arrived):
    host = open_host(url_of(f"line.half_open direction={direction} from=1ms"))
    host.greet()
    before = host.port.simulation.dialect.counters["requests"]
    host.port.wait_until_ns(2 * MS)
    host.link.send_request(Ping(1), host.now_us())
    host.port.write(host.link.data_to_send())
    host.port.wait_until_ns(20 * MS)
    assert host.port.in_waiting == 0
    assert host.port.simulation.dialect.counters["requests"] - before == arrived
    assert host.port.simulation.fault_counts == {"line.half_open": 1}


# --- transducers -------------------------------------------------------------------------------

FIRST, SECOND = bytes(range(16)), bytes(range(100, 116))


def radiated(open_host, *faults):
    """Return phase and amplitude codes of transducers 0 to 4, after FIRST and then SECOND."""
    host = open_host(url_of(*faults))
    start_us = host.arm()
    for k, codes in enumerate((FIRST, SECOND)):
        host.stream(codes, start_us + 10_000 + 1000 * k)
    host.port.wait_until_ns(host.now_ns() + 20 * MS)
    host.port.close()
    last = [record for record in host.port.records if record["kind"] == "latch"][-1]
    assert base64.b64decode(last["phase_codes"]) == SECOND
    drive = last["radiated"] or last
    return [base64.b64decode(drive[key])[:5] for key in ("phase_codes", "amplitude_codes")]


FULL = b"\xff" * 5


@pytest.mark.parametrize(
    ("faults", "phases", "amplitudes"),
    [
        (["device.off column=0"], SECOND[:5], bytes(4) + b"\xff"),
        (["device.stuck bank=0 code=9"], b"\x09" * 5, FULL),
        (["device.wrong column=0"], FIRST[:4] + SECOND[4:5], FULL),
        (["device.off bank=0", "device.ok column=0"], SECOND[:5], b"\xff" * 4 + b"\x00"),
        (["device.slow column=0 us=0"], SECOND[:5], FULL),
    ],
)
def test_what_faulty_transducers_radiate(open_host, faults, phases, amplitudes):
    assert radiated(open_host, *faults) == [phases, amplitudes]


def test_a_slow_transducer_is_between_the_last_drive_and_this_one(open_host):
    """By hand: with T = tau it keeps e^-1 of the first; phases differ by 100 codes of 256."""
    phases, amplitudes = radiated(open_host, "device.slow transducer=0 us=1000")
    assert 240 > amplitudes[0] > 100  # |0.632 e^{j 140.6 deg} + 0.368| = 0.428, of 255
    assert 60 < phases[0] < 100


def test_garbage_is_other_codes_at_each_latch_and_replays(open_host):
    phases, amplitudes = radiated(open_host, "device.garbage column=0")
    assert phases[:4] != SECOND[:4]
    assert phases[4:] == SECOND[4:5]
    assert amplitudes == FULL
    assert radiated(open_host, "device.garbage column=0") == [phases, amplitudes]


def test_a_bank_that_is_not_there_is_refused(open_host):
    with pytest.raises(ConfigurationError, match=r"must be 0 to \d+ \(16 transducers"):
        open_host(url_of("device.off bank=1"))


# --- refusals, however a fault is given ----------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "toml", "problem"),
    [
        (
            "line.flip from=5s until=1s",
            'from = "5s"\nuntil = "1s"\n',
            "line.flip from=5s until=1s: until must be after 5s",
        ),
        ("line.flip ber=nan", 'ber = "nan"\n', "line.flip ber=nan, must be 0 to 1"),
    ],
)
def test_it_is_one_line_wherever_a_fault_is_given(text, toml, problem, tmp_path, open_host, capsys):
    plan = tmp_path / "plan.toml"
    plan.write_text(f'[[fault]]\nname = "line.flip"\n{toml}')
    for url in (url_of(text), f"{VIRTUAL}&fault_plan={plan}"):
        with pytest.raises(ConfigurationError) as caught:
            open_host(url)
        assert problem in str(caught.value)
        assert "\n" not in str(caught.value)
    for option in (f"--fault={text}", f"--fault-plan={plan}"):
        assert main(["--link", str(tmp_path / "board"), option]) == 2
        assert verify(["verify", "--virtual-time", option]) == 2
        said = capsys.readouterr().err
        assert said.count(problem) == said.count("\n") == 2
    assert verify(["verify", "--port", url_of(text)]) == 2
    assert capsys.readouterr().err.count("\n") == 1


@pytest.mark.parametrize(
    ("dialect", "fault"),
    [((), "device.off column=16"), (("--dialect", "sonicsurface"), "frame.crc p=1")],
    ids=["place", "dialect"],
)
def test_a_fault_that_a_board_cannot_have_is_refused_by_the_option_that_holds_it(
    dialect, fault, tmp_path, capsys
):
    plan = tmp_path / "plan.toml"
    plan.write_text(FaultPlan.parse([fault]).as_toml())
    name = fault.partition(" ")[0]
    options = {f"--fault={fault}": "--fault", f"--fault-plan={plan}": f"--fault-plan '{plan}':"}
    for word, option in options.items():
        assert main(["--link", str(tmp_path / "board"), *dialect, word]) == 2
        assert f": {option} {name} " in capsys.readouterr().err
