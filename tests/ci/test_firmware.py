"""Firmware on emulated microcontrollers: the short form of ci/firmware, the pin that gates the
output, and the complaints of ci/firmware.  Not run without QEMU and the ARM compiler."""

import contextlib
import dataclasses
import itertools
import os
import re
import shutil
import signal
import struct
import subprocess
import sys
import time
from pathlib import Path

import pytest

from firmware_check import __main__ as command
from firmware_check import memory, pins, steps
from firmware_check.emulator import Emulator
from firmware_check.enable_pin import EnablePin
from firmware_check.hang import hang
from firmware_check.ports import EMULATE, FOLDER, PORTS, build, missing_tool
from haptogram.driver.line.port import open_transport
from haptogram.errors import ConfigurationError
from haptogram_protocol.framing import FrameDecoder, encode_frame
from haptogram_protocol.messages import (
    FIRST_STREAM_SEQ,
    VERSION_MAJOR,
    Arm,
    ArmReply,
    Config,
    FocalPoint,
    GetStatus,
    Hello,
    HelloReply,
    Mute,
    Phases,
    Ping,
    Points,
    Pong,
    SetConfig,
    SetConfigReply,
    StatusReply,
    Trace,
    TraceMode,
    build_body,
    parse_body,
)

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "firmware.md"
SESSION = 0xC41F
PATIENCE_S = 60
QUICK = {"CFLAGS": "-O1"}
TRACES = "-DPORT_TRACES_PINS=1"
RECORD = 8 + 2 * 256

pytestmark = [pytest.mark.realtime, pytest.mark.nightly]


@pytest.fixture(scope="module")
def tools():
    """QEMU and the ARM compiler; the test is skipped where one is missing."""
    if why := missing_tool():
        pytest.skip(f"not run: {why}")


@pytest.fixture(scope="module")
def firmware(request, tmp_path_factory):
    """The firmware of every port, built once: a function of the name and of what is defined."""
    request.getfixturevalue("tools")
    built = {}

    def of(name, defines=""):
        if (name, defines) not in built:
            folder = tmp_path_factory.mktemp(name)
            built[name, defines] = build(PORTS[name], folder, DEFINES=defines, **QUICK)
        return built[name, defines]

    return of


@contextlib.contextmanager
def running(name, elf, **options):
    with Emulator(PORTS[name].machine, elf, **options) as emulator:
        emulator.wait_for_board(PATIENCE_S)
        yield emulator


#: A few clauses of either port: line, reset, points, chunks; the whole suite takes minutes.
_ASKED = ("2.1/1", "2.1/2", "2.1/3-meanwhile", "4.3/5", "5.4/1-rounding", "7.3/1")
CLAUSES = [f"--clause=HG-{clause}" for clause in _ASKED]


@pytest.mark.parametrize("name", PORTS)
def test_the_firmware_passes_conform_in_the_emulated_chip(name, firmware, tmp_path):
    port, elf = PORTS[name], firmware(name)
    with running(name, elf) as emulator:
        step = steps.conform(port, emulator.url, emulator.reset_command, tmp_path, CLAUSES)
        used = memory.footprint(elf, emulator)
    # A machine that holds QEMU up leaves doubt (3), and never finds a fault (1).
    assert step.status in (0, 3), step.log.read_text("utf-8")
    assert "NOT-OBSERVED" not in step.summary, "a reset was not to be had"
    assert (tmp_path / "conform.xml").exists()
    assert 0 < used.stack_used < used.stack
    assert used.static + used.stack <= 128 * 1024
    assert used.static + used.stack == stated_memory(name)


def stated_memory(name):
    """The bytes that docs/firmware.md states, by make -C protocol/c sizes."""
    return int(re.search(rf"^{name} +\d+ +(\d+)$", PAGE.read_text("utf-8"), re.MULTILINE)[1])


@pytest.mark.skipif(not shutil.which("arm-none-eabi-gcc"), reason="no compiler for ARM")
def test_the_page_states_the_sizes_of_the_firmware(tmp_path):
    make = ["make", "-s", "-C", ROOT / "protocol" / "c", f"BUILD={tmp_path}", "sizes"]
    made = sizes_in(subprocess.run(make, check=True, capture_output=True, text=True).stdout)
    stated = sizes_in(PAGE.read_text("utf-8").split("<!-- sizes -->")[1].split("<!-- end -->")[0])
    assert len(made) == 9
    # Other releases of the compiler make some bytes more or less.
    assert stated == {name: pytest.approx(size, rel=0.03) for name, size in made.items()}


def sizes_in(text):
    """The bytes of flash by name, of a table of `make sizes`."""
    rows = re.findall(r"^(\S.*?) +(\d+) +[\d-]+$", text, re.MULTILINE)
    return {name: int(size) for name, size in rows}


def test_the_firmware_passes_verify_in_the_emulated_chip(firmware, tmp_path):
    with running("musca_b1", firmware("musca_b1")) as emulator:
        step = steps.verify(PORTS["musca_b1"], emulator.url, tmp_path, quick=True)
    assert step.status == 0, step.log.read_text("utf-8")
    assert (tmp_path / "verify.xml").exists()


@pytest.mark.usefixtures("tools")
def test_what_the_registers_hold_is_judged_as_a_capture_of_the_pins(tmp_path, monkeypatch):
    monkeypatch.setenv("MAKEFLAGS", "CFLAGS=-O1")
    step = steps.pins(PORTS["musca_b1"], tmp_path)
    assert step.summary == "PASS: 16 of 256 elements: every captured pin does what was intended"
    records, recording = tmp_path / "pins.records", tmp_path / "pins.mcap"
    told = bytearray(records.read_bytes())
    for phase in range(8 + 17, len(told), RECORD):
        told[phase] ^= 0x80
    records.write_bytes(told)
    step = steps.judge_pins(records, 256, recording, tmp_path)
    assert step.status == 1
    assert "element 17 (e17): inverted: half a period off in every frame" in step.log.read_text()


def test_firmware_that_tells_nothing_of_its_drives_is_named(tmp_path):
    with pytest.raises(ConfigurationError, match="no record of the drive registers; the firmware"):
        pins.write_capture(tmp_path / "none", 256, tmp_path / "pins.vcd")


def test_a_record_of_the_drives_comes_though_nothing_changes(firmware, tmp_path):
    records, elf = tmp_path / "records", firmware("musca_b1", f"{TRACES} -DPIN_TRACE_LONGEST_S=1")
    with running("musca_b1", elf, pins=records):
        end_s = time.monotonic() + PATIENCE_S
        while (size := records.stat().st_size) < 3 * RECORD and time.monotonic() < end_s:
            time.sleep(0.05)
    assert size >= 3 * RECORD


@pytest.mark.parametrize("after_s", [-6, 31, 53, 100])
def test_records_further_apart_than_their_clock_can_tell_are_named(after_s, tmp_path):
    records, capture = tmp_path / "records", tmp_path / "pins.vcd"
    seconds = (80, 79, 109, 109 + after_s)  # what was due a second before comes late
    ticks = [40_000_000 * second % 2**32 for second in seconds]
    told = [struct.pack("<IHH", at, 40, 0) + bytes(RECORD - 8) for at in ticks]
    records.write_bytes(b"".join(told[:3]))
    assert pins.write_capture(records, 256, capture)
    records.write_bytes(b"".join(told))
    with pytest.raises(
        ConfigurationError, match=r"record 3 comes -?\d+\.\d s after the one before"
    ):
        pins.write_capture(records, 256, capture)


class Board:
    """A session with firmware, and what it sent."""

    def __init__(self, url):
        self.transport = open_transport(url)
        self.decoder = FrameDecoder()

    def send(self, message, seq, *, session=SESSION, flags=0, time_us=0):
        time_us &= 0xFFFFFFFF
        body = build_body(message, flags=flags, seq=seq, time_us=time_us, session=session)
        self.transport.write_some(encode_frame(body))

    def wait_for(self, kind, patience_s=PATIENCE_S):
        """Return the next message of this kind, or None."""
        end_ns = self.transport.now_ns() + int(patience_s * 1e9)
        while self.transport.now_ns() < end_ns:
            for body in self.decoder.feed(self.transport.read_available(end_ns)):
                if isinstance(body, bytes) and body[0] == kind.TYPE:
                    return parse_body(body)[1]
        return None

    def hello(self, nonce=SESSION):
        self.send(Hello(VERSION_MAJOR, 0, nonce), 0, session=0)
        return self.wait_for(HelloReply)

    def arm_and_latch(self):
        self.hello()
        self.send(Arm(), 1)
        assert self.wait_for(ArmReply)
        self.send(Phases(bytes(256)), FIRST_STREAM_SEQ, flags=0x10)


@contextlib.contextmanager
def board_with_pin(name, elf, tmp_path):
    log = tmp_path / "log"
    with running(name, elf, log=log) as emulator:
        board = Board(emulator.url)
        try:
            yield board, EnablePin(PORTS[name], log)
        finally:
            board.transport.close()


@pytest.mark.parametrize("name", PORTS)
def test_the_pin_is_off_from_the_start_on_at_a_latch_and_off_at_mute(name, firmware, tmp_path):
    with board_with_pin(name, firmware(name), tmp_path) as (board, pin):
        assert not any(pin.levels())
        board.arm_and_latch()
        assert pin.wait_for(level=True, patience_s=PATIENCE_S)
        board.send(Mute(), 2)
        assert pin.wait_for(level=False, patience_s=PATIENCE_S)


def test_firmware_without_the_loop_that_it_is_to_hang_in_is_named(firmware, tmp_path, monkeypatch):
    monkeypatch.setattr("firmware_check.hang._ENDLESS", b"\xde\xad")
    with pytest.raises(
        ConfigurationError, match=r"fault_handler holds no branch to itself \(dead\)"
    ):
        hang(PORTS["musca_b1"], firmware("musca_b1"), tmp_path)
    with pytest.raises(ConfigurationError, match=r"musca_b1\.elf: has no symbol gone with a size"):
        memory.symbol(firmware("musca_b1"), "gone")


HANGS = "-DPORT_HANGS_AFTER_LATCH=1"


def test_mute_switches_off_in_the_interrupt_though_the_main_loop_hangs(firmware, tmp_path):
    """QEMU has no watchdog of the STM32, so that nothing else can have done it."""
    elf = firmware("netduinoplus2", HANGS)
    with board_with_pin("netduinoplus2", elf, tmp_path) as (board, pin):
        board.arm_and_latch()
        assert pin.wait_for(level=True, patience_s=PATIENCE_S)
        board.send(Hello(VERSION_MAJOR, 0, SESSION + 1), 5, session=0)
        assert board.wait_for(HelloReply, patience_s=0.5) is None  # the main loop hangs
        assert pin.levels()[-1]
        board.send(Mute(), 2, session=0)
        assert pin.wait_for(level=False, patience_s=PATIENCE_S)


def test_a_main_loop_that_hangs_is_reset_with_the_output_off(firmware, tmp_path):
    """QEMU has no watchdog of the STM32: there the same check has to fail."""
    steps_of = {}
    for name in PORTS:
        port = dataclasses.replace(PORTS[name], has_watchdog=True)
        patience_s = 3 if name == "netduinoplus2" else PATIENCE_S
        steps_of[name] = hang(port, firmware(name), tmp_path, patience_s)
    musca, stm32 = (steps_of[name] for name in ("musca_b1", "netduinoplus2"))
    assert musca.status == 0, musca.summary
    assert stm32.status == 1
    assert stm32.summary == "FAILED: a main loop that hangs leaves the output on for 3 s"


# --- Time inside the chip ----------------------------------------------------------------------

#: 125 million instructions a second: fewer than the chip carries out at 168 MHz.
INSTRUCTION_NS = 8
MEASURES = "-DCHIP_MEASURES_LATCH=1 -DPORT_SPINS=1"
SAMPLES, TRIES = 2, 40


class TimedBoard(Board):
    """An ARMED board that tells when its latches took effect."""

    def __init__(self, url):
        super().__init__(url)
        self.seq, self.stream_seq = 0, FIRST_STREAM_SEQ
        self.identity = self.hello()
        times = {"hold_ms": 10_000, "host_timeout_ms": 10_000, "late_window_us": 100_000}
        config = Config(trace_mode=TraceMode.CRC, status_period_ms=0, **times)
        self.ask(SetConfig(config), SetConfigReply)
        self.ask(Arm(), ArmReply)

    def ask(self, message, kind):
        self.seq += 1
        self.send(message, self.seq)
        return self.wait_for(kind)

    def lateness_us(self, frame):
        """Send a frame that is late, and return by how much its latch comes after it is due.

        STATUS tells when it was ready, which is when a late frame is due.  None: the machine held
        the emulator up, and the frame was too late to be latched.
        """
        self.ask(GetStatus(), StatusReply)  # its margins start anew
        now_us = self.ask(Ping(1), Pong).t_rx_us
        self.send(frame, self.stream_seq & 0xFFFF, time_us=now_us)
        self.stream_seq += 1
        if self.wait_for(Trace, patience_s=2) is None:
            self.ask(Arm(), ArmReply)
            return None
        status = self.ask(GetStatus(), StatusReply)
        ready_us = unwrapped(now_us - status.margin_min_us)
        return unwrapped(status.last_latch_us) + -ready_us // 25 * 25


def unwrapped(t_us):
    """The device time since a reset of not more than an hour ago."""
    t_us %= 2**32
    return t_us if t_us >= 2**32 - 10_000_000 else t_us + 2**32


def frames():
    yield Phases(bytes(range(256)))
    for count in (1, 2, 4, 8):
        yield Points(tuple(FocalPoint(1000 * n, 500, 150_000 + n, 9999, n) for n in range(count)))


def latenesses_us(elf):
    """The lateness of latches of codes and of 1 to 8 points, by the clock of the chip."""
    with Emulator("netduinoplus2", elf, instruction_ns=INSTRUCTION_NS) as emulator:
        emulator.wait_for_board(PATIENCE_S)
        board = TimedBoard(emulator.url)
        found = []
        for frame in frames():
            tried = (board.lateness_us(frame) for _ in range(TRIES))
            known = (late_us for late_us in tried if late_us is not None)
            found.append(list(itertools.islice(known, SAMPLES)))
        board.transport.close()
    return found, board.identity


def test_every_drive_is_latched_on_time_with_the_lead_that_the_stm32_advertises(firmware):
    found, identity = latenesses_us(firmware("netduinoplus2", MEASURES))
    assert identity.latch_lead_us > 0
    assert found == [[0] * SAMPLES] * len(list(frames()))


def test_a_lead_of_nothing_is_too_short_and_shows_how_long_the_chip_takes(firmware):
    none = "-DBOARD_LATCH_LEAD_US=0 -DBOARD_POINT_TIME_US=0"
    found, _ = latenesses_us(firmware("netduinoplus2", f"{MEASURES} {none}"))
    least_us = [min(late_us) for late_us in found]
    assert 25 <= least_us[0] < least_us[1] < least_us[2] < least_us[3] < least_us[4]
    page = PAGE.read_text("utf-8")
    for count, late_us in zip(("codes", 1, 2, 4, 8), least_us, strict=True):
        stated = re.search(rf"^\| {count}\b.*\| (\d+) 000 \|", page, re.MULTILINE)
        assert late_us / INSTRUCTION_NS == pytest.approx(int(stated[1]), rel=0.25), count


def test_a_drive_that_waits_is_in_the_second_registers_before_it_is_due(firmware):
    elf = firmware("musca_b1")
    with running("musca_b1", elf) as emulator:
        board = TimedBoard(emulator.url)
        codes = bytes(range(256))
        due_us = board.ask(Ping(1), Pong).t_rx_us + 5_000_000
        board.send(Phases(codes), FIRST_STREAM_SEQ, time_us=due_us)
        status = board.ask(GetStatus(), StatusReply)
        assert (status.queued, status.counters.latched) == (1, 0)
        address, size = memory.symbol(elf, "registers")
        assert codes in emulator.memory(address, size)
        board.transport.close()


def test_the_timer_takes_the_next_drive_on_time_though_the_main_loop_hangs(firmware):
    """It is loaded in the turn that hangs, for a time further ahead than SysTick reaches."""
    elf = firmware("netduinoplus2", HANGS)
    with running("netduinoplus2", elf) as emulator:
        board = TimedBoard(emulator.url)
        t_us = board.ask(Ping(1), Pong).t_rx_us + 1_000_000
        for number, code in enumerate((1, 2)):
            frame = Phases(bytes([code]) * 256)
            board.send(frame, FIRST_STREAM_SEQ + number, time_us=t_us + 400_000 * number)
        end_s = time.monotonic() + PATIENCE_S
        while (driven := driving(elf, emulator)) != 2 and time.monotonic() < end_s:
            time.sleep(0.05)
        board.transport.close()
    assert driven == 2


def driving(elf, emulator):
    """The phase code of the set of registers that drives."""
    (address, size), (active, _) = (memory.symbol(elf, name) for name in ("registers", "active"))
    registers = emulator.memory(address, size)
    return registers[emulator.memory(active, 1)[0] * (size // 2)]


def test_a_board_that_is_deaf_while_it_starts_passes_what_is_asked_after_a_reset(
    firmware, tmp_path
):
    port, elf = PORTS["musca_b1"], firmware("musca_b1", "-DPORT_DEAF_MS=300")
    clauses = [f"--clause=HG-{clause}" for clause in ("4.7/1", "6.1/1", "9.2/1")]
    with running("musca_b1", elf) as emulator:
        step = steps.conform(port, emulator.url, emulator.reset_command, tmp_path, clauses)
    assert step.status == 0, step.log.read_text("utf-8")


def test_firmware_that_keeps_its_configuration_passes_what_is_asked_of_it(firmware, tmp_path):
    port, elf = PORTS["musca_b1"], firmware("musca_b1", "-DPORT_KEEPS_CONFIG=1")
    clauses = [f"--clause=HG-{clause}" for clause in ("7.1/3-fields", "7.1/4", "7.4/5")]
    with running("musca_b1", elf) as emulator:
        step = steps.conform(port, emulator.url, emulator.reset_command, tmp_path, clauses)
    assert step.status in (0, 3), step.log.read_text("utf-8")
    assert "UNIMPLEMENTED" not in step.summary
    assert "NOT-OBSERVED" not in step.summary


@pytest.mark.parametrize("name", PORTS)
def test_a_reset_by_the_monitor_starts_another_life(name, firmware):
    with running(name, firmware(name)) as emulator:
        first = emulator.wait_for_board(PATIENCE_S)
        assert emulator.wait_for_board(PATIENCE_S).boot_id == first.boot_id
        emulator.reset()
        assert emulator.wait_for_board(PATIENCE_S).boot_id != first.boot_id


@pytest.mark.usefixtures("tools")
def test_the_board_compiles_without_a_warning_for_three_cores():
    done = subprocess.run(
        ["make", "-s", "-C", FOLDER, "warnings"], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


@pytest.mark.usefixtures("tools")
def test_the_firmware_of_the_real_chip_builds_and_takes_what_the_page_states(tmp_path):
    make = ["make", "-s", "-C", FOLDER, f"BUILD={tmp_path}", "CFLAGS=-O1", "stm32f405"]
    done = subprocess.run(make, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    size = ["arm-none-eabi-size", tmp_path / "stm32f405.elf"]
    row = subprocess.run(size, capture_output=True, text=True, check=True).stdout.splitlines()[1]
    _, data, bss = map(int, row.split()[:3])
    assert data + bss == stated_memory("stm32f405") <= 128 * 1024


def test_firmware_has_no_heap(firmware):
    listed = subprocess.run(
        ["arm-none-eabi-nm", firmware("musca_b1")], capture_output=True, text=True, check=True
    )
    names = {line.split()[-1] for line in listed.stdout.splitlines()}
    assert "board_receive" in names
    assert not {name for name in names if re.search(r"malloc|calloc|realloc|sbrk", name)}


# Two cases instead of all of them.
SHORT = {"haptogram conform": " --clause HG-2.3 --clause HG-4.3/5 --timeout 20"}


@pytest.mark.usefixtures("tools")
def test_the_commands_of_the_page_run(tmp_path, monkeypatch):
    shutil.copytree(
        ROOT / "protocol" / "c", tmp_path / "protocol" / "c", ignore=shutil.ignore_patterns("build")
    )
    blocks = re.findall(r"<!-- run -->\n```sh\n(.*?)```", PAGE.read_text("utf-8"), re.DOTALL)
    assert len(blocks) == 2
    monkeypatch.setenv("PATH", f"{Path(sys.executable).parent}:{os.environ['PATH']}")
    monkeypatch.setenv("MAKEFLAGS", "CFLAGS=-O1")
    for block in blocks:
        said = shell(shortened(block), tmp_path)
        assert said.count("cases        2 cases: 2 OK\n") == said.count("haptogram-c99") == 1
    assert "PASS: every focus is on target" in said


def shortened(block):
    """The commands of a block, each on one line, with less to do."""
    lines = block.replace("\\\n", " ").splitlines()
    return "\n".join(
        line + next((more for start, more in SHORT.items() if line.startswith(start)), "")
        for line in lines
    )


def shell(script, folder):
    """Run the commands as a CI service does; return what they printed.  Nothing is left running."""
    with (folder / "said").open("w+", encoding="utf-8") as said:
        run = subprocess.Popen(
            ["bash", "-eo", "pipefail", "-c", script],
            cwd=folder,
            stdin=subprocess.DEVNULL,
            stdout=said,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
        try:
            status = run.wait(5 * PATIENCE_S)
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(run.pid, signal.SIGKILL)
        said.seek(0)
        text = said.read()
    assert status == 0, f"{script}\n{text}"
    return text


# --- Complaints --------------------------------------------------------------------------------


@pytest.mark.usefixtures("tools")
def test_firmware_that_hangs_at_its_start_is_named(tmp_path):
    source, elf = tmp_path / "endless.S", tmp_path / "endless.elf"
    source.write_text(".thumb\n.word 0x20001000, 0x08000009\nb .\n")
    options = ["-nostdlib", "-mcpu=cortex-m4", "-Wl,-Ttext=0x08000000,-e0x08000009"]
    subprocess.run(["arm-none-eabi-gcc", *options, source, "-o", elf], check=True)
    with (
        Emulator("netduinoplus2", elf) as emulator,
        pytest.raises(ConfigurationError, match="did not answer HELLO within 1 s: it hangs"),
    ):
        emulator.wait_for_board(1.0)


def test_a_machine_that_qemu_does_not_have_is_named(firmware):
    with (
        pytest.raises(ConfigurationError, match=r"QEMU did not start.*unsupported machine type"),
        Emulator("pdp11", firmware("musca_b1")) as emulator,
    ):
        emulator.wait_for_board(5.0)


def emulated(*words):
    done = subprocess.run(
        [EMULATE, *words], capture_output=True, text=True, check=False, timeout=PATIENCE_S
    )
    return done.returncode, done.stdout, done.stderr


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["musca-b1", "gone.elf"], "gone.elf: there is no such firmware"),
        (["musca-b1"], "takes MACHINE and FIRMWARE, not musca-b1"),
        (["--reset", "gone"], "gone: no QEMU answers"),
    ],
)
@pytest.mark.usefixtures("tools")
def test_a_wrong_argument_of_emulate_is_named(words, complaint):
    status, said, complained = emulated(*words)
    assert (status, said) == (2, "")
    assert complained.startswith(f"emulate: {complaint}")
    assert len(complained.splitlines()) == 1


def processes_with(text):
    """Command lines of this machine that name *text*."""
    found = []
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        with contextlib.suppress(OSError):
            line = path.read_bytes().replace(b"\0", b" ").decode(errors="replace")
            found += [line] if text in line and f"/{os.getpid()}/" not in str(path) else []
    return found


@pytest.mark.skipif(sys.platform != "linux", reason="not run: /proc and prctl are Linux")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_nothing_is_left_of_a_run_that_is_ended(number, firmware, tmp_path):
    out = tmp_path / "out"
    folder = out / "musca_b1"
    folder.mkdir(parents=True)
    elf = firmware("musca_b1")
    (folder / elf.name).write_bytes(elf.read_bytes())
    os.utime(folder / elf.name)
    run = subprocess.Popen(
        [sys.executable, "-m", "firmware_check", "--port", "musca_b1", "--out", out],
        env=os.environ | {"PYTHONPATH": f"{ROOT / 'ci'}", "CFLAGS": "-O1"},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert run.stdout.readline() == "musca_b1: 256 transducers, QEMU musca-b1\n"
    run.send_signal(number)
    _, complaint = run.communicate(timeout=PATIENCE_S)
    if number != signal.SIGKILL:
        assert (run.returncode, complaint) == (130, "ci/firmware: interrupted\n")
    end_s = time.monotonic() + PATIENCE_S
    while processes_with(str(out)) and time.monotonic() < end_s:
        time.sleep(0.05)
    assert processes_with(str(out)) == []


@pytest.mark.usefixtures("tools")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_the_compiler_ends_with_a_build_that_is_ended(number, tmp_path):
    out = tmp_path / "out"
    run = subprocess.Popen(
        [sys.executable, "-m", "firmware_check", "--port", "musca_b1", "--out", out],
        env=os.environ | {"PYTHONPATH": f"{ROOT / 'ci'}", "TMPDIR": str(tmp_path)},
        stderr=subprocess.PIPE,
        text=True,
    )
    end_s = time.monotonic() + PATIENCE_S
    while not any("cc1" in line for line in processes_with(str(out))) and run.poll() is None:
        assert time.monotonic() < end_s
        time.sleep(0.01)
    run.send_signal(number)
    _, complaint = run.communicate(timeout=PATIENCE_S)
    assert (run.returncode, complaint) == (130, "ci/firmware: interrupted\n")
    while processes_with(str(out)) and time.monotonic() < end_s:
        time.sleep(0.05)
    assert processes_with(str(out)) == []
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_a_missing_tool_is_named_with_the_packages(monkeypatch, capsys):
    monkeypatch.setenv("PATH", "/nowhere")
    assert command.main(["--quick"]) == 2
    _, complaint = capsys.readouterr()
    assert complaint.startswith("ci/firmware: qemu-system-arm is not installed; Debian, Ubuntu: ")
    assert "gcc-arm-none-eabi" in complaint
    assert len(complaint.splitlines()) == 1


def test_a_port_that_cannot_be_judged_does_not_stop_the_next_one(tmp_path, monkeypatch, capsys):
    tools = {"qemu-system-arm": "", "arm-none-eabi-gcc": "echo /nano.specs", "make": "exit 2"}
    for name, text in tools.items():
        (tmp_path / name).write_text(f"#!/bin/sh\n{text}\n")
        (tmp_path / name).chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path))
    assert command.main(["--out", str(tmp_path / "out")]) == 2
    _, complaint = capsys.readouterr()
    starts = [f"ci/firmware: {name}: the firmware {name} does not compile: see " for name in PORTS]
    assert [line.partition(str(tmp_path))[0] for line in complaint.splitlines()] == starts
    assert command.main(["--port", "musca_b1", "--out", str(tmp_path / "make")]) == 2
    _, complaint = capsys.readouterr()
    unwritten = (
        f"--out '{tmp_path}/make/musca_b1' cannot be written: a folder of its path is a file"
    )
    assert complaint == f"ci/firmware: musca_b1: {unwritten}\n"


@pytest.mark.parametrize(
    ("apt_get", "complaint"),
    [
        (None, "--install needs {first}, of Debian or Ubuntu: install qemu-system-arm gcc-arm"),
        ("echo $* >> said; echo E: no network; exit 100", "apt-get update failed: E: no network"),
        ("echo $* >> said", "qemu-system-arm is not installed; Debian, Ubuntu: apt-get install"),
    ],
)
def test_what_cannot_be_installed_is_named(apt_get, complaint, tmp_path, monkeypatch, capsys):
    first = "apt-get" if os.geteuid() == 0 else "sudo"
    if apt_get is not None:
        for name, text in (("apt-get", apt_get), ("sudo", 'exec "$@"')):
            (tmp_path / name).write_text(f"#!/bin/sh\n{text}\n")
            (tmp_path / name).chmod(0o755)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PATH", str(tmp_path))
    assert command.main(["--install"]) == 2
    _, complained = capsys.readouterr()
    assert complaint.format(first=first) in complained
    assert len(complained.splitlines()) == 1
    if apt_get is not None and "exit" not in apt_get:
        packages = "qemu-system-arm gcc-arm-none-eabi libnewlib-arm-none-eabi make"
        installed = f"install --yes --no-install-recommends {packages}"
        assert (tmp_path / "said").read_text() == f"update\n{installed}\n"


def test_the_worst_of_several_ends_is_the_status():
    assert command.worst_status([0, 3, 0]) == 3
    assert command.worst_status([3, 2]) == 2
    assert command.worst_status([2, 1, 130]) == 1
    assert command.worst_status([0, 0]) == 0
    assert command.worst_status([3, -9]) == 2
