"""Array files of Ultraino: ``.xml`` and ``.xml.gz``, written by Java's ``XMLEncoder``.

Such a file is a program that builds a ``Simulation`` with its transducers: elements call setters,
set public fields by reflection, and name objects for later. Only what leads to a place, a direction
and a number of a transducer is carried out; no class is looked for and no code of the file runs.

Source of the classes: asiermarzo/Ultraino 2173581, ``simulation/Transducer.java``,
``scene/Entity.java`` and ``math/Transform.java``. A transducer emits along its own +y.
"""

from __future__ import annotations

import gzip
import math
import xml.parsers.expat
import zlib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np

from haptogram.acoustics.arrays import MAX_TRANSDUCERS, FloatArray
from haptogram.acoustics.model.boards.layout import Y_UP
from haptogram.acoustics.model.geometry import TransducerArray
from haptogram.errors import ConfigurationError, reading_file, refusals_of

MAX_BYTES: Final = 16 << 20  # uncompressed; 256 transducers take less than one
MAX_DEPTH: Final = 64
MAX_ELEMENTS: Final = 200_000  # a transducer takes about 30
SUFFIXES: Final = (".xml", ".xml.gz")
_GZIP: Final = b"\x1f\x8b"
_NUMBERS: Final = ("byte", "short", "int", "long", "float", "double")
_TEXTS: Final = ("string", "char", "boolean", "class")
_TRANSDUCERS: Final = "transducers"


@dataclass(frozen=True)
class UltrainoArray:
    """The transducers of an array file, in the order of their numbers.

    Attributes
    ----------
    array : TransducerArray
        Their places in our axes: +z is Ultraino's +y.
    numbers : tuple of int
        For each the number by which its program addresses it.
    corrections_rad : (N,) numpy.ndarray
        Phase that the program adds for each, because of how it is wired or mounted.
    """

    array: TransducerArray
    numbers: tuple[int, ...]
    corrections_rad: FloatArray


def read_ultraino_array(path: Path, number: str = "orderNumber") -> UltrainoArray:
    """Read an array file.

    Parameters
    ----------
    number : str
        Property of a transducer that is its channel: ``orderNumber`` for FPGAs,
        ``driverPinNumber`` for Arduinos.

    Raises
    ------
    ConfigurationError
        Names the file and its fault: it cannot be read, has more than 16 MiB or 200 000 elements
        when it is unpacked, a document type or entities, no transducers, two of one number, or a
        number that is not whole.
    """
    data = _ultraino_bytes_of(path)
    with refusals_of(f"{path}:"):
        root = _UltrainoReader().read(data)
        found = _ultraino_transducers(root)
        numbers = [_ultraino_number(transducer, number) for transducer in found]
        order = sorted(range(len(found)), key=numbers.__getitem__)
        if len(set(numbers)) < len(numbers):
            raise ConfigurationError(_same_ultraino_numbers(numbers, number))
        transforms = [_ultraino_part(found[n], "transform") for n in order]
        turn = np.array(Y_UP)
        places = np.array([_ultraino_place(transform) for transform in transforms]) @ turn.T
        normals = np.array([_ultraino_direction(transform) for transform in transforms]) @ turn.T
        corrections = [math.pi * _ultraino_value(found[n], "phaseCorrection") for n in order]
        return UltrainoArray(
            TransducerArray(places, normals),
            tuple(numbers[n] for n in order),
            np.array(corrections),
        )


@dataclass(eq=False)
class _UltrainoObject:
    """An object of the file: its properties and public fields, and what was added to it."""

    values: dict[str, Any] = field(default_factory=dict)
    items: list[Any] = field(default_factory=list)

    def part(self, name: str) -> Any:
        """Return a part; a getter gives an object to be filled where none was set."""
        return self.values.setdefault(name, _UltrainoObject())


@dataclass
class _Element:
    """An element that has begun: a call whose arguments are the values inside it."""

    tag: str
    attributes: dict[str, str]
    parent: _Element | None
    arguments: list[Any] = field(default_factory=list)
    text: list[str] = field(default_factory=list)
    done: bool = False
    value: Any = None


class _UltrainoReader:
    """Carries out the calls of a file, one element after the other."""

    def __init__(self) -> None:
        self._open: list[_Element] = []
        self._named: dict[str, _Element] = {}
        self._first: Any = None
        self._elements = 0

    def read(self, data: bytes) -> Any:
        """Return the first object of the file, when all calls are done."""
        parser = xml.parsers.expat.ParserCreate()
        parser.StartDoctypeDeclHandler = _refuse_ultraino_doctype
        parser.StartElementHandler = self._begin_element
        parser.EndElementHandler = self._end_element
        parser.CharacterDataHandler = self._characters
        try:
            parser.Parse(data, True)
        except xml.parsers.expat.ExpatError as error:
            raise ConfigurationError(f"line {error.lineno} is not XML, or not whole") from error
        except (LookupError, ValueError) as error:
            raise ConfigurationError(f"its encoding cannot be read: {error}") from error
        return self._first

    def _begin_element(self, tag: str, attributes: dict[str, str]) -> None:
        """Open an XML element within the last one; refuse one too many or too deep.

        The limits are MAX_ELEMENTS in a file, MAX_DEPTH within each other.
        """
        if len(self._open) >= MAX_DEPTH:
            raise ConfigurationError(f"elements are nested more than {MAX_DEPTH} deep")
        self._elements += 1
        if self._elements > MAX_ELEMENTS:
            raise ConfigurationError(f"more than {MAX_ELEMENTS} elements")
        element = _Element(tag, attributes, self._open[-1] if self._open else None)
        self._open.append(element)
        if (name := attributes.get("id")) is not None:
            self._named[name] = element  # what is inside it may name it already

    def _characters(self, text: str) -> None:
        """Add text to the open element, if there is one."""
        if self._open:
            self._open[-1].text.append(text)

    def _end_element(self, tag: str) -> None:
        """Evaluate the element that ends; its value is an argument of the one around it."""
        value = self._value_of(self._open.pop())
        if self._first is None and tag == "object":
            self._first = value
        if self._open and tag != "void":
            self._open[-1].arguments.append(value)

    def _value_of(self, element: _Element) -> Any:
        """Return the value of an element; it is computed once, when it is first asked for."""
        if not element.done:
            element.done = True
            element.value = self._call(element)
        return element.value

    def _call(self, element: _Element) -> Any:
        """Return the number, text or object that an XML element of Java stands for; else None."""
        attributes, arguments = element.attributes, element.arguments
        if element.tag in _NUMBERS:
            return _as_ultraino_number("".join(element.text))
        if element.tag in _TEXTS:
            return "".join(element.text)
        if element.tag not in ("object", "void") or "index" in attributes:
            return None  # java, array, null: nothing of them is a place
        if (named := self._named.get(attributes.get("idref", ""))) is not None:
            return self._value_of(named)
        if "class" in attributes:
            is_field = attributes.get("method") == "getField"
            return arguments[0] if is_field and arguments else _UltrainoObject()
        parent = element.parent
        return _carry_out_ultraino_call(attributes, arguments, parent and self._value_of(parent))


def _carry_out_ultraino_call(attributes: dict[str, str], arguments: list[Any], target: Any) -> Any:
    """Set or get a property of *target*, or add to it; return what a getter returns, else None.

    A *target* that is a text names a public field, which is set or got of the first argument.
    """
    method = attributes.get("method")
    if isinstance(target, str) and arguments and isinstance(arguments[0], _UltrainoObject):
        if method == "set" and len(arguments) == 2:
            arguments[0].values[target] = arguments[1]
        return arguments[0].part(target) if method == "get" else None
    if not isinstance(target, _UltrainoObject):
        return None
    if (name := attributes.get("property", attributes.get("field"))) is not None:
        if not arguments:
            return target.part(name)
        target.values[name] = arguments[0]
    elif method == "add" and arguments:
        target.items.append(arguments[0])
    return None


def _refuse_ultraino_doctype(*_: object) -> None:
    """Raise: a document type can define entities, which are not read."""
    raise ConfigurationError("a document type, and so maybe entities: such a file is not read")


def _ultraino_bytes_of(path: Path) -> bytes:
    """Return the bytes of a file, unpacked if it is gzip; refuse more than 16 MiB."""
    with reading_file(path, "array", (OSError, EOFError, zlib.error)), path.open("rb") as file:
        is_packed = file.read(len(_GZIP)) == _GZIP
        file.seek(0)
        source = gzip.GzipFile(fileobj=file) if is_packed else file
        data = source.read(MAX_BYTES + 1)
    if len(data) > MAX_BYTES:
        raise ConfigurationError(f"{path}: more than {MAX_BYTES} bytes")
    return data


def _ultraino_transducers(root: Any) -> list[_UltrainoObject]:
    """Return the transducers of an array file; raise ConfigurationError unless 1 to 1024."""
    listed = root.part(_TRANSDUCERS).items if isinstance(root, _UltrainoObject) else []
    found = [item for item in listed if isinstance(item, _UltrainoObject)]
    if not 1 <= len(found) <= MAX_TRANSDUCERS:
        raise ConfigurationError(
            f"{len(found)} transducers; an array file of Ultraino holds 1 to {MAX_TRANSDUCERS}"
        )
    return found


def _ultraino_part(built: _UltrainoObject, *names: str) -> _UltrainoObject:
    """Return the first component of *names* that an Ultraino object has; if none, an empty one."""
    parts = (built.values.get(name) for name in names)
    return next((part for part in parts if isinstance(part, _UltrainoObject)), _UltrainoObject())


def _ultraino_value(built: _UltrainoObject, name: str, default: float = 0.0) -> float:
    """Return a field, *default* without it; raise ConfigurationError if it is no finite float."""
    value = built.values.get(name, default)
    if not isinstance(value, float) or not math.isfinite(value):
        raise ConfigurationError(f"{name} is no finite number")
    return value


def _ultraino_number(transducer: _UltrainoObject, name: str) -> int:
    """Return a field as a whole number from 0 on, 0 without it; else raise ConfigurationError."""
    value = _ultraino_value(transducer, name)
    if value != round(value) or value < 0:
        raise ConfigurationError(f"{name} is {value:g}, must be a whole number from 0 on")
    return int(value)


def _same_ultraino_numbers(numbers: list[int], name: str) -> str:
    """Return the error text: two transducers have one number, or all still have the default."""
    if len(set(numbers)) > 1:
        return f"two transducers have the same {name}"
    return (
        f"{name} of all {len(numbers)} transducers is {numbers[0]}: none is assigned to a pin yet. "
        "Assign them in Ultraino and save the file, or give places in mm in the order of the "
        "channels as a CSV file"
    )


def _as_ultraino_number(text: str) -> float:
    """Return a text as float; raise ConfigurationError if it is no number."""
    try:
        return float(text)
    except ValueError as error:
        raise ConfigurationError(f"{text[:40]!r} is no number") from error


def _ultraino_place(transform: _UltrainoObject) -> list[float]:
    """Return x, y and z of a transducer's translation in metres."""
    translation = _ultraino_part(transform, "translation")
    return [_ultraino_value(translation, axis) for axis in "xyz"]


def _ultraino_direction(transform: _UltrainoObject) -> list[float]:
    """Return the direction (x, y, z) of the transducer's own +y: q (0, 1, 0) q*."""
    rotation = _ultraino_part(transform, "rotation", "rot")
    x, y, z = (_ultraino_value(rotation, axis) for axis in "xyz")
    w = _ultraino_value(rotation, "w", 1.0)
    return [2 * (x * y - z * w), w * w - x * x + y * y - z * z, 2 * (y * z + x * w)]
