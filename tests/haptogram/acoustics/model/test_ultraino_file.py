"""Array files of Ultraino: what Java's XMLEncoder wrote of such objects, and what is no such file.

``tests/data/dialects/arrays`` holds what the encoder of Java 17 wrote of three transducers whose
vectors have public fields (``fields.xml``) or setters (``properties.xml``).
"""

import gzip
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dialect_boards import DialectBoard
from haptogram.acoustics.model.boards.ultraino_file import (
    MAX_BYTES,
    MAX_ELEMENTS,
    read_ultraino_array,
)
from haptogram.errors import ConfigurationError

FILES = Path(__file__).parents[3] / "data" / "dialects" / "arrays"
both = pytest.mark.parametrize("name", ["fields", "properties"])


@both
@pytest.mark.parametrize("packed", [False, True])
def test_transducers_come_in_the_order_of_their_numbers(name, packed, tmp_path):
    path = FILES / f"{name}.xml"
    if packed:
        path = tmp_path / f"{name}.xml.gz"
        path.write_bytes(gzip.compress((FILES / f"{name}.xml").read_bytes()))
    found = read_ultraino_array(path)
    assert found.numbers == (0, 1, 2)
    expected = [[-0.01, -0.005, 0], [0, -0.005, 0], [0.01, -0.005, 0]]
    assert np.allclose(found.array.positions_m, expected)
    assert np.allclose(found.array.normals, [[0, 0, 1], [0, 0, 1], [0, 0, -1]])  # half a turn of x
    assert np.allclose(found.corrections_rad, [0, np.pi, 0])
    turned = read_ultraino_array(path, "driverPinNumber")
    assert np.allclose(turned.array.positions_m, expected[::-1])


@both
def test_a_board_has_the_emitters_of_the_file(name):
    board = DialectBoard("ultraino-fpga", array=str(FILES / f"{name}.xml"))
    assert board.settings.wiring.channels == (0, 1, 2)
    assert np.allclose(board.settings.calibration.phase_rad, [0, -np.pi, 0])
    assert board.latches[0].pulses.count == 256
    assert board.latches[0].radiated.shape == (3,)


FINE = (FILES / "properties.xml").read_text()
REFUSED = {
    "an entity": (FINE.replace("<java", '<!DOCTYPE a [<!ENTITY b "c">]><java', 1), "document type"),
    "an outer entity": (
        FINE.replace("<java", '<!DOCTYPE a [<!ENTITY b SYSTEM "file:///etc/passwd">]><java', 1),
        "document type",
    ),
    "another file": ("<a/>", "0 transducers"),
    "no XML": ("x,y,z", "line 1 is not XML"),
    "an unknown encoding": (FINE.replace("UTF-8", "UTF-88"), "encoding cannot be read"),
    "an encoding of many bytes": (FINE.replace("UTF-8", "shift_jis"), "encoding cannot be read"),
    "half a file": (FINE[: len(FINE) // 2], "not whole"),
    "depth": ("<void>" * 500, "nested"),
    "two of a number": (FINE.replace("<int>2</int>", "<int>1</int>"), "same orderNumber"),
    "no pins": (
        FINE.replace("<int>2</int>", "<int>0</int>").replace("<int>1</int>", "<int>0</int>"),
        "of all 3 transducers is 0: none is assigned to a pin yet",
    ),
    "no number": (FINE.replace("<int>2</int>", "<int>two</int>"), "no number"),
    "infinite": (FINE.replace("<float>0.005</float>", "<float>Infinity</float>"), "no finite"),
    "between": (FINE.replace("<int>2</int>", "<float>2.5</float>"), "whole number"),
    "far away": (FINE.replace("<float>0.005</float>", "<float>1e30</float>"), "m"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_no_array_file_is_one_line_with_its_name(name, tmp_path):
    text, says = REFUSED[name]
    path = tmp_path / "array.xml"
    path.write_text(text)
    with pytest.raises(ConfigurationError, match=says) as refused:
        read_ultraino_array(path)
    assert str(path) in str(refused.value)
    assert "\n" not in str(refused.value)


MIB = gzip.compress(bytes(1 << 20))
BOMBS = {
    "one byte too much": gzip.compress(bytes(MAX_BYTES + 1)),
    "4 GiB": MIB * 4096,
    "elements": gzip.compress(b"<a>" + b"<b id='0'/>" * (MAX_BYTES // 12)),
    "named elements": gzip.compress(
        b"<a>" + b"".join(b"<b id='%d'/>" % n for n in range(MAX_ELEMENTS + 1))
    ),
}


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", BOMBS)
def test_a_file_that_unpacks_to_much_is_not_unpacked(name, tmp_path):
    path = tmp_path / "array.xml.gz"
    path.write_bytes(BOMBS[name])
    with pytest.raises(ConfigurationError, match="more than"):
        read_ultraino_array(path)


def test_what_was_packed_twice_or_not_wholly_is_refused(tmp_path):
    path = tmp_path / "array.xml.gz"
    path.write_bytes(gzip.compress(gzip.compress(FINE.encode())))
    with pytest.raises(ConfigurationError, match="not XML"):
        read_ultraino_array(path)
    path.write_bytes(gzip.compress(FINE.encode())[:-20])
    with pytest.raises(ConfigurationError, match="cannot be read"):
        read_ultraino_array(path)
    with pytest.raises(ConfigurationError, match="cannot be read"):
        read_ultraino_array(tmp_path / "none.xml")


TAGS = st.sampled_from(["object", "void", "float", "int", "string", "array", "null", "java"])
ATTRIBUTES = st.dictionaries(
    st.sampled_from(["class", "method", "property", "id", "idref", "index", "field"]),
    st.sampled_from(["a", "b", "getField", "set", "get", "add", "transducers", "x", "0"]),
    max_size=3,
)


@st.composite
def elements(draw, depth=0):
    tag, attributes = draw(TAGS), draw(ATTRIBUTES)
    words = "".join(f' {name}="{value}"' for name, value in attributes.items())
    inside = draw(st.sampled_from(["", "1", "x", "transducers"]))
    if depth < 4:
        inside += "".join(draw(st.lists(elements(depth + 1), max_size=3)))
    return f"<{tag}{words}>{inside}</{tag}>"


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    return tmp_path_factory.mktemp("any") / "array.xml"


@given(text=elements())
def test_any_calls_are_an_array_or_refused(path, text):
    path.write_text(text)
    try:
        found = read_ultraino_array(path)
    except ConfigurationError:
        return
    assert 1 <= found.array.count <= 1024
