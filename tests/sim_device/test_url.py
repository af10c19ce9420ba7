"""``haptogram://``: the whole virtual board inside this process, on either clock."""

import base64
import itertools
import json
import zlib

import pytest
import serial
from hypothesis import given
from hypothesis import strategies as st

import sim_device
from haptogram.acoustics import Drive, SingleFocus, superpose_foci
from haptogram.errors import ConfigurationError
from haptogram_protocol.connection import RequestRefused
from haptogram_protocol.messages import (
    Config,
    DriveKind,
    ErrorCode,
    FocalPoint,
    GetGeometry,
    GetStatus,
    Ping,
    Play,
    PlaybackEnded,
    Points,
    ReadDrive,
    ReadTrace,
    SetConfig,
    Status,
    Trace,
    TraceDrive,
    TraceMode,
    TracePlayback,
    UploadBegin,
    UploadChunk,
    UploadCommit,
    UploadKind,
)
from haptogram_protocol.state import OutputState
from sim_device.simulation import HOST_BUFFER

VIRTUAL = "haptogram://?clock=virtual&array=4x4"
CODES = bytes(range(0, 160, 10))


def let_pass(host, seconds):
    """Let virtual time pass, and hear what comes meanwhile."""
    host.port.wait_until_ns(host.port.now_ns() + round(seconds * 1e9))
    while host.port.in_waiting:
        host.listen()


@pytest.mark.parametrize(
    ("url", "text"),
    [
        ("haptogram://?sed=1", "no parameter 'sed'; did you mean seed"),
        ("haptogram://?seed=x", "seed is 'x', must be a whole number"),
        ("haptogram://?seed=-1", "seed is -1, must be 0 to"),
        ("haptogram://?clock=fast", "clock is 'fast'; known are wall, virtual"),
        ("haptogram://?baud=0", "baud is 0, must be 300 to"),
        ("haptogram://?array=0x4", "array is '0x4', must be a grid of 1 to 1024"),
        ("haptogram://?array=none.csv", "none.csv"),
        ("haptogram://board?seed=1", r"must be haptogram://\?name=value"),
        ("haptogram://[", r"must be haptogram://\?name=value"),
        ("haptogram://\N{ACCOUNT OF}?seed=1", r"must be haptogram://\?name=value"),
        ("haptogram://?backdoor=/dev/null/x", "backdoor '/dev/null/x' cannot be written"),
    ],
)
def test_a_url_that_makes_no_sense_is_refused_in_one_line(open_host, url, text):
    with pytest.raises(ConfigurationError, match=text) as caught:
        open_host(url)
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith(f"{url}: ") or "backdoor '" in text


def test_a_blocking_read_advances_virtual_time_to_its_timeout_or_to_the_next_byte(open_host):
    host = open_host(VIRTUAL)
    port = host.port
    port.timeout = 1.5
    assert port.read(1) == b""
    assert port.now_ns() == 1_500_000_000
    host.link.send_hello(host.now_us())
    port.write(host.link.data_to_send())
    assert port.read(1) == b"\x00"
    assert port.now_ns() == 1_500_000_000  # a line without a baud rate takes no time


def test_a_read_that_could_never_end_is_refused(open_host):
    port = open_host(VIRTUAL).port
    port.timeout = None
    with pytest.raises(serial.SerialException, match="nothing will ever come"):
        port.read(1)


def test_a_closed_port_says_so(open_host):
    port = open_host(VIRTUAL).port
    port.close()
    with pytest.raises(serial.SerialException):
        port.read(1)
    with pytest.raises(serial.SerialException):
        port.write(b"x")


@pytest.mark.realtime
def test_a_board_is_powered_down_with_its_port(open_host):
    host = open_host(VIRTUAL + "&reconstruct=0")
    host.arm()
    host.port.close()
    board = host.port.simulation.dialect.board
    assert board.output.state is OutputState.MUTED
    assert [record["kind"] for record in host.port.records[-2:]] == ["output", "end"]


def test_a_board_that_is_interrupted_when_it_is_made_leaves_no_worker_behind(
    open_host, tmp_path, monkeypatch
):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("sim_device.protocol_haptogram.Simulation", interrupted)
    door = tmp_path / "door"
    with pytest.raises(KeyboardInterrupt):
        open_host(f"haptogram://?array=4x4&backdoor={door}&reconstruct=0")
    assert '"kind":"end"' in door.read_text().splitlines()[-1]  # it was told to end, and has


def test_on_the_wall_clock_the_board_answers_without_a_thread(open_host):
    host = open_host("haptogram://?array=4x4&seed=5")
    assert host.greet().message.transducers == 16
    assert host.ask(Ping(9)).message.echo == 9


def test_the_line_takes_ten_bits_a_byte(open_host):
    host = open_host(VIRTUAL + "&baud=100000")
    host.greet()
    began_ns = host.port.now_ns()
    host.link.send_request(Ping(1), host.now_us())
    ping = host.link.data_to_send()
    host.port.write(ping)
    pong = host.wait().message
    boot_us = host.port.simulation.dialect.board.settings.boot_us
    arrival_ns = began_ns + len(ping) * 100_000
    assert pong.t_rx_us == (boot_us - (-arrival_ns // 1000)) % 2**32
    assert pong.t_tx_us == pong.t_rx_us


def test_the_pong_tells_when_its_first_byte_leaves_behind_others(open_host):
    host = open_host(VIRTUAL + "&baud=100000")
    host.arm(trace_mode=TraceMode.OFF)
    host.link.send_request(GetGeometry(0, 16), host.now_us())
    host.port.write(host.link.data_to_send())
    asked = [host.wait()]
    first_ns = host.port.now_ns()
    asked.append(host.ask(Ping(1)))
    assert asked[1].message.t_tx_us >= asked[1].message.t_rx_us
    assert host.port.now_ns() > first_ns


def test_streamed_frames_are_latched_traced_and_reconstructed(open_host):
    host = open_host("haptogram://?clock=virtual&reconstruct=1&array=8x8")
    now_us = host.arm(trace_mode=TraceMode.CRC)
    model = host.port.simulation.dialect.board.settings.model
    targets = [(0.003, 0.011, 0.08), (-0.02, 0.004, 0.1), (0.001, -0.012, 0.06)]
    sent = []
    for k, target in enumerate(targets):
        drive = Drive.from_weights(superpose_foci(model, [target], [1.0], [0.0]))
        sent.append(
            (host.stream(drive.phase_codes.tobytes(), now_us + 5_000 + 1_000 * k)[0], drive)
        )
    let_pass(host, 0.1)
    traces = [e.message for e in host.events if isinstance(e.message, Trace)]
    assert [(t.index, t.crc) for t in traces] == [(index, d.digest()) for index, d in sent]
    host.port.close()
    records = host.port.records
    assert json.loads(json.dumps(records, allow_nan=False)) == records
    latches = [r for r in records if r["kind"] == "latch"]
    assert [r["index"] for r in latches] == [index for index, _ in sent]
    for record, (_, drive), target in zip(latches, sent, targets, strict=True):
        assert base64.b64decode(record["phase_codes"]) == drive.phase_codes.tobytes()
        found = record["reconstruction"]
        assert found["kind"] == "single_focus"
        assert set(found) == {"kind", *SingleFocus.__dataclass_fields__}
        limits = found["bound_m"]
        offsets = zip(found["position_m"], target, limits, strict=True)
        assert all(abs(is_m - was_m) <= limit_m for is_m, was_m, limit_m in offsets)
    assert records[0]["kind"] == "board"
    end = {"kind": "end", "latched": 3, "reconstructed": 3, "dropped": 0, "notices_dropped": 0}
    assert records[-1] == {**end, "clean": True}


def run_once(open_host, url):
    host = open_host(url)
    now_us = host.arm(trace_mode=TraceMode.DRIVE)
    for k in range(50):
        host.stream(bytes([k] * 16), now_us + 5_000 + 1_000 * k)
        let_pass(host, 0.0007)
    let_pass(host, 0.5)
    host.port.close()
    return json.dumps([host.port.records, [repr(e) for e in host.events]])


def test_the_same_inputs_give_the_same_run_byte_for_byte(open_host):
    url = VIRTUAL + "&reconstruct=0&baud=1000000&seed=4"
    assert run_once(open_host, url) == run_once(open_host, url)


def test_points_are_computed_by_the_board(open_host):
    host = open_host(VIRTUAL)
    host.arm()
    model = host.port.simulation.dialect.board.settings.model
    points = [FocalPoint(10_000, -3_000, 80_000, 65_535, 0), FocalPoint(0, 0, 60_000, 0, 99)]
    _, wire = host.link.stream_frame(Points(tuple(points)), t_apply_us=None)
    host.port.write(wire)
    let_pass(host, 0.001)
    reply = host.ask(ReadDrive(DriveKind.LATCHED, 0, 16)).message
    want = Drive.from_weights(superpose_foci(model, [(0.01, -0.003, 0.08)], [1.0], [0.0]))
    assert reply.data == want.phase_codes.tobytes() + want.amplitude_codes.tobytes()


def test_a_sequence_is_uploaded_and_played_on_the_boards_clock(open_host):
    host = open_host(VIRTUAL)
    host.arm(trace_mode=TraceMode.CRC)
    data = b"".join(bytes([k] * 16) for k in range(5))
    begin = UploadBegin(UploadKind.PHASES, 0, 9, len(data), zlib.crc32(data))
    assert host.ask(begin).message.max_chunk >= 16
    host.link.send_chunk(UploadChunk(0, data), host.now_us())
    assert host.wait().message.received == len(data)
    assert host.ask(UploadCommit(9)).message.frames == 5
    assert isinstance(host.ask(Play(8, 1000, 2, 1000), immediate=True), RequestRefused)
    host.ask(Play(9, 1000, 2, 1000), immediate=True)
    host.stream(CODES)  # is dropped: a sequence plays
    let_pass(host, 0.05)
    traces = [e for e in host.events if isinstance(e.message, TracePlayback)]
    assert [(t.message.key.loop, t.message.key.index) for t in traces] == [
        divmod(k, 5) for k in range(10)
    ]
    times_us = [t.header.time_us for t in traces]
    assert {b - a for a, b in itertools.pairwise(times_us)} == {1000}
    (ended,) = [e.message for e in host.events if isinstance(e.message, PlaybackEnded)]
    assert ended == PlaybackEnded(9, 2, 10)
    counters = host.ask(GetStatus()).message.counters
    assert (counters.latched, counters.dropped_state) == (10, 1)


def test_the_trace_ring_keeps_the_last_latches(open_host):
    host = open_host(VIRTUAL)
    now_us = host.arm(trace_mode=TraceMode.RING)
    for k in range(10):
        host.stream(bytes([k] * 16), now_us + 1_000 * (k + 5))
    let_pass(host, 0.03)
    reply = host.ask(ReadTrace(7, 100)).message
    assert (reply.oldest, reply.next) == (0, 10)
    assert [record.number for record in reply.records] == [7, 8, 9]


def test_the_trace_ring_shows_what_it_holds_across_latches_that_it_has_not_kept(open_host):
    host = open_host(VIRTUAL)
    now_us = host.arm(trace_mode=TraceMode.RING, host_timeout_ms=10_000)
    host.stream(bytes(16), now_us + 5_000)
    let_pass(host, 0.02)
    host.ask(SetConfig(Config(trace_mode=TraceMode.OFF, host_timeout_ms=10_000)))
    for _ in range(300):  # more than one reply has room for
        host.stream(bytes(16))
        let_pass(host, 0.001)
    host.ask(SetConfig(Config(trace_mode=TraceMode.RING, host_timeout_ms=10_000)))
    host.stream(bytes(16))
    let_pass(host, 0.02)
    reply = host.ask(ReadTrace(0, 0xFFFF)).message
    assert [record.number for record in reply.records] == [0, 301]


def test_trace_drive_reports_every_kth_latch_and_nothing_of_the_others(open_host):
    host = open_host(VIRTUAL)
    now_us = host.arm(trace_mode=TraceMode.DRIVE, trace_divider=3)
    first, _ = host.stream(bytes(16), now_us + 4_000)
    for k in range(6):
        host.stream(bytes([k] * 16), now_us + 1_000 * (k + 5))
    let_pass(host, 0.03)
    traced = [e.message.key.index for e in host.events if isinstance(e.message, TraceDrive)]
    assert traced == [first, first + 3, first + 6]


def test_an_unread_line_drops_trace_first_counts_it_and_delays_no_latch(open_host):
    host = open_host("haptogram://?clock=virtual&baud=500000&array=16x16")
    now_us = host.arm(trace_mode=TraceMode.DRIVE, status_period_ms=0, hold_ms=1000)
    port, simulation = host.port, host.port.simulation
    for k in range(400):
        host.stream(bytes(256), now_us + 50_000 + 10_000 * k)
        port.wait_until_ns(port.now_ns() + 10_000_000)
    assert simulation.host_waiting <= HOST_BUFFER + 4098
    counters = simulation.dialect.counters
    assert counters["latched"] > 390
    assert counters["trace_dropped"] > 100
    port.reset_input_buffer()
    reply = host.ask(GetStatus()).message
    assert reply.counters.trace_dropped > 100


def test_values_out_of_bounds_are_refused_with_their_offset(open_host):
    host = open_host(VIRTUAL)
    host.arm()
    for name, value in (("hold_ms", 0), ("late_window_us", 100_001), ("trace_divider", 0)):
        refused = host.ask(SetConfig(Config(**{name: value})))
        assert isinstance(refused, RequestRefused)
        assert refused.error.code == ErrorCode.BAD_VALUE
        assert refused.error.detail == Config.WIRE[name].offset
    assert host.ask(SetConfig(Config(ramp_ms=0))).message.config.ramp_ms == 0


def test_status_comes_by_itself_and_takes_at_most_a_tenth_of_the_line(open_host):
    host = open_host(VIRTUAL + "&baud=57600")
    host.arm(status_period_ms=300)
    refused = host.ask(SetConfig(Config(status_period_ms=100)))
    assert refused.error.detail == Config.WIRE["status_period_ms"].offset
    host.events.clear()
    let_pass(host, 3.05)
    statuses = [e.message for e in host.events if isinstance(e.message, Status)]
    assert len(statuses) == 10
    assert statuses[-1].state is OutputState.MUTED


@given(st.lists(st.binary(max_size=60), max_size=20))
def test_no_bytes_can_stop_the_board_or_make_it_radiate(chunks):
    sim_device.register_url_handler()
    with serial.serial_for_url(VIRTUAL, timeout=0.001) as port:
        for chunk in chunks:
            port.write(chunk)
            port.read(100)
        board = port.simulation.dialect.board
        assert board.output.state is OutputState.DISARMED
        assert board.output.radiated(board.output.now_us).is_muted
        assert board.output.counters.latched == 0
