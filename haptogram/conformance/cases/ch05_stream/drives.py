"""HG-5.1, HG-5.2, HG-5.3, HG-5.4, HG-7.9: phases and amplitudes, streamed or of points."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Final, TypeAlias

from haptogram_protocol import messages as m
from haptogram_protocol.rules import READ_BACKS

from ...case import Depth, case, unobservable_case
from ...client import latching, playback, uploads
from ...client.board_client import BoardClient
from ...client.drive_paths import drive_paths, registers_asked_for
from ...client.stream_kinds import random_point_to_send
from ...judge.witness import JudgeWitness
from ...outcome import EXTERNAL, SELF_REPORTED, check, check_equal, check_fields, require
from .every_drop import judge_first_drop

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from haptogram.acoustics import AcousticModel
    from haptogram.driver.frames.frame import Mode

    Errors: TypeAlias = NDArray[np.float64]

amplitude_is_linear = unobservable_case(
    "HG-5.3/2", "the pressure itself: only a microphone shows it", EXTERNAL
)
_SPEEDS_MM_S: Final = (300_000, 331_300, 380_000)  # HG-7.1: least, 0 C, most
_CEILINGS: Final = (1, 100, 254)
_SEQUENCE: Final = 3
_COMPUTES: Final = m.Feature.POINTS | m.Feature.READ_LATCHED
_GRADED: Final = m.Feature.READ_LATCHED | m.Feature.AMPLITUDE
_AT_SPEEDS: Final = _COMPUTES | m.Feature.CONFIG
_CORRECTED: Final = READ_BACKS | m.Feature.CORRECTION
_LIMITED: Final = READ_BACKS | m.Feature.CONFIG | m.Feature.AMPLITUDE
_Target: TypeAlias = tuple[float, float, float]
#: Off every plane of symmetry of a grid: on one a mirrored or transposed drive is a correct one.
_TARGETS_M: Final = ((0.017, 0.031, 0.150), (-0.026, 0.012, 0.120), (0.009, -0.024, 0.180))
_WORST: Final = 1.5 + 1e-6  # one step beyond the rounding, which is half of one
_ROUNDING: Final = 0.25  # of a step: the mean error is 0 when rounded, 0.5 when cut off
_MANY: Final = 24
_SIGNS: Final = (-1, 1)
#: Signs of coordinates: every octant, each plane, and the axis of emission.
_SIDES: Final[tuple[tuple[int, int, int], ...]] = (
    *((x, y, z) for x in _SIGNS for y in _SIGNS for z in _SIGNS),
    (0, 1, 1),
    (1, 0, 1),
    (1, 1, 0),
    (0, 0, 1),
)
_ENDS: Final = (1, 255, 256, 32_767, 32_768, 65_535, 65_536, 300_000, 524_288, 700_000, 1_000_000)
_FAR: Final = (-1_000_000, 654_321)
_FAINT: Final = 4_100  # 1/16 of full amplitude, where phases begin to count
_TURNS: Final = 16


@case("HG-5.1/1")
def drives_have_a_count_in_range(board: BoardClient) -> None:
    """N is 1 to 1024"""
    count = board.identity.transducers
    check(1 <= count <= m.MAX_TRANSDUCERS, f"N is {count}")


@case("HG-5.1/2")
def drives_count_along_y_first(board: BoardClient) -> None:
    """on a grid GET_GEOMETRY counts the rows of a column before the next column"""
    nx, ny = board.identity.grid_nx, board.identity.grid_ny
    require(nx * ny > 1, "this board is no grid of two transducers or more")
    places = [(element.x_um, element.y_um) for element in board.read_geometry()]
    wrong = [n for n, (a, b) in enumerate(itertools.pairwise(places)) if not a < b]
    check(not wrong, f"transducers {wrong[:4]} are before those behind, by column and row")


@case("HG-5.1/3")
def points_have_their_origin_in_the_centre(board: BoardClient) -> None:
    """the origin is the centre of all transducers, and their normals point to +z"""
    elements = board.read_geometry()
    check(all(element.nz > 0 for element in elements), "a normal points away from +z")
    for axis in ("x_um", "y_um"):
        values = [getattr(element, axis) for element in elements]
        middle_um = (min(values) + max(values)) / 2
        check(abs(middle_um) <= 1, f"the middle of all {axis} is {middle_um:g}, not 0")


@case("HG-5.2/1", evidence=SELF_REPORTED)
def stream_phases_reach_their_registers(board: BoardClient) -> None:
    """random codes reach the registers of their transducers"""
    witness = JudgeWitness.of(board)
    board.arm()
    for _ in range(3):
        registers, since = board.random_registers(), board.link.mark()
        latching.latch_now(board, m.Phases(registers))
        witness.expect(registers, since=since)


@case("HG-5.2/3", evidence=SELF_REPORTED)
def stream_phases_have_their_length(board: BoardClient) -> None:
    """PHASES with a byte less or more than N are counted in bad_length"""
    judge_first_drop(board, "HG-3.2/4")


@case("HG-5.2/6", evidence=SELF_REPORTED)
def stream_phases_have_full_amplitude(board: BoardClient) -> None:
    """after DRIVES of amplitude 10, PHASES has amplitude 255 again"""
    witness = JudgeWitness.of(board)
    board.arm()
    registers = board.random_registers()
    if board.has(m.Feature.AMPLITUDE):
        latching.latch_now(board, m.Drives(registers + b"\x0a" * len(registers)))
    since = board.link.mark()
    latching.latch_now(board, board.phases(registers))
    witness.expect(registers, since=since)


@case("HG-5.3/1", needs=m.Feature.AMPLITUDE, evidence=SELF_REPORTED)
def takes_stream_drives(board: BoardClient) -> None:
    """DRIVES are latched with phase and amplitude; other lengths are counted"""
    witness = JudgeWitness.of(board)
    count = board.identity.transducers
    board.arm()
    phases, amplitudes = board.random.randbytes(count), board.random.randbytes(count)
    since = board.link.mark()
    with board.counting(latched=1, bad_length=2):
        latching.latch_now(board, m.Drives(phases + amplitudes))
        for size in (2 * count - 2, 2 * count + 2):
            board.link.send(board.link.stream_raw(m.Drives.TYPE, bytes(size)))
    witness.expect(phases, amplitudes, since=since)


@case("HG-5.2/6-paths", needs=m.Feature.READ_LATCHED, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def every_path_of_streamed_codes(board: BoardClient) -> None:
    """PHASES and DRIVES of every format reach the registers, at once, at their time and played"""
    board.arm()
    for path in drive_paths(board):
        due = registers_asked_for(board, path.latch())
        shown = latching.read_back(board)
        if due is not None:
            got = shown.phases, shown.amplitudes
            check_equal(got, due, f"{path.name}: the latched drive")


@case("HG-5.4/1-paths", needs=_AT_SPEEDS, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def every_path_of_streamed_points(board: BoardClient) -> None:
    """focal points on every path at three speeds of sound, the same ones too: phases, amplitudes"""
    for speed in _SPEEDS_MM_S:
        board.arm(sound_speed_mm_s=speed)
        for path in drive_paths(board):
            message = path.latch()
            if isinstance(message, m.Points):
                judge_points_read_back(board, message, f"{path.name}, {speed / 1000:g} m/s")
    _judge_same_points_streamed_again(board)


def _judge_same_points_streamed_again(board: BoardClient) -> None:
    """FAILED unless points streamed again are computed for the speed of sound set meanwhile."""
    for number in sorted({1, board.most_points}):
        message = m.Points(tuple(random_point_to_send(board, number) for _ in range(number)))
        board.arm(sound_speed_mm_s=_SPEEDS_MM_S[0])
        for speed, between in itertools.product(_SPEEDS_MM_S, (False, True)):
            if between:  # the drive that is latched is another one
                latching.latch_now(board)
            board.configure(sound_speed_mm_s=speed)
            index = latching.latch_now(board, message)
            check_equal(board.status().last_seq, index, "frame lost: the number of the last latch")
            name = f"the same {number} points again, {speed / 1000:g} m/s"
            judge_points_read_back(board, message, name)


@case("HG-5.4/2-sums", needs=_COMPUTES, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def every_sum_of_streamed_points(board: BoardClient) -> None:
    """1 to max_points points of full amplitude that add up, cancel and mix, streamed and played"""
    board.arm()
    most = board.most_points
    for number in range(1, most + 1):
        board.wire.forget_received()  # the read-backs of a large array are a flood
        for name, group in _groups_of_full_points(board, number):
            latching.latch_now(board, m.Points(group))
            judge_points_read_back(board, m.Points(group), f"{number} {name}")
    size = most * m.FocalPoint.LAYOUT.size
    if board.has(m.Feature.SEQUENCE_POINTS) and size <= board.identity.max_upload_bytes:
        for name, group in _groups_of_full_points(board, most):
            uploads.upload_to_board(
                board, m.UploadKind.POINTS, _SEQUENCE, m.Points(group).serialize(), most
            )
            playback.play_out(board, _SEQUENCE, 1, period_us=playback.period_to_play(board, most))
            judge_points_read_back(board, m.Points(group), f"{most} {name}, played")


def _groups_of_full_points(
    board: BoardClient, number: int
) -> Iterator[tuple[str, tuple[m.FocalPoint, ...]]]:
    """Yield name and group of *number* full-amplitude points: equal, half in antiphase, random."""
    place = random_point_to_send(board)
    for quarter in range(4):
        lag = (0x4000 * quarter + board.random.randrange(0x4000)) & 0xFFFF
        full = replace(place, amplitude=0xFFFF, phase=lag)
        yield f"equal points, lag {lag:#06x}", (full,) * number
    opposed = replace(full, phase=full.phase ^ 0x8000)
    yield "points, half of them opposed", (full, opposed) * (number // 2) + (full,) * (number % 2)
    anywhere = (random_point_to_send(board) for _ in range(number))
    yield "points anywhere", tuple(replace(point, amplitude=0xFFFF) for point in anywhere)


def judge_points_read_back(
    board: BoardClient, message: m.Points, name: str, model: AcousticModel | None = None
) -> None:
    """FAILED if a phase or an amplitude of the latched drive of points is off by over a step."""
    from ...judge.focusing import judge_drive_of_points

    model = model or _model_of_streamed_points(board)
    judge_drive_of_points(board, model, tuple(message.points), latching.read_back(board), name)


@case("HG-7.9/1-paths", needs=_CORRECTED, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def every_drive_path_is_corrected(board: BoardClient) -> None:
    """on every path the radiated phases are the latched ones and the correction, modulo 256"""
    correction = board.random.randbytes(board.identity.transducers)
    uploads.upload_to_board(board, m.UploadKind.CORRECTION, 0, correction)
    board.arm()
    for path in drive_paths(board):
        path.latch()
        judge_corrected_drive(board, correction, path.name)


def judge_corrected_drive(board: BoardClient, correction: bytes, name: str) -> latching.ClientDrive:
    """FAILED unless the radiated phases are the latched ones, corrected; return the latched."""
    latched, radiated = latching.read_back(board), latching.read_back_radiated(board)
    due = bytes((a + b) % 256 for a, b in zip(latched.phases, correction, strict=True))
    check_fields(radiated, f"{name}, radiated with a correction", phases=due)
    return latched


@case("HG-7.9/2-paths", needs=_LIMITED, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def every_drive_path_is_limited(board: BoardClient) -> None:
    """on every path no radiated amplitude is above ceilings of 1, 100 and 254, none below them
    less
    """
    for ceiling in _CEILINGS:
        board.arm(amplitude_ceiling=ceiling)
        for path in drive_paths(board):
            path.latch()
            latched, radiated = latching.read_back(board), latching.read_back_radiated(board)
            loudest = max(radiated.amplitudes)
            check(loudest <= ceiling, f"{path.name}: ceiling {ceiling}, {loudest} is radiated")
            pairs = zip(latched.amplitudes, radiated.amplitudes, strict=True)
            quiet = [number for number, (a, b) in enumerate(pairs) if a <= ceiling and a != b]
            text = f"{path.name}: ceiling {ceiling} changes lower amplitudes, {quiet[:4]}"
            check(not quiet, text)


def _model_of_streamed_points(board: BoardClient) -> AcousticModel:
    """Return the acoustic model by which the board has to compute POINTS."""
    from ...judge.array_model import judged_model_of_board

    return judged_model_of_board(board)


def _judge_latched_foci(board: BoardClient, mode: Mode, targets_m: Sequence[_Target]) -> None:
    """FAILED unless the drives that frames latch, read back, focus on *targets_m*.

    *targets_m* are (x, y, z); *mode*: the frames are PHASES, DRIVES or POINTS.  The first judgement
    compiles code for seconds, in which a hold would expire: it comes after the last latch.
    """
    from ...judge.focusing import judge_focus, judge_of_model, judged_host_frames

    model, shown = _model_of_streamed_points(board), []
    frames = judged_host_frames(model, board.identity, targets_m, mode)
    board.arm()
    for frame in frames:
        latching.latch_now(board, frame.message)
        shown.append(latching.read_back(board))
    judge = judge_of_model(model)
    for frame, drive in zip(frames, shown, strict=True):
        judge_focus(judge, frame, drive)


@case("HG-5.2/1-focus", needs=m.Feature.READ_LATCHED, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def streamed_phases_make_a_focus(board: BoardClient) -> None:
    """PHASES for each of several foci: the focus of the latched drive lies on its target"""
    _judge_latched_foci(board, "phases", _TARGETS_M)


@case("HG-5.3/1-focus", needs=_GRADED, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def streamed_drives_make_a_focus(board: BoardClient) -> None:
    """DRIVES for each of two foci: the focus of the latched drive lies on its target"""
    _judge_latched_foci(board, "drives", _TARGETS_M[:2])


@case("HG-5.4/1", needs=_COMPUTES, evidence=SELF_REPORTED)
def streamed_points_make_a_focus(board: BoardClient) -> None:
    """POINTS for each of two foci: the focus lies on its target; sign, order and axes are right"""
    _judge_latched_foci(board, "points", _TARGETS_M[:2])


def _random_point_to_stream(board: BoardClient) -> m.FocalPoint:
    """Return a random point: x and y ±4 to 40 mm, z 80 to 200 mm, 15 to 46 % of full amplitude."""

    def away(low: int, high: int) -> int:
        return board.random.choice((-1, 1)) * board.random.randrange(low, high)

    return m.FocalPoint(
        away(4_000, 40_000),
        away(4_000, 40_000),
        board.random.randrange(80_000, 200_000),
        board.random.randrange(10_000, 30_000),
        board.random.randrange(65_536),
    )


def _errors_of_random_points(board: BoardClient, points: int) -> tuple[Errors, Errors]:
    """Latch drives of *points* random points; return the errors of phase and amplitude codes.

    An error is the latched code less the exact one, for each transducer of each drive; of phases
    only where the amplitude is 1/16 of the full one or more.
    """
    from ...judge.focusing import judged_amplitude_errors, judged_phase_errors

    model, found = _model_of_streamed_points(board), []
    board.arm()
    for _ in range(max(_MANY, -(-400 // board.identity.transducers))):
        group = tuple(_random_point_to_stream(board) for _ in range(points))
        latching.latch_now(board, m.Points(group))
        found.append((group, latching.read_back(board)))
    graded = board.has(m.Feature.AMPLITUDE)
    phases = judged_phase_errors(model, found)
    return phases, judged_amplitude_errors(model, found, graded=graded)


def _check_errors(errors: Errors, name: str) -> None:
    """FAILED if an error of either sign is over 1.5 steps of a code; *name* begins the finding."""
    worst = float(abs(errors).max())
    check(worst <= _WORST, f"{name} is off by {worst:.2f} steps before rounding")


@case("HG-5.4/1-rounding", needs=_COMPUTES, evidence=SELF_REPORTED)
def streamed_points_are_rounded(board: BoardClient) -> None:
    """over 24 random foci phase codes are rounded to the nearest, not cut off"""
    phases, _ = _errors_of_random_points(board, 1)
    mean = float(phases.mean())
    kind = "cut off" if mean < 0 else "rounded up"
    check(abs(mean) < _ROUNDING, f"phase codes are {kind}: off by {mean:+.2f} steps on average")


@case("HG-5.4/2", needs=_COMPUTES, evidence=SELF_REPORTED)
def streamed_points_have_their_amplitude(board: BoardClient) -> None:
    """amplitude codes of two points together: floor(255 min(1, |w|) + 1/2), 255 without
    AMPLITUDE
    """
    points = min(2, board.most_points)
    _, amplitudes = _errors_of_random_points(board, points)
    _check_errors(amplitudes, "an amplitude")
    mean = float(amplitudes.mean())
    is_even = points == 1 or abs(mean) < _ROUNDING
    check(is_even, f"amplitudes are off by {mean:+.2f} codes on average")


@case("HG-5.4/3", needs=_COMPUTES, evidence=SELF_REPORTED)
def streamed_points_are_exact(board: BoardClient) -> None:
    """over 24 random superpositions no phase and no amplitude is off by more than one step"""
    phases, amplitudes = _errors_of_random_points(board, min(3, board.most_points))
    _check_errors(phases, "a phase")
    _check_errors(amplitudes, "an amplitude")


@case("HG-5.4/3-sides", needs=_COMPUTES, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def streamed_points_lie_on_every_side(board: BoardClient) -> None:
    """frames of 1 to max_points points on every side, near, far, silent: no step is wrong by
    more
    """
    model = _model_of_streamed_points(board)
    board.arm()
    for number in range(1, board.most_points + 1):
        for side in _SIDES:
            group = tuple(_random_point_on_side(board, side, number) for _ in range(number))
            name = f"{number} points at x {side[0]:+d}, y {side[1]:+d}, z {side[2]:+d} and beyond"
            latching.latch_now(board, m.Points(group))
            judge_points_read_back(board, m.Points(group), name, model)


def _random_point_on_side(
    board: BoardClient, side: tuple[int, int, int], number: int
) -> m.FocalPoint:
    """Return a random point with *side* (-1, 0, 1) as signs of x, y, z, each of them up to 1 m.

    Its amplitude is at most 1/*number* of the full one.
    """
    longest = board.random.choice((400, 40_000, 1_000_000))
    x, y, z = (sign * board.random.randrange(1, longest + 1) for sign in side)
    level = board.random.choice((0, board.random.randrange(65_535 // number), 65_535 // number))
    return m.FocalPoint(x, y, z, level, board.random.choice((0, board.random.randrange(65_536))))


@case("HG-5.4/3-faint", needs=_COMPUTES, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def streamed_points_all_but_cancel(board: BoardClient) -> None:
    """2 and max_points points that cancel but for 1/16 of full, at every phase: no step is wrong"""
    most = min(board.most_points, 2 * 65_535 // _FAINT)
    require(most >= 2, "one point alone cancels nothing")
    model = _model_of_streamed_points(board)
    board.arm()
    for number, turn in itertools.product({2, most - most % 2}, range(_TURNS)):
        x, y, z = (board.random.randrange(-40_000, 40_001) for _ in range(3))
        level, phase = 2 * 65_535 // number, turn * 0x10000 // _TURNS
        levels = [level] * (number - 1) + [level - _FAINT]
        group = tuple(
            m.FocalPoint(x, y, z, one, (phase + 0x8000 * (place % 2)) & 0xFFFF)
            for place, one in enumerate(levels)
        )
        name = f"{number} points that cancel but for {_FAINT}, from phase {phase:#06x}"
        latching.latch_now(board, m.Points(group))
        judge_points_read_back(board, m.Points(group), name, model)


@case("HG-5.4/3-ends", needs=_COMPUTES, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def streamed_points_lie_at_every_end(board: BoardClient) -> None:
    """points on a transducer, beside it, at the centre, at the ends of each axis: no step is
    wrong
    """
    model = _model_of_streamed_points(board)
    board.arm()
    last = board.identity.transducers - 1
    elements = board.read_geometry()
    places = {(0, 0, 0)}
    for n in {0, last // 2, last}:
        element = elements[n]
        at = (element.x_um, element.y_um, element.z_um)
        places |= {at, (at[0] + 1, at[1], at[2]), (at[0], at[1] - 1, at[2])}
        places |= {(at[0], at[1], z) for z in (-1, 1, 8575, 500_000, 999_999, 1_000_000)}
    for axis in range(3):
        for end in (*_ENDS, *(-end for end in _ENDS)):
            places.add(tuple(end if n == axis else 0 for n in range(3)))  # type: ignore[arg-type]
    places |= {(x, y, z) for x in _FAR for y in _FAR for z in _FAR}
    levels = itertools.cycle(((65_535, 0), (32_768, 0x4000), (40_000, 0xFFFF), (20_000, 0x8000)))
    for place, (level, phase) in zip(sorted(places), levels, strict=False):
        name = f"a point at {place} µm, amplitude {level}, phase {phase:#06x}"
        point = m.FocalPoint(*place, level, phase)
        latching.latch_now(board, m.Points((point,)))
        judge_points_read_back(board, m.Points((point,)), name, model)


@case("HG-5.4/4", needs=m.Feature.POINTS, evidence=SELF_REPORTED)
def counts_the_points_of_a_frame(board: BoardClient) -> None:
    """the most points are latched, more than max_points counted in bad_value, none in bad_length"""
    most = board.identity.max_points
    text = "more points than max_points do not fit into a frame"
    require((most + 1) * m.FocalPoint.LAYOUT.size <= 4000, text)
    size = (min(most + 1, 250) + min(2 * most, 250)) * m.FocalPoint.LAYOUT.size
    board.require_hold(board.wire.period_us(2 * size), f"frames of {most + 1} points and more")
    board.arm()
    point = m.FocalPoint(10_000, 5_000, 150_000, 8_000, 0)
    with board.counting(latched=1, bad_value=2, bad_length=1):
        latching.latch_now(board, m.Points((point,) * board.most_points))
        for number in (most + 1, 2 * most):
            board.link.stream(m.Points((point,) * min(number, 250)))
        board.link.send(board.link.stream_raw(m.Points.TYPE, b""))
        board.clock.wait_latched()
