"""Plans as text and TOML, and the faults of frames, of what a board reports, and of its port."""

import base64
import re
from pathlib import Path

import pytest
import serial
from hypothesis import given, settings
from hypothesis import strategies as st

from haptogram.cli import main as verify
from haptogram.errors import ConfigurationError
from haptogram.settings.board import BoardConfig
from haptogram.settings.faults.kinds import FAULT_KINDS, PLACES, described, words_of
from haptogram.settings.faults.plan import Fault, FaultPlan
from haptogram_protocol.framing import FrameDecoder, encode_frame
from haptogram_protocol.messages import GetStatus, Ping, build_body, parse_body
from haptogram_protocol.state import OutputState
from sim_device.board.clock import DeviceClock
from sim_device.command import main
from sim_device.faults.clock import faulty_clock
from sim_device.faults.injector import on_line
from sim_device.faults.line import Chunk

VIRTUAL = "haptogram://?clock=virtual&array=4x4&reconstruct=0"
MS = 1_000_000
DOCS = Path(__file__).resolve().parents[3] / "docs" / "faults.md"
EXAMPLE = 'seed = 7\n\n[[fault]]\nname = "line.flip"\nber = 1e-5\nfrom = "2s"\n'


def url_of(*faults):
    return VIRTUAL + "".join(f"&fault={fault.replace(' ', '+')}" for fault in faults)


@st.composite
def fault_texts(draw):
    name = draw(st.sampled_from(sorted(FAULT_KINDS)))
    words, places = [], [key for key in FAULT_KINDS[name] if key in PLACES]
    for key, limits in FAULT_KINDS[name].items():
        if key in PLACES:
            continue
        if limits.whole:
            number = st.integers(int(limits.least), int(limits.most))
        else:
            number = st.floats(limits.least, limits.most)
        words += draw(st.lists(number.map(lambda n, key=key: f"{key}={n!r}"), max_size=1))
    if places:
        words.append(f"{draw(st.sampled_from(places))}={draw(st.integers(0, 9))}")
    from_ns, length_ns = draw(st.integers(1, 10**12)), draw(st.integers(1, 10**12))
    times = {"from": f"from={from_ns}ns", "until": f"until={from_ns + length_ns}ns"}
    may = [key for key in words_of(name) if key in times]
    if name == "line.disconnect" and words:
        may.remove("until")
    said = draw(st.sets(st.sampled_from(may))) if may else set()
    return " ".join([name, *words, *(times[key] for key in sorted(said))])


# --- text and TOML -----------------------------------------------------------------------------


@settings(max_examples=40)
@given(st.lists(fault_texts(), max_size=4), st.integers(0, 2**64 - 1))
def test_a_plan_can_be_pasted_back_as_text_and_as_toml(texts, seed):
    plan = FaultPlan.parse(texts, seed)
    assert FaultPlan.from_toml(plan.as_toml(), seed=1) == plan
    assert FaultPlan.parse([str(fault) for fault in plan.faults], seed) == plan


def test_toml_says_the_same_as_the_command_line():
    assert FaultPlan.from_toml(EXAMPLE) == FaultPlan.parse(["line.flip ber=1e-5 from=2s"], 7)
    assert FaultPlan.from_toml("", seed=3) == FaultPlan((), 3)


def test_a_file_and_the_command_line_add_up(tmp_path):
    file = tmp_path / "plan.toml"
    file.write_text(EXAMPLE)
    plan = BoardConfig.of(fault=["line.break"], fault_plan=file, seed=1).plan
    assert [fault.name for fault in plan.faults] == ["line.flip", "line.break"]
    assert plan.seed == 7
    assert BoardConfig.of(fault_plan=file, fault_seed=8).plan.seed == 8
    assert BoardConfig.of(seed=1).plan == FaultPlan((), 1)


def test_a_url_takes_a_file_as_well(tmp_path, open_host):
    file = tmp_path / "plan.toml"
    file.write_text('[[fault]]\nname = "frame.crc"\np = 1\nuntil = "1ms"\n')
    host = open_host(f"{VIRTUAL}&fault_plan={file}")
    host.greet()
    assert host.port.simulation.fault_counts == {"frame.crc": 1}


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("seed =", "fault plan: Invalid value"),
        ("sead = 1", "fault plan: sead; known: seed"),
        ("seed = -1", "seed = -1, must be 0 or more"),
        ("seed = true", "seed = True"),
        ("fault = 1", "must have tables"),
        ("[[fault]]\nber = 1", "no fault ''"),
        ('[[fault]]\nname = "line.flip"\nber = 2', "ber=2, must be 0 to 1"),
        ('[[fault]]\nname = "line.flip"\nber = [1]', "is not a number"),
        ('[[fault]]\nname = "line.flip"\nfrom = 2', "must be a time"),
    ],
)
def test_toml_that_makes_no_sense_is_refused_as_text_is(text, problem):
    with pytest.raises(ConfigurationError, match=re.escape(problem)):
        FaultPlan.from_toml(text)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("device.dead column=1.5", "column=1.5, must be a whole number"),
        ("device.garbage bank=1 column=1", "must have either"),
        ("line.flip direction=left", "must be down, up or both"),
        ("frame.crc direction=up", "no parameter 'direction'"),
        ("line.baud ppm=3e5", "must be -200000 to 200000"),
        ("line.flip from=-1s", "must not be before power-up"),
    ],
)
def test_texts_that_make_no_sense(text, problem):
    with pytest.raises(ConfigurationError, match=re.escape(problem)):
        Fault.parse(text)


def test_a_plan_that_is_not_there_is_one_line(tmp_path, capsys):
    absent = str(tmp_path / "absent.toml")
    assert main(["--link", str(tmp_path / "b"), "--fault-plan", absent]) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_every_fault_is_in_the_documentation_with_what_it_takes():
    rows = re.findall(r"^\| `([a-z]+\.[a-z_]+)` \| (.*?) \|", DOCS.read_text(), re.MULTILINE)
    documented = dict(rows)
    for text in described():
        name, *words = text.split()
        expected = " ".join(word for word in words if "=N" not in word)
        assert expected in documented.pop(name).replace("`", ""), text
    assert not documented


def test_the_last_record_repeats_the_run(open_host):
    faults = ["line.flip ber=1e-3", "frame.crc p=0.2"]
    ends = []
    for url in (url_of(*faults) + "&seed=5", None, f"{url_of(*faults)}&seed=6"):
        plan = FaultPlan.from_toml(ends[0]["fault_plan"]) if url is None else None
        texts = [] if plan is None else [str(fault) for fault in plan.faults]
        host = open_host(url or f"{url_of(*texts)}&seed={plan.seed}")
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
    "frame.sequence p=1 by=-200": "duplicate",
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


@settings(max_examples=30)
@given(st.binary(min_size=1, max_size=200), st.sampled_from(sorted(COUNTED_AS)))
def test_what_is_no_frame_is_left_alone(noise, fault):
    plan = FaultPlan.parse([fault])
    noise = noise.replace(b"\x00", b"\x01")
    assert on_line(plan, "down", 0, noise)[0] == [Chunk(0, noise)]
    frame = encode_frame(build_body(Ping(1), flags=0, seq=9, time_us=0, session=5))
    assert on_line(plan, "up", 0, frame)[0][0].data == frame


def test_only_one_field_changes_and_the_crc_is_right():
    frame = encode_frame(build_body(Ping(77), flags=0, seq=9, time_us=3, session=5))
    for fault, change in (("sequence", {"seq": 8}), ("session", {"session": 6})):
        chunks, fired = on_line(FaultPlan.parse([f"frame.{fault} p=1"]), "down", 0, frame)
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
    assert host.port.simulation.board.state is OutputState.DISARMED
    assert told.counters.crc == 0
    assert host.port.simulation.dialect.counters["crc"] > 0
    assert host.port.simulation.fault_counts["device.status"] > 0


def test_a_clock_that_is_told_wrong_while_the_board_latches_right(open_host):
    records = {}
    for faults in ((), ("device.clock us=5000",)):
        host = open_host(url_of(*faults))
        shown_us = host.greet().t_device_us
        pong = host.ask(Ping(1)).message
        board_us = host.port.simulation.board.now_us & 0xFFFFFFFF
        records[faults] = (shown_us, pong.t_rx_us, pong.t_tx_us, board_us)
    healthy, faulty = records.values()
    assert [f - h for f, h in zip(faulty, healthy, strict=True)] == [5000, 5000, 5000, 0]


def test_the_clock_may_wrap_soon(open_host):
    assert (
        faulty_clock(FaultPlan.parse(["clock.wrap us=1000"]), DeviceClock(5)).boot_us
        == 2**32 - 1000
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
    with pytest.raises(ConfigurationError, match="no such place; the array has 16 transducers"):
        open_host(url_of("device.off bank=1"))


# --- what cannot be, however a fault is given -----------------------------------------------------

SPAN = "must not be before power-up (0s), nor after 4611686018s"
NEVER = {
    "line.flip from=5s until=1s": "line.flip from=5s until=1s: until must be after 5s",
    "line.flip from=2s until=2s": "line.flip from=2s until=2s: until must be after 2s",
    "line.flip until=0s": "line.flip from=0s until=0s: until must be after 0s",
    "line.flip until=-1s": f"line.flip until=-1s: {SPAN}",
    "line.flip from=-1ns": f"line.flip from=-1ns: {SPAN}",
    "line.flip from=1e10s": f"line.flip from=1e10s: {SPAN}",
    "line.flip until=1e10s": "line.flip until=1e10s: must not be before power-up",
    "line.flip from=nans": "line.flip from=nans: must be a time such as 2s",
    "line.flip from=infs": "line.flip from=infs: must be a time such as 2s",
    "line.flip from=1e999s": "line.flip from=1e999s: must be a time such as 2s",
    "line.flip from=2": "line.flip from=2: must be a time such as 2s",
    "line.flip from=": "line.flip from=: must be a time such as 2s",
    "line.flip from=s": "line.flip from=s: must be a time such as 2s",
    "line.flip ber": "line.flip ber= is not a number",
    "line.flip ber=nan": "line.flip ber=nan, must be 0 to 1",
    "line.flip ber=inf": "line.flip ber=inf, must be 0 to 1",
    "line.flip ber=-1": "line.flip ber=-1, must be 0 to 1",
    "line.slice bytes=1e300": "line.slice bytes=",
    "line.delay us=1e10": "line.delay us=10000000000, must be 0 to 1000000000",
    "line.disconnect ms=0": "line.disconnect ms=0, must be 1e-06 to 1000000000",
    "line.disconnect ms=5 until=9s": "line.disconnect ms=5 until=9s: say either how long, or until",
    "line.disconnect from=2s until=1s": "line.disconnect from=2s until=1s: until must be after 2s",
    "clock.step us=-1": "clock.step us=-1, must be 0 to 1000000000",
    "clock.step until=2s": "clock.step has no parameter 'until'; known: us, from",
    "clock.offset from=2s": "clock.offset has no parameter 'from'; known: us",
    "clock.wrap until=2s": "clock.wrap has no parameter 'until'; known: us",
    "device.off transducer=-1": "device.off transducer=-1, must be 0 to 65535",
    "device.off": "device.off: must have either transducer=N, column=N or bank=N",
    "device.off bank=0 column=1": "device.off column=1 bank=0: must have either",
}
NEVER |= {  # every kind that takes times
    f"{name} {place}from=5s until=1s": f"{name} from=5s until=1s: until must be after 5s"
    for name in FAULT_KINDS
    if "until" in words_of(name)
    for place in ["bank=0 " if "bank" in FAULT_KINDS[name] else ""]
}


def toml_of(text):
    name, *words = text.split()
    lines = [f'{key} = "{value}"' for key, _, value in (word.partition("=") for word in words)]
    return "\n".join(["[[fault]]", f'name = "{name}"', *lines])


def refused(act):
    with pytest.raises(ConfigurationError) as caught:
        act()
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize(("text", "problem"), NEVER.items())
def test_what_cannot_be_is_refused_with_fault_parameter_value_and_limit(text, problem):
    assert problem in refused(lambda: FaultPlan.parse([text]))
    assert problem in refused(lambda: FaultPlan.from_toml(toml_of(text)))


@pytest.mark.parametrize("text", ["line.flip from=5s until=1s", "line.flip ber=nan"])
def test_it_is_one_line_wherever_a_fault_is_given(text, tmp_path, open_host, capsys):
    problem, plan = NEVER[text], tmp_path / "plan.toml"
    plan.write_text(toml_of(text))
    assert problem in refused(lambda: open_host(url_of(text)))
    assert problem in refused(lambda: open_host(f"{VIRTUAL}&fault_plan={plan}"))
    for option in (f"--fault={text}", f"--fault-plan={plan}"):
        assert main(["--link", str(tmp_path / "board"), option]) == 2
        assert verify(["verify", "--virtual-time", option]) == 2
        said = capsys.readouterr().err
        assert said.count(problem) == said.count("\n") == 2
    assert verify(["verify", "--port", url_of(text)]) == 2
    assert capsys.readouterr().err.count("\n") == 1


@pytest.mark.parametrize(
    ("fault", "problem"),
    [
        (
            ("line.flip", {"ber": 0.1}, 5, 1),
            "line.flip from=5ns until=1ns: until must be after 5ns",
        ),
        (("line.flip", {"ber": 0.1}, -5), "line.flip from=-5ns: must not be before power-up"),
        (("line.flip", {"ber": 0.1}, 1 << 62), "nor after"),
        (("line.flip", {"ber": float("nan")}), "line.flip ber=nan, must be 0 to 1"),
        (("line.flip", {"ber": "1"}), "line.flip ber='1' is not a number"),
        (("line.flip", {}), "line.flip: its parameters are ber"),
        (("line.flip", {"ber": 0.1}, 0, 9, "left"), "must be down, up or both"),
        (("frame.crc", {"p": 0.1}, 0, 9, "both"), "frame.crc direction=both, must be down"),
        (("line.disconnect", {"ms": 5.0}, 0, 9), "line.disconnect ms=5 until=9ns: say either"),
        (("line.slice", {"bytes": 1.5, "gap_us": 0}), "bytes=1.5, must be a whole number"),
        (("line.flop", {}), "no fault 'line.flop'; known: "),
    ],
)
def test_a_fault_that_is_made_by_hand_is_refused_too(fault, problem):
    assert problem in refused(lambda: Fault(*fault))


@pytest.mark.parametrize(
    ("texts", "problem"),
    [
        ("line.flip", "faults is 'line.flip', must be a list such as ['line.flip ber=1e-5']"),
        (b"line.flip", "faults is b'line.flip', must be a list"),
        (None, "faults is None, must be a list"),
        (5, "faults is 5, must be a list"),
        ([5], "faults[0] is 5, must be a text such as 'line.flip ber=1e-5'"),
        ([None], "faults[0] is None, must be a text"),
        ([b"line.flip"], "faults[0] is b'line.flip', must be a text"),
        ([["line.flip"]], "faults[0] is ['line.flip'], must be a text"),
        (["line.flip ber=1 ber=0.5"], "line.flip ber=0.5: ber is said twice"),
        (["line.flip from=1s from=2s"], "line.flip from=2s: from is said twice"),
    ],
)
def test_what_is_no_list_of_texts_is_refused(texts, problem):
    assert problem in refused(lambda: FaultPlan.parse(texts))


def test_a_plan_is_made_of_faults():
    assert "FaultPlan.parse" in refused(lambda: FaultPlan(("line.flip",)))


def test_a_string_of_a_file_does_not_break_the_line():
    text = '[[fault]]\nname = "line.flip"\nber = "a\\nb"\n'
    assert "ber=a b is not a number" in refused(lambda: FaultPlan.from_toml(text))


def test_a_port_may_be_gone_until_a_time():
    fault = Fault.parse("line.disconnect from=1s until=3s")
    assert (fault.from_ns, fault.until_ns) == (1_000 * MS, 3_000 * MS)
    assert str(fault) == "line.disconnect from=1s until=3s"
    assert Fault.parse(str(fault)) == fault
