"""The C board in virtual time: the dialogues, and the same life as the Python board."""

import contextlib
import random
import zlib

import pytest

from haptogram_protocol.framing import FrameDecoder, encode_frame
from haptogram_protocol.messages import (
    FIRST_STREAM_SEQ,
    VERSION_MAJOR,
    Arm,
    Config,
    Disarm,
    DriveKind,
    Drives,
    Error,
    ErrorCode,
    Feature,
    Flag,
    FocalPoint,
    GetConfig,
    GetGeometry,
    GetStatus,
    Hello,
    Mute,
    Phases,
    Ping,
    Play,
    PlaybackEnded,
    Points,
    Pong,
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
    parse_body,
)
from haptogram_protocol.state import MuteReason, OutputState
from protocol_vectors.vector_files import DIALOGUE_FILES, outcome, play, vectors
from vector_recorder.boards import CBoard, PythonBoard

SESSION = 0x0C99
COUNT = 4
LIMITS = {"queue_depth": 32}
BOOT_US = 2**32 - 10_000_000


@pytest.fixture
def c_board(programs):
    board = CBoard(programs)
    yield board
    board.close()


@pytest.mark.sampled(1)
@pytest.mark.parametrize("machine", [{}, {"late_us": 0}], ids=["alone", "transducers"])
def test_the_c_board_answers_as_every_dialogue_says(programs, machine):
    """With transducers it ends if it radiates another drive than it loaded ahead."""
    with contextlib.closing(CBoard(programs, **machine)) as board:
        for dialogue in vectors(*DIALOGUE_FILES):
            board.reset()
            assert play(dialogue, board) == [], dialogue["id"]


def frame(message, seq, *, session=SESSION, flags=0, time_us=0):
    body = build_body(message, flags=flags, seq=seq, time_us=time_us, session=session)
    return encode_frame(body)


def messages(sent):
    return [parse_body(body)[1] for body in FrameDecoder().feed(sent)]


def test_a_hardware_fault_switches_off_until_disarm(c_board):
    c_board(1000, frame(Hello(VERSION_MAJOR, 0, SESSION, 0), 1, session=0))
    c_board(1000, frame(Arm(), 2))
    c_board(1004, frame(Phases(bytes(COUNT)), FIRST_STREAM_SEQ, flags=0x10))
    (changed,) = messages(c_board.raise_hardware_fault(2000))
    assert changed == StateChanged(OutputState.FAULT, MuteReason.FAULT)
    (refused,) = messages(c_board(2000, frame(Arm(), 3)))
    assert (refused.code, refused.detail) == (4, OutputState.FAULT)
    kept = ((4, Mute(), OutputState.FAULT), (15, Disarm(), OutputState.DISARMED))
    for seq, message, state in kept:
        (reply,) = messages(c_board(2000, frame(message, seq)))
        assert reply.state is state
        (status,) = messages(c_board(2000, frame(GetStatus(), seq + 10)))
        reasons = {OutputState.FAULT: MuteReason.FAULT, OutputState.DISARMED: MuteReason.DISARM}
        assert status.reason is reasons[state]  # HG-6.2/3


@pytest.mark.parametrize("first", [False, True], ids=["", "behind-another"])
@pytest.mark.parametrize("session", [SESSION, 0])
def test_a_mute_that_overtakes_switches_off_for_good_what_came_before_it(c_board, session, first):
    sequence = bytes(COUNT)
    c_board(1000, frame(Hello(VERSION_MAJOR, 0, SESSION, 0), 1, session=0))
    begin = UploadBegin(UploadKind.PHASES, 0, 1, COUNT, zlib.crc32(sequence))
    for seq, message in enumerate((begin, UploadChunk(0, sequence), UploadCommit(1), Arm()), 2):
        c_board(1000, frame(message, seq))
    c_board(1004, frame(Play(1, 1000, 0, 500), 6, flags=0x10))
    t_us = (BOOT_US + 4000) & 0xFFFFFFFF
    due = [
        (frame(Arm(), 7), Error(Arm.TYPE, ErrorCode.BAD_STATE, OutputState.MUTED)),
        (frame(Ping(9), 8), Pong(9, t_us, t_us)),
        (frame(Phases(sequence), FIRST_STREAM_SEQ, flags=0x10), None),
    ]
    sooner, mute = frame(Mute(), 6), frame(Mute(), 9, session=session)
    length = len(sooner) * first + sum(len(data) for data, _ in due) + len(mute)
    behind = [PlaybackEnded(1, 3, 3)]
    if first:  # an answer to one MUTE lets nothing pass that another has overtaken
        assert c_board.overtake(4000, len(sooner)) == b""
    assert c_board.overtake(4000, length) == b""  # the reply comes first, with the frame
    assert c_board.overtake(4000, length) == b""  # an interrupt that tells twice of one MUTE
    if first:
        reply, *behind = messages(c_board(4000, sooner))
        assert (reply.state, behind) == (OutputState.MUTED, [PlaybackEnded(1, 3, 3)])
        behind = []
    for data, answer in due:
        assert messages(c_board(4000, data)) == ([] if answer is None else [answer])
    reply, *events = messages(c_board(4000, mute))
    if not session and not first:
        behind.insert(0, StateChanged(OutputState.MUTED, MuteReason.MUTE))
    assert (reply.state, events) == (OutputState.MUTED, behind)
    (status,) = messages(c_board(9000, frame(GetStatus(), 10)))
    counters = status.counters
    assert (counters.latched, counters.dropped_state, counters.accepted) == (3, 1, 0)
    (armed,) = messages(c_board(9000, frame(Arm(), 11)))  # what comes behind MUTE counts again
    assert armed.state is OutputState.ARMED


def test_a_status_that_gives_way_leaves_the_margins_to_the_next(c_board):
    c_board(1000, frame(Hello(VERSION_MAJOR, 0, SESSION, 0), 1, session=0))
    c_board(1000, frame(SetConfig(Config(status_period_ms=10, sound_speed_mm_s=343987)), 2))
    c_board(1000, frame(Arm(), 3))
    t_us = (BOOT_US + 8000) & 0xFFFFFFFF
    phases = frame(Phases(bytes(COUNT)), FIRST_STREAM_SEQ, time_us=t_us)
    pings = range(4, 404)  # whose answers take more room than STATUS may have
    c_board.hold_output(5000, phases + b"".join(frame(Ping(seq), seq) for seq in pings))
    said = messages(c_board(12_000))
    assert [type(message) for message in said] == [Pong] * len(pings)
    (status,) = messages(c_board(12_000, frame(GetStatus(), 404)))
    assert (status.margins, status.margin_min_us, status.margin_mean_us) == (1, 3000, 3000)


def test_what_was_taken_for_a_mute_and_is_none_refuses_nothing_behind_it(c_board):
    c_board(1000, frame(Hello(VERSION_MAJOR, 0, SESSION, 0), 1, session=0))
    c_board(1000, frame(Arm(), 2))
    overtaken, found = frame(Arm(), 3), frame(Ping(9), 4)
    assert c_board.overtake(2000, len(overtaken) + len(found)) == b""
    (refused,) = messages(c_board(2000, overtaken))
    assert refused == Error(Arm.TYPE, ErrorCode.BAD_STATE, OutputState.MUTED)
    pong, changed = messages(c_board(2000, found))
    assert (pong.echo, changed) == (9, StateChanged(OutputState.MUTED, MuteReason.MUTE))
    (armed,) = messages(c_board(2000, frame(Arm(), 5)))
    assert armed.state is OutputState.ARMED


def test_mute_that_overtakes_disarm_in_fault_ends_as_behind_it(c_board):
    c_board(1000, frame(Hello(VERSION_MAJOR, 0, SESSION, 0), 1, session=0))
    c_board.raise_hardware_fault(1000)
    disarm, mute = frame(Disarm(), 2), frame(Mute(), 3)
    c_board.overtake(2000, len(disarm) + len(mute))
    replies = messages(c_board(2000, disarm + mute))
    assert [reply.state for reply in replies] == [OutputState.DISARMED, OutputState.MUTED]


@pytest.mark.parametrize("keeps", [False, True])
def test_a_reset_keeps_configuration_and_correction_where_the_board_has_memory_for_it(
    programs, keeps
):
    codes, other = b"\1\2\3\4", Config(hold_ms=77, sound_speed_mm_s=350_000)
    asked = (Hello(VERSION_MAJOR, 0, SESSION, 0), 1), (GetConfig(), 2)
    seen = []
    with contextlib.closing(CBoard(programs, keeps=keeps)) as board:
        for _ in range(3):
            (hello, config) = [
                messages(board(1000, frame(message, seq, session=SESSION * (seq > 1))))[0]
                for message, seq in asked
            ]
            assert (Feature.CONFIG_KEPT in Feature(hello.features)) is keeps
            assert hello.config_crc == config.config_crc
            seen.append((config.config.hold_ms, hello.sound_speed_mm_s, config.config_crc))
            if len(seen) == 1:
                begin = UploadBegin(UploadKind.CORRECTION, 0, 0, COUNT, zlib.crc32(codes))
                upload = (begin, UploadChunk(0, codes), UploadCommit(0), SetConfig(other))
                for seq, message in enumerate(upload, 3):
                    board(2000, frame(message, seq))
            board.reset()
    kept = (77, 350_000, zlib.crc32(other.pack() + codes))
    assert seen[1:] == [kept if keeps else seen[0]] * 2


def test_what_waits_for_the_line_is_bounded_and_trace_gives_way(programs):
    board = CBoard(programs, grid_nx=32, grid_ny=32)
    config = Config(trace_mode=TraceMode.DRIVE, status_period_ms=0)
    board(1000, frame(Hello(VERSION_MAJOR, 0, SESSION, 0), 1, session=0))
    board(1000, frame(SetConfig(config), 2))
    board(1000, frame(Arm(), 3))
    frames = b"".join(
        frame(
            Phases(bytes(1024)),
            FIRST_STREAM_SEQ + n & 0xFFFF,
            time_us=BOOT_US + 2000 + 1000 * n,
        )
        for n in range(16)
    )
    board(1000, frames)
    sent = messages(board(30_000, frame(GetStatus(), 4)))
    assert len(sent) < 10
    assert sent[-1].counters.latched == 16
    assert sent[-1].counters.trace_dropped == 16 - (len(sent) - 1)
    board.close()


# --- Two boards, one life ----------------------------------------------------------------------


class Life:
    """A random life of a host: mostly sensible, often not."""

    def __init__(self, seed):
        self.random = random.Random(seed)
        self.t_us = 1000
        self.seq = 1
        self.index = FIRST_STREAM_SEQ
        self.session = SESSION
        self.sequence = bytes(self.random.randrange(256) for _ in range(3 * COUNT))
        self.waiting = [self.hello(), self.upload_begin(), self.upload_chunk(), self.commit()]

    def step(self):
        """Return the time and the bytes of what happens next."""
        self.t_us += self.random.choice([0, 0, 10, 333, 1000, 4999, 20_000, 90_000])
        if self.waiting:
            return self.t_us, self.waiting.pop(0)()
        act = self.random.choices(
            [self.stream, self.request, self.play, self.noise, self.again, self.hello_again],
            [12, 8, 3, 2, 2, 0.3],
        )[0]
        return self.t_us, act()

    def hello(self):
        return lambda: self.sent(Hello(VERSION_MAJOR, 0, self.session), session=0)

    def upload_begin(self):
        crc = zlib.crc32(self.sequence)
        message = UploadBegin(UploadKind.PHASES, 0, 1, len(self.sequence), crc)
        return lambda: self.sent(message)

    def upload_chunk(self):
        return lambda: self.sent(UploadChunk(0, self.sequence))

    def commit(self):
        return lambda: self.sent(UploadCommit(1))

    def sent(self, message, *, session=None, flags=0, time_us=0):
        self.seq += 1
        session = self.session if session is None else session
        return frame(message, self.seq & 0xFFFF, session=session, flags=flags, time_us=time_us)

    def hello_again(self):
        self.session = self.random.choice([self.session, self.random.randrange(1, 65536)])
        self.index = FIRST_STREAM_SEQ
        return self.hello()()

    def when(self):
        offset = self.random.choice([-50, 0, 1, 24, 500, 3000, 30_000, 300_000, 11_000_000])
        return BOOT_US + self.t_us + offset

    def stream(self):
        self.index += self.random.choice([0, 1, 1, 1, 1, 1, 3])
        flags = self.random.choice([0, 0, 0, Flag.IMMEDIATE, Flag.IMMEDIATE, 0x20])
        message = self.drive()
        seq = self.index & 0xFFFF
        return frame(message, seq, session=self.session, flags=flags, time_us=self.when())

    def drive(self):
        size = COUNT + self.random.choice([0] * 12 + [1, -1])
        kinds = [
            Phases(self.random.randbytes(size)),
            Phases(self.random.randbytes(COUNT)),
            Drives(self.random.randbytes(2 * COUNT)),
            Points(tuple(self.point() for _ in range(self.random.choice([1, 2, 8, 9])))),
        ]
        return self.random.choice(kinds)

    def point(self):
        x, y = (self.random.randrange(-40_000, 40_000) for _ in range(2))
        return FocalPoint(x, y, self.random.randrange(20_000, 200_000), 9000, 777)

    def request(self):
        return self.sent(self.message(), flags=self.random.choice([0] * 9 + [1]))

    def message(self):
        return self.random.choice(self.choices())()

    def choices(self):
        pick = self.random.randrange
        config = Config(
            hold_ms=self.random.choice([5, 50, 500]),
            ramp_ms=self.random.choice([0, 7, 100]),
            host_timeout_ms=self.random.choice([19, 40, 400]),
            status_period_ms=self.random.choice([0, 10, 100]),
            late_window_us=self.random.choice([0, 60]),
            trace_mode=self.random.choice(list(TraceMode)),
            amplitude_ceiling=self.random.choice([255, 100]),
            trace_divider=self.random.choice([1, 3]),
        )
        plain = [Arm, Arm, Arm, Arm, Mute, Disarm, GetStatus, GetConfig, Stop]
        return [
            *plain,
            lambda: Ping(pick(2**64)),
            lambda: SetConfig(config),
            lambda: GetGeometry(pick(6), pick(6)),
            lambda: ReadDrive(DriveKind(pick(2)), pick(6), pick(6)),
            lambda: ReadTrace(pick(30), pick(30)),
            lambda: UploadBegin(UploadKind(1 + pick(3)), pick(2), pick(3), 4 * pick(4), 0),
            lambda: UploadChunk(pick(12), self.random.randbytes(pick(9))),
            lambda: UploadCommit(pick(3)),
        ]

    def play(self):
        flags = self.random.choice([0, Flag.IMMEDIATE])
        message = Play(
            self.random.choice([1, 1, 1, 2]),
            self.random.choice([50, 100, 1003, 20_000]),
            self.random.choice([0, 1, 2]),
            self.random.choice([0, 30, 300]),
        )
        return self.sent(message, flags=flags, time_us=0 if flags else self.when())

    def noise(self):
        good = bytearray(self.stream())
        good[self.random.randrange(len(good))] ^= 1 << self.random.randrange(8)
        return self.random.choice([bytes(good), self.random.randbytes(30), b"\1" * 5000])

    def again(self):
        """A repetition, a number used before, another session, an unknown type."""
        seq = self.seq - self.random.choice([0, 0, 1, 5])
        message = self.random.choice([Arm(), Ping(1), GetStatus()])
        session = self.random.choice([self.session, self.session, 0x7777])
        line = frame(message, seq & 0xFFFF, session=session)
        body = FrameDecoder().feed(line)[0]
        unknown = encode_frame(bytes([self.random.choice([0x3F, 0x7F, 0xC0])]) + body[1:])
        return self.random.choice([line, line, unknown])


# What one board says of itself, and what HG-6.8/2 leaves open.
OWN = {"boot_id", "firmware", "queue_depth", "rx_window", "free_bytes", "geometry_hash"}
OWN |= {"max_sequence_frames", "max_upload_bytes", "upload_window", "max_chunk", "trace_ring"}

# Without an upload the Python board says 0 where HG-6.2/2 asks for the output state.
UPLOADS = {UploadChunk.TYPE, UploadCommit.TYPE}


def told(sent, events):
    """What a board sent, without what is its own: the responses, or the events."""
    found = []
    for item in FrameDecoder().feed(sent):
        taken = outcome(item)["frame"]
        if (taken["header"]["type"] >= 0xC0) is events:
            fields = {name: v for name, v in taken["fields"].items() if name not in OWN}
            if fields.get("request") in UPLOADS and fields.get("code") == ErrorCode.BAD_STATE:
                del fields["detail"]
            found.append((taken["message"], taken["header"], fields))
    return found


@pytest.mark.parametrize("seed", range(5))
def test_the_c_board_and_the_python_board_live_the_same_life(c_board, seed):
    life, python_board = Life(seed), PythonBoard(**LIMITS)
    seen = set()
    for number in range(300):
        at_us, data = life.step()
        c_said, python_said = c_board(at_us, data), python_board(at_us, data)
        for events in (False, True):
            assert told(c_said, events) == told(python_said, events), (number, data.hex())
            seen |= {message for message, _, _ in told(c_said, events)}
    assert {"HELLO_REPLY", "ARM_REPLY", "PLAY_REPLY", "STATUS_REPLY", "ERROR", "STATUS"} <= seen
