"""Points of the shapes: on the shape, evenly spread, in an order without long jumps."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from haptogram.errors import ConfigurationError
from haptogram.objects.shapes import MAX_POINTS, Circle, Hemisphere, Line, Point, Sphere

CENTER_M = (0.01, -0.02, 0.12)
RADIUS_M = 0.05
RESOLUTIONS_M = (0.020, 0.010, 0.005, 0.002)  # those of the paper

SHAPES = {
    "line": Line((-0.05, 0.01, 0.1), (0.04, -0.02, 0.15)),
    "circle": Circle(RADIUS_M, CENTER_M),
    "sphere": Sphere(RADIUS_M, CENTER_M),
    "lower half": Hemisphere(RADIUS_M, CENTER_M),
    "upper half": Hemisphere(RADIUS_M, CENTER_M, lower=False),
}
every_shape = pytest.mark.parametrize("shape", SHAPES.values(), ids=SHAPES)
every_resolution = pytest.mark.parametrize("resolution_m", RESOLUTIONS_M)

# From 1 m to a tenth of a millimetre, but never so fine as to have too many points.
radii_m = st.floats(0.005, 0.5)
shares = st.floats(0.02, 1.0)


def jumps(points, closed=False):
    last = points[:1] if closed else points[-1:]
    steps = np.linalg.norm(np.diff(np.concatenate([points, last]), axis=0), axis=1)
    return steps if closed else steps[:-1]


def nearest_neighbours(points):
    return cKDTree(points).query(points, k=2)[0][:, 1]


def distance_from_line(points, line):
    start, end = np.array(line.start_m), np.array(line.end_m)
    along = (end - start) / np.linalg.norm(end - start)
    offsets = points - start
    return np.linalg.norm(offsets - np.outer(offsets @ along, along), axis=1)


@every_shape
@every_resolution
def test_neighbours_are_about_a_resolution_apart(shape, resolution_m):
    nearest = nearest_neighbours(shape.sample(resolution_m)) / resolution_m
    # The number of rings, and of points on each, is whole: at 20 mm the rounding shows.
    assert nearest.min() > 0.45
    assert nearest.max() < 1.35
    assert 0.75 < np.median(nearest) < 1.25


@every_shape
@every_resolution
def test_no_jump_is_much_longer_than_a_resolution(shape, resolution_m):
    steps = jumps(shape.sample(resolution_m)) / resolution_m
    assert steps.max() < 2.3
    if not isinstance(shape, Line):  # which skips every other point, on the way out and back
        assert np.median(steps) < 1.25


@every_shape
def test_sampling_repeats_exactly(shape):
    np.testing.assert_array_equal(shape.sample(0.005), shape.sample(0.005))


@every_shape
def test_no_point_comes_twice(shape):
    points = shape.sample(0.005)
    assert len(np.unique(points.round(9), axis=0)) == len(points)


@every_resolution
def test_the_paper_s_hemisphere_has_its_area_in_points(resolution_m):
    count = len(SHAPES["lower half"].sample(resolution_m))
    squares = 2.0 * math.pi * (RADIUS_M / resolution_m) ** 2
    # Half a ring hangs over the rim: 2 pi R d / 2 of it.
    assert squares < count < squares + 1.3 * math.pi * RADIUS_M / resolution_m + 3


@given(radii_m, shares)
def test_points_of_spheres_lie_on_them(radius_m, share):
    points = Sphere(radius_m, CENTER_M).sample(2.0 * radius_m * share)
    distances = np.linalg.norm(points - CENTER_M, axis=1)
    np.testing.assert_allclose(distances, radius_m, rtol=1e-12)


@given(radii_m, shares, st.booleans())
def test_a_half_sphere_begins_at_its_pole_and_ends_on_its_rim(radius_m, share, lower):
    points = Hemisphere(radius_m, CENTER_M, lower=lower).sample(2.0 * radius_m * share)
    sign = -1.0 if lower else 1.0
    heights = sign * (points[:, 2] - CENTER_M[2])
    np.testing.assert_allclose(points[0], np.add(CENTER_M, (0, 0, sign * radius_m)), atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(points - CENTER_M, axis=1), radius_m, rtol=1e-12)
    assert heights.min() > -1e-12
    assert abs(heights[-1]) < 1e-12  # the rim


def test_the_upper_half_mirrors_the_lower_one():
    lower, upper = (SHAPES[name].sample(0.005) - CENTER_M for name in ("lower half", "upper half"))
    np.testing.assert_allclose(upper, lower * (1, 1, -1), atol=1e-15)


@given(radii_m, shares)
def test_points_of_circles_lie_on_them(radius_m, share):
    points = Circle(radius_m, CENTER_M).sample(2.0 * radius_m * share)
    np.testing.assert_allclose(np.linalg.norm(points - CENTER_M, axis=1), radius_m, rtol=1e-12)
    np.testing.assert_array_equal(points[:, 2], CENTER_M[2])
    assert np.ptp(jumps(points, closed=True)) < 1e-12  # also from the last to the first


@given(
    st.tuples(st.floats(-0.1, 0.1), st.floats(-0.1, 0.1), st.floats(0.05, 0.2)),
    st.tuples(st.floats(0.2, 0.3), st.floats(-0.1, 0.1), st.floats(0.05, 0.2)),
    st.floats(0.005, 1.0),
)
def test_a_line_runs_out_and_back_and_closes(start_m, end_m, share):
    line = Line(start_m, end_m)
    length_m = math.dist(start_m, end_m)
    points = line.sample(length_m * share)
    spacing_m = length_m / (len(points) - 1)
    assert distance_from_line(points, line).max() < 1e-12
    assert jumps(points, closed=True).max() < 2.0 * spacing_m + 1e-12
    for end in (start_m, end_m):
        assert np.linalg.norm(points - end, axis=1).min() < 1e-12
    assert np.ptp(nearest_neighbours(points)) < 1e-12
    assert spacing_m == pytest.approx(length_m * share, rel=0.5)


def test_a_point_is_one_point():
    np.testing.assert_array_equal(Point(CENTER_M).sample(0.002), [CENTER_M])


@every_shape
@pytest.mark.parametrize("resolution_m", [0.0, -0.001, math.nan, math.inf, 9e-6])
def test_a_resolution_that_is_none_is_refused(shape, resolution_m):
    with pytest.raises(ConfigurationError, match=r"resolution_m is .*, must be 1e-05 to 100"):
        shape.sample(resolution_m)


@pytest.mark.parametrize("resolution_m", [0.0, math.nan])
def test_a_point_checks_its_resolution_too(resolution_m):
    with pytest.raises(ConfigurationError, match="resolution"):
        Point(CENTER_M).sample(resolution_m)


@every_shape
def test_a_resolution_coarser_than_the_shape_is_refused(shape):
    with pytest.raises(ConfigurationError, match=r"200 mm, must not be more than the object's \d+"):
        shape.sample(0.2)


@pytest.mark.parametrize("shape", [Line((0, 0, 0.1), (5, 0, 0.1)), Sphere(0.5, CENTER_M)])
def test_too_many_points_are_refused_before_they_are_made(shape):
    with pytest.raises(ConfigurationError, match=f"must be {MAX_POINTS} or fewer"):
        shape.sample(1e-5)


@pytest.mark.parametrize("kind", [Circle, Sphere, Hemisphere])
@pytest.mark.parametrize("radius_m", [0.0, -0.01, math.nan, math.inf])
def test_a_radius_that_is_none_is_refused(kind, radius_m):
    with pytest.raises(ConfigurationError, match=r"radius_m is .*, must be 1e-05 to 100"):
        kind(radius_m, CENTER_M)


@pytest.mark.parametrize("place", [(0, 0), (0, 0, math.nan), (0, math.inf, 0)])
@pytest.mark.parametrize(
    "make",
    [
        Point,
        lambda place: Line(place, CENTER_M),
        lambda place: Line(CENTER_M, place),
        lambda place: Circle(RADIUS_M, place),
        lambda place: Sphere(RADIUS_M, place),
        lambda place: Hemisphere(RADIUS_M, place),
    ],
)
def test_a_place_that_is_none_is_refused(make, place):
    with pytest.raises(ConfigurationError, match=r"must be (three numbers|within 100 m)"):
        make(place)
