"""Faults on purpose: what a plan of them says, and what they do.  See docs/faults.md.

A plan is data. What a fault does to a chunk follows from plan, seed, time and chunk alone, so the
same traffic meets the same faults again.
"""

from __future__ import annotations

import dataclasses
import random
import tomllib
import zlib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final, Self

from haptogram.errors import ConfigurationError

from .clock import DeviceClock
from .fault_kinds import FAULT_KINDS, PLACES, REPORTS, Parameter, shown
from .frame_faults import FRAME_FAULTS
from .line_faults import LINE_FAULTS, Chunk
from .report_faults import REPORT_FAULTS

_UNITS_NS: Final = {"s": 1_000_000_000, "ms": 1_000_000, "us": 1_000, "ns": 1}
_NS_PER_MS: Final = 1_000_000
_FOR_EVER_NS: Final = 1 << 62
_TIMES: Final = ("from", "until")
_WRAP_US: Final = 1 << 32
_BOTH: Final = "both"
_ON_CHUNKS: Final = {**LINE_FAULTS, **FRAME_FAULTS, **REPORT_FAULTS}


@dataclass(frozen=True, slots=True)
class Fault:
    """One fault of a plan.

    Attributes
    ----------
    name : str
        Such as ``line.flip``.
    values : mapping of str to float
        Its parameters, all of them.
    from_ns, until_ns : int
        When it is there, since power-up.
    direction : str
        ``down`` to the board, ``up`` from it, or ``both``: on which bytes it acts.
    """

    name: str
    values: Mapping[str, float]
    from_ns: int = 0
    until_ns: int = _FOR_EVER_NS
    direction: str = _BOTH

    @classmethod
    def parse(cls, text: str) -> Self:
        """Return the fault that *text* names: ``NAME [PARAMETER=VALUE ...]``.

        Raises
        ------
        ConfigurationError
            For a fault or a parameter that is not known, or a value that makes no sense.
        """
        name, *words = text.split() or [""]
        return cls.of(name, dict(word.partition("=")[::2] for word in words))

    @classmethod
    def of(cls, name: str, texts: Mapping[str, str]) -> Self:
        """Return the fault *name* with the parameters in *texts*; see :meth:`parse`."""
        if name not in FAULT_KINDS:
            raise ConfigurationError(f"no fault {name!r}; known: {', '.join(FAULT_KINDS)}")
        known = (*FAULT_KINDS[name], *_TIMES, *(["direction"] if _has_direction(name) else []))
        for key in texts:
            if key not in known:
                raise ConfigurationError(
                    f"{name} has no parameter {key!r}; known: {', '.join(known)}"
                )
        values = {
            key: _number(name, key, texts[key], limits) if key in texts else limits.default
            for key, limits in FAULT_KINDS[name].items()
        }
        _check_place(name, values)
        from_ns, until_ns = (_time_ns(key, texts[key]) if key in texts else None for key in _TIMES)
        from_ns = from_ns or 0
        end_ns = _end_ns(name, values, from_ns)
        until_ns = end_ns if until_ns is None else min(until_ns, end_ns)
        return cls(name, values, from_ns, until_ns, _direction(name, texts.get("direction")))

    @property
    def said(self) -> dict[str, float | str]:
        """Parameters that are not what they would be if nothing were said, in order."""
        said: dict[str, float | str] = {
            key: value
            for key, value in self.values.items()
            if value != FAULT_KINDS[self.name][key].default
        }
        if _has_direction(self.name) and self.direction != _BOTH:
            said["direction"] = self.direction
        if self.from_ns:
            said["from"] = _time_text(self.from_ns)
        if self.until_ns != _end_ns(self.name, self.values, self.from_ns):
            said["until"] = _time_text(self.until_ns)
        return said

    def __str__(self) -> str:
        """Return the text that :meth:`parse` takes."""
        return " ".join([self.name, *(f"{key}={_text(value)}" for key, value in self.said.items())])

    def is_there(self, t_ns: int) -> bool:
        """Return whether the fault is there at *t_ns*."""
        return self.from_ns <= t_ns < self.until_ns


@dataclass(frozen=True, slots=True)
class FaultPlan:
    """Faults, and the seed of what is random about them.

    Attributes
    ----------
    faults : tuple of Fault
        In the order in which they act.
    seed : int
        Two runs with the same plan, seed and traffic meet the same faults.
    """

    faults: tuple[Fault, ...] = ()
    seed: int = 0

    @classmethod
    def parse(cls, texts: Iterable[str], seed: int = 0) -> Self:
        """Return the plan of *texts*; see :meth:`Fault.parse`."""
        return cls(tuple(Fault.parse(text) for text in texts), seed)

    @classmethod
    def from_toml(cls, text: str, seed: int = 0) -> Self:
        """Return the plan that a TOML document holds, tables ``[[fault]]`` and maybe a ``seed``.

        Parameters
        ----------
        seed : int
            The seed, if the document has none.

        Raises
        ------
        ConfigurationError
            If it is no TOML, or for what :meth:`Fault.parse` refuses.
        """
        try:
            document = tomllib.loads(text)
        except tomllib.TOMLDecodeError as error:
            raise ConfigurationError(f"fault plan: {error}") from error
        tables, own_seed = document.pop("fault", []), document.pop("seed", seed)
        if document:
            raise ConfigurationError(f"fault plan: {', '.join(document)}; known: seed, [[fault]]")
        if type(own_seed) is not int or own_seed < 0:
            raise ConfigurationError(f"fault plan: seed = {own_seed}, must be 0 or more")
        if not isinstance(tables, list) or not all(isinstance(table, dict) for table in tables):
            raise ConfigurationError("fault plan: must have tables [[fault]]")
        return cls(tuple(_from_table(table) for table in tables), own_seed)

    def as_toml(self) -> str:
        """Return the document that :meth:`from_toml` makes this plan of."""
        tables = (
            "\n".join(["[[fault]]", *(f"{key} = {_toml(value)}" for key, value in items)])
            for items in ([("name", fault.name), *fault.said.items()] for fault in self.faults)
        )
        return "\n\n".join([f"seed = {self.seed}", *tables]) + "\n"

    def line(self, direction: str, t_ns: int, chunk: bytes) -> tuple[list[Chunk], dict[str, int]]:
        """Return what becomes of *chunk*, sent at *t_ns*, and which faults did something to it.

        Parameters
        ----------
        direction : str
            ``down`` to the board or ``up`` from it.
        """
        chunks, fired = [Chunk(t_ns, chunk)], dict[str, int]()
        for number, fault in enumerate(self.faults):
            act = _ON_CHUNKS.get(fault.name)
            if act is None or fault.direction not in (_BOTH, direction):
                continue
            if fault.is_there(t_ns):
                source = self._random(number, direction, t_ns, chunk)
                chunks, count = act(chunks, fault.values, source)
                fired[fault.name] = fired.get(fault.name, 0) + count
        return chunks, fired

    def clock(self, healthy: DeviceClock) -> DeviceClock:
        """Return *healthy* with the faults of this plan.

        Raises
        ------
        ConfigurationError
            If it would run backwards.
        """
        clock = healthy
        for fault in self.faults:
            amount = round(fault.values.get("us", fault.values.get("ppm", 0)))
            if fault.name == "clock.offset":
                clock = dataclasses.replace(clock, boot_us=clock.boot_us + amount)
            elif fault.name == "clock.wrap":
                clock = dataclasses.replace(clock, boot_us=_WRAP_US - amount)
            elif fault.name == "clock.ppm":
                clock = dataclasses.replace(clock, ppm=clock.ppm + amount)
            elif fault.name == "clock.step":
                at_us = max(1, fault.from_ns // 1000)
                clock = dataclasses.replace(clock, step_us=amount, step_at_us=at_us)
        if clock.ppm <= -1_000_000 or clock.step_us < 0 or clock.boot_us < 0:
            raise ConfigurationError("the device's clock must not run backwards")
        return clock

    def of_device(self, t_ns: int) -> Iterator[tuple[int, Fault, random.Random]]:
        """Yield the faults of transducers that are there at *t_ns*, with what is random there."""
        for number, fault in enumerate(self.faults):
            if is_of_transducers(fault.name) and fault.is_there(t_ns):
                yield number, fault, self._random(number, "device", t_ns, b"")

    def named(self, name: str) -> Iterator[Fault]:
        """Yield the faults with this name."""
        return (fault for fault in self.faults if fault.name == name)

    def _random(self, number: int, where: str, t_ns: int, chunk: bytes) -> random.Random:
        return random.Random(f"{self.seed}/{number}/{where}/{t_ns}/{zlib.crc32(chunk)}")


def is_of_transducers(name: str) -> bool:
    """Return whether a fault changes what is radiated."""
    return name.startswith("device.") and name not in REPORTS


def _has_direction(name: str) -> bool:
    return name.startswith("line.") and name != "line.disconnect"


def _direction(name: str, text: str | None) -> str:
    if name in REPORTS:
        return "up"
    if name.startswith("frame."):
        return "down"
    if text is not None and text not in ("down", "up", _BOTH):
        raise ConfigurationError(f"{name} direction={text}, must be down, up or both")
    return text or _BOTH


def _end_ns(name: str, values: Mapping[str, float], from_ns: int) -> int:
    """Return when a fault is over by itself."""
    if name != "line.disconnect":
        return _FOR_EVER_NS
    return from_ns + round(values["ms"] * _NS_PER_MS)


def _number(name: str, key: str, text: str, limits: Parameter) -> float:
    try:
        value = float(text)
    except ValueError as error:
        raise ConfigurationError(f"{name} {key}={text} is not a number") from error
    if not limits.least <= value <= limits.most:
        raise ConfigurationError(
            f"{name} {key}={text}, must be {shown(limits.least)} to {shown(limits.most)}"
        )
    if limits.whole and value != round(value):
        raise ConfigurationError(f"{name} {key}={text}, must be a whole number")
    return value


def _time_ns(word: str, text: str) -> int:
    number = text.rstrip("nums")
    unit = text[len(number) :]
    try:
        t_ns = round(float(number) * _UNITS_NS[unit])
    except (KeyError, ValueError, OverflowError) as error:
        raise ConfigurationError(f"{word}: must be a time such as 2s, 500ms, 10us") from error
    if not 0 <= t_ns <= _FOR_EVER_NS:
        raise ConfigurationError(f"{word}={text}: must not be before power-up, nor in 146 years")
    return t_ns


def _time_text(t_ns: int) -> str:
    unit = next(unit for unit, size_ns in _UNITS_NS.items() if t_ns % size_ns == 0)
    return f"{t_ns // _UNITS_NS[unit]}{unit}"


def _check_place(name: str, values: Mapping[str, float]) -> None:
    places = sum(values[place] >= 0 for place in PLACES if place in values)
    if is_of_transducers(name) and places != 1:
        words = [f"{place}=N" for place in PLACES]
        text = f"{', '.join(words[:-1])} or {words[-1]}"
        raise ConfigurationError(f"{name}: must have either {text}")


def _from_table(table: dict[str, Any]) -> Fault:
    name = str(table.get("name", ""))
    return Fault.of(name, {key: str(value) for key, value in table.items() if key != "name"})


def _text(value: float | str) -> str:
    return value if isinstance(value, str) else shown(value)


def _toml(value: float | str) -> str:
    return f'"{value}"' if isinstance(value, str) else shown(value)
