"""The generated C99 headers: up to date, compiled strictly, and with asserts that bite."""

import enum
import graphlib
import re
import shutil

import pytest

from haptogram_protocol.errors import LocalProtocolError
from haptogram_protocol.messages import DriveKind, GeometryReply, Message
from haptogram_protocol.record import Record, record, repeated, wire
from protocol_c.building import FOLDER, compiler, compilers, run, spoilt
from wire_export.c import HEADERS
from wire_export.c.names import c_enumerated, c_member_name

STRICT = ("-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-Wshadow", "-Wconversion")
PROGRAM = '#include "haptogram_messages.h"\nint main(void) { return 0; }\n'


@pytest.mark.parametrize("name", HEADERS)
def test_a_header_is_what_the_messages_make_of_it(name):
    assert (FOLDER / name).read_text("utf-8") == HEADERS[name](), "run: ci/export-wire"


def compiled(tmp_path, include, *command):
    source = tmp_path / "program.c"
    source.write_text(PROGRAM)
    return run(*command, f"-I{include}", source, "-o", tmp_path / "program")


def test_the_headers_compile_without_a_warning(tmp_path):
    compiler()
    for name in compilers():
        assert compiled(tmp_path, FOLDER, name, *STRICT) == (0, "")


def test_the_headers_compile_as_cplusplus(tmp_path):
    compiler()
    for name in [name for name in ("g++", "clang++") if shutil.which(name)]:
        flags = ("-std=c++11", *STRICT[1:], "-x", "c++")
        assert compiled(tmp_path, FOLDER, name, *flags) == (0, "")


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("uint8_t nonce[2];", "uint8_t nonce[4];"),
        ("uint8_t t_rx_us[4];", ""),
        ("sizeof(struct hg_wire_hello) == 8", "sizeof(struct hg_wire_hello) == 12"),
    ],
)
def test_a_layout_that_is_not_the_wire_does_not_compile(tmp_path, old, new):
    name = compiler()
    source = spoilt(tmp_path, "haptogram.h", old, new)
    status, output = compiled(tmp_path, source, name, *STRICT)
    assert status != 0
    assert "hg_assert_" in output or "no member" in output


def test_a_field_is_never_called_by_a_keyword():
    assert [c_member_name(name) for name in ("short", "shorter", "crc")] == [
        "short_",
        "shorter",
        "crc",
    ]


def test_enumerations_that_c_could_not_check_are_refused():
    @record
    class Inner(Record):
        kind: DriveKind = wire("B", "kind", enum=DriveKind)

    @record
    class Outer(Message):
        items: tuple[Inner, ...] = repeated(Inner, "items")

    with pytest.raises(LocalProtocolError):
        list(c_enumerated(Outer))
    assert list(c_enumerated(Inner)) == [(0, 0b11)]
    assert list(c_enumerated(GeometryReply)) == []


def test_values_without_a_bit_are_refused():
    class Wide(enum.IntEnum):
        LARGE = 40

    @record
    class Odd(Record):
        value: Wide = wire("B", "value", enum=Wide)

    with pytest.raises(LocalProtocolError):
        list(c_enumerated(Odd))


# What the examples of the README call of their surroundings.
SURROUNDINGS = (
    '#include "haptogram_codec.h"\nvoid count(int);\nvoid handle(const struct hg_frame *);\n',
    '#include "board/board.h"\nsize_t send(const uint8_t *, size_t);\n'
    "int64_t radiate(void *, const struct drive *, int64_t);\n"
    "void begin(void);\nvoid turn(const uint8_t *, size_t, int64_t);\n",
)


def test_the_examples_of_the_readme_compile(tmp_path):
    text = (FOLDER / "README.md").read_text("utf-8")
    examples = re.findall(r"```c\n(.*?)```", text, re.DOTALL)
    for declared, example in zip(SURROUNDINGS, examples, strict=True):
        source = tmp_path / "example.c"
        source.write_text(declared + example)
        command = (compiler(), *STRICT, f"-I{FOLDER}", "-c", source, "-o", tmp_path / "example.o")
        assert run(*command) == (0, "")


def parts_included(folder):
    """For each part of the board, a .c file with its .h file: the parts that it includes."""
    included = {}
    for path in (folder / "board").iterdir():
        found = re.findall(r'^#include "(\w+)\.h"', path.read_text("utf-8"), re.MULTILINE)
        included.setdefault(path.stem, set()).update(set(found) - {path.stem})
    return included


def test_the_parts_of_the_board_include_each_other_one_way(tmp_path):
    order = list(graphlib.TopologicalSorter(parts_included(FOLDER)).static_order())
    assert (order[0], order[-1]) == ("limits", "board")
    back = spoilt(
        tmp_path, "board/link.c", '#include "link.h"', '#include "link.h"\n#include "judge.h"'
    )
    with pytest.raises(graphlib.CycleError):
        list(graphlib.TopologicalSorter(parts_included(back)).static_order())
