"""What a board refuses: with which code, which detail, and that nothing has changed."""

import zlib

import pytest

from haptogram.acoustics import AcousticModel
from haptogram.errors import ConfigurationError
from haptogram_protocol.framing import encode_frame
from haptogram_protocol.messages import (
    Arm,
    Config,
    DriveKind,
    Drives,
    ErrorCode,
    Feature,
    FocalPoint,
    GetGeometry,
    GetStatus,
    MessageType,
    Mute,
    Phases,
    Play,
    Points,
    ReadDrive,
    ReadTrace,
    SetConfig,
    StateChanged,
    Stop,
    TraceMode,
    UploadBegin,
    UploadChunk,
    UploadCommit,
    UploadKind,
    build_body,
)
from haptogram_protocol.rules import REFUSALS
from haptogram_protocol.state import MuteReason, OutputState
from sim_device.board.refusal import RefusalError
from sim_device.board.settings import ALL_FEATURES, BoardSettings
from sim_device.simulation import Simulation

MODEL = AcousticModel.default(4, 4)
_T = MessageType


class InProcessPort:
    """A port in virtual time for a board of any settings."""

    def __init__(self, **settings):
        self.simulation = Simulation(BoardSettings(model=MODEL, **settings))

    def now_ns(self):
        return self.simulation.now_ns

    def write(self, data):
        self.simulation.host_write(data, self.simulation.now_ns)

    def read(self, size):
        self.simulation.advance_to(self.simulation.now_ns + 50_000)
        return self.simulation.host_read(size)

    in_waiting = 1 << 20


@pytest.fixture
def host(open_host):
    def make(**settings):
        small = type(open_host("haptogram://?clock=virtual&array=4x4"))(InProcessPort(**settings))
        small.arm()
        return small

    return make


def refused(host, request, **how):
    answer = host.ask(request, **how)
    return ErrorCode(answer.error.code), answer.error.detail


def begin(kind=UploadKind.PHASES, points=0, target=1, size=32, crc=0):
    return UploadBegin(kind, points, target, size, crc)


@pytest.mark.parametrize(
    ("request_", "code", "detail"),
    [
        (begin(size=15), ErrorCode.BAD_LENGTH, 16),
        (begin(size=0), ErrorCode.BAD_LENGTH, 16),
        (begin(size=16_000), ErrorCode.TOO_LARGE, 1_000),
        (begin(size=160), ErrorCode.TOO_LARGE, 5),
        (begin(target=0), ErrorCode.BAD_VALUE, 2),
        (begin(points=1), ErrorCode.BAD_VALUE, 1),
        (begin(UploadKind.POINTS, points=9, size=144), ErrorCode.BAD_VALUE, 1),
        (begin(UploadKind.POINTS, points=2, size=48), ErrorCode.BAD_LENGTH, 32),
        (begin(UploadKind.CORRECTION, target=0), ErrorCode.BAD_LENGTH, 16),
        (begin(UploadKind.CORRECTION, size=16), ErrorCode.BAD_VALUE, 2),
        (UploadCommit(1), ErrorCode.BAD_STATE, OutputState.ARMED),
        (GetGeometry(16, 1), ErrorCode.NOT_FOUND, 16),
        (ReadDrive(DriveKind.RADIATED, 99, 1), ErrorCode.NOT_FOUND, 16),
        (Play(1, 1000, 1, 1000), ErrorCode.NOT_FOUND, 0),
    ],
)
def test_requests_that_cannot_be_carried_out(host, request_, code, detail):
    board = host(max_upload_bytes=1_000, max_sequence_frames=5)
    assert refused(board, request_) == (code, detail)


STORED = bytes(range(16))
NO_RADIATED = ALL_FEATURES ^ Feature.READ_RADIATED ^ Feature.CORRECTION


def _store(board):
    board.ask(begin(size=16, crc=zlib.crc32(STORED)))
    send_chunk(board, 0, STORED)
    board.ask(UploadCommit(1))


def _refusals_in_order(board):
    """Yield each refusal of table 14.1, met by a request with every defect behind it as well."""
    past = {"t_apply_us": board.port.simulation.dialect.now_us - 1000}
    yield _T.GET_GEOMETRY, 0, board.ask(GetGeometry(16, 1))
    yield _T.READ_DRIVE, 0, board.ask(ReadDrive(9, 99, 1))
    yield _T.READ_DRIVE, 1, board.ask(ReadDrive(DriveKind.RADIATED, 99, 1))
    yield _T.READ_DRIVE, 2, board.ask(ReadDrive(DriveKind.LATCHED, 99, 1))
    yield _T.SET_CONFIG, 0, board.ask(SetConfig(Config(trace_mode=9, hold_ms=0)))
    yield _T.SET_CONFIG, 1, board.ask(SetConfig(Config(hold_ms=0, trace_divider=0)))
    yield _T.UPLOAD_CHUNK, 0, send_chunk(board, 8, bytes(33))
    yield _T.UPLOAD_COMMIT, 0, board.ask(UploadCommit(2))
    _store(board)
    board.ask(begin(size=32))
    yield _T.UPLOAD_CHUNK, 1, send_chunk(board, 8, bytes(33))
    yield _T.UPLOAD_CHUNK, 2, send_chunk(board, 8, bytes(25))
    yield _T.UPLOAD_CHUNK, 3, send_chunk(board, 8, bytes(1))
    yield _T.UPLOAD_COMMIT, 1, board.ask(UploadCommit(2))
    board.ask(Play(1, 1000, 0, 1000), immediate=True)
    yield _T.UPLOAD_COMMIT, 2, board.ask(UploadCommit(1))
    yield _T.UPLOAD_BEGIN, 0, board.ask(begin(9, 1, 1, 1009))
    yield _T.UPLOAD_BEGIN, 1, board.ask(begin(UploadKind.CORRECTION, 1, 1, 1009))
    yield _T.PLAY, 0, board.ask(Play(9, 24, 1, 0), **past)
    board.ask(Stop())
    yield _T.UPLOAD_COMMIT, 3, board.ask(UploadCommit(1))
    send_chunk(board, 0, bytes(32))
    yield _T.UPLOAD_COMMIT, 4, board.ask(UploadCommit(1))
    yield _T.UPLOAD_BEGIN, 2, board.ask(begin(UploadKind.CORRECTION, 1, 1, 1009))
    for place, (points, target, size) in enumerate(
        ((1, 0, 1009), (0, 0, 1009), (0, 1, 1009), (0, 1, 1008), (0, 1, 96)), 3
    ):
        yield _T.UPLOAD_BEGIN, place, board.ask(begin(points=points, target=target, size=size))
    for place, play in enumerate((Play(9, 24, 1, 0), Play(1, 24, 1, 0), Play(1, 25, 1, 0)), 1):
        yield _T.PLAY, place, board.ask(play, **past)
    yield _T.PLAY, 4, board.ask(Play(1, 25, 1, 1000), **past)
    board.port.simulation.dialect.raise_hardware_fault()
    yield _T.ARM, 0, board.ask(Arm())


def test_refusals_come_in_the_order_of_the_table(host):
    board = host(max_upload_bytes=1_000, max_sequence_frames=5, max_chunk=32, features=NO_RADIATED)
    met = set()
    for kind, place, answer in _refusals_in_order(board):
        row = REFUSALS[kind][place]
        assert answer.error.code == row.code, row
        assert not row.detail.isdigit() or answer.error.detail == int(row.detail), row
        met.add((kind, place))
    rows = {(kind, place) for kind, rows in REFUSALS.items() for place in range(len(rows))}
    assert rows - met == {(_T.DISARM, 0)}  # no fault of this board lasts


def send_chunk(host, offset, data):
    host.link.send_chunk(UploadChunk(offset, data), host.now_us())
    return host.wait()


def test_chunks_outside_their_upload(host):
    board = host(max_chunk=32)
    assert send_chunk(board, 0, b"x").error.code == ErrorCode.BAD_STATE
    board.ask(begin())
    assert send_chunk(board, 0, bytes(33)).error.detail == 32
    assert send_chunk(board, 30, bytes(3)).error.code == ErrorCode.BAD_VALUE
    assert send_chunk(board, 8, bytes(24)).error.code == ErrorCode.INCOMPLETE
    assert refused(board, UploadCommit(1)) == (ErrorCode.INCOMPLETE, 0)
    assert refused(board, UploadCommit(2)) == (ErrorCode.BAD_VALUE, 0)


def test_play_within_its_limits_and_not_over_another(host):
    board = host(max_unattended_ms=5_000)
    board.ask(begin(crc=zlib.crc32(bytes(32))))
    send_chunk(board, 0, bytes(32))
    board.ask(UploadCommit(1))
    assert refused(board, Play(1, 24, 1, 1000), immediate=True) == (ErrorCode.BAD_VALUE, 2)
    assert refused(board, Play(1, 25, 1, 0), immediate=True) == (ErrorCode.BAD_VALUE, 10)
    assert refused(board, Play(1, 25, 1, 5001), immediate=True) == (ErrorCode.BAD_VALUE, 10)
    now_us = board.port.simulation.dialect.board.now_us
    for start_us in (now_us - 1_000, now_us + 10_100_000):
        code = refused(board, Play(1, 25, 1, 1000), t_apply_us=start_us)
        assert code == (ErrorCode.BAD_VALUE, 0)
    assert board.ask(Play(1, 1000, 0, 1000), immediate=True).message.state is OutputState.ARMED
    armed = int(OutputState.ARMED)
    assert refused(board, Play(1, 1000, 0, 1000), immediate=True) == (ErrorCode.BAD_STATE, armed)
    assert refused(board, begin()) == (ErrorCode.BAD_STATE, armed)
    assert refused(board, UploadCommit(1)) == (ErrorCode.BAD_STATE, armed)
    assert board.ask(Stop()).message.state is OutputState.ARMED
    assert board.ask(Stop()).message.state is OutputState.ARMED


def test_no_room_for_another_sequence_is_said_before_the_first_byte(host):
    board = host(max_upload_bytes=48, max_stored_bytes=48)
    board.ask(begin(crc=zlib.crc32(bytes(32))))
    send_chunk(board, 0, bytes(32))
    board.ask(UploadCommit(1))
    assert refused(board, begin(target=2)) == (ErrorCode.TOO_LARGE, 16)
    assert board.ask(begin(target=1)).message.window > 0  # takes the place of the old one


@pytest.mark.parametrize(
    ("message", "counter"),
    [
        (Phases(bytes(15)), "bad_length"),
        (Drives(bytes(30)), "bad_length"),
        (Points((FocalPoint(0, 0, 50_000, 65_535, 0),) * 9), "bad_value"),
    ],
)
def test_stream_frames_with_wrong_values_are_counted_once(host, message, counter):
    board = host()
    before = board.ask(GetStatus()).message.counters
    _, wire = board.link.stream_frame(message, t_apply_us=None)
    board.port.write(wire)
    after = board.ask(GetStatus()).message.counters
    names = [name for name in after.WIRE if getattr(after, name) != getattr(before, name)]
    assert sorted(names) == sorted(["frames", "requests", counter])
    assert getattr(after, counter) == getattr(before, counter) + 1


@pytest.mark.parametrize(
    ("feature", "request_"),
    [
        (Feature.CONFIG, SetConfig(Config())),
        (Feature.TRACE_RING, ReadTrace(0, 1)),
        (Feature.SEQUENCE_PHASES, begin()),
        (Feature.CORRECTION, begin(UploadKind.CORRECTION, target=0, size=16)),
        (Feature.READ_RADIATED, ReadDrive(DriveKind.RADIATED, 0, 1)),
        (Feature.SEQUENCE_PHASES | Feature.SEQUENCE_POINTS, Stop()),
        (Feature.READ_LATCHED | Feature.READ_RADIATED, ReadDrive(DriveKind.LATCHED, 0, 1)),
    ],
)
def test_what_a_board_lacks_it_does_not_know(host, feature, request_):
    board = host(features=ALL_FEATURES ^ feature)
    assert refused(board, request_) == (ErrorCode.UNSUPPORTED, int(request_.TYPE))


def test_a_trace_that_a_board_lacks_cannot_be_set(host):
    board = host(features=ALL_FEATURES ^ Feature.TRACE)
    offset = Config.WIRE["trace_mode"].offset
    wanted = SetConfig(Config(trace_mode=TraceMode.CRC))
    assert refused(board, wanted) == (ErrorCode.BAD_VALUE, offset)


def test_a_board_without_amplitudes_mutes_hard_and_knows_only_full_ones(host):
    board = host(features=ALL_FEATURES ^ Feature.AMPLITUDE)
    faint = Points((FocalPoint(0, 0, 50_000, 6_000, 0),))
    for message in (Drives(bytes(32)), faint):
        board.port.write(board.link.stream_frame(message, t_apply_us=None)[1])
    board.port.simulation.advance_to(board.port.now_ns() + 25_000)  # to the carrier's boundary
    drive = board.ask(ReadDrive(DriveKind.LATCHED, 0, 16)).message
    assert set(drive.data[16:]) == {255}
    assert board.ask(GetStatus()).message.counters.unknown_type == 1
    simulation = board.port.simulation
    powered = simulation.dialect.board
    latched_ns = (powered.latched.t_latch_us - powered.settings.boot_us) * 1000
    simulation.advance_to(latched_ns + 199_999_000)
    assert set(powered.radiated(powered.now_us).amplitude_codes) == {255}
    simulation.advance_to(latched_ns + 200_000_000)
    assert powered.state is OutputState.MUTED


def test_a_mute_of_another_session_is_carried_out_and_told_to_the_host(host):
    board = host()
    body = build_body(Mute(), flags=0, seq=77, time_us=0, session=0)
    board.port.write(encode_frame(body))
    board.ask(GetStatus())
    assert StateChanged(OutputState.MUTED, MuteReason.MUTE) in [e.message for e in board.events]
    assert board.ask(Arm()).message.state is OutputState.ARMED


def test_settings_that_no_board_can_have():
    with pytest.raises(ConfigurationError, match="queue_depth is 0, must be 1 to 65535"):
        BoardSettings(model=MODEL, queue_depth=0)
    slow = MODEL.transducer.__class__(frequency_hz=30_000.0)
    model = AcousticModel(MODEL.array, MODEL.medium, slow)
    with pytest.raises(ConfigurationError, match="whole number of microseconds"):
        BoardSettings(model=model)


def test_a_refusal_says_why_as_the_wire_does():
    board = Simulation(BoardSettings(model=MODEL)).dialect.board
    with pytest.raises(RefusalError, match="BAD_STATE, detail 0"):
        board.play(4, start_us=None, period_us=1000, loops=1, unattended_ms=1000)
