from __future__ import annotations

import functools
import re
from collections.abc import Callable
from typing import TYPE_CHECKING
from xml.etree import ElementTree

import numpy as np
import pytest

from haptogram.acoustics import AcousticModel, Drive, TransducerArray
from haptogram.report.figures.style import embed_picture
from haptogram.report.run import pictures
from haptogram.report.run.fieldmap import field_rms_kpa, frame_field_picture
from haptogram.report.run.series import (
    plotted_bounds_mm,
    plotted_focus_mm,
    plotted_frames_of_run,
    plotted_relative_error,
    worst_frames_of_run,
)
from haptogram.verification import FrameStatus, RunVerdict
from judged_runs import aim, damage, delay, hide, lose, make_run, targets

pytestmark = pytest.mark.sampled(3)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

pytest.importorskip("matplotlib")

Scene = tuple[RunVerdict, AcousticModel]

PICTURES: dict[str, Callable[[RunVerdict, AcousticModel], Figure]] = {
    "foci": pictures.draw_run_foci,
    "errors": pictures.draw_run_errors,
    "field": lambda run, model: field(run, model, close=False),
    "close-up of the field": lambda run, model: field(run, model, close=True),
    "along_object": lambda run, _: pictures.draw_run_along_object(run),
    "lateness": pictures.draw_run_lateness,
}
_COLOUR = re.compile(rb"#[0-9a-f]{6}")
_THEMED = {b"#000000", b"#ffffff", b"#dddddd", b"#555555", b"#e4e6e8", b"#16181b", b"#3a3f45"}


def field(run: RunVerdict, model: AcousticModel, *, close: bool) -> Figure:
    shown = frame_field_picture(run, model, None, 8)
    assert shown is not None
    return pictures.draw_run_field(shown, model, close=close)


def line_model() -> AcousticModel:
    plane = AcousticModel.default(2, 2)
    return AcousticModel(TransducerArray.grid(128, 1), plane.medium, plane.transducer)


def along_x(count: int) -> np.ndarray:
    return np.array([(x, 0.0, 0.15) for x in np.linspace(-0.1, 0.1, count)])


@functools.cache
def scene(name: str) -> Scene:
    model = AcousticModel.default(6, 6)
    match name:
        case "no frames":
            return make_run(model, []), model
        case "one frame":
            return make_run(model, targets(1)), model
        case "nothing verified":
            return make_run(model, targets(3), {0: lose, 1: hide, 2: lose}), model
        case "line":
            return make_run(line_model(), along_x(3)), line_model()
        case "column":
            tall = AcousticModel(TransducerArray.grid(1, 16), model.medium, model.transducer)
            return make_run(tall, along_x(1)[:, [1, 0, 2]] + [0.0, 0.1, 0.0]), tall
    moved = targets(6)[5] + [3e-3, 0.0, 0.0]
    changes = {1: lose, 2: delay, 3: damage, 4: hide, 5: aim(model, moved)}
    return make_run(model, targets(6), changes), model


SCENES = ["no frames", "one frame", "nothing verified", "line", "everything"]
#: The field alone looks for the longer side.
CASES = [
    *(
        (place, name)
        for place in SCENES
        for name in PICTURES
        if (place, "field") != (SCENES[0], name[-5:])
    ),
    ("column", "field"),
]


@pytest.mark.sampled(1)
@pytest.mark.parametrize(("place", "name"), CASES)
def test_every_run_gives_every_picture(place: str, name: str) -> None:
    svg = embed_picture(PICTURES[name](*scene(place)), name).svg
    root = ElementTree.fromstring(svg)
    width, height = (float(root.attrib[side].removesuffix("pt")) for side in ("width", "height"))
    assert width == pytest.approx(367.2 if "field" in name else 576.0)
    assert 0.33 * width <= height <= width
    # In a dark page nothing is black on black: all but the colours of data follows the theme.
    drawn = svg[svg.index(b"</style>") :]
    assert set(_COLOUR.findall(drawn)).isdisjoint(_THEMED)
    assert b"prefers-color-scheme:dark" in svg


def test_the_same_run_gives_the_same_picture(good_run: RunVerdict, model: AcousticModel) -> None:
    svg, again = (
        embed_picture(pictures.draw_run_errors(good_run, model), "").svg for _ in range(2)
    )
    assert svg == again


@pytest.mark.nightly
def test_many_points_become_pixels(model: AcousticModel) -> None:
    few, many = (make_run(model, targets(count)) for count in (300, 600))
    sizes = [len(embed_picture(pictures.draw_run_foci(run, model), "").svg) for run in (few, many)]
    assert sizes[1] < sizes[0]


def test_a_picture_leaves_the_settings_of_the_user_alone(good_run: RunVerdict) -> None:
    import matplotlib

    usual = embed_picture(pictures.draw_run_along_object(good_run), "")
    with matplotlib.rc_context({"font.size": 31.0}):
        assert embed_picture(pictures.draw_run_along_object(good_run), "") == usual
        assert matplotlib.rcParams["font.size"] == 31.0


# --- What the pictures show --------------------------------------------------------------------


def test_the_peak_of_the_field_is_where_the_focus_is(
    good_run: RunVerdict, model: AcousticModel
) -> None:
    shown = frame_field_picture(good_run, model, None, 8)
    assert shown is not None
    assert not shown.latched
    away_m = np.array(shown.level.peak_m()) - shown.frame.target_m
    assert np.hypot(*away_m[:2]) < 1.5e-3
    assert np.ptp(shown.level.plane.horizontal_m) == pytest.approx(0.160)
    # The unit is that of the verdict: kPa RMS at the focus.
    assert shown.frame.pressure_rms_pa is not None
    middle = field_rms_kpa(shown.close_level)[30, 30]
    assert 1e3 * middle == pytest.approx(shown.frame.pressure_rms_pa, rel=5e-3)


def test_a_drive_that_is_given_is_the_one_that_is_shown(model: AcousticModel) -> None:
    points = targets(4)
    elsewhere = points[2] + [0.012, 0.0, 0.0]
    run = make_run(model, points, {2: aim(model, elsewhere)})
    assert run.frames[2].status is FrameStatus.OFF_TARGET
    ideal = frame_field_picture(run, model, None, 8)
    assert ideal is not None
    assert ideal.frame.number != 2  # an ideal drive would belie the frame that was wrong
    drives = {2: _drive(model, elsewhere)}
    shown = frame_field_picture(run, model, drives, 8)
    assert shown is not None
    assert (shown.latched, shown.frame.number) == (True, 2)
    assert shown.close_level.peak_m()[0] == pytest.approx(elsewhere[0], abs=1e-3)


def _drive(model: AcousticModel, point: np.ndarray) -> Drive:
    from haptogram.acoustics import focus_phases

    return Drive.from_weights(np.exp(1j * focus_phases(model, point)))


def test_a_point_inside_an_element_is_left_out() -> None:
    plane = AcousticModel.default(4, 4)
    raised = plane.array.positions_m.copy()
    raised[5, 2] = 0.040  # an element that stands in the vertical plane
    model = AcousticModel(TransducerArray.from_positions(raised), plane.medium, plane.transducer)
    run = make_run(model, [(float(raised[5, 0]), float(raised[5, 1]), 0.15)])
    shown = frame_field_picture(run, model, None, 8)
    assert shown is not None
    assert np.isnan(shown.upright.values).any()
    assert np.isfinite(shown.most_kpa)


def test_a_coordinate_that_cannot_be_observed_has_no_error() -> None:
    run, model = scene("line")
    frame = run.frames[0]
    assert plotted_focus_mm(frame)[1:] == pytest.approx([0.0, 150.0], abs=1e-12)
    assert frame.bound_mm is not None
    assert plotted_relative_error(frame) == pytest.approx(
        abs(plotted_focus_mm(frame)[0] + 100.0) / frame.bound_mm[0]
    )
    assert plotted_bounds_mm(model, frame) is None  # across the beam is along y, too


def test_errors_stay_within_the_bounds_that_are_drawn(
    good_run: RunVerdict, model: AcousticModel
) -> None:
    for frame in good_run.frames:
        bounds = plotted_bounds_mm(model, frame)
        assert bounds is not None
        assert frame.lateral_error_mm is not None
        assert frame.lateral_error_mm <= bounds[0]
        assert frame.axial_error_mm is not None
        assert bounds[1] is not None
        assert abs(frame.axial_error_mm) <= bounds[1]


def test_the_worst_frames_come_first() -> None:
    run, _ = scene("everything")
    first, second, *rest = worst_frames_of_run(run, 10)
    assert {first.number, second.number} == {3, 5}
    errors = [plotted_relative_error(frame) or 0.0 for frame in rest]
    assert errors == sorted(errors, reverse=True)


def test_thinning_keeps_what_went_wrong() -> None:
    run, _ = scene("everything")
    kept = [frame.number for frame in plotted_frames_of_run(run.frames, 2)]
    assert kept == [0, 1, 3, 4, 5]
    assert plotted_frames_of_run(run.frames, 6) == run.frames


def test_a_tilted_and_a_sideways_array_have_their_field_drawn(model: AcousticModel) -> None:
    turns = {
        "tilted": np.array([[1.0, 0.0, 0.0], [0.0, 0.866, -0.5], [0.0, 0.5, 0.866]]),
        "sideways": np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]]),
    }
    for turn in turns.values():
        rotation, _ = np.linalg.qr(turn)
        rotation *= np.sign(np.diag(rotation.T @ turn))
        array = model.array.moved(rotation, (0.0, 0.0, 0.1))
        placed = AcousticModel(array, model.medium, model.transducer)
        target = rotation @ np.array([0.01, 0.0, 0.12]) + np.array([0.0, 0.0, 0.1])
        shown = frame_field_picture(make_run(placed, [target]), placed, None, 8)
        assert shown is not None
        assert shown.most_kpa > 1.0
        low_m, high_m = shown.upright.plane.vertical_m
        assert low_m < target[2] < high_m
