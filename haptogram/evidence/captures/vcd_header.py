"""Declarations of a value change dump (IEEE 1364-2005, clause 18.2.3): time scale and channels."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, Final, TypeAlias

from haptogram.errors import ConfigurationError

from .capture import MOST_CHANNELS

#: Characters of an identifier code: packed into an int64.
LONGEST_ID: Final = 7
_LONGEST_HEADER: Final = 1 << 22
_END_OF_HEADER: Final = re.compile(rb"\$enddefinitions\s+\$end")
_TIMESCALE: Final = re.compile(r"(1|10|100)\s*(s|ms|us|ns|ps|fs)")
_NO_BITS: Final = ("real", "realtime", "string", "event")
_UNITS_S: Final = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "ps": 1e-12, "fs": 1e-15}
_WIDTH: Final = re.compile(r"[0-9]{1,4}")
_RANGE: Final = re.compile(r"\[(-?\d{1,9}):(-?\d{1,9})\]")
#: Identifier code of a variable, packed, and a bit of it: 0 is the last one of its vectors.
VcdBit: TypeAlias = tuple[int, int]
#: Scopes, words of the name, and bit of a channel.
_Variable: TypeAlias = tuple[list[str], list[str], VcdBit]


@dataclass(frozen=True, slots=True)
class VcdHeader:
    """The declarations of a dump.

    Attributes
    ----------
    tick_s : float
        Seconds in a tick.
    names : mapping of str to (int, int)
        Identifier code of each channel, packed into a number of base 256, and its bit.
    """

    tick_s: float
    names: Mapping[str, VcdBit]


def read_vcd_header(path: Path, file: BinaryIO) -> tuple[VcdHeader, bytes]:
    """Return the declarations, and the bytes that were read after them.

    Raises
    ------
    ConfigurationError
        A file that is no VCD, without a time scale or a channel, or with two of one name.
    """
    data = b""
    while (end := _END_OF_HEADER.search(data)) is None:
        more = file.read(1 << 16)
        if not more or len(data) > _LONGEST_HEADER:
            raise ConfigurationError(
                f"{path}: no $enddefinitions: it is neither a VCD nor a session of sigrok (.sr), "
                "or was cut off in its header"
            )
        data += more
    words = data[: end.start()].decode("utf-8", "replace").split()
    return _vcd_declarations(path, words), data[end.end() :]


def _vcd_declarations(path: Path, words: list[str]) -> VcdHeader:
    """Parse the declarations of a VCD file: time unit, scopes, variables and buses.

    Refuses one without time unit, and none or over 2048 channels.
    """
    scopes: list[str] = []
    found: list[_Variable] = []
    buses: list[tuple[list[str], list[str]]] = []
    tick_s = None
    for keyword, body in _vcd_sections(words):
        if keyword == "$timescale":
            tick_s = _vcd_timescale(path, " ".join(body))
        elif keyword == "$scope":
            scopes.append(body[-1] if body else "")
        elif keyword == "$upscope" and scopes:
            scopes.pop()
        elif keyword == "$var" and len(body) >= 4 and body[0] not in _NO_BITS:
            if body[1] == "1":
                found.append((scopes.copy(), body[3:], (_packed_vcd_code(path, body[2]), 0)))
            elif _WIDTH.fullmatch(body[1]):
                buses.append((scopes.copy(), body))
    if tick_s is None:
        raise ConfigurationError(f"{path}: no $timescale; the times of its edges are unknown")
    for scopes, body in buses:
        if len(found) + int(body[1]) <= MOST_CHANNELS:  # a simulation may hold any registers
            found += _bus_bits(path, scopes, body)
    if not 1 <= len(found) <= MOST_CHANNELS:
        raise ConfigurationError(f"{path}: {len(found)} channels, must be 1 to {MOST_CHANNELS}")
    return VcdHeader(tick_s, _named_vcd_variables(path, found))


def _bus_bits(path: Path, scopes: list[str], body: list[str]) -> list[_Variable]:
    """Split a multi-bit variable into a channel per bit, ``name[bit]``, by its range or from 0."""
    width, code = int(body[1]), _packed_vcd_code(path, body[2])
    name, numbers = _plain_vcd_words(body[3:]), _RANGE.search("".join(body[3:]))
    first, last = (int(n) for n in numbers.groups()) if numbers else (width - 1, 0)
    step = 1 if first >= last else -1
    plain = [*name[:-1], _RANGE.sub("", name[-1])]
    return [(scopes, [*plain, f"[{last + step * bit}]"], (code, bit)) for bit in range(width)]


def _vcd_sections(words: list[str]) -> Iterator[tuple[str, list[str]]]:
    """Yield each keyword with the words between it and its $end; without an $end it is left out."""
    begin = 0
    for place, word in enumerate(words):
        if word == "$end":
            if begin < place:
                yield words[begin], words[begin + 1 : place]
            begin = place + 1


def _vcd_timescale(path: Path, text: str) -> float:
    """Return the time unit of a VCD file in seconds, of a text such as "10 ns"; else raise."""
    if (found := _TIMESCALE.fullmatch(text)) is None:
        raise ConfigurationError(
            f"{path}: $timescale is {text!r}, must be 1, 10 or 100 and s, ms, us, ns, ps or fs"
        )
    return int(found[1]) * _UNITS_S[found[2]]


def _packed_vcd_code(path: Path, code: str) -> int:
    """Return an identifier as an integer of its bytes; refuse a long one."""
    if len(code) > LONGEST_ID:
        raise ConfigurationError(
            f"{path}: identifier {code!r} has {len(code)} characters, can have {LONGEST_ID}"
        )
    return int.from_bytes(code.encode("latin-1", "replace"), "big")


def _named_vcd_variables(path: Path, found: list[_Variable]) -> dict[str, VcdBit]:
    """Return the channels by name; with their scopes where the name is not unique.

    Programs of analysers put spaces into a name; simulators name the bit of a vector after it,
    which tells the channels of one vector apart. Two channels of one full name are refused.
    """
    bits = Counter((*scopes, *_plain_vcd_words(words)) for scopes, words, _ in found)
    owners: dict[str, set[str]] = {}
    codes: dict[str, set[VcdBit]] = {}
    named = []
    for scopes, words, code in found:
        plain = _plain_vcd_words(words)
        short = " ".join(plain)
        if bits[(*scopes, *plain)] > 1 and len(plain) < len(words):
            short += words[-1]
        full = ".".join([*scopes, short])
        named.append((full, short, code))
        owners.setdefault(short, set()).add(full)
        codes.setdefault(full, set()).add(code)
    if twice := [full for full, known in codes.items() if len(known) > 1]:
        raise ConfigurationError(
            f"{path}: {len(codes[twice[0]])} channels are named {twice[0]!r}; give each its own"
        )
    return {short if len(owners[short]) == 1 else full: code for full, short, code in named}


def _plain_vcd_words(words: list[str]) -> list[str]:
    """Return the words of a name without a trailing bit index."""
    return words[:-1] if len(words) > 1 and words[-1].startswith("[") else words
