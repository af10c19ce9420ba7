"""The driver on boards of other dialects: every one, real ports, wrong boards, and none."""

import base64
import contextlib
import dataclasses
import doctest
import itertools
import json
import re
import signal

import numpy as np
import pytest

import sim_device
from haptogram import ConfigurationError, LinkError, VirtualBoard, verify_run
from haptogram.driver import dialect_driver
from haptogram.driver.dialect_driver import DialectDriver
from haptogram.driver.line.budget import highest_line_rate_hz
from haptogram.driver.line.port import PyserialTransport
from haptogram.errors import DeviceError, NoAnswerError
from haptogram.evidence.backdoor import board_model_of_evidence
from haptogram.evidence.board_process import BoardProcess
from haptogram.evidence.dialects.latches import dialect_run_observations
from haptogram.settings.board import BoardConfig
from haptogram.settings.board_url import PortConfig
from haptogram_protocol.dialects.table import DIALECTS
from sim_device.protocol_haptogram import open_virtual_port
from swallowing_port import SwallowingPort

pytestmark = pytest.mark.sampled(2)

every_dialect = pytest.mark.parametrize("name", DIALECTS)
SERIAL = [name for name, dialect in DIALECTS.items() if dialect.bauds]
HIGHEST_M, LOWEST_M = 0.15, 0.03
ABOVE_A_CAVITY_M = 0.022  # boards that face each other hold their foci between them


def targets(driver):
    """Return a short object off all planes of symmetry, at a height that suits the array."""
    array = driver.model.array
    width, depth, height = np.ptp(array.positions_m, axis=0)
    up = np.clip(0.9 * max(width, depth), LOWEST_M, HIGHEST_M)
    up = ABOVE_A_CAVITY_M if height > 0.01 else up
    places = [(0.13, 0.21, up), (-0.17, 0.11, 0.95 * up), (0.05, -0.23, up + 0.002)]
    return [array.world_m(np.array([x * width, y * depth, z])) for x, y, z in places]


@contextlib.contextmanager
def in_virtual_time(name, **options):
    """Give the port to a board in this process, and what its back door has seen."""
    config = PortConfig(
        board=BoardConfig.of(dialect=name, **options), clock="virtual", reconstruct=False
    )
    with contextlib.closing(open_virtual_port(config)) as port:
        yield PyserialTransport(port, "board"), port.records


def judged(driver, records):
    seen = dialect_run_observations(driver.intended, records, None)
    return verify_run(driver.intended, seen, model=board_model_of_evidence(records[0]))


@pytest.mark.sampled(1)
@pytest.mark.pty
@every_dialect
def test_an_object_is_verified_on_a_board_at_a_real_port(name):
    with VirtualBoard(dialect=name, reconstruct=False) as board:
        with DialectDriver(board.url, dialect=name) as driver:
            driver.focus(targets(driver)[0])
            report = driver.stream(targets(driver), rate_hz=20)
        verdict = board.verify(driver.intended, min_verified=1.0)
    assert verdict, str(verdict)
    assert report.frames == len(report.lateness_us) == 3
    assert verdict.counts["verified"] == verdict.counts["latched"] == 4
    assert verdict.as_dict()["evidence"] == "external"


@pytest.mark.nightly
@pytest.mark.pty
def test_devices_over_tcp_in_a_process_of_their_own(tmp_path):
    seen = tmp_path / "backdoor.jsonl"
    words = ["--dialect=autd3", "--tcp=127.0.0.1:0", f"--backdoor={seen}", "--no-reconstruct"]
    board = BoardProcess(words, tmp_path / "log")
    try:
        board.wait_until_ready()
        (address,) = re.findall(r"socket://\S+", board.log())
        with DialectDriver(address, dialect="autd3") as driver:
            driver.stream(targets(driver), rate_hz=20)
    finally:
        board.stop()
        board.close_pipe()
    records = [json.loads(line) for line in seen.read_text().splitlines()]
    verdict = judged(driver, records)
    assert verdict, str(verdict)
    assert verdict.counts["verified"] == 3


@every_dialect
def test_another_order_of_the_channels_fails(name):
    with in_virtual_time(name) as (port, records):
        count = DialectDriver(port, dialect=name).model.array.count
    with in_virtual_time(name) as (port, records):
        with DialectDriver(port, dialect=name, channels=range(count)[::-1]) as driver:
            driver.stream(targets(driver), rate_hz=20)
        verdict = judged(driver, records)
    assert verdict.exit_status == 1, str(verdict)
    assert verdict.counts["latched"] == 3


@every_dialect
def test_one_silent_element_fails_by_name(name):
    with in_virtual_time(name, fault=("device.off transducer=3",)) as (port, records):
        with DialectDriver(port, dialect=name) as driver:
            driver.stream(targets(driver), rate_hz=20)
        verdict = judged(driver, records)
    assert verdict.exit_status == 1, str(verdict)
    assert all("element 3 " in "; ".join(frame.faults) for frame in verdict.frames)


@every_dialect
def test_a_step_more_on_one_channel_shows(name):
    with in_virtual_time(name) as (port, records):
        with DialectDriver(port, dialect=name) as driver:
            (frame,) = driver.frames(targets(driver)[:1])
            codes = list(frame.codes)
            codes[1] = (codes[1] + 1) % frame.steps
            driver.stream([dataclasses.replace(frame, codes=tuple(codes))], rate_hz=20)
        for seen in (dialect_run_observations(driver.intended, records, None), driver.observations):
            verdict = verify_run(driver.intended, seen, model=board_model_of_evidence(records[0]))
            assert verdict.exit_status == 1
            (fault,) = verdict.frames[0].faults
            assert fault.replace("(0, 1) ", "") == "element 1 off by +1 LSB"


@pytest.mark.sampled(1)
@pytest.mark.pty
@pytest.mark.parametrize("name", SERIAL)
def test_a_port_that_says_nothing_gives_evidence_of_the_wire(name):
    with SwallowingPort() as far, DialectDriver(far.path, dialect=name) as driver:
        driver.stream(targets(driver), rate_hz=20)
        frames = driver.frames(targets(driver))
    display = DIALECTS[name].display(driver.boards)
    board = DIALECTS[name].board(**display.options)
    shown, at = [], 0
    while at < len(far.data):
        end = board.next_frame_end(far.data, at)
        shown.append(board.receive_data(far.data[at:end]))
        at = end
    every = [operation for operations in shown for operation in operations]
    found = [display.read(every[:end]) for end in range(1, len(every) + 1)]
    sounding = [codes for codes in found if codes is not None and set(codes) != {None}]
    distinct = [codes for codes, _ in itertools.groupby(sounding)]
    assert distinct == [list(frame.codes) for frame in frames]
    assert display.read(every) == [None] * display.channels  # off in the end
    verdict = verify_run(driver.intended, driver.observations, model=driver.model)
    assert all(frame.criteria == {} for frame in verdict.frames)
    assert (verdict.exit_status, verdict.counts["latched"]) == (3, 0)
    assert verdict.as_dict()["evidence"] == "wire"
    assert all("nobody saw" in frame.note for frame in verdict.frames)


@pytest.mark.pty
def test_a_link_that_does_not_answer_is_told():
    with SwallowingPort() as far, pytest.raises(NoAnswerError, match="no answer to Hello within"):
        DialectDriver(far.path, dialect="autd3", timeout_s=0.2)


class CutPort:
    """A port that takes one byte at a time, and the user interrupts after some of them."""

    def __init__(self, port):
        self.url, self.now_ns = port.url, port.now_ns
        self.read_available, self.close = port.read_available, port.close
        self._write = port.write_some
        self.bytes_until_cut = None

    def write_some(self, data):
        if self.bytes_until_cut is None:
            return self._write(data)
        if self.bytes_until_cut <= 0:
            self.bytes_until_cut = None
            signal.raise_signal(signal.SIGINT)
            return self._write(data)
        self.bytes_until_cut -= 1
        return self._write(data[:1])


def show_a_focus(driver, cut, bytes_until_cut):
    """Latch a focus; the user interrupts after so many of the bytes that follow."""
    driver.focus(targets(driver)[0])
    driver.hold(0.05)
    cut.bytes_until_cut = bytes_until_cut


def last_widths(records):
    """Return the widths of the pulses that the board radiates in the end."""
    *_, last = (record for record in records if record["kind"] == "pulses")
    return base64.b64decode(last["widths"])


@pytest.fixture
def ctrl_c():
    """Python's own answer to Ctrl-C, which a job in the background does not have."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@every_dialect
@pytest.mark.usefixtures("ctrl_c")
@pytest.mark.parametrize("share", [0.1, 0.6, 0.9])
def test_every_channel_is_off_after_an_interrupt_within_a_frame(name, share):
    with in_virtual_time(name) as (port, records):
        cut = CutPort(port)
        with contextlib.suppress(KeyboardInterrupt), DialectDriver(cut, dialect=name) as driver:
            show_a_focus(driver, cut, share * DIALECTS[name].frame_bytes(driver.boards))
            driver.focus(targets(driver)[1])
            pytest.fail("the frame was not cut")
    assert not any(last_widths(records))


@every_dialect
@pytest.mark.usefixtures("ctrl_c")
@pytest.mark.parametrize("share", [0.0, 0.1, 0.6])
def test_every_channel_is_off_after_another_interrupt_while_the_driver_closes(name, share):
    with in_virtual_time(name) as (port, records):
        cut = CutPort(port)
        with contextlib.suppress(KeyboardInterrupt), DialectDriver(cut, dialect=name) as driver:
            show_a_focus(driver, cut, share * DIALECTS[name].frame_bytes(driver.boards))
            raise KeyboardInterrupt
        assert cut.bytes_until_cut is None
    assert not any(last_widths(records))


@pytest.mark.parametrize("seconds", [0.98, 1.0, 2.01])
def test_a_board_that_forgets_the_beginning_of_a_frame_falls_silent_when_it_is_told(seconds):
    """InteractLab clears its FIFO after every second of silence, and a frame that has begun."""

    def is_silent():
        return not any(last_widths(records))

    with in_virtual_time("interactlab") as (port, records):
        with DialectDriver(port, dialect="interactlab") as driver:
            driver.focus(targets(driver)[0])
            driver.hold(seconds)
            driver.mute()
            driver.hold(0.05)
            assert is_silent()
            driver.focus(targets(driver)[0])
            driver.hold(seconds)
            assert not is_silent()
        assert is_silent()


def test_the_first_frame_is_shown_by_a_board_that_forgets_while_the_host_lets_it_settle():
    with in_virtual_time("interactlab") as (port, records):
        write, late_ns = port.write_some, iter([1_000_000])  # the frame that opens, on its way
        port.read_available(port.now_ns() + 2_000_000_000)  # the board is up

        def write_late(data):
            port.read_available(port.now_ns() + next(late_ns, 0))
            return write(data)

        port.write_some = write_late
        with DialectDriver(port, dialect="interactlab") as driver:
            driver.focus(targets(driver)[0])
            driver.hold(0.05)
            assert any(last_widths(records))


def test_devices_that_are_not_there_are_refused_in_the_words_of_the_board():
    with (
        in_virtual_time("autd3", dialect_option=("devices=2",)) as (port, _),
        pytest.raises(DeviceError, match="1 devices are opened, this board has 2"),
    ):
        DialectDriver(port, dialect="autd3")


@pytest.mark.parametrize("name", SERIAL)
def test_the_highest_rate_is_that_of_the_budget(name):
    with in_virtual_time(name) as (port, records), DialectDriver(port, dialect=name) as driver:
        size = DIALECTS[name].frame_bytes(driver.boards)
        highest_hz = highest_line_rate_hz(size, DIALECTS[name].bauds[0])
        driver.stream(targets(driver), rate_hz=highest_hz)
        with pytest.raises(ConfigurationError, match=f"{size} bytes a frame at .* lower the rate"):
            driver.stream(targets(driver), rate_hz=1.01 * highest_hz)
        assert len(driver.intended) == 3
    assert judged(driver, records)


@pytest.mark.parametrize("name", ["arm", "play", "read_drive", "status", "clock", "identity"])
def test_what_the_wire_has_no_bytes_for_is_not_there(name):
    with (
        in_virtual_time("sonicsurface") as (port, _),
        DialectDriver(port, dialect="sonicsurface") as driver,
    ):
        assert not hasattr(driver, name)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"dialect": "sonicsurfaces"}, "did you mean sonicsurface"),
        ({"dialect": 3}, "the name of a wire"),
        ({"dialect": "sonicsurface", "baudrate": 0}, "baudrate is 0"),
        ({"dialect": "sonicsurface", "channels": [0, 1]}, "channels holds 2, must be one for each"),
        ({"dialect": "ultraino-nano8", "channels": [0] * 8}, "a channel twice"),
        ({"dialect": "interactlab", "channels": range(256, 512)}, "2 boards are needed"),
        (
            {"dialect": dataclasses.replace(DIALECTS["interactlab"], display=None)},
            "can be emulated and not driven",
        ),
        (
            {"dialect": dataclasses.replace(DIALECTS["interactlab"], name="ours", layout="")},
            "the array of dialect ours is not known here",
        ),
    ],
)
def test_what_makes_no_sense_is_refused_before_the_port_is_opened(options, says):
    with pytest.raises(ConfigurationError, match=says):
        DialectDriver("/dev/no-such-port", **options)
    with pytest.raises(LinkError, match="no such port"):
        DialectDriver("/dev/no-such-port", dialect="sonicsurface")


def test_phases_of_a_caller_are_rounded_to_the_steps_of_the_board():
    with in_virtual_time("sonicsurface") as (port, records):
        with DialectDriver(port, dialect="sonicsurface") as driver:
            codes = driver.phases(np.linspace(0.0, 2.0 * np.pi, 256, endpoint=False))
            driver.hold(0.05)
            with pytest.raises(ConfigurationError, match=r"shape \(3,\), must be \(256,\)"):
                driver.phases([0.0, 1.0, 2.0])
            with pytest.raises(ConfigurationError, match=r"phases_rad.* is 1e\+300, must be"):
                driver.phases([1e300] * 256)
            driver.mute()
        assert codes[0] == codes[-1] == 0
        assert set(codes) == set(range(32))
        assert [record["kind"] for record in records].count("pulses") == 5
    with pytest.raises(LinkError):
        driver.focus((0.0, 0.0, 0.15))


def test_the_example_runs():
    sim_device.register_url_handler()
    assert doctest.testmod(dialect_driver).failed == 0


def test_lost_and_strange_latches_are_told_apart():
    """No number is on the wire: what is left over of either side is lost, or nobody's."""
    with in_virtual_time("sonicsurface") as (port, records):
        with DialectDriver(port, dialect="sonicsurface") as driver:
            driver.stream(targets(driver) * 4, rate_hz=40)
        power_up, *latches = [n for n, record in enumerate(records) if record["kind"] == "pulses"]
        sounding = latches[1:-1]  # the driver switches off before and behind

    def counts(left_out=(), doubled=()):
        kept = [r for n, r in enumerate(records) if n not in left_out]
        kept += [records[n] for n in doubled]
        kept.sort(key=lambda record: record.get("t_latch_us", 0) if "rises" in record else 0)
        found = judged(driver, kept).counts
        return found["on_target"], found["lost"], found["unexpected"]

    assert len(sounding) == len(driver.intended) == 12
    assert counts() == (12, 0, 0)
    assert counts(left_out=sounding[4:5]) == (11, 1, 0)
    assert counts(left_out=sounding[2:4]) == (10, 2, 0)
    assert counts(left_out=sounding[-1:]) == (11, 1, 0)
    assert counts(doubled=sounding[4:5]) == (12, 0, 1)
    assert power_up not in sounding
