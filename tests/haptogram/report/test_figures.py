"""Pictures: what is sampled, where marks lie, and that files say what they should."""

import math
import re
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptogram.acoustics import (
    AcousticModel,
    NumpyEngine,
    PointSource,
    Transducer,
    focus_phases,
    pressure,
)
from haptogram.acoustics.levels.dynamics import Resonator
from haptogram.errors import ConfigurationError
from haptogram.report.figures import (
    PicturePlane,
    check_picture_format,
    draw_plane_figure,
    encode_figure,
    figure_quantity_and_label,
    sample_picture_mean,
    sample_picture_plane,
)
from haptogram.report.figures.style import embed_picture, new_figure

pytestmark = pytest.mark.sampled(3)

MODEL = AcousticModel.default(8, 8)
ENGINE = NumpyEngine(MODEL)
AIR = ENGINE.model.medium
TARGET = (0.01, -0.005, 0.08)
WEIGHTS = np.exp(1j * focus_phases(MODEL, TARGET))
MARKS = {"target", "peak"}
PLANE = PicturePlane("xy", TARGET, (-0.03, 0.03), (-0.02, 0.02), 2e-3)


def field(plane=PLANE):
    return sample_picture_plane(ENGINE, WEIGHTS, plane)


@given(st.sampled_from(["xy", "xz", "yz"]), st.integers(0, 5), st.integers(0, 5))
def test_a_plane_holds_the_field_at_its_points(orientation, i, j):
    plane = PicturePlane(orientation, (0.003, 0.004, 0.06), (0.01, 0.03), (0.05, 0.07), 4e-3)
    values = field(plane).values
    across, up = plane.coordinates_m()
    assert values.shape == (len(up), len(across)) == (6, 6)
    point = np.array([0.003, 0.004, 0.06])
    point["xyz".index(orientation[0])] = across[i]
    point["xyz".index(orientation[1])] = up[j]
    assert values[j, i] == pytest.approx(pressure(MODEL, WEIGHTS, [point])[0], rel=1e-12)


def mean_field():
    return sample_picture_mean(ENGINE, WEIGHTS[None], PLANE, 1e-3, Resonator(1e-3))


def test_the_peak_of_a_plane_lies_at_its_focus():
    assert math.dist(field().peak_m(), TARGET) < 3e-3


def test_points_next_to_an_element_are_left_out():
    values = field(PicturePlane("xz", (0.005, 0.005, 0.0), (-0.05, 0.05), (0.0, 0.02), 1e-3)).values
    assert np.isnan(values).any()
    assert np.isfinite(values).sum() > 0.9 * values.size


def test_progress_reaches_its_end(monkeypatch):
    monkeypatch.setattr("haptogram.report.figures.planes._POINTS_PER_CALL", 100)
    told = []
    values = sample_picture_plane(
        ENGINE, WEIGHTS, PLANE, lambda done, of: told.append((done, of))
    ).values
    assert told[-1] == (values.size, values.size)
    assert len(told) == math.ceil(values.size / 100)
    monkeypatch.undo()
    assert values == pytest.approx(field().values, rel=1e-12)


def test_force_is_the_same_for_a_drive_and_for_its_mean():
    assert figure_quantity_and_label(AIR, mean_field().values, "force")[0] == pytest.approx(
        figure_quantity_and_label(AIR, field().values, "force")[0], rel=1e-9
    )


def test_a_drawn_plane_has_units_and_marks_where_they_belong():
    figure = draw_plane_figure(field(), targets_m=[TARGET, (0.0, 0.0, 0.2)])
    axes, bar = figure.axes
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("x (mm)", "y (mm)")
    assert "Pa" in bar.get_ylabel()
    image = axes.images[0]
    assert image.get_extent() == pytest.approx([-31.0, 31.0, -21.0, 21.0])
    marks = {line.get_label(): line.get_xydata()[0] for line in axes.lines}
    assert marks["target"] == pytest.approx([10.0, -5.0])
    assert marks["peak"] == pytest.approx(np.array(field().peak_m()[:2]) * 1e3)
    rms = np.abs(field().values) / math.sqrt(2.0)
    scale = 1e3 if "kPa" in bar.get_ylabel() else 1.0
    assert scale * np.asarray(image.get_array()) == pytest.approx(rms)


def test_phase_and_force_are_drawn_as_such():
    phase = draw_plane_figure(field(), quantity="phase").axes
    assert phase[0].images[0].get_clim() == (-math.pi, math.pi)
    assert "rad" in phase[1].get_ylabel()
    force = draw_plane_figure(field(), quantity="force").axes
    assert np.asarray(force[0].images[0].get_array()) == pytest.approx(
        figure_quantity_and_label(AIR, field().values, "force")[0]
    )


@pytest.mark.nightly
def test_pictures_are_repeatable():
    svg, again = (
        encode_figure(draw_plane_figure(field(), targets_m=[TARGET]), ".svg") for _ in range(2)
    )
    assert svg == again
    assert b"pressure (kPa RMS)" in svg


def test_a_picture_says_what_it_is_of_and_where_and_marks_target_and_peak():
    picture = draw_plane_figure(field(), targets_m=[TARGET], title="a focus")
    axes = picture.axes[0]
    assert axes.get_title(loc="left") == "a focus\nplane z = 80 mm"
    assert set(axes.get_legend_handles_labels()[1]) == MARKS
    elsewhere = draw_plane_figure(field(), peak_m=(0.02, 0.01, 0.08)).axes[0]
    assert elsewhere.get_title(loc="left") == "plane z = 80 mm"
    assert [float(line.get_xdata()[0]) for line in elsewhere.lines[:2]] == [20.0, 20.0]


@pytest.mark.sampled(1)
@pytest.mark.parametrize("up_m", [(0.04, 0.14), (0.005, 0.06), (0.005, 0.70)])
def test_nothing_of_a_picture_is_cut_whatever_the_shape_of_its_plane(up_m):
    plane = PicturePlane("xz", TARGET, (-0.06, 0.06), up_m, 5e-3)
    picture = draw_plane_figure(field(plane), targets_m=[TARGET], title="a focus with a long name")
    picture.draw_without_rendering()
    whole, (width_in, height_in) = picture.get_tightbbox(), picture.get_size_inches()
    assert whole.x0 >= 0.0
    assert whole.y0 >= 0.0
    assert whole.x1 <= width_in
    assert whole.y1 <= height_in
    legend = picture.legends[0].get_window_extent()
    assert legend.y1 < picture.axes[0].xaxis.label.get_window_extent().y0


@pytest.mark.parametrize(
    "make",
    [
        lambda: PicturePlane("xx", TARGET, (0.0, 1.0), (0.0, 1.0)),
        lambda: PicturePlane("xy", TARGET, (0.0, 0.0), (0.0, 1.0)),
        lambda: PicturePlane("xy", TARGET, (0.0, math.nan), (0.0, 1.0)),
        lambda: PicturePlane("xy", TARGET, (0.0, 1.0), (0.0, 1.0), 0.0),
        lambda: PicturePlane("xy", TARGET, (0.0, 1.0), (0.0, 1.0), 1e-6),
        lambda: field(PicturePlane("xy", (0, 0, 1e-4), (0.0050, 0.0052), (0.0050, 0.0052), 1e-4)),
        lambda: draw_plane_figure(field(), quantity="colour"),
        lambda: draw_plane_figure(mean_field(), quantity="phase"),
        lambda: check_picture_format(Path("field.gif")),
    ],
)
def test_impossible_pictures_are_refused(make):
    with pytest.raises(ConfigurationError):
        make()


def test_a_plane_behind_the_array_is_refused_and_one_that_cuts_it_is_not():
    behind = PicturePlane("xy", (0.0, 0.0, -0.02), (-0.03, 0.03), (-0.02, 0.02), 5e-3)
    with pytest.raises(ConfigurationError, match="20 mm behind the baffle"):
        field(behind)
    half = field(PicturePlane("xz", (0.0, 0.0, 0.0), (-0.03, 0.03), (-0.02, 0.02), 5e-3)).values
    assert np.isnan(half[:4]).all()
    assert np.nanmin(np.abs(half[5:])) > 0.0
    everywhere = AcousticModel(MODEL.array, MODEL.medium, Transducer(PointSource()))
    assert np.abs(sample_picture_plane(NumpyEngine(everywhere), WEIGHTS, behind).values).min() > 0.0


def labelled(axes):
    return {line.get_label(): line.get_xydata() for line in axes.lines}


UPRIGHT = PicturePlane("xz", TARGET, (-0.06, 0.06), (0.005, 0.12), 4e-3)


def test_the_array_lies_below_an_upright_plane():
    axes = draw_plane_figure(field(UPRIGHT)).axes[0]
    elements = labelled(axes)["transducers"]
    assert sorted(map(tuple, elements)) == sorted(
        map(tuple, 1e3 * MODEL.array.positions_m[:, [0, 2]])
    )
    assert axes.get_ylim()[0] < 0.0 < axes.get_ylim()[1]


def test_an_array_that_is_far_off_leaves_the_picture_as_it_is():
    axes = draw_plane_figure(
        field(PicturePlane("xz", TARGET, (-0.03, 0.03), (0.07, 0.09), 2e-3))
    ).axes[0]
    assert "transducers" not in labelled(axes)
    assert axes.get_ylim() == pytest.approx((69.0, 91.0))


@pytest.mark.parametrize("quantity", ["pressure", "force"])
def test_decibels_are_relative_to_the_largest_value(quantity):
    image, bar = draw_plane_figure(field(), quantity=quantity, decibels=True).axes
    values = np.asarray(image.images[0].get_array())
    level = 20.0 * np.log10(np.abs(field().values) / np.abs(field().values).max())
    assert values == pytest.approx(np.maximum(level, -40.0))
    assert image.images[0].get_clim() == (-40.0, 0.0)
    assert "dB; 0 dB is " in bar.get_ylabel()
    with pytest.raises(ConfigurationError, match="no level in decibels"):
        draw_plane_figure(field(), quantity="phase", decibels=True)


_COLOUR = re.compile(rb"#[0-9a-f]{6}")
_THEMED = {b"#000000", b"#ffffff", b"#dddddd", b"#555555", b"#e4e6e8", b"#16181b", b"#3a3f45"}


def test_in_a_dark_page_nothing_is_black_on_black():
    svg = embed_picture(draw_plane_figure(field()), "").svg
    drawn = svg[svg.index(b"</style>") :]
    assert set(_COLOUR.findall(drawn)).isdisjoint(_THEMED)
    assert b"prefers-color-scheme:dark" in svg


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("name", ["a$\\frac{$b", "日本", "a\x1b[31m\x00", "<b>&", "ü\nzwei"])
def test_a_name_of_any_signs_stands_in_a_picture_as_it_is(name):
    with new_figure() as figure:
        figure.add_subplot().set_xlabel(name)
    texts = ElementTree.fromstring(embed_picture(figure, "").svg).itertext()
    shown = "".join(sign if sign >= " " or sign == "\n" else "\ufffd" for sign in name)
    assert set(shown.split("\n")) <= {text.strip() for text in texts}


def test_a_picture_leaves_the_settings_of_the_user_alone():
    import matplotlib

    usual = embed_picture(draw_plane_figure(field()), "")
    with matplotlib.rc_context({"font.size": 31.0}):
        assert embed_picture(draw_plane_figure(field()), "") == usual
        assert matplotlib.rcParams["font.size"] == 31.0
