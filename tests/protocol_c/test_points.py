"""Focal points in single precision, at the extremes of what a frame can ask for (HG-5.4)."""

import math

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from haptogram_protocol.framing import FrameDecoder, encode_frame
from haptogram_protocol.messages import (
    VERSION_MAJOR,
    Arm,
    Config,
    DriveKind,
    FocalPoint,
    Hello,
    Points,
    ReadDrive,
    SetConfig,
    build_body,
    parse_body,
)
from vector_recorder.boards import CBoard

SESSION = 0x0F32
PITCH_UM = 10_000
LEAST, MOST = -(2**31), 2**31 - 1
METRE = 1_000_000  # HG-5.4/3: accuracy is demanded up to here


class PointsBoard:
    """A C board that shows the drive which it computes for some points."""

    def __init__(self, programs, nx, ny):
        self.board = CBoard(programs, grid_nx=nx, grid_ny=ny)
        self.nx, self.ny = nx, ny
        self.seq, self.index = 0, 0xFFF0 - 1
        self.ask(Hello(VERSION_MAJOR, 0, SESSION, 0), session=0)

    def ask(self, message, *, flags=0, session=SESSION, seq=None):
        if seq is None:
            self.seq = seq = self.seq + 1 & 0xFFFF
        body = build_body(message, flags=flags, seq=seq, time_us=0, session=session)
        replies = FrameDecoder().feed(self.board(self.seq * 1000, encode_frame(body)))
        return [parse_body(reply)[1] for reply in replies]

    def drive(self, points, sound_speed_mm_s):
        """Phase and amplitude codes of every transducer, as integers."""
        self.ask(SetConfig(Config(sound_speed_mm_s=sound_speed_mm_s, status_period_ms=0)))
        self.ask(Arm())
        self.index += 1
        self.ask(Points(tuple(points)), flags=0x10, seq=self.index & 0xFFFF)
        count = self.nx * self.ny
        self.board(self.seq * 1000 + 25)
        (reply,) = self.ask(ReadDrive(DriveKind.LATCHED, 0, count))
        codes = np.frombuffer(reply.data, np.uint8).astype(int)
        return codes[:count], codes[count:]


def weights(points, nx, ny, sound_speed_mm_s):
    """The superposition of HG-5.4 in double precision, by its formula."""
    x = (np.repeat(np.arange(nx), ny) - (nx - 1) / 2) * PITCH_UM
    y = (np.tile(np.arange(ny), nx) - (ny - 1) / 2) * PITCH_UM
    total = np.zeros(nx * ny, complex)
    for point in points:
        distance_um = np.sqrt((point.x_um - x) ** 2 + (point.y_um - y) ** 2 + point.z_um**2.0)
        turns = point.phase / 65536 - distance_um * 40_000 / (sound_speed_mm_s * 1e3)
        total += point.amplitude / 65535 * np.exp(2j * math.pi * (turns % 1))
    return total


def errors(points, codes, nx, ny, speed):
    """Steps by which phases and amplitudes are off before rounding; phases only where there is
    enough amplitude that a step of the sum is less than a step of the phase."""
    phases, amplitudes = codes
    due = weights(points, nx, ny, speed)
    shown = np.exp(2j * math.pi * phases / 256)
    clear = np.abs(due) >= 1 / 16  # HG-5.4/3
    off = np.angle(shown * np.conj(due)) / (2 * math.pi) * 256
    return np.abs(off[clear]), np.abs(amplitudes - 255 * np.minimum(1, np.abs(due)))


coordinates = st.one_of(
    st.sampled_from([-METRE, METRE, 0, 1, -1, 5000, 75_000, -15_000]),
    st.integers(-300_000, 300_000),
    st.integers(-METRE, METRE),
)
focal_points = st.builds(
    FocalPoint, coordinates, coordinates, coordinates, st.integers(0, 65535), st.integers(0, 65535)
)


@pytest.fixture(scope="module", params=[(16, 16), (1, 1), (1, 1024), (5, 3)], ids=str)
def points_board(request, programs):
    board = PointsBoard(programs, *request.param)
    yield board
    board.board.close()


@settings(deadline=None, suppress_health_check=list(HealthCheck))
@given(points=st.lists(focal_points, min_size=1, max_size=8), speed=st.integers(300_000, 380_000))
def test_no_code_is_off_by_more_than_rounding_and_a_tenth_of_a_step(points_board, points, speed):
    board = points_board
    phase_errors, amplitude_errors = errors(
        points, board.drive(points, speed), board.nx, board.ny, speed
    )
    assert max(phase_errors, default=0) <= 0.6
    assert max(amplitude_errors) <= 0.6


def test_a_far_point_has_its_own_phase_on_every_element(programs):
    board = PointsBoard(programs, 16, 16)
    point = FocalPoint(MOST, LEAST, MOST, 65535, 12345)
    phases, amplitudes = board.drive([point], 343_200)
    off, _ = errors([point], (phases, amplitudes), 16, 16, 343_200)
    assert max(off) <= 0.6
    assert len(set(phases)) > 16
    assert set(amplitudes) == {255}
    board.board.close()
