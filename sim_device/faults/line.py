"""Effects of the faults of the line on the chunks that are sent."""

from __future__ import annotations

import dataclasses
import math
import random
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final, TypeAlias

from ..line.sampling import sample_uart_characters

_NS_PER_US: Final = 1_000
_NS_PER_MS: Final = 1_000_000


@dataclass(frozen=True, slots=True)
class FaultChunk:
    """Bytes that are sent in one go, at ``t_ns``."""

    t_ns: int
    data: bytes


Values: TypeAlias = Mapping[str, float]
# What a fault leaves of the chunks, and how often it fired.
Acted: TypeAlias = tuple[list[FaultChunk], int]
# Given chunks, parameters and a source of chance.
LineFault: TypeAlias = Callable[[list[FaultChunk], Values, random.Random], Acted]
# Given the bytes of a chunk, which it changes: how often it fired.
Edit: TypeAlias = Callable[[bytearray, Values, random.Random], int]


def _fault_places(count: int, chance: float, source: random.Random) -> Iterator[int]:
    """Yield the random places out of *count* that are hit, each with probability *chance*."""
    if chance <= 0:
        return
    place = -1
    while True:
        gap = 0.0 if chance >= 1 else math.log(1 - source.random()) / math.log1p(-chance)
        place += 1 + int(min(gap, count))  # the gap of the least chance is infinite
        if place >= count:
            return
        yield place


def fault_on_bytes(edit: Edit) -> LineFault:
    """Return a fault that applies *edit* to the bytes of each chunk."""

    def act(chunks: list[FaultChunk], values: Values, source: random.Random) -> Acted:
        changed, fired = [], 0
        for chunk in chunks:
            data = bytearray(chunk.data)
            fired += edit(data, values, source)
            changed.append(FaultChunk(chunk.t_ns, bytes(data)))
        return changed, fired

    return act


def _flip_fault(data: bytearray, values: Values, source: random.Random) -> int:
    """Flip each bit with probability "ber"; return how many."""
    places = list(_fault_places(8 * len(data), values["ber"], source))
    for place in places:
        data[place // 8] ^= 1 << place % 8
    return len(places)


def _drop_fault(data: bytearray, values: Values, source: random.Random) -> int:
    """Remove each byte with probability "p"; return how many."""
    places = list(_fault_places(len(data), values["p"], source))
    for place in reversed(places):
        del data[place]
    return len(places)


def _insert_fault(data: bytearray, values: Values, source: random.Random) -> int:
    """Insert a random byte before each byte with probability "p"; return how many."""
    places = list(_fault_places(len(data), values["p"], source))
    for place in reversed(places):
        data.insert(place, source.randrange(256))
    return len(places)


def _burst_fault(data: bytearray, values: Values, source: random.Random) -> int:
    """Overwrite runs of "bytes" bytes with random ones; return how many runs.

    At each byte one begins with probability "p".
    """
    places = list(_fault_places(len(data), values["p"], source))
    for place in places:
        stop = min(len(data), place + round(values["bytes"]))
        data[place:stop] = source.randbytes(stop - place)
    return len(places)


def _loss_fault(data: bytearray, values: Values, source: random.Random) -> int:
    """With probability "p" remove "bytes" bytes (or all) from a random one on; return 0 or 1."""
    fires = source.random() < values["p"]
    if fires:
        first = source.randrange(len(data))
        del data[first : first + round(values.get("bytes", len(data)))]
    return int(fires)


def _break_fault(data: bytearray, values: Values, source: random.Random) -> int:
    """With probability "p" replace the bytes by one zero, as on a line held low; return 0 or 1."""
    fires = data != b"\x00" and source.random() < values["p"]
    if fires:
        data[:] = b"\x00"  # what a receiver makes of a line held low
    return int(fires)


def _baud_fault(data: bytearray, values: Values, _: random.Random) -> int:
    """Sample the bytes at a bit rate that is wrong by "ppm"; return 1 if any changed, else 0."""
    received, __ = sample_uart_characters(bytes(data), 1 + values["ppm"] / 1e6)
    is_changed = received != data
    data[:] = received
    return int(is_changed)


def _no_line_fault(chunks: list[FaultChunk], _: Values, __: random.Random) -> Acted:
    """Lose all chunks, as on a cut wire; return none, and how many they were."""
    return [], len(chunks)


def _gone_fault(_: list[FaultChunk], __: Values, ___: random.Random) -> Acted:
    """Lose all chunks of an unplugged port; return none, and 0: the unplugging is counted."""
    return [], 0  # it fires once, when the port goes: see FaultInjector.has_left


def _duplicate_fault(chunks: list[FaultChunk], values: Values, source: random.Random) -> Acted:
    """Send each chunk twice with probability "p"; return all, and how many are copies."""
    doubled: list[FaultChunk] = []
    for chunk in chunks:
        doubled += [chunk] * (1 + (source.random() < values["p"]))
    return doubled, len(doubled) - len(chunks)


def _delay_fault(chunks: list[FaultChunk], values: Values, source: random.Random) -> Acted:
    """Delay all chunks by "us" plus a random part of "jitter_us", the same one for all.

    Returns the chunks and how many were delayed.
    """
    late_us = values["us"] + values["jitter_us"] * source.random()
    late_ns = round(late_us * _NS_PER_US)
    late = [FaultChunk(chunk.t_ns + late_ns, chunk.data) for chunk in chunks]
    return late, len(late) if late_ns else 0


def _slice_fault(chunks: list[FaultChunk], values: Values, _: random.Random) -> Acted:
    """Cut chunks into pieces of "bytes" bytes, "gap_us" apart.

    Returns the pieces, and by how many they are more than the chunks.
    """
    size, gap_ns = round(values["bytes"]), round(values["gap_us"] * _NS_PER_US)
    cut = [
        FaultChunk(chunk.t_ns + k * gap_ns, chunk.data[start : start + size])
        for chunk in chunks
        for k, start in enumerate(range(0, len(chunk.data), size))
    ]
    return cut, len(cut) - len(chunks)


def _grid_fault(name: str, unit_ns: int) -> LineFault:
    """Return a fault that holds each chunk until the next point of a grid in time.

    The step of the grid is the fault's parameter *name*, in units of *unit_ns* nanoseconds.
    """

    def act(chunks: list[FaultChunk], values: Values, _: random.Random) -> Acted:
        grid_ns = round(values[name] * unit_ns) or 1
        held = [dataclasses.replace(c, t_ns=-(-c.t_ns // grid_ns) * grid_ns) for c in chunks]
        return held, sum(new != old for new, old in zip(held, chunks, strict=True))

    return act


LINE_FAULTS: Final[Mapping[str, LineFault]] = MappingProxyType(
    {
        "line.flip": fault_on_bytes(_flip_fault),
        "line.drop": fault_on_bytes(_drop_fault),
        "line.insert": fault_on_bytes(_insert_fault),
        "line.burst": fault_on_bytes(_burst_fault),
        "line.truncate": fault_on_bytes(_loss_fault),
        "line.overrun": fault_on_bytes(_loss_fault),
        "line.break": fault_on_bytes(_break_fault),
        "line.baud": fault_on_bytes(_baud_fault),
        "line.half_open": _no_line_fault,
        "line.disconnect": _gone_fault,
        "line.duplicate": _duplicate_fault,
        "line.delay": _delay_fault,
        "line.slice": _slice_fault,
        "line.coalesce": _grid_fault("us", _NS_PER_US),
        "line.batch": _grid_fault("ms", _NS_PER_MS),
    }
)
