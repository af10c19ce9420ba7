"""Frozen dataclasses whose classes share their methods, for modules that most commands load.

The standard library writes and compiles six methods anew for each class: in all, a seventh of the
time in which a command starts. An instance is made in half of the time as well. There is no
``InitVar``, ``order`` or ``field(hash=...)``.
"""

from __future__ import annotations

import dataclasses
import operator
from collections.abc import Callable
from dataclasses import field, fields, replace
from types import MemberDescriptorType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dataclasses import dataclass
else:

    def dataclass(cls=None, /, *, frozen=False, eq=True, **options):
        """Make *cls* a dataclass, as :func:`dataclasses.dataclass`; a frozen one is quick."""
        if not frozen:
            return dataclasses.dataclass(cls, eq=eq, **options)

        def make(cls):
            return _frozen_class(cls, eq=eq, **options)

        return make if cls is None else make(cls)


class _FrozenMethods:
    """The methods that frozen classes share; `__compared__` gets the values to compare."""

    __compared__: Callable[[Any], tuple[Any, ...]]

    def __repr__(self) -> str:
        shown = (one.name for one in fields(self) if one.repr)  # type: ignore[arg-type]  # of one
        told = ", ".join(f"{name}={getattr(self, name)!r}" for name in shown)
        return f"{type(self).__qualname__}({told})"

    def __eq__(self, other: object) -> bool:
        if other.__class__ is not self.__class__:
            return NotImplemented
        values = type(self).__compared__
        return values(self) == values(other)

    def __hash__(self) -> int:
        return hash(type(self).__compared__(self))

    def __setattr__(self, name: str, value: object) -> None:
        raise dataclasses.FrozenInstanceError(f"cannot assign to field {name!r}")

    def __delattr__(self, name: str) -> None:
        raise dataclasses.FrozenInstanceError(f"cannot delete field {name!r}")

    def __getstate__(self) -> list[Any]:
        return [getattr(self, one.name) for one in fields(self)]  # type: ignore[arg-type]  # of one

    def __setstate__(self, state: list[Any]) -> None:
        for one, value in zip(fields(self), state, strict=True):  # type: ignore[arg-type]  # of one
            object.__setattr__(self, one.name, value)


def _frozen_class(cls: Any, *, eq: bool, **options: Any) -> Any:
    """Make *cls* a frozen dataclass that takes its methods, but ``__init__``, from a common class.

    Methods of its own stay. *eq*: whether ``__eq__`` and ``__hash__`` are among them; *options* go
    to :func:`dataclasses.dataclass`.
    """
    names = ["__repr__", "__setattr__", "__delattr__"]
    names += ["__eq__", "__hash__"] if eq else []
    names += ["__getstate__", "__setstate__"] if options.get("slots") else []
    names = [name for name in names if vars(cls).get(name) is None]  # and are not its own
    cls.__doc__ = cls.__doc__ or cls.__name__  # else the signature is looked up, which takes long
    bases = [vars(base).get("__dataclass_params__") for base in cls.__mro__[1:]]
    known = [params for params in bases if params is not None]
    if not all(params.frozen for params in known):
        raise TypeError("cannot inherit frozen dataclass from a non-frozen one")
    try:
        for params in known:  # else it refuses to leave the methods to us
            params.frozen = False
        made: Any = dataclasses.dataclass(init=False, repr=False, eq=False, **options)(cls)
        made.__dataclass_params__.frozen = True
    finally:
        for params in known:
            params.frozen = True
    made.__init__ = _init_of_frozen(made)
    made.__compared__ = _values_getter([one.name for one in fields(made) if one.compare])
    for name in names:
        setattr(made, name, vars(_FrozenMethods)[name])
    return made


def _init_of_frozen(made: Any) -> Any:
    """Return an ``__init__`` that sets each slot, or entry of the dictionary, directly."""
    known: dict[str, Any] = {"_missing": dataclasses.MISSING}
    lines, places, named = list[str](), list[str](), list[str]()
    for one in fields(made):
        name, value, usual = one.name, one.name, ""
        if one.default is not dataclasses.MISSING:
            usual, known[f"_usual_{name}"] = f"_usual_{name}", one.default
        elif one.default_factory is not dataclasses.MISSING:
            usual, known[f"_new_{name}"] = "_missing", one.default_factory
            value = f"_new_{name}() if {name} is _missing else {name}"
        if one.init:
            (named if one.kw_only else places).append(f"{name}={usual}" if usual else name)
        elif not usual:
            continue  # __post_init__ sets it
        else:
            value = f"_new_{name}()" if usual == "_missing" else usual
        slot = getattr(made, name, None)
        if isinstance(slot, MemberDescriptorType):
            known[f"_set_{name}"] = slot.__set__
            lines.append(f"_set_{name}(self, {value})")
        else:
            lines.append(f"self.__dict__[{name!r}] = {value}")
    if hasattr(made, "__post_init__"):
        lines.append("self.__post_init__()")
    taken = ", ".join(["self", *places, *(["*", *named] if named else [])])
    exec(f"def __init__({taken}): {'; '.join(lines) or 'pass'}", known)
    init = known["__init__"]
    init.__annotations__ = {o.name: o.type for o in fields(made) if o.init} | {"return": None}
    init.__qualname__, init.__module__ = f"{made.__qualname__}.__init__", made.__module__
    return init


def _values_getter(names: list[str]) -> Callable[[Any], tuple[Any, ...]]:
    """Return a function that gets the attributes *names* of an instance."""
    if len(names) > 1:
        return operator.attrgetter(*names)
    return lambda one: tuple(getattr(one, name) for name in names)


__all__ = ["dataclass", "field", "fields", "replace"]
