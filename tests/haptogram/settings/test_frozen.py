"""Frozen dataclasses with shared methods are what the standard library makes of the same class."""

import copy
import dataclasses
import inspect
import pickle

import pytest

from haptogram.settings import frozen


def made_by(dataclass):
    """The same classes, made by one decorator."""

    @dataclass(frozen=True, slots=True)
    class Base:
        """A base."""

        x: float
        names: list = frozen.field(default_factory=list, repr=False, compare=False)
        y: int = frozen.field(default=3, compare=False)
        twice: float = frozen.field(init=False)
        marks: list = frozen.field(init=False, default_factory=list, compare=False)

        def __post_init__(self):
            object.__setattr__(self, "twice", 2.0 * self.x)

    @dataclass(frozen=True, slots=True)
    class Derived(Base):
        z: str = "z"

    @dataclass(frozen=True, kw_only=True)
    class Named:
        a: int = 1
        b: str

    @dataclass(frozen=True, eq=False)
    class ByIdentity:
        a: int

    @dataclass(frozen=True, slots=True)
    class OwnMethods:
        a: int

        def __eq__(self, other):
            return True

        def __repr__(self):
            return "own"

    @dataclass(frozen=True, slots=True)
    class Empty:
        pass

    return [
        (Base, (1.0,), {}),
        (Base, (1.0, ["n"]), {"y": 4}),
        (Derived, (2.0,), {"z": "w"}),
        (Named, (), {"b": "c"}),
        (Named, (), {"a": 2, "b": "c"}),
        (ByIdentity, (1,), {}),
        (OwnMethods, (1,), {}),
        (Empty, (), {}),
    ]


PAIRS = list(zip(made_by(frozen.dataclass), made_by(dataclasses.dataclass), strict=True))


@pytest.mark.parametrize(("ours", "theirs"), PAIRS)
def test_instances_are_as_those_of_the_standard_library(ours, theirs):
    (kind, places, named), (other, *_) = ours, theirs
    one, two, plain = kind(*places, **named), kind(*places, **named), other(*places, **named)
    assert repr(one) == repr(plain)
    assert dataclasses.asdict(one) == dataclasses.asdict(plain)
    assert (one == two) == (plain == other(*places, **named))
    assert (one == one and one != plain) or kind.__name__ == "OwnMethods"
    if kind.__name__ != "ByIdentity":
        assert hash(one) == hash(plain) == hash(two)
    assert kind.__match_args__ == other.__match_args__
    assert hasattr(one, "__dict__") == hasattr(plain, "__dict__")
    assert list(inspect.signature(kind).parameters) == list(inspect.signature(other).parameters)
    assert dataclasses.asdict(copy.deepcopy(one)) == dataclasses.asdict(one)


@pytest.mark.parametrize(("ours", "theirs"), PAIRS)
def test_nobody_changes_one(ours, theirs):
    for kind, places, named in (ours, theirs):
        one = kind(*places, **named)
        for name in (*(field.name for field in dataclasses.fields(kind)), "other"):
            with pytest.raises((dataclasses.FrozenInstanceError, TypeError)):
                setattr(one, name, 1)
            with pytest.raises((dataclasses.FrozenInstanceError, AttributeError, TypeError)):
                delattr(one, name)


def test_a_missing_argument_is_named():
    (kind, *_), *_ = made_by(frozen.dataclass)
    with pytest.raises(TypeError, match="missing 1 required positional argument: 'x'"):
        kind()


def test_a_default_is_made_for_each():
    (kind, *_), *_ = made_by(frozen.dataclass)
    assert kind(1.0).names is not kind(1.0).names
    assert kind(1.0).marks == []


@frozen.dataclass(frozen=True, slots=True)
class Kept:
    x: int
    y: tuple = ()


def test_one_is_pickled_and_replaced():
    one = Kept(1, (2, 3))
    assert pickle.loads(pickle.dumps(one)) == one
    assert frozen.replace(one, x=4) == Kept(4, (2, 3))


def test_one_that_is_not_frozen_is_of_the_standard_library():
    @frozen.dataclass(slots=True)
    class Open:
        x: int

    one = Open(1)
    one.x = 2
    assert one == Open(2)


def test_classes_of_both_kinds_are_bases_of_each_other():
    @dataclasses.dataclass(frozen=True, slots=True)
    class Theirs(Kept):
        z: int = 1

    @frozen.dataclass(frozen=True, slots=True)
    class Ours(Theirs):
        w: int = 2

    one = Ours(1, w=3)
    assert repr(one).endswith("Ours(x=1, y=(), z=1, w=3)")
    for kind in (Kept, Theirs, Ours):
        with pytest.raises((dataclasses.FrozenInstanceError, TypeError)):
            kind(1).x = 2


def test_a_base_that_is_not_frozen_is_refused_and_a_failure_leaves_a_frozen_base():
    @dataclasses.dataclass
    class Open:
        x: int

    with pytest.raises(TypeError, match="non-frozen"):

        @frozen.dataclass(frozen=True)
        class _Wrong(Open):
            y: int

    with pytest.raises(ValueError, match="mutable default"):

        @frozen.dataclass(frozen=True)
        class _Failed(Kept):
            z: list = []  # noqa: RUF012

    with pytest.raises(TypeError, match="non-frozen"):

        @dataclasses.dataclass
        class _Open(Kept):
            z: int = 0
