"""Arrays: order, origin, files, refusals."""

import struct
import zlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptogram.acoustics import TransducerArray
from haptogram.acoustics.model.geometry import MAX_COORDINATE_M
from haptogram.errors import ConfigurationError
from strategies_acoustics import grids, seeds


def test_element_number_counts_along_y_first():
    array = TransducerArray.grid(4, 3, pitch_m=0.010)
    for ix in range(4):
        for iy in range(3):
            expected = ((ix - 1.5) * 0.010, (iy - 1.0) * 0.010, 0.0)
            assert array.positions_m[ix * 3 + iy] == pytest.approx(expected, abs=1e-15)


@pytest.mark.filterwarnings("error")
def test_sides_that_are_numbers_of_numpy_are_those_of_python():
    array = TransducerArray.grid(np.uint8(20), np.uint8(20))
    assert array.digest() == TransducerArray.grid(20, 20).digest()


@given(grids())
def test_a_grid_is_centred_faces_up_and_is_symmetric(array):
    assert array.centre_m == pytest.approx([0, 0, 0], abs=1e-12)
    assert (array.normals == [0, 0, 1]).all()
    assert array.positions_m[::-1] == pytest.approx(-array.positions_m, abs=1e-15)
    corner = np.hypot(*(array.pitch_m * (np.array(array.grid_shape) - 1) / 2))
    assert array.aperture_radius_m == pytest.approx(corner + array.pitch_m / 2)


def test_arrays_cannot_be_changed():
    array = TransducerArray.grid(2, 2)
    with pytest.raises(ValueError, match="read-only"):
        array.positions_m[0, 0] = 1.0
    with pytest.raises(AttributeError):
        array.pitch_m = 1.0


def test_an_array_copies_what_it_is_given():
    given_positions = np.array([[0.0, 0, 0], [0.01, 0, 0]])
    array = TransducerArray.from_positions(given_positions)
    given_positions[0, 0] = 9.0
    assert array.positions_m[0, 0] == 0.0


def test_digest_is_the_crc_of_the_elements_as_the_wire_has_them_in_order():
    array = TransducerArray.from_positions([[0.0123456, 0, 0], [-0.001, 0.002, 0.003]])
    records = struct.pack("<3i3h", 12346, 0, 0, 0, 0, 32767)
    records += struct.pack("<3i3h", -1000, 2000, 3000, 0, 0, 32767)
    assert array.digest() == zlib.crc32(records)


@given(seeds, st.integers(1, 40))
def test_what_a_host_learns_on_the_wire_has_the_digest_of_the_array(seed, count):
    """Normals are unit vectors to half a step of an i16: made so again, they round otherwise."""
    rng = np.random.default_rng(seed)
    places = rng.uniform(-0.3, 0.3, (count, 3))
    array = TransducerArray.from_positions(places, rng.normal(size=(count, 3)))
    learned = array.on_wire()
    assert learned.digest() == array.digest()
    assert learned.on_wire().digest() == array.digest()
    np.testing.assert_allclose(learned.normals, array.normals, atol=5e-5)
    np.testing.assert_allclose(np.linalg.norm(learned.normals, axis=1), 1.0, rtol=1e-12)


def test_the_digest_is_that_of_the_numbers_on_the_wire_of_any_board():
    """A board may round its normals as it likes."""
    positions_um, normals = [[1000, 0, 0], [0, 99_000_000, -5]], [[0, 0, 32766], [1, -18918, 26754]]
    records = b"".join(
        struct.pack("<3i3h", *place, *normal)
        for place, normal in zip(positions_um, normals, strict=True)
    )
    array = TransducerArray.from_wire(positions_um, normals)
    assert array.digest() == zlib.crc32(records)
    assert array.normals[0].tolist() == [0.0, 0.0, 1.0]


@given(st.integers(0, 8), st.integers(0, 2), st.sampled_from([2e-6, -2e-6]))
def test_digest_sees_every_coordinate(element, axis, shift):
    array = TransducerArray.grid(3, 3)
    moved = array.positions_m.copy()
    moved[element, axis] += shift
    assert TransducerArray.from_positions(moved).digest() != array.digest()


def test_aperture_without_a_pitch_takes_the_closest_pair():
    array = TransducerArray.from_positions([[-0.010, 0, 0], [0.0, 0, 0], [0.010, 0, 0]])
    assert array.aperture_radius_m == pytest.approx(0.015)
    assert TransducerArray.from_positions([[0.1, 0, 0]]).aperture_radius_m == 0.0


@pytest.mark.parametrize("normals", [False, True])
def test_a_file_gives_the_same_array(tmp_path, normals):
    array = TransducerArray.grid(3, 2, pitch_m=0.0105)
    lines = ["x,y,z,nx,ny,nz" if normals else "# comment\nx, y, z\n"]
    lines += [",".join(f"{1e3 * v:.9g}" for v in p) + ",0,0,2" * normals for p in array.positions_m]
    path = tmp_path / "array.csv"
    path.write_text("\n".join(lines) + "\n\n")
    read = TransducerArray.parse(str(path))
    assert read.digest() == array.digest()
    assert read.grid_shape is None
    assert read.normals == pytest.approx(array.normals)


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", "array.csv: no elements"),
        ("x,y,z\n", "array.csv: no elements"),
        ("a,b,c\n1,2,3\n", "array.csv:1: header is 'a,b,c'"),
        ("x,y,z\n1,2,3\n1,2\n", "array.csv:3: 2 values, must be 3"),
        ("x,y,z\n1,2,3\n\n1,2,wide\n", "array.csv:4: .*wide"),
        ("x,y,z\n1,2," + "3" * 140_000, "array.csv:2: field larger than"),
        ("x,y,z\n1,2,nan\n", "array.csv:2: .*nan"),
        ("x,y,z\n1,2,3\n1,2,3.05\n", "array.csv: elements 0 and 1 are 0.05 mm apart"),
        ("x,y,z,nx,ny,nz\n1,2,3,0,0,0\n", "array.csv: normal of element 0 has no direction"),
    ],
)
def test_a_bad_file_is_refused_with_its_line(tmp_path, text, complaint):
    path = tmp_path / "array.csv"
    path.write_text(text)
    with pytest.raises(ConfigurationError, match=complaint):
        TransducerArray.from_file(path)


def test_a_file_that_is_not_text_is_refused(tmp_path):
    path = tmp_path / "array.bin"
    path.write_bytes(b"\xff\xfe\x00\x01" * 9)
    with pytest.raises(ConfigurationError, match=r"array\.bin"):
        TransducerArray.parse(str(path))


@pytest.mark.parametrize("text", ["16x16", " 16 X 16 "])
def test_parse_reads_a_grid(text):
    array = TransducerArray.parse(text, pitch_m=0.0105)
    assert array.digest() == TransducerArray.grid(16, 16, pitch_m=0.0105).digest()


@pytest.mark.parametrize(
    ("make", "complaint"),
    [
        (lambda: TransducerArray.grid(0, 4), "side of the grid is 0"),
        (lambda: TransducerArray.grid(33, 32), "1056 transducers, must be 1 to 1024"),
        (lambda: TransducerArray.grid(99999, 99999), "must be 1 to 1024"),
        (lambda: TransducerArray.grid(4, 4, pitch_m=0.0), "pitch_m is 0"),
        (lambda: TransducerArray.grid(4, 4, pitch_m=float("nan")), "pitch_m is nan"),
        (lambda: TransducerArray.grid(4, 4, pitch_m=1e-5), r"0\.01 mm apart.*0\.1 mm"),
        (lambda: TransducerArray.parse("16x"), "16x"),
        (lambda: TransducerArray.parse("no such file.csv"), "no such file.csv"),
        (lambda: TransducerArray.from_positions([[0, 0]]), r"\(1, 2\), must be \(M, 3\)"),
        (lambda: TransducerArray.from_positions(np.empty((0, 3))), "0 transducers"),
        (lambda: TransducerArray.from_positions([[0, 0, np.inf]]), "inf, must be finite"),
        (lambda: TransducerArray.from_positions([[0, 0, 101.0]]), f"101 m.*{MAX_COORDINATE_M:g} m"),
        (lambda: TransducerArray.from_positions("abc"), "not an array of numbers"),
        (lambda: TransducerArray.from_positions([[0, 0, 0]], [[0, 0, 1]] * 2), r"must be \(1, 3\)"),
        (lambda: TransducerArray(np.zeros((1, 3)), np.ones((1, 3)), (2, 2)), "does not hold 1"),
    ],
)
def test_a_bad_array_is_refused_with_value_and_limit(make, complaint):
    with pytest.raises(ConfigurationError, match=complaint):
        make()
