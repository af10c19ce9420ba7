"""Boards that another process simulates, here a few lines of Python."""

import contextlib
import dataclasses
import os
import shlex
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptogram.errors import ConfigurationError, LinkLostError
from haptogram.evidence.captures.channel_map import ChannelMap
from haptogram.evidence.captures.files import read_capture
from haptogram.evidence.captures.pin_record import pin_record_of_capture
from haptogram.settings.board import BoardConfig
from haptogram.settings.board_url import PortConfig
from haptogram_protocol.dialects.sonicsurface import OFF
from sim_device.blueprint import blueprint_of
from sim_device.board.settings import board_settings
from sim_device.dialects.simulated import process
from sim_device.dialects.simulated.pins import STEPS, SimulatedPins
from sim_device.dialects.simulated.unit import SimulatedUnit
from sim_device.protocol_haptogram import open_virtual_port

SCRIPT = Path(__file__).with_name("python_simulator.py")
PINS = 16
OFF_FRAME = b"\xfe" + bytes([OFF]) * 256 + b"\xfd"
RAMP = b"\xfe" + bytes(n % 32 for n in range(256)) + b"\xfd"


def command(*words):
    return shlex.join(map(str, (sys.executable, SCRIPT, *words)))


def opened(simulator, array="4x4", **options):
    board = BoardConfig.of(dialect="sonicsurface", array=array, simulator=simulator, **options)
    return open_virtual_port(PortConfig(board=board, clock="virtual", reconstruct=False))


def records(frames, simulator=None, **options):
    port = opened(simulator, **options)
    for frame in frames:
        port.write(frame)
        port.flush()
        port.wait_until_ns(port.now_ns() + 1_000_000)
    port.close()
    return port.records


def latches(found):
    return [record for record in found if record["kind"] == "pulses"]


def children():
    return Path(f"/proc/{os.getpid()}/task/{os.getpid()}/children").read_text().split()


def test_its_latches_are_those_of_the_emulation():
    frames = [OFF_FRAME, RAMP, RAMP, OFF_FRAME]
    emulated, simulated = latches(records(frames)), latches(records(frames, command(PINS)))
    assert [seen["number"] for seen in simulated] == list(range(len(frames) + 1))
    assert len(simulated) == len(emulated)
    for ours, theirs in zip(simulated, emulated, strict=True):
        late_us = ours["t_latch_us"] - theirs["t_latch_us"]
        assert 0 <= late_us <= 26  # to the next period of the carrier
        assert ours["steps"] == STEPS


def test_a_frame_that_changes_no_pin_is_a_latch_all_the_same():
    uniform = b"\xfe" + bytes(PINS) + bytes([OFF]) * (256 - PINS) + b"\xfd"
    causes = [seen["cause"] for seen in latches(records([uniform, RAMP, RAMP], command(PINS)))]
    assert causes == ["power-up", "swap", "pins", "swap"]


def test_it_is_the_same_each_time():
    frames = [OFF_FRAME, RAMP]
    assert records(frames, command(PINS)) == records(frames, command(PINS))


@pytest.mark.parametrize(
    ("way", "seen"),
    [
        ("dies", "has ended: out of memory in the 3rd process"),
        ("back", "went back in time"),
        ("ahead", "went ahead of its time"),
        ("stops", "and sent no byte"),
        ("garbage", "wrote 'Warning: metavalue detected'"),
        ("bad-pins", "wrote 'P 30000 0000'; a change is P, a time from 0 to 24999, and 4 digits"),
        ("bad-byte", r"wrote 'R \d+ -1', which is no line of a simulator here"),
        ("skips", "periods of the carrier"),
    ],
)
@pytest.mark.parametrize("is_captured", [False, True])
def test_one_that_misbehaves_is_named_once_and_what_it_showed_is_kept(
    way, seen, is_captured, tmp_path
):
    before = children()
    file = {"simulator_capture": tmp_path / "pins.vcd"} if is_captured else {}
    port = opened(command(PINS, way), **file)
    port.write(RAMP)
    with pytest.raises(LinkLostError, match=seen) as caught:
        port.wait_until_ns(port.now_ns() + 20_000_000)
    assert "\n" not in str(caught.value)
    port.write(OFF_FRAME)
    port.wait_until_ns(port.now_ns() + 20_000_000)  # a board without power
    port.close()
    assert latches(port.records)[0]["cause"] == "power-up"
    assert port.records[-1]["kind"] == "end"
    assert children() == before


def test_one_that_hangs_is_given_up(monkeypatch):
    monkeypatch.setattr("sim_device.dialects.simulated.process.PATIENCE_S", 0.5)
    port = opened(command(PINS, "hangs"))
    port.write(RAMP)
    with pytest.raises(LinkLostError, match=r"did not answer for 0\.5 s"):
        port.wait_until_ns(port.now_ns() + 20_000_000)


def test_one_that_says_what_is_the_same_once_is_as_good(tmp_path):
    turned = b"\xfe" + bytes((n + 16) % 32 for n in range(256)) + b"\xfd"
    frames, files = [OFF_FRAME, RAMP, turned], [tmp_path / "all.vcd", tmp_path / "same.vcd"]
    found = [
        records(frames, command(PINS, *way), simulator_capture=file)
        for way, file in zip(((), ("same",)), files, strict=True)
    ]
    assert found[1][1:] == found[0][1:]
    assert files[1].read_bytes() == files[0].read_bytes()


def test_one_that_answers_late_is_as_good():
    assert records([RAMP], command(PINS, "late"))[1:] == records([RAMP], command(PINS))[1:]


@pytest.mark.parametrize(
    ("simulator", "seen"),
    [
        ("/nonexistent/simulator", "cannot be started: there is no such file"),
        ("cat", "wrote 'L 4340'"),
        ("sed -u s/.*//", "wrote ''"),
        ("yes", "wrote 'y'"),
        ("false", "has ended: status 1"),
        (command(PINS, "none", 2), "speaks version 2 of the protocol, must be 1"),
        (command(12), "has 12 pins, and the array 16 channels"),
        ("'", "No closing quotation"),
    ],
)
def test_what_is_no_simulator_of_this_board_is_refused(simulator, seen):
    before = children()
    with pytest.raises(ConfigurationError, match=seen):
        opened(simulator)
    assert children() == before


#: What stands between the lines of a simulator that is not quite one.
ODD = [
    *(b"R 5 41\n", b"R 99 1ff\n", b"R\n", b"= 3\n", b"= -1\n", b"= 99999999999999999999\n"),
    *(b"= 3|\n", b"|\n", b" |\n", b"P|\n", b"P 5 01|\n", b"P 0 0\n", b"P 0 ff\n"),
    *(b"P 24999 1f\n", b"P 25000 01\n", b"\n", b" ", b". 5\n", b"x", b"\xff", b"9" * 5000),
    "\N{ARABIC-INDIC DIGIT FOUR}".encode(),
]


class OddProcess:
    """A simulator of five pins in the place of a process; it says odd things here and there."""

    def __init__(self, odd):
        self.odd, self.now_ns, self.close = list(odd), 0, lambda: None

    def ask(self, text, _):
        if text.startswith(b"L"):
            return b"hello 1\npins a b c d e\nperiod 25000\n. 0\n"
        until_ns = int(text.rsplit(b"T ", 1)[1])
        periods = until_ns // 25_000 - self.now_ns // 25_000
        self.now_ns = until_ns
        lines = [b"P 7 %02x\n|\n" % (n % 32) for n in range(periods)] + [b"P 3 01\n"]
        place, line = self.odd.pop(0) if self.odd else (0, b"")
        lines.insert(round(place * len(lines)), line)
        answer = b"".join(lines)
        return answer + b"\n" * (not answer.endswith(b"\n")) + b". %d\n" % until_ns


@pytest.mark.parametrize("is_captured", [False, True])
@given(st.lists(st.tuples(st.floats(0, 1), st.sampled_from(ODD)), min_size=30, max_size=30))
def test_whatever_a_simulator_says_is_read_or_refused(is_captured, tmp_path_factory, odd):
    settings = board_settings(array="5x1")
    for said in odd:
        file = tmp_path_factory.mktemp("odd") / "pins.vcd" if is_captured else None
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(
                process, "LineProcess", lambda *_, said=said: OddProcess([(0, b""), said])
            )
            unit = SimulatedUnit(
                dataclasses.replace(settings, simulator="odd", simulator_capture=file)
            )
        with contextlib.suppress(LinkLostError):
            for t_us in (70, 160, 200):
                unit.advance_to(settings.boot_us + t_us)
        unit.power_down()


@pytest.mark.parametrize(
    "content", [b"# notes\n", b"\xff#5\xfe", b"text", b"#" + b"9" * 99 + b"\n"]
)
def test_a_file_that_is_no_capture_is_left_alone(content, tmp_path):
    file = tmp_path / "notes.md"
    file.write_bytes(content)
    with pytest.raises(ConfigurationError, match=r"notes\.md: is there and no capture"):
        opened(command(PINS), simulator_capture=file)
    assert file.read_bytes() == content


def period(changes, digits=1):
    return b"".join(b"P %d %0*x\n" % (t_ns, digits, high) for t_ns, high in changes) + b"|\n"


def test_the_fundamental_of_a_pin_is_that_of_its_pulse():
    pins = SimulatedPins(3, 25_000)
    text = period([(0, 1), (6_250, 3), (12_500, 2), (18_750, 0)])
    (shown,) = list(pins.take(text * 4))
    np.testing.assert_allclose(shown.pulses.weights(), [1j, -1, 0], atol=1e-3)


def test_a_period_in_which_the_drive_changes_is_no_drive():
    pins = SimulatedPins(1, 25_000)
    before, after = period([(0, 1), (12_500, 0)]), period([(5_000, 1), (17_500, 0)])
    torn = period([(0, 1), (5_000, 0), (10_000, 1), (17_500, 0)])
    shown = list(pins.take(before * 3 + torn + after * 3))
    assert [drive.t_ns for drive in shown] == [0, 100_000]


def test_a_carrier_of_half_the_frequency_is_counted_and_radiates_nothing():
    pins = SimulatedPins(1, 25_000)
    shown = list(pins.take((period([(0, 1)]) + period([(0, 0)])) * 20))
    assert pins.halved == 5
    assert abs(shown[-1].pulses.weights()[0]) < 1e-3


def test_half_the_carrier_is_said_once(caplog):
    port = opened(command(PINS, "half"))
    port.wait_until_ns(port.now_ns() + 5_000_000)
    port.close()
    (said,) = [record for record in caplog.records if record.levelname == "WARNING"]
    assert said.getMessage() == "half the carrier: pins repeat after 50000 ns"


def test_pins_that_jitter_by_a_nanosecond_show_one_drive():
    pins = SimulatedPins(1, 25_000)
    text = b"".join(period([(n % 3, 1), (12_500 + n % 2, 0)]) for n in range(40))
    assert len(list(pins.take(text))) == 1


def test_its_pins_and_its_line_are_a_capture_that_goes_on_after_a_power_cycle(tmp_path):
    path = tmp_path / "pins.vcd"
    for _ in range(2):
        port = opened(command(PINS), simulator_capture=path)
        port.write(RAMP)
        port.flush()
        port.wait_until_ns(port.now_ns() + 1_000_000)
        port.close()
    elements = {f"out{pin}": pin for pin in range(PINS)}
    fields = {"reference": "carrier", "to_board": "to_board", "baud": 230_400}
    mapped = ChannelMap.of(path, {**fields, "sample_rate_hz": 1e9, "elements": elements})
    record = pin_record_of_capture(read_capture(path), mapped)
    assert record.to_board is not None
    assert bytes(record.to_board.values) == RAMP * 2
    assert record.to_board.damaged == 0
    shown = {pin: np.median(pulses.falls - pulses.rises) for pin, pulses in record.pins.items()}
    assert shown == pytest.approx(dict.fromkeys(range(PINS), 0.5), abs=0.01)


def test_slow_down_is_for_a_simulated_board_and_a_terminal():
    with pytest.raises(ConfigurationError, match="slow_down is for a simulated board"):
        blueprint_of(BoardConfig.of(slow_down=2.0))
    board = BoardConfig.of(dialect="sonicsurface", array="4x4", simulator=command(PINS))
    with pytest.raises(ConfigurationError, match="simulator needs clock=virtual"):
        open_virtual_port(PortConfig(board=board, clock="wall"))
