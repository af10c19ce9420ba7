"""HG-5.2, HG-5.3, HG-5.4: the focus of a latched drive lies on its target.

Targets lie well off every plane of symmetry of a grid: on such a plane a mirrored or transposed
drive is a correct one, and the fault could not be seen.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import TYPE_CHECKING, Final, TypeAlias

from haptogram_protocol.messages import Feature, FocalPoint, Points

from ...case import Depth, case
from ...client.board_client import BoardClient
from ...client.latching import latch_now, read_back
from ...outcome import SELF_REPORTED, check, require

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from haptogram.acoustics import AcousticModel
    from haptogram.driver.frames.frame import Mode

    Errors: TypeAlias = NDArray[np.float64]

_Target: TypeAlias = tuple[float, float, float]
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
_COMPUTES: Final = Feature.POINTS | Feature.READ_LATCHED


def _model_of_streamed_points(board: BoardClient) -> AcousticModel:
    from ...judge.array_model import judged_model_of_board

    return judged_model_of_board(board)


def _judge_latched_foci(board: BoardClient, mode: Mode, targets_m: Sequence[_Target]) -> None:
    """Latch a frame for each focus and read its drive back, then judge them.

    A hold may be shorter than that: where the loops of the search are compiled first, it takes
    seconds.
    """
    from ...judge.focusing import judge_focus, judge_of_model, judged_host_frames

    model, shown = _model_of_streamed_points(board), []
    frames = judged_host_frames(model, board.identity, targets_m, mode)
    board.arm()
    for frame in frames:
        latch_now(board, frame.message)
        shown.append(read_back(board))
    judge = judge_of_model(model)
    for frame, drive in zip(frames, shown, strict=True):
        judge_focus(judge, frame, drive)


@case("HG-5.2/1-focus", needs=Feature.READ_LATCHED, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def streamed_phases_make_a_focus(board: BoardClient) -> None:
    """PHASES for each of several foci: the focus of the latched drive lies on its target"""
    _judge_latched_foci(board, "phases", _TARGETS_M)


@case(
    "HG-5.3/1-focus",
    needs=Feature.READ_LATCHED | Feature.AMPLITUDE,
    evidence=SELF_REPORTED,
    depth=Depth.DEFAULT,
)
def streamed_drives_make_a_focus(board: BoardClient) -> None:
    """DRIVES for each of two foci: the focus of the latched drive lies on its target"""
    _judge_latched_foci(board, "drives", _TARGETS_M[:2])


@case("HG-5.4/1", needs=_COMPUTES, evidence=SELF_REPORTED)
def streamed_points_make_a_focus(board: BoardClient) -> None:
    """POINTS for each of two foci: the focus lies on its target; sign, order and axes are right"""
    _judge_latched_foci(board, "points", _TARGETS_M[:2])


def _random_point_to_stream(board: BoardClient) -> FocalPoint:
    def away(low: int, high: int) -> int:
        return board.random.choice((-1, 1)) * board.random.randrange(low, high)

    return FocalPoint(
        away(4_000, 40_000),
        away(4_000, 40_000),
        board.random.randrange(80_000, 200_000),
        board.random.randrange(10_000, 30_000),
        board.random.randrange(65_536),
    )


def _errors_of_random_points(board: BoardClient, points: int) -> tuple[Errors, Errors]:
    """Latch random superpositions; return the errors of phases and amplitudes, in steps."""
    from ...judge.focusing import judged_amplitude_errors, judged_phase_errors

    model, found = _model_of_streamed_points(board), []
    board.arm()
    for _ in range(max(_MANY, -(-400 // board.identity.transducers))):
        group = tuple(_random_point_to_stream(board) for _ in range(points))
        latch_now(board, Points(group))
        found.append((group, read_back(board)))
    graded = board.has(Feature.AMPLITUDE)
    phases = judged_phase_errors(model, found)
    return phases, judged_amplitude_errors(model, found, graded=graded)


def _check_errors(errors: Errors, name: str) -> None:
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
            _latch_and_judge_points(board, model, group, name)


def _random_point_on_side(
    board: BoardClient, side: tuple[int, int, int], number: int
) -> FocalPoint:
    """Return a point on one side of each axis (0: on its plane), up to 1 m away."""
    longest = board.random.choice((400, 40_000, 1_000_000))
    x, y, z = (sign * board.random.randrange(1, longest + 1) for sign in side)
    level = board.random.choice((0, board.random.randrange(65_535 // number), 65_535 // number))
    return FocalPoint(x, y, z, level, board.random.choice((0, board.random.randrange(65_536))))


def _latch_and_judge_points(
    board: BoardClient, model: AcousticModel, group: tuple[FocalPoint, ...], name: str
) -> None:
    """FAILED if a phase or an amplitude of a frame is off by more than one step."""
    from ...judge.focusing import judge_drive_of_points

    latch_now(board, Points(group))
    judge_drive_of_points(board, model, group, read_back(board), name)


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
            FocalPoint(x, y, z, one, (phase + 0x8000 * (place % 2)) & 0xFFFF)
            for place, one in enumerate(levels)
        )
        name = f"{number} points that cancel but for {_FAINT}, from phase {phase:#06x}"
        _latch_and_judge_points(board, model, group, name)


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
        _latch_and_judge_points(board, model, (FocalPoint(*place, level, phase),), name)


@case("HG-5.4/4", needs=Feature.POINTS, evidence=SELF_REPORTED)
def counts_the_points_of_a_frame(board: BoardClient) -> None:
    """the most points are latched, more than max_points counted in bad_value, none in bad_length"""
    most = board.identity.max_points
    text = "more points than max_points do not fit into a frame"
    require((most + 1) * FocalPoint.LAYOUT.size <= 4000, text)
    size = (min(most + 1, 250) + min(2 * most, 250)) * FocalPoint.LAYOUT.size
    board.require_hold(board.wire.period_us(2 * size), f"frames of {most + 1} points and more")
    board.arm()
    point = FocalPoint(10_000, 5_000, 150_000, 8_000, 0)
    with board.counting(latched=1, bad_value=2, bad_length=1):
        latch_now(board, Points((point,) * board.most_points))
        for number in (most + 1, 2 * most):
            board.link.stream(Points((point,) * min(number, 250)))
        board.link.send(board.link.stream_raw(Points.TYPE, b""))
        board.clock.wait_latched()
