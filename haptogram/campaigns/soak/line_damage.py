"""The faults of the soak's line: each makes pieces of the bytes of a frame.

The names are those of :mod:`haptogram.settings.faults`, and two more: ``lose`` takes a whole frame
away, ``junk`` puts a run before it that is longer than a frame can be.  A fault is drawn for a
whole frame, not for a byte, so that the account knows the fault of every frame.
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from typing import Final, TypeAlias

from haptogram.settings.faults.kinds import FAULT_KINDS
from haptogram_protocol.framing import MAX_ENCODED_BYTES

#: Pieces of a frame, each with how long the line waits before it.
Pieces: TypeAlias = list[tuple[int, bytes]]

_MOST_FLIPS: Final = 3
_BURST_BYTES: Final = round(FAULT_KINDS["line.burst"]["bytes"].default)
_MOST_INSERTED: Final = 4
_JUNK_BYTES: Final = MAX_ENCODED_BYTES + 100
_LEAST_DELAY_NS: Final = 100_000
_MOST_DELAY_NS: Final = 60_000_000  # beyond the lead of the stream: some frames come too late


def _flip_damage(wire: bytes, source: random.Random) -> Pieces:
    flipped = bytearray(wire)
    for place in source.sample(range(8 * len(wire)), source.randint(1, _MOST_FLIPS)):
        flipped[place // 8] ^= 1 << place % 8
    return [(0, bytes(flipped))]


def _burst_damage(wire: bytes, source: random.Random) -> Pieces:
    place = source.randrange(len(wire))
    count = min(_BURST_BYTES, len(wire) - place)
    return [(0, wire[:place] + source.randbytes(count) + wire[place + count :])]


def _drop_damage(wire: bytes, source: random.Random) -> Pieces:
    place = source.randrange(len(wire))
    return [(0, wire[:place] + wire[place + 1 :])]


def _insert_damage(wire: bytes, source: random.Random) -> Pieces:
    place = source.randrange(len(wire) + 1)
    more = source.randbytes(source.randint(1, _MOST_INSERTED))
    return [(0, wire[:place] + more + wire[place:])]


def _truncate_damage(wire: bytes, source: random.Random) -> Pieces:
    return [(0, wire[: source.randrange(len(wire))])]


def _break_damage(_: bytes, __: random.Random) -> Pieces:
    return [(0, b"\x00")]  # what a receiver makes of a line held low


def _loss_damage(_: bytes, __: random.Random) -> Pieces:
    return []


def _duplicate_damage(wire: bytes, _: random.Random) -> Pieces:
    return [(0, wire), (0, wire)]


def _junk_damage(wire: bytes, source: random.Random) -> Pieces:
    return [(0, source.randbytes(_JUNK_BYTES).replace(b"\x00", b"\x01")), (0, wire)]


def _delay_damage(wire: bytes, source: random.Random) -> Pieces:
    spread = math.log(_MOST_DELAY_NS / _LEAST_DELAY_NS)
    return [(round(_LEAST_DELAY_NS * math.exp(spread * source.random())), wire)]


def _slice_damage(wire: bytes, source: random.Random) -> Pieces:
    place = source.randrange(1, len(wire))
    return [(0, wire[:place]), (source.randrange(_LEAST_DELAY_NS), wire[place:])]


FAULTS: Final[dict[str, Callable[[bytes, random.Random], Pieces]]] = {
    "flip": _flip_damage,
    "burst": _burst_damage,
    "drop": _drop_damage,
    "insert": _insert_damage,
    "truncate": _truncate_damage,
    "break": _break_damage,
    "lose": _loss_damage,
    "duplicate": _duplicate_damage,
    "junk": _junk_damage,
    "delay": _delay_damage,
    "slice": _slice_damage,
}
KINDS: Final = tuple(FAULTS)
