"""The C board with transducers: what its machine radiates, and the time that it measured."""

import contextlib
import itertools
import zlib

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from haptogram_protocol.framing import FrameDecoder, encode_frame
from haptogram_protocol.messages import (
    FIRST_STREAM_SEQ,
    VERSION_MAJOR,
    Arm,
    Config,
    Disarm,
    DriveKind,
    ErrorCode,
    GetConfig,
    Hello,
    Mute,
    Phases,
    Play,
    ReadDrive,
    ReadTrace,
    SetConfig,
    SetConfigReply,
    StateChanged,
    Trace,
    TraceMode,
    TracePlayback,
    UploadBegin,
    UploadBeginReply,
    UploadChunk,
    UploadCommit,
    UploadKind,
    build_body,
    parse_body,
)
from vector_recorder.boards import CBoard

SESSION, COUNT, LATE_US = 0x0C97, 4, 7
BOOT_US = 2**32 - 10_000_000
T_US = 1004  # a multiple of 25 µs of the device clock


class Host:
    """A session with a board in virtual time."""

    def __init__(self, board):
        self.board, self.seq, self.index = board, 0, FIRST_STREAM_SEQ - 1
        self.ask(0, Hello(VERSION_MAJOR, 0, SESSION, 0), session=0)

    def ask(self, now_us, message, *, session=SESSION, flags=0, at_us=0):
        self.seq += 1
        return self.sent(now_us, message, self.seq, session, flags, at_us)

    def stream(self, now_us, message, at_us=None):
        """Send a stream frame for a device time; None: at once."""
        self.index += 1
        flags = 0x10 if at_us is None else 0
        return self.sent(now_us, message, self.index & 0xFFFF, SESSION, flags, at_us or 0)

    def sent(self, now_us, message, seq, session, flags, at_us):
        body = build_body(message, flags=flags, seq=seq, time_us=at_us, session=session)
        return self.received(self.board(now_us, encode_frame(body)))

    def until(self, at_us):
        return self.received(self.board(at_us))

    def received(self, sent):
        return [parse_body(body) for body in FrameDecoder().feed(sent)]


@pytest.fixture
def host(programs):
    with contextlib.closing(CBoard(programs, late_us=LATE_US)) as board:
        yield Host(board)


def phases(code):
    return Phases(bytes([code]) * COUNT)


def steps(radiated):
    """Time and amplitude of what was radiated; 0: off."""
    found = [item.split(":") for item in radiated]
    return [(int(f[0]), 0 if f[1] == "off" else int(f[2])) for f in found]


@pytest.mark.nightly
def test_every_report_of_a_latch_has_the_measured_time(host):
    config = {"status_period_ms": 0, "hold_ms": 10_000}
    for number, mode in enumerate((TraceMode.CRC, TraceMode.RING)):
        at_us = T_US + 1000 * number
        host.ask(at_us, SetConfig(Config(trace_mode=mode, **config)))
        host.ask(at_us, Arm())
        events = host.stream(at_us, phases(9))
        assert host.board.radiated == [f"{at_us}:9:255"]
        measured = BOOT_US + at_us + LATE_US
        if mode is TraceMode.CRC:
            ((header, trace),) = events
            assert isinstance(trace, Trace)
            assert header.time_us == measured
        ((_, drive),) = host.ask(at_us + 500, ReadDrive(DriveKind.LATCHED, 0, COUNT))
        assert drive.t_latch_us == measured
    ((_, reply),) = host.ask(2600, ReadTrace(0, 10))
    assert [record.t_latch_us for record in reply.records] == [measured]


@pytest.mark.parametrize("message", [Mute(), Disarm(), Hello(VERSION_MAJOR, 0, SESSION + 1, 0)])
def test_the_machine_is_switched_off_at_once(host, message):
    host.ask(T_US, Arm())
    host.stream(T_US, phases(1))
    session = 0 if isinstance(message, Hello) else SESSION
    host.ask(1777, message, session=session)
    assert host.board.radiated == ["1777:off"]


def test_the_machine_follows_a_ramp_in_steps_of_a_millisecond_down_to_off(host):
    hold_us, ramp_us = 20_000, 50_000
    host.ask(T_US, SetConfig(Config(hold_ms=20, ramp_ms=50, status_period_ms=0)))
    host.ask(T_US, Arm())
    host.stream(T_US, phases(1))
    begins_us = T_US + LATE_US + hold_us
    host.until(begins_us - 1)
    assert host.board.radiated == []
    ((_, changed),) = host.until(begins_us + ramp_us)
    assert isinstance(changed, StateChanged)
    ramp = steps(host.board.radiated)
    assert (ramp[0], ramp[-1]) == ((begins_us, 255), (begins_us + ramp_us, 0))
    for (before_us, before), (after_us, after) in itertools.pairwise(ramp):
        assert 0 < after_us - before_us <= 1000
        assert after < before


def test_a_latch_in_a_ramp_is_radiated_at_full_amplitude(host):
    host.ask(T_US, SetConfig(Config(hold_ms=20, ramp_ms=50, status_period_ms=0)))
    host.ask(T_US, Arm())
    host.stream(T_US, phases(1))
    host.until(40_004)
    assert steps(host.board.radiated)[-1][1] < 200
    host.stream(40_004, phases(2))
    assert host.board.radiated[-1] == "40004:2:255"
    host.until(55_000)
    assert host.board.radiated == []


def test_a_frame_in_the_ramp_of_the_lease_brings_full_amplitude_back(host):
    config = Config(hold_ms=10_000, ramp_ms=50, host_timeout_ms=20, status_period_ms=0)
    host.ask(T_US, SetConfig(config))
    host.ask(T_US, Arm())
    host.stream(T_US, phases(3))
    host.until(40_004)
    assert steps(host.board.radiated)[-1][1] < 200
    host.ask(40_500, Arm())
    assert steps(host.board.radiated)[-1] == (40_500, 255)


def test_a_new_ceiling_and_a_new_correction_are_radiated_at_once(host):
    config = {"status_period_ms": 0, "hold_ms": 10_000, "host_timeout_ms": 10_000}
    host.ask(T_US, SetConfig(Config(**config)))
    host.ask(T_US, Arm())
    host.stream(T_US, phases(1))
    host.ask(5600, SetConfig(Config(amplitude_ceiling=100, **config)))
    assert host.board.radiated == ["5600:1:100"]
    codes = bytes([9] * COUNT)
    host.ask(5700, UploadBegin(UploadKind.CORRECTION, 0, 0, COUNT, zlib.crc32(codes)))
    host.ask(5700, UploadChunk(0, codes))
    assert host.board.radiated == []
    host.ask(5700, UploadCommit(0))
    assert host.board.radiated == ["5700:10:100"]
    host.until(9000)
    assert host.board.radiated == []


def test_a_ceiling_that_is_set_in_a_ramp_cuts_it_and_leaves_its_line(host):
    begins_us = T_US + LATE_US + 20_000

    def configure(at_us, ceiling):
        config = Config(hold_ms=20, ramp_ms=50, status_period_ms=0, amplitude_ceiling=ceiling)
        host.ask(at_us, SetConfig(config))

    configure(T_US, 200)
    host.ask(T_US, Arm())
    host.stream(T_US, phases(1))
    for after_us, ceiling, due in ((10_000, 255, 160), (20_000, 60, 60), (21_000, 255, 116)):
        host.until(begins_us + after_us - 1)
        configure(begins_us + after_us, ceiling)
        assert steps(host.board.radiated)[-1] == (begins_us + after_us, due)
    host.until(begins_us + 40_000)
    assert steps(host.board.radiated)[-1] == (begins_us + 40_000, 40)
    host.until(begins_us + 50_000)
    assert steps(host.board.radiated)[-1] == (begins_us + 50_000, 0)


@pytest.mark.parametrize(("baud", "least_ms"), [(3_000_000, 10), (115_200, 128), (9600, 1532)])
def test_status_takes_no_more_than_a_tenth_of_the_line(programs, baud, least_ms):
    with contextlib.closing(CBoard(programs, late_us=0, bytes_per_s=baud // 10)) as board:
        host = Host(board)
        ((_, config),) = host.ask(T_US, GetConfig())
        assert config.config.status_period_ms == max(100, least_ms)
        for period_ms, is_taken in ((least_ms, True), (least_ms - 1, False), (0, True)):
            ((_, reply),) = host.ask(T_US, SetConfig(Config(status_period_ms=period_ms)))
            assert isinstance(reply, SetConfigReply) is is_taken
            assert is_taken or (reply.code, reply.detail) == (ErrorCode.BAD_VALUE, 6)


# --- Loaded ahead -------------------------------------------------------------------------------


def due(at_us):
    return (BOOT_US + at_us) & 0xFFFFFFFF


def test_a_drive_that_waits_is_loaded_ahead_with_the_settings_of_its_latch(host):
    config = {"status_period_ms": 0, "hold_ms": 10_000, "host_timeout_ms": 10_000}
    host.ask(T_US, SetConfig(Config(**config)))
    host.ask(T_US, Arm())
    host.stream(T_US, phases(1), due(5004))
    host.stream(T_US, phases(2), due(6004))
    host.until(5500)
    assert host.board.radiated == ["5004:1:255:ahead"]
    host.ask(5600, SetConfig(Config(amplitude_ceiling=100, **config)))
    host.until(7000)
    assert host.board.radiated == ["6004:2:100:ahead"]


def test_every_frame_of_a_playback_is_loaded_ahead(host):
    data = bytes(code for code in (10, 20, 30) for _ in range(COUNT))
    host.ask(T_US, UploadBegin(UploadKind.PHASES, 0, 3, len(data), zlib.crc32(data)))
    host.ask(T_US, UploadChunk(0, data))
    host.ask(T_US, UploadCommit(3))
    host.ask(T_US, Arm())
    host.ask(T_US, Play(3, 1000, 2, 1000), at_us=due(2004))
    host.until(10_004)
    codes = [10, 20, 30] * 2
    assert host.board.radiated[:6] == [
        f"{2004 + 1000 * n}:{code}:255:ahead" for n, code in enumerate(codes)
    ]


@pytest.mark.parametrize("message", [Mute(), Disarm(), Hello(VERSION_MAJOR, 0, SESSION + 1, 0)])
def test_what_was_loaded_is_not_radiated_after_the_end(host, message):
    host.ask(T_US, Arm())
    host.stream(T_US, phases(1), due(5004))
    host.ask(1777, message, session=0 if isinstance(message, Hello) else SESSION)
    host.until(9000)
    assert host.board.radiated == []


def test_nothing_is_loaded_ahead_for_a_time_in_the_ramp_of_the_lease(host):
    config = Config(hold_ms=10_000, ramp_ms=50, host_timeout_ms=20, status_period_ms=0)
    host.ask(T_US, SetConfig(config))
    host.ask(T_US, Arm())
    host.stream(T_US, phases(1), due(31_004))
    host.until(32_004)
    (time, amplitude), *_ = steps(host.board.radiated)
    assert time == 31_004
    assert 0 < amplitude < 255
    assert "ahead" not in host.board.radiated[0]


def test_nothing_is_loaded_ahead_for_a_time_after_the_end_of_the_hold(host):
    """The timer would take it though a main loop that is late has yet to end the output."""
    config = Config(hold_ms=20, ramp_ms=5, host_timeout_ms=10_000, status_period_ms=0)
    host.ask(T_US, SetConfig(config))
    host.ask(T_US, Arm())
    host.stream(T_US, phases(1))
    host.stream(T_US, phases(2), due(60_004))
    host.until(70_000)
    assert host.board.radiated[-1] == f"{T_US + LATE_US + 25_000}:off"


# --- Uploads ------------------------------------------------------------------------------------


def test_a_chunk_behind_a_gap_is_refused_and_changes_nothing(host):
    size = COUNT * 50
    for gap in (0, 7, 8, 9, 100, size - 1):
        host.ask(T_US, UploadBegin(UploadKind.PHASES, 0, 3, size, 0))
        ((_, reply),) = host.ask(T_US, UploadChunk(0, bytes(gap)))
        assert reply.received == gap
        for message in (UploadChunk(gap + 1, bytes(size - gap - 1)), UploadCommit(3)):
            ((_, error),) = host.ask(T_US, message)
            assert (error.code, error.detail) == (ErrorCode.INCOMPLETE, gap)


uploads = st.lists(st.tuples(st.integers(1, 4), st.integers(1, 12)), min_size=1, max_size=12)


@settings(deadline=None, suppress_health_check=list(HealthCheck))
@given(uploads=uploads, store_bytes=st.integers(40, 200))
def test_sequences_stay_whole_while_others_come_and_go(programs, uploads, store_bytes):
    """A store takes what its size allows, and no more; every sequence plays as it came."""
    with contextlib.closing(CBoard(programs, late_us=0, store_bytes=store_bytes)) as board:
        host, stored = Host(board), {}
        for number, (target, frames) in enumerate(uploads):
            data = bytes((number * 37 + n) % 256 for n in range(frames * COUNT))
            begin = UploadBegin(UploadKind.PHASES, 0, target, len(data), zlib.crc32(data))
            ((_, reply),) = host.ask(T_US, begin)
            taken = sum(map(len, stored.values()))
            if isinstance(reply, UploadBeginReply):
                assert taken + len(data) <= store_bytes
                host.ask(T_US, UploadChunk(0, data))
                ((_, done),) = host.ask(T_US, UploadCommit(target))
                assert done.frames == frames
                stored[target] = data
            else:
                assert reply.code == ErrorCode.TOO_LARGE
                assert reply.detail < len(data)
                assert taken + len(data) > store_bytes
        check_stored(host, stored)


def check_stored(host, stored):
    """Play every sequence; its trace tells what was latched."""
    host.ask(T_US, SetConfig(Config(trace_mode=TraceMode.CRC, status_period_ms=0)))
    host.ask(T_US, Arm())
    at_us = T_US
    for target, data in stored.items():
        said = host.ask(at_us, Play(target, 1000, 1, 1000), flags=0x10)
        at_us += 1000 * (len(data) // COUNT) + 25
        said += host.until(at_us)
        frames = [data[n : n + COUNT] for n in range(0, len(data), COUNT)]
        due = [zlib.crc32(frame + b"\xff" * COUNT) for frame in frames]
        assert [m.crc for _, m in said if isinstance(m, TracePlayback)] == due
