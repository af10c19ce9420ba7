"""Faults on purpose: what a plan of them says, and what they do.  See docs/faults.md.

A plan is data. What a fault does to a chunk follows from plan, seed, time and chunk alone, so the
same traffic meets the same faults again.
"""

from __future__ import annotations

import dataclasses
import random
import zlib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Final, Self

from haptogram.errors import ConfigurationError

from .clock import DeviceClock
from .line_faults import LINE_FAULTS, Chunk

_UNITS_NS: Final = {"ns": 1, "us": 1_000, "ms": 1_000_000, "s": 1_000_000_000}
_FOR_EVER_NS: Final = 1 << 62
_CHANCE: Final = ("ber", "p")
_WHERE: Final = {"transducer": -1.0, "column": -1.0}
# Parameters of every fault, with what they are unless something else is said.
_PARAMETERS: Final[dict[str, dict[str, float]]] = {
    "line.flip": {"ber": 1e-5},
    "line.drop": {"p": 1e-4},
    "line.insert": {"p": 1e-4},
    "line.burst": {"p": 1e-4, "bytes": 8},
    "line.duplicate": {"p": 1e-2},
    "line.truncate": {"p": 1e-2},
    "line.break": {"p": 1e-3},
    "line.delay": {"us": 1000, "jitter_us": 0},
    "line.slice": {"bytes": 16, "gap_us": 1000},
    "line.coalesce": {"us": 1000},
    "line.batch": {"ms": 16},
    "clock.offset": {"us": 1000},
    "clock.ppm": {"ppm": 100},
    "clock.step": {"us": 1000},
    "device.dead": _WHERE,
    "device.stuck": {**_WHERE, "code": 0},
    "device.delayed": {**_WHERE, "code": 64},
    "device.intermittent": {**_WHERE, "p": 0.5},
}


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
    """

    name: str
    values: Mapping[str, float]
    from_ns: int = 0
    until_ns: int = _FOR_EVER_NS

    @classmethod
    def parse(cls, text: str) -> Self:
        """Return the fault that *text* names: ``NAME [PARAMETER=VALUE ...]``.

        Raises
        ------
        ConfigurationError
            For a fault or a parameter that is not known, or a value that makes no sense.
        """
        name, *words = text.split() or [""]
        if name not in _PARAMETERS:
            raise ConfigurationError(f"no fault {name!r}; known: {', '.join(_PARAMETERS)}")
        values, times = dict(_PARAMETERS[name]), {"from": 0, "until": _FOR_EVER_NS}
        for word in words:
            key, _, value = word.partition("=")
            if key in times:
                times[key] = _time_ns(word, value)
            elif key in values:
                values[key] = _number(name, key, value)
            else:
                known = ", ".join([*_PARAMETERS[name], *times])
                raise ConfigurationError(f"{name} has no parameter {key!r}; known: {known}")
        _check_place(name, values)
        return cls(name, values, times["from"], times["until"])

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

    def line(self, direction: str, t_ns: int, chunk: bytes) -> tuple[list[Chunk], dict[str, int]]:
        """Return what becomes of *chunk*, sent at *t_ns*, and which faults did something to it.

        Parameters
        ----------
        direction : str
            ``down`` to the board or ``up`` from it: both meet the same kinds of faults.
        """
        chunks, fired = [Chunk(t_ns, chunk)], dict[str, int]()
        for number, fault in enumerate(self.faults):
            act = LINE_FAULTS.get(fault.name)
            if act is None or not fault.is_there(t_ns):
                continue
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
            elif fault.name == "clock.ppm":
                clock = dataclasses.replace(clock, ppm=clock.ppm + amount)
            elif fault.name == "clock.step":
                at_us = max(1, fault.from_ns // 1000)
                clock = dataclasses.replace(clock, step_us=amount, step_at_us=at_us)
        if clock.ppm <= -1_000_000 or clock.step_us < 0 or clock.boot_us < 0:
            raise ConfigurationError("the device's clock must not run backwards")
        return clock

    def of_device(self, t_ns: int) -> Iterator[tuple[Fault, random.Random]]:
        """Yield the faults of the device that are there at *t_ns*, with what is random there."""
        for number, fault in enumerate(self.faults):
            if fault.name.startswith("device.") and fault.is_there(t_ns):
                yield fault, self._random(number, "device", t_ns, b"")

    def _random(self, number: int, where: str, t_ns: int, chunk: bytes) -> random.Random:
        return random.Random(f"{self.seed}/{number}/{where}/{t_ns}/{zlib.crc32(chunk)}")


def _number(name: str, key: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError as error:
        raise ConfigurationError(f"{name} {key}={text} is not a number") from error
    signed = name.startswith("clock.")
    most = 1.0 if key in _CHANCE else 1e9
    least = 1.0 if key == "bytes" else -most if signed else 0.0
    if not least <= value <= most:
        raise ConfigurationError(f"{name} {key}={text}, must be {least:g} to {most:g}")
    return value


def _time_ns(word: str, text: str) -> int:
    number = text.rstrip("nums")
    unit = text[len(number) :]
    try:
        return round(float(number) * _UNITS_NS[unit])
    except (KeyError, ValueError, OverflowError) as error:
        raise ConfigurationError(f"{word}: must be a time such as 2s, 500ms, 10us") from error


def _check_place(name: str, values: Mapping[str, float]) -> None:
    if name.startswith("device.") and (values["transducer"] < 0) == (values["column"] < 0):
        raise ConfigurationError(f"{name}: must have either transducer=N or column=N")
