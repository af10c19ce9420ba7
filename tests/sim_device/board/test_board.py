"""The board under random schedules, in its own time: no bytes, no clock."""

import contextlib
import dataclasses
import zlib
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptogram.acoustics import AcousticModel, Drive
from haptogram_protocol.messages import (
    Config,
    ErrorCode,
    LatchKey,
    UploadBegin,
    UploadChunk,
    UploadCommit,
    UploadKind,
)
from haptogram_protocol.state import MuteReason, OutputState
from sim_device.board.board import Board
from sim_device.board.events import PlaybackEnd, RampBegan, RampEnded, StateChange
from sim_device.board.refusal import RefusalError
from sim_device.board.settings import BoardSettings
from sim_device.board.stream_queue import StreamFrame

MODEL = AcousticModel.default(2, 2)
SETTINGS = BoardSettings(model=MODEL, queue_depth=4, max_horizon_us=2_000_000)
CARRIER_US = 25
QUICK = Config(hold_ms=3, ramp_ms=2, host_timeout_ms=20, late_window_us=100)


def a_drive(code: int) -> Drive:
    return Drive(np.full(4, code % 256, np.uint8), np.full(4, 255, np.uint8))


def a_board(config: Config = QUICK, settings: BoardSettings = SETTINGS) -> Board:
    board = Board(settings)
    board.advance_to(-(-settings.boot_us // CARRIER_US) * CARRIER_US)
    board.open_session(1)
    board.configure(config)
    board.arm()
    return board


def upload(board: Board, target: int, frames: int) -> None:
    data = b"".join(bytes([k]) * 4 for k in range(frames))
    board.begin_upload(UploadBegin(UploadKind.PHASES, 0, target, len(data), zlib.crc32(data)))
    board.store_chunk(UploadChunk(0, data))
    assert board.commit_upload(UploadCommit(target)) == frames


# --- random schedules --------------------------------------------------------------------------


@dataclass(frozen=True)
class Step:
    wait_us: int
    action: str
    value: int


STEPS = st.lists(
    st.builds(
        Step,
        st.one_of(st.integers(0, 60), st.integers(0, 4_000), st.integers(0, 30_000)),
        st.sampled_from(
            ["stream"] * 6
            + ["immediate", "arm", "mute", "disarm", "renew", "play", "stop", "config", "session"]
        ),
        st.integers(-200, 6_000),
    ),
    max_size=40,
)


class Run:
    """A board, and everything that can be seen of it while a schedule is carried out."""

    def __init__(self, steps, cuts=()):
        self.board = a_board()
        self.cuts = list(cuts)
        self.submitted = self.dropped = 0
        self.asked = {}
        self.arrived = {}
        self.latches, self.notices, self.radiated = [], [], []
        upload(self.board, 7, 3)
        for number, step in enumerate(steps):
            self.pass_time(self.board.output.now_us + step.wait_us)
            self.act(number, step)
            self.look()

    def pass_time(self, until_us):
        start_us = self.board.output.now_us
        for cut in self.cuts:
            between_us = start_us + (until_us - start_us) * cut // 100
            self.board.advance_to(max(between_us, self.board.output.now_us))
        self.board.advance_to(until_us)
        self.look()

    def look(self):
        self.latches += self.board.output.take_latches()
        self.notices += self.board.output.take_notices()
        self.radiated.append(
            self.board.output.radiated(self.board.output.now_us).amplitude_codes.tobytes()
        )

    def act(self, number, step):
        board = self.board
        if step.action in ("stream", "immediate"):
            t_apply_us = board.output.now_us + step.value if step.action == "stream" else None
            self.asked[number], self.arrived[number] = t_apply_us, board.output.now_us
            self.submitted += 1
            self.dropped += (
                board.submit(StreamFrame(number, t_apply_us, a_drive(number))) is not None
            )
        elif step.action == "play":
            times = {"start_us": None, "period_us": 100 + abs(step.value), "unattended_ms": 25}
            with contextlib.suppress(RefusalError):  # not armed, or playing already
                board.play(7, loops=step.value % 3, **times)
        elif step.action == "config":
            board.configure(dataclasses.replace(QUICK, hold_ms=1 + abs(step.value) % 9))
        elif step.action == "session":
            board.open_session(2 + number)
        else:
            {
                "arm": board.arm,
                "mute": board.mute,
                "disarm": board.disarm,
                "renew": board.output.renew_lease,
                "stop": board.stop,
            }[step.action]()


@given(STEPS, st.lists(st.integers(0, 100), min_size=1, max_size=4).map(sorted))
def test_any_partition_of_time_gives_the_same_result(steps, cuts):
    whole, cut = Run(steps), Run(steps, cuts)
    assert cut.latches == whole.latches
    assert cut.notices == whole.notices
    assert cut.board.output.counters == whole.board.output.counters
    assert cut.board.next_event_us() == whole.board.next_event_us()
    assert cut.radiated[-1:] == whole.radiated[-1:]


@given(STEPS)
def test_every_frame_is_latched_queued_flushed_or_dropped_once(steps):
    run = Run(steps)
    counters = run.board.output.counters
    of_stream = [latch for latch in run.latches if latch.key.sequence == 0]
    assert counters.latched == len(run.latches)
    assert counters.late == sum(latch.late for latch in run.latches)
    drops = [
        counters.dropped_late,
        counters.dropped_future,
        counters.dropped_order,
        counters.dropped_full,
        counters.dropped_state,
    ]
    assert sum(drops) == run.dropped
    taken = len(of_stream) + run.board.queued + counters.flushed
    assert taken + run.dropped == run.submitted


@given(STEPS)
def test_latches_keep_their_order_and_never_come_early(steps):
    run = Run(steps)
    times_us = [latch.t_latch_us for latch in run.latches]
    assert times_us == sorted(set(times_us))  # at most one in a carrier period
    assert all(t_us % CARRIER_US == 0 for t_us in times_us)
    indices = [latch.key.index for latch in run.latches if latch.key.sequence == 0]
    assert indices == sorted(set(indices))
    for latch in run.latches:
        if latch.key.sequence == 0:
            t_apply_us = run.asked[latch.key.index]
            arrival_us = run.arrived[latch.key.index]
            assert latch.t_latch_us >= max(arrival_us, t_apply_us or 0)
            assert latch.late == (t_apply_us is not None and t_apply_us < arrival_us)


@given(STEPS)
def test_the_output_is_silent_unless_armed_and_latched_since(steps):
    run = Run(steps)
    happened = [(notice.t_us, notice) for notice in run.notices if isinstance(notice, StateChange)]
    armed_us = [t_us for t_us, change in happened if change.state is OutputState.ARMED]
    armed = not happened or happened[-1][1].state is OutputState.ARMED
    assert armed == (run.board.output.state is OutputState.ARMED)
    latched = [latch for latch in run.latches if latch.t_latch_us >= armed_us[-1]]
    if not (armed and latched):
        run.board.advance_to(run.board.output.now_us)
        assert run.board.output.radiated(run.board.output.now_us).is_muted


@given(STEPS, st.integers(0, 40_000))
def test_left_alone_the_output_only_fades_and_ends_silent(steps, pause_us):
    board = Run(steps).board
    board.stop()
    while board.queued:
        board.advance_to(board.next_event_us())
    loudness = []
    for _ in range(40):
        board.advance_to(board.output.now_us + pause_us // 40 + 1)
        loudness.append(int(board.output.radiated(board.output.now_us).amplitude_codes.max()))
    assert loudness == sorted(loudness, reverse=True)
    board.advance_to(board.output.now_us + 100_000)
    assert board.output.state is not OutputState.ARMED
    assert board.output.radiated(board.output.now_us).is_muted
    assert board.next_event_us() is None


# --- single rules ------------------------------------------------------------------------------


def latch_now(board: Board, index: int = 0) -> int:
    board.submit(StreamFrame(index, None, a_drive(1)))
    board.advance_to(-(-board.output.now_us // CARRIER_US) * CARRIER_US)
    (latch,) = board.output.take_latches()
    return latch.t_latch_us


def test_hold_ramp_and_mute_come_to_the_microsecond():
    board = a_board()
    t_us = latch_now(board)
    for after_us, code in ((2_999, 255), (3_000, 255), (4_000, 128), (4_999, 0), (5_000, 0)):
        board.advance_to(t_us + after_us)
        assert board.output.radiated(board.output.now_us).amplitude_codes[0] == code
    assert (board.output.state, board.output.reason) == (OutputState.MUTED, MuteReason.HOLD_EXPIRED)
    assert board.output.counters.timeouts == 1


def test_a_latch_is_named_by_the_32_bits_that_a_trace_holds():
    board = a_board()
    board.arm()
    board.submit(StreamFrame((1 << 32) + 5, None, a_drive(1)))
    board.advance_to(-(-board.output.now_us // CARRIER_US) * CARRIER_US)
    (latch,) = board.output.take_latches()
    assert latch.key == LatchKey(sequence=0, loop=0, index=5)


def test_a_latch_in_the_ramp_of_the_hold_restores_full_output():
    board = a_board()
    t_us = latch_now(board)
    board.advance_to(t_us + 4_000)
    board.output.renew_lease()  # not what this ramp waits for
    assert board.output.radiated(board.output.now_us).amplitude_codes[0] == 128
    latch_now(board, 1)
    assert board.output.radiated(board.output.now_us).amplitude_codes[0] == 255
    notices = [n for n in board.output.take_notices() if isinstance(n, RampBegan | RampEnded)]
    assert notices == [
        RampBegan(t_us + 3_000, MuteReason.HOLD_EXPIRED, t_us + 5_000),
        RampEnded(board.output.now_us, restored=True),
    ]


def test_a_latch_does_not_undo_the_ramp_of_the_lease_but_a_frame_does():
    board = a_board(dataclasses.replace(QUICK, hold_ms=1000))
    armed_us = board.output.now_us
    latch_now(board)
    board.submit(StreamFrame(1, armed_us + 21_000, a_drive(2)))
    board.advance_to(armed_us + 21_000)
    (latch,) = board.output.take_latches()
    assert latch.ramping
    assert latch.radiated.amplitude_codes[0] == 128
    assert latch.drive.amplitude_codes[0] == 255
    board.output.renew_lease()
    assert board.output.radiated(board.output.now_us).amplitude_codes[0] == 255


def test_a_ramp_keeps_its_line_and_the_ceiling_in_force_cuts_it_off():
    config = dataclasses.replace(QUICK, ramp_ms=10, amplitude_ceiling=100, host_timeout_ms=1000)
    board = a_board(config)
    begins_us = latch_now(board) + 3_000
    settings = ((255, 10, 80), (255, 2000, 60), (30, 0, 30), (255, 10, 40))
    for after_ms, (ceiling, ramp_ms, due) in zip((2, 4, 5, 6), settings, strict=True):
        board.advance_to(begins_us + after_ms * 1000)
        board.configure(dataclasses.replace(config, amplitude_ceiling=ceiling, ramp_ms=ramp_ms))
        assert board.output.radiated(board.output.now_us).amplitude_codes[0] == due
    board.advance_to(begins_us + 8_000)
    assert board.output.radiated(board.output.now_us).amplitude_codes[0] == 20
    latch_now(board, 1)
    assert board.output.radiated(board.output.now_us).amplitude_codes[0] == 255


def test_a_silent_host_is_muted_even_before_the_first_latch():
    board = a_board()
    board.advance_to(board.output.now_us + 22_000)
    assert (board.output.state, board.output.reason) == (OutputState.MUTED, MuteReason.HOST_SILENT)


def test_playback_brings_its_own_lease_and_the_host_timeout_returns_after_it():
    board = a_board(dataclasses.replace(QUICK, hold_ms=1000))
    upload(board, 1, 3)
    start_us = board.output.now_us
    board.play(1, start_us=start_us, period_us=10_010, loops=0, unattended_ms=50)
    board.advance_to(start_us + 52_000)
    assert (board.output.state, board.output.reason) == (OutputState.MUTED, MuteReason.UNATTENDED)
    board.arm()
    board.play(1, start_us=None, period_us=20_000, loops=1, unattended_ms=1000)
    board.advance_to(board.output.now_us + 40_025)
    assert PlaybackEnd in [type(n) for n in board.output.take_notices()]
    ended_us = board.output.now_us
    board.advance_to(ended_us + 15_000)
    assert board.output.state is OutputState.ARMED
    board.advance_to(ended_us + 23_000)
    assert board.output.reason is MuteReason.HOST_SILENT


def test_playback_never_accumulates_rounding():
    board = a_board(dataclasses.replace(QUICK, hold_ms=1000))
    upload(board, 1, 3)
    start_us = board.output.now_us + 7
    board.play(1, start_us=start_us, period_us=333, loops=40, unattended_ms=1000)
    board.advance_to(start_us + 333 * 120)
    latches = board.output.take_latches()
    due_us = [start_us + k * 333 for k in range(120)]
    assert [latch.t_latch_us for latch in latches] == [-(-t // 25) * 25 for t in due_us]
    assert [(latch.key.loop, latch.key.index) for latch in latches] == [
        divmod(k, 3) for k in range(120)
    ]


@pytest.mark.parametrize("pass_time", [Board.advance_to, Board.idle_to])
def test_time_does_not_run_backwards(pass_time):
    board = a_board()
    with pytest.raises(ValueError, match="cannot go back"):
        pass_time(board, board.output.now_us - 1)


def test_two_frames_on_one_carrier_period_the_later_replaces_the_earlier():
    board = a_board()
    boundary_us = board.output.now_us + 1_000
    board.submit(StreamFrame(1, boundary_us - 10, a_drive(1)))
    board.submit(StreamFrame(2, boundary_us - 5, a_drive(2)))
    board.advance_to(boundary_us)
    assert [latch.key.index for latch in board.output.take_latches()] == [2]
    assert board.output.counters.flushed == 1


@pytest.mark.parametrize(
    ("offset_us", "counter"),
    [(-101, "dropped_late"), (2_000_001, "dropped_future")],
)
def test_what_comes_too_late_or_too_early_is_dropped(offset_us, counter):
    board = a_board()
    board.submit(StreamFrame(1, board.output.now_us + offset_us, a_drive(1)))
    assert getattr(board.output.counters, counter) == 1
    assert board.margins.take() == (1, offset_us, offset_us)
    assert board.margins.take() == (0, 0, 0)


def test_a_full_queue_and_a_wrong_order_keep_what_is_queued():
    board = a_board()
    for index in range(5):
        board.submit(StreamFrame(index, board.output.now_us + 1_000 * (index + 1), a_drive(index)))
    board.submit(StreamFrame(5, board.output.now_us + 500, a_drive(5)))
    assert (board.output.counters.dropped_full, board.output.counters.dropped_order) == (1, 1)
    assert board.queued == 4


@pytest.mark.parametrize("bits", [5, 6])
def test_fewer_bits_leave_the_low_bits_of_the_registers_empty(bits):
    board = a_board()
    codes = np.arange(4, dtype=np.uint8) + 3
    board.submit(StreamFrame(0, None, Drive(codes, np.full(4, 255, np.uint8), bits)))
    assert board.output.latched.drive.phase_codes.tolist() == (codes * 2 ** (8 - bits)).tolist()
    assert board.output.latched.commanded_bits == bits


def test_correction_and_ceiling_change_what_is_radiated_not_what_is_latched():
    board = a_board(dataclasses.replace(QUICK, amplitude_ceiling=100))
    before = board.config_crc
    codes = bytes([250, 1, 2, 3])
    board.begin_upload(UploadBegin(UploadKind.CORRECTION, 0, 0, 4, zlib.crc32(codes)))
    board.store_chunk(UploadChunk(0, codes))
    board.commit_upload(UploadCommit(0))
    latch_now(board)
    assert board.output.latched.drive == a_drive(1)
    board.submit(StreamFrame(1, None, a_drive(10)))
    board.advance_to(board.output.now_us + 25)
    (latch,) = board.output.take_latches()
    assert latch.radiated.phase_codes.tolist() == [4, 11, 12, 13]
    assert latch.radiated.amplitude_codes.tolist() == [100] * 4
    assert board.config_crc != before


def test_a_fault_stops_everything_until_disarm():
    board = a_board()
    latch_now(board)
    board.output.raise_hardware_fault()
    assert board.output.radiated(board.output.now_us).is_muted
    with pytest.raises(RefusalError) as caught:
        board.arm()
    assert (caught.value.code, caught.value.detail) == (ErrorCode.BAD_STATE, OutputState.FAULT)
    board.mute()
    assert (board.output.state, board.output.reason) == (OutputState.FAULT, MuteReason.FAULT)
    board.disarm()
    board.arm()
    assert board.output.state is OutputState.ARMED


@given(st.lists(st.integers(0, 5), max_size=12))
def test_chunks_may_come_more_than_once_and_not_behind_a_gap(places):
    board, received = a_board(), 0
    data = bytes(range(48))
    board.begin_upload(UploadBegin(UploadKind.PHASES, 0, 3, 48, zlib.crc32(data)))
    for place in [*places, *range(6)]:
        chunk = UploadChunk(8 * place, data[8 * place : 8 * place + 8])
        if chunk.offset > received:
            with pytest.raises(RefusalError) as caught:
                board.store_chunk(chunk)
            assert (caught.value.code, caught.value.detail) == (ErrorCode.INCOMPLETE, received)
            continue
        received = max(received, chunk.offset + 8)
        assert board.store_chunk(chunk) == received
    assert board.commit_upload(UploadCommit(3)) == 12


def test_an_upload_is_taken_whole_or_not_at_all():
    board = a_board()
    upload(board, 3, 2)
    data = bytes(12)
    board.begin_upload(UploadBegin(UploadKind.PHASES, 0, 3, 12, zlib.crc32(data) ^ 1))
    refused = []
    for size in (4, 12):
        board.store_chunk(UploadChunk(0, data[:size]))
        with pytest.raises(RefusalError) as caught:
            board.commit_upload(UploadCommit(3))
        refused.append((caught.value.code, caught.value.detail))
    assert refused == [
        (ErrorCode.INCOMPLETE, 4),
        (ErrorCode.CRC_MISMATCH, zlib.crc32(data)),
    ]
    board.play(3, start_us=None, period_us=1000, loops=1, unattended_ms=100)
    board.advance_to(board.output.now_us + 2_000)
    assert len(board.output.take_latches()) == 2  # the old sequence


def test_a_shorter_hold_that_has_run_out_already_acts_at_once():
    board = a_board(dataclasses.replace(QUICK, hold_ms=500, host_timeout_ms=1000))
    assert board.submit(StreamFrame(1, None, a_drive(1))) is None
    latched_us = board.output.now_us + CARRIER_US
    board.advance_to(latched_us + 100_000)
    board.output.take_notices()
    board.configure(dataclasses.replace(QUICK, host_timeout_ms=1000))
    assert any(isinstance(notice, RampBegan) for notice in board.output.take_notices())
