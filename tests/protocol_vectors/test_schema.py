"""The schema of the vectors, checked by the few rules of JSON Schema that it uses."""

import copy
import json
import re

import pytest

from protocol_vectors.vector_files import EVERY_FILE, FOLDER, read

SCHEMA = json.loads((FOLDER / "schema.json").read_text("utf-8"))
TYPES = {"object": dict, "array": list, "string": str, "integer": int, "boolean": bool}
NOT_RULES = {"description", "title", "$schema", "$defs"}


def complaints(value, schema, path="$"):
    """Yield what is wrong with *value*; a rule that is not known here is an error."""
    for rule, argument in schema.items():
        if rule not in NOT_RULES:
            yield from RULES[rule](value, argument, schema, path)


def _type(value, name, _, path):
    if not isinstance(value, TYPES[name]) or (name == "integer" and isinstance(value, bool)):
        yield f"{path}: {value!r} is no {name}"


def _ref(value, target, _, path):
    name = target.removeprefix("#/$defs/")
    yield from complaints(value, SCHEMA["$defs"][name], path)


def _properties(value, properties, _, path):
    for name, schema in properties.items():
        if isinstance(value, dict) and name in value:
            yield from complaints(value[name], schema, f"{path}.{name}")


def _additional(value, allowed, schema, path):
    assert allowed is False
    for name in set(value) - set(schema.get("properties", {})) if isinstance(value, dict) else ():
        yield f"{path}: {name} is not known"


def _required(value, names, _, path):
    for name in set(names) - set(value) if isinstance(value, dict) else ():
        yield f"{path}: {name} is missing"


def _items(value, schema, _, path):
    for number, item in enumerate(value if isinstance(value, list) else ()):
        yield from complaints(item, schema, f"{path}[{number}]")


def _pattern(value, pattern, _, path):
    if isinstance(value, str) and not re.search(pattern, value):
        yield f"{path}: {value!r} is not like {pattern}"


def _enum(value, allowed, _, path):
    if value not in allowed:
        yield f"{path}: {value!r} is none of {allowed}"


def _minimum(value, least, _, path):
    if isinstance(value, int) and value < least:
        yield f"{path}: {value} is below {least}"


def _maximum(value, most, _, path):
    if isinstance(value, int) and value > most:
        yield f"{path}: {value} is above {most}"


def _min_items(value, least, _, path):
    if isinstance(value, list) and len(value) < least:
        yield f"{path}: {len(value)} items, at least {least}"


def _all_of(value, schemas, _, path):
    for schema in schemas:
        yield from complaints(value, schema, path)


def _one_of(value, schemas, _, path):
    results = [list(complaints(value, schema, path)) for schema in schemas]
    if sum(not result for result in results) != 1:
        yield f"{path}: fits {sum(not r for r in results)} of {len(schemas)}; {results}"


RULES = {
    "type": _type,
    "$ref": _ref,
    "properties": _properties,
    "additionalProperties": _additional,
    "required": _required,
    "items": _items,
    "pattern": _pattern,
    "enum": _enum,
    "minimum": _minimum,
    "maximum": _maximum,
    "minItems": _min_items,
    "allOf": _all_of,
    "oneOf": _one_of,
}


@pytest.mark.parametrize("name", EVERY_FILE)
def test_a_file_fits_the_schema(name):
    assert list(complaints(read(name), SCHEMA)) == []


def spoil(document, path, value):
    """A copy of *document* with one value replaced, or removed where it is None."""
    copied = copy.deepcopy(document)
    place = copied
    for key in path[:-1]:
        place = place[key]
    if value is None:
        del place[path[-1]]
    else:
        place[path[-1]] = value
    return copied


@pytest.mark.parametrize(
    ("name", "path", "value"),
    [
        ("frames-valid.json", ["vectors"], []),
        ("frames-valid.json", ["protocol"], "one"),
        ("frames-valid.json", ["vectors", 0, "id"], "other/1"),
        ("frames-valid.json", ["vectors", 0, "line"], "0"),
        ("frames-valid.json", ["vectors", 0, "line"], None),
        ("frames-valid.json", ["vectors", 0, "clauses"], ["HG-2.1"]),
        ("frames-valid.json", ["vectors", 0, "flags"], []),
        ("frames-valid.json", ["vectors", 0, "outcome", 0, "frame", "header", "seq"], 65536),
        ("frames-valid.json", ["vectors", 0, "outcome", 0, "frame", "header", "seq"], None),
        ("frames-valid.json", ["vectors", 0, "more"], 1),
        ("frames-invalid.json", ["vectors", 0, "outcome", 0, "drop"], "parity"),
        ("dialogues.json", ["vectors", 0, "steps", 0, "at_us"], -1),
        ("dialogues.json", ["vectors", 0, "steps", 0, "expect", 0, "message"], "error"),
        ("dialogues.json", ["vectors", 0, "board", "grid_nx"], True),
        ("dialogues.json", ["vectors", 0, "board", "grid"], 2),
    ],
)
def test_the_check_finds_what_does_not_fit(name, path, value):
    document = read(name)
    short = document | {"vectors": document["vectors"][:1]}
    assert list(complaints(short, SCHEMA)) == []
    assert list(complaints(spoil(short, path, value), SCHEMA)) != []
