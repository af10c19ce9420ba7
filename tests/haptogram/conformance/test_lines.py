"""Lines and boards that are slow: the suite measures, waits, and says what it could not see."""

import functools
import random
import shlex
import signal
import subprocess
import sys
from pathlib import Path

import pytest
import serial
from boards import Wrapped, run, virtual
from identities import identity

import sim_device
from haptogram.conformance.case import Depth
from haptogram.conformance.cases import all_cases, select
from haptogram.conformance.cases.ch06_output import every_effect
from haptogram.conformance.client import malformed_frames
from haptogram.conformance.client.request_client import RequestClient
from haptogram.conformance.client.wire import ClientWaitLimits, RawFrameClient
from haptogram.conformance.judge.held_state import judged_held_state
from haptogram.conformance.run.access import VirtualAccess
from haptogram.conformance.run.runner import SuiteOptions, SuiteRunner
from haptogram.conformance.run.spawning import SpawnAccess
from haptogram.conformance.verdict import INCONCLUSIVE_STATUS, Behaviour
from haptogram.driver.line.port import PyserialTransport
from haptogram.report.conformance.text import suite_text
from haptogram_protocol.cobs import cobs_encode
from haptogram_protocol.framing import FrameDecoder, encode_frame
from haptogram_protocol.messages import (
    Arm,
    ArmReply,
    Disarm,
    GetStatus,
    Phases,
    Ping,
    ReadDrive,
    SetConfigReply,
    StopReply,
)

pytestmark = pytest.mark.sampled(2)

DEAF = Path(__file__).parents[2] / "deaf_board.py"
AT_A_RESET = ("HG-4.1/4-reset", "HG-4.7/1", "HG-6.1/1", "HG-9.2/1")


@pytest.mark.pty
@pytest.mark.realtime
def test_a_board_that_is_deaf_while_it_boots_passes(tmp_path):
    words = [sys.executable, DEAF, tmp_path / "board", "0.3", "--array", "3x2"]
    access = SpawnAccess(shlex.join(map(str, words)), boot_timeout_s=60)
    suite = run(access, *AT_A_RESET, timeout_s=10)
    judged = [result for result in suite.results if "this depth" not in result.detail]
    assert {r.case: r.detail for r in judged if r.behaviour is not Behaviour.OK} == {}
    assert all(result.recovers for result in suite.results)


def test_an_interrupt_while_a_board_is_started_leaves_no_process(monkeypatch):
    """The system starts it before Python has its number: an interrupt came between the two."""
    started = []

    class InterruptedStart(subprocess.Popen):
        def __init__(self, *words, **values):
            super().__init__(*words, **values)
            started.append(self)
            signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(subprocess, "Popen", InterruptedStart)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    access = SpawnAccess("sleep 60")
    try:
        with pytest.raises(KeyboardInterrupt):
            access.open()
        access.close()
        assert started[0].poll() is not None
        access._output.end(60)  # noqa: SLF001  its thread closes the pipe
    finally:
        signal.signal(signal.SIGINT, before)
        started[0].kill()


def other_than_stated(baud, stated):
    """A board in virtual time that is judged as if its line were of *stated* baud in real time."""
    sim_device.register_url_handler()

    def start(number):
        url = f"haptogram://?clock=virtual&baud={baud}&seed={number}"
        return PyserialTransport(serial.serial_for_url(url, timeout=0), url)

    return VirtualAccess("other", start, baudrate=stated, virtual=False)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("baud", [57_600, 921_600])
def test_a_line_slower_than_stated_is_measured(baud):
    suite = run(other_than_stated(baud, 3_000_000), "HG-3.8/1-queue", "HG-3.9/4", "HG-5.7/3")
    assert suite.settings["measured_baudrate"] == pytest.approx(baud, rel=0.02)
    assert {r.behaviour for r in suite.results} == {Behaviour.OK}
    assert f"{suite.settings['measured_baudrate']} Bd as measured" in suite_text(suite)


def test_a_line_too_slow_for_a_verdict_fails_no_board():
    suite = run(virtual(baud=57_600), "HG-8.3/2-paths", "HG-8.7", "HG-9.5/1", depth=Depth.DEFAULT)
    told = [r for r in suite.results if r.behaviour is Behaviour.INCONCLUSIVE]
    assert told
    assert all("a line of 57600 Bd is too slow" in r.detail for r in told)
    assert Behaviour.FAILED not in {r.behaviour for r in suite.results}
    assert suite.exit_status == INCONCLUSIVE_STATUS


@pytest.mark.nightly
def test_a_line_faster_than_stated_fails_no_board():
    """That of an emulated chip brings a frame at once, at whatever rate it stands."""
    suite = run(other_than_stated(3_000_000, 115_200), "HG-5.7", "HG-8.3", "HG-12.3")
    judged = {result.behaviour for result in suite.results}
    assert judged == {Behaviour.OK, Behaviour.NOT_OBSERVED}
    assert {r.behaviour for r in suite.results if r.case == "HG-5.7/5-windows"} == {Behaviour.OK}


def test_readings_may_take_longer_than_the_timers_of_an_event(monkeypatch):
    """A line on which 30 ms pass before each reading: ARM behind the event outlives its lease."""

    def read_slowly(board, since):
        board.wire.idle(30_000)
        return judged_held_state(board, since)

    monkeypatch.setattr(every_effect, "judged_held_state", read_slowly)
    (result,) = run(virtual(array="3x2"), "HG-6.11/5-alone").results
    assert (result.behaviour, result.detail) == (Behaviour.OK, "")


def test_the_verdict_names_what_a_reset_would_add():
    access = virtual(array="3x2")
    access.can_reset = False
    text = suite_text(run(access, "HG-2.3", "HG-3.6/1", "HG-6.1")).splitlines()[-1]
    assert text.startswith("verdict      PASS (exit status 0); ")
    assert text.endswith(" would add HG-3.6/1-sides, HG-3.6/1-time, HG-6.1/1")
    assert "would add" not in suite_text(run(virtual(array="3x2"), "HG-2.3", "HG-6.1"))


class Halting(Wrapped):
    """Hands a frame on after 250 ms if *is_late* says so of its body, *times* times."""

    def __init__(self, inner, times, is_late):
        super().__init__(inner)
        self.times, self.is_late, self.unread = times, is_late, b""

    def write_some(self, data):
        bodies = [body for body in FrameDecoder().feed(data) if isinstance(body, bytes)]
        if self.times > 0 and any(map(self.is_late, bodies)):
            self.times -= 1
            end_ns = self.now_ns() + 250_000_000
            while self.now_ns() < end_ns:
                self.unread += super().read_available(end_ns)
        return super().write_some(data)

    def read_available(self, deadline_ns):
        data, self.unread = self.unread, b""
        return data or super().read_available(deadline_ns)


class DisarmAfterDrive:
    """True for a DISARM with a drive between it and the last one that was late."""

    sounds = False

    def __call__(self, body):
        self.sounds |= body[0] == Phases.TYPE
        is_late = body[0] == Disarm.TYPE and self.sounds
        self.sounds &= not is_late
        return is_late


@pytest.mark.parametrize(("times", "verdict"), [(2, Behaviour.OK), (3, Behaviour.INCONCLUSIVE)])
def test_an_end_that_arrives_when_a_timer_has_ended_the_output_is_sent_again(times, verdict):
    halting = functools.partial(Halting, times=times, is_late=DisarmAfterDrive())
    access = virtual(array="3x2", wrap=halting)
    [result] = run(access, "HG-6.5/1-moments").results
    assert result.behaviour is verdict, result.detail
    assert result.seconds > 0.25 * times
    if verdict is Behaviour.INCONCLUSIVE:
        assert result.detail.startswith("DISARM sounding: the host, its line or an emulator")


class Storing(Wrapped):
    """Begins its answers to SET_CONFIG, ARM and STOP 3 ms after the request has come."""

    late_us = 3000

    def __init__(self, inner):
        super().__init__(inner)
        self.decoder = FrameDecoder()

    def read_available(self, deadline_ns):
        bodies = [*self.decoder.feed(super().read_available(deadline_ns))]
        if any(map(self.is_late, bodies)):
            end_ns = self.now_ns() + 1000 * self.late_us
            while self.now_ns() < end_ns:
                bodies += self.decoder.feed(super().read_available(end_ns))
        return b"".join(encode_frame(self.told_later(body)) for body in bodies)

    def is_late(self, body):
        return body[0] in (SetConfigReply.TYPE, ArmReply.TYPE, StopReply.TYPE)

    def told_later(self, body):
        t_us = int.from_bytes(body[4:8], "little") + self.late_us * self.is_late(body)
        return body[:4] + (t_us % 2**32).to_bytes(4, "little") + body[8:]


@pytest.mark.parametrize("case", ["HG-6.7/1-pauses", "HG-7.1/3-lease", "HG-7.6/5-waiting"])
def test_a_timer_starts_when_a_request_comes_however_long_its_answer_takes(case):
    [result] = run(virtual(array="3x2", wrap=Storing), case).results
    assert (result.behaviour, result.detail) == (Behaviour.OK, "")


class Stalled(Wrapped):
    """A board whose machine has no time for it for 1.5 s, from its frame number *first* on."""

    def __init__(self, inner, first):
        super().__init__(inner)
        self.left, self.until_ns, self.kept = first, 0, b""

    def write_some(self, data):
        self.left -= 1
        if self.left == 0:
            self.until_ns = self.now_ns() + 1_500_000_000
        if self.now_ns() >= self.until_ns:
            return super().write_some(data)
        self.kept += data
        return len(data)

    def read_available(self, deadline_ns):
        if not self.kept:
            return super().read_available(deadline_ns)
        data = super().read_available(min(deadline_ns, self.until_ns))
        if self.now_ns() >= self.until_ns:
            super().write_some(self.kept)
            self.kept = b""
        return data


@pytest.mark.parametrize("first", range(20, 44, 4))
def test_a_board_that_is_held_up_for_longer_than_an_answer_may_take_recovers(first):
    access = virtual(array="3x2", wrap=lambda inner: Stalled(inner, first))
    access.virtual = False
    [result] = run(access, "HG-4.3/6").results
    assert (result.behaviour, str(result.recovery)) == (Behaviour.OK, "clean after 1 frame")


class Away(Wrapped):
    """Reads nothing for 250 ms behind each ARM, and then all that has come."""

    unread = b""

    def write_some(self, data):
        written = super().write_some(data)
        bodies = [body for body in FrameDecoder().feed(data) if isinstance(body, bytes)]
        if any(body[0] == Arm.TYPE for body in bodies):
            end_ns = self.now_ns() + 250_000_000
            while self.now_ns() < end_ns:
                self.unread += super().read_available(end_ns)
        return written

    def read_available(self, deadline_ns):
        data, self.unread = self.unread, b""
        return data or super().read_available(deadline_ns)


def test_a_timer_that_ends_before_the_host_looks_fails_no_board():
    access = virtual(array="3x2", wrap=Away)
    access.virtual = False
    [result] = run(access, "HG-6.4/4-origins").results
    assert result.behaviour is Behaviour.INCONCLUSIVE, result.detail
    assert "muted before the case looked" in result.detail


@pytest.mark.parametrize("times", [1, 99])
def test_frames_that_came_too_late_fail_no_board(times):
    """They are sent again, twice at most."""
    access = virtual(array="3x2", wrap=functools.partial(Halting, times=times, is_late=is_timed))
    access.virtual = False
    [result] = run(access, "HG-5.8/3-replaced").results
    assert result.behaviour is (Behaviour.OK if times == 1 else Behaviour.INCONCLUSIVE)
    assert times == 1 or "was held up: frames came too late, by" in result.detail


def test_a_read_back_that_comes_after_the_hold_judges_the_ramp_that_it_shows():
    access = virtual(array="3x2", wrap=lambda inner: Halting(inner, 99, is_read_back))
    [result] = run(access, "HG-6.11/4-latches").results
    assert result.behaviour is Behaviour.OK, result.detail


class Oversleeping(Wrapped):
    """Wakes up 100 ms late."""

    def read_available(self, deadline_ns):
        end_ns, data = deadline_ns + 100_000_000, b""
        while self.now_ns() < end_ns:
            data += super().read_available(end_ns)
        return data


def test_a_host_that_oversleeps_blames_no_status_that_came_in_its_time():
    access = virtual(array="3x2", wrap=Oversleeping)
    [result] = run(access, "HG-9.1/1-lengths").results
    assert result.behaviour is Behaviour.OK, result.detail


class SecondTimed:
    """True for the second stream frame with a time: it is 5 ms late where the board takes 100."""

    count = 0

    def __call__(self, body):
        self.count += is_timed(body)
        return is_timed(body) and self.count == 2


class PingBeforeConfiguration:
    """True for the PING that asks for the time, behind a drive and a GET_STATUS."""

    last = ()

    def __call__(self, body):
        self.last = (*self.last, body[0])[-4:]
        return self.last == (Phases.TYPE, Ping.TYPE, GetStatus.TYPE, Ping.TYPE)


@pytest.mark.parametrize(
    ("case", "is_late"),
    [("HG-9.1/3-latches", SecondTimed), ("HG-7.1/3-hold", PingBeforeConfiguration)],
)
def test_a_frame_that_came_after_the_end_of_its_window_or_timer_fails_no_board(case, is_late):
    access = virtual(array="3x2", wrap=lambda inner: Halting(inner, 1, is_late()))
    access.virtual = False
    [result] = run(access, case).results
    assert result.behaviour is Behaviour.OK, result.detail


@pytest.mark.parametrize("case", ["HG-6.11/4-latches", "HG-12.3/1-latches"])
def test_a_line_that_needs_long_for_a_drive_is_not_too_slow(case):
    """A drive of 256 transducers takes 48 ms at 57600 baud, a read-back of it 92."""
    access = virtual(baud=57_600)
    access.virtual = False
    [result] = run(access, case).results
    assert result.behaviour is Behaviour.OK, result.detail


def is_read_back(body):
    return body[0] == ReadDrive.TYPE


def is_timed(body):
    return body[0] == Phases.TYPE and not body[1]


@pytest.mark.parametrize("size", [2048, 4090, 4095, 4096])
@pytest.mark.parametrize("seed", range(12))
def test_a_frame_of_every_size_is_found(seed, size):
    wire = RawFrameClient(Wrapped(_Silent()), ClientWaitLimits.of(1, virtual=True), baudrate=9600)
    link = RequestClient(wire, random.Random(seed if seed else 2072706088))
    link.seq = 977 * seed
    encoded, _ = malformed_frames.malformed_mute_of_size(link, size)
    assert len(encoded) == size
    assert 0 not in encoded


def test_a_frame_whose_crc_ends_in_zero_is_still_cobs_without_its_last_byte():
    """Such a frame has a wrong CRC when it is cut, and is not what the case has to send."""
    [case] = select(all_cases(), ["HG-2.2/2"])
    with SuiteRunner(virtual(array="3x2"), SuiteOptions()) as runner:
        board = runner.session()
        bodies = (board.link.body(Ping.TYPE, bytes(8), seq=seq) for seq in range(9999))
        ends = [cobs_encode(malformed_frames.malformed_with_crc(body))[-1] for body in bodies]
        board.link.seq = ends.index(1, 100) - 1
        case.body(board)


def test_a_pause_takes_no_number_from_requests_made_before_it_and_forgets_no_reply():
    """More requests than the smallest window holds, then a drive and a request sent again."""
    with SuiteRunner(identity(rx_window=4098), SuiteOptions()) as runner:
        board = runner.session()
        before = board.status().counters
        numbered = [board.link.request_wire(Ping(echo)) for echo in range(400)]
        since = board.link.mark()
        board.link.send(*(wire for wire, _ in numbered))
        board.wire.idle(100_000)
        answers = board.link.responses(since)
        assert [answer.message.echo for answer in answers] == list(range(400))
        pauses = board.link.pauses
        assert pauses
        board.link.send(*(board.link.stream_wire(board.flat_phases()) for _ in range(300)))
        assert board.link.pauses > pauses
        again, seq = numbered[-1]
        since = board.link.mark()
        board.link.send(again)
        assert board.link.answer_to(Ping.TYPE, seq, since).body == answers[-1].body
        counted = board.counted_since(before)
        found = [counted[name] for name in ("requests", "repeated", "stale_session")]
        assert found == [400, 1, 0]


class _Silent:
    url = "silent://"

    def now_ns(self):
        return 0
