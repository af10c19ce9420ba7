"""Value change dumps (IEEE 1364-2005, clause 18), as logic analysers and simulators write them.

The file is read in chunks, each of which becomes arrays of tokens; nothing is kept but edges.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from haptogram.errors import ConfigurationError, reading_file

from .capture import MOST_EDGES, Capture, ChannelEdges
from .vcd_header import LONGEST_ID, VcdBit, VcdHeader, read_vcd_header

_CHUNK: Final = 4 << 20  # bytes
_MOST_DIGITS: Final = 18
_FEW_CODES: Final = 1 << 16  # identifiers of one sign or two
_NARROW: Final = 1 << 15  # channels that 16 bits count
_HASH, _DOLLAR, _ZERO, _ONE = (ord(c) for c in "#$01")
_SCALARS: Final = np.frombuffer(b"01xXzZ", np.uint8)
_VECTORS: Final = np.frombuffer(b"bB", np.uint8)
_WORDS: Final = np.frombuffer(b"bBrRsS", np.uint8)  # vectors, reals and texts (of simulators)

_Bytes: TypeAlias = NDArray[np.uint8]
_Numbers: TypeAlias = NDArray[np.int64]


def read_vcd(path: Path) -> Capture:
    """Return the edges of all bits; times count from the first one of the file.

    A file that was cut off is read as far as its last whole line; :attr:`Capture.cut` tells.

    Raises
    ------
    ConfigurationError
        A file that cannot be read or is no VCD: names the place.
    """
    with reading_file(path, "capture"), path.open("rb") as file:
        header, rest = read_vcd_header(path, file)
        body = _VcdBody(path, sorted(set(header.names.values())))
        cut = ""
        for chunk, is_whole in _vcd_chunks(path, file, rest):
            body.take(chunk)
            cut = "" if is_whole else "the file ends in the middle of a line"
    return body.capture(header, cut)


def _vcd_chunks(path: Path, file: BinaryIO, rest: bytes) -> Iterator[tuple[_Bytes, bool]]:
    """Yield chunks of whole lines, each with False if a last line is cut off and dropped.

    *rest* is what was read of the body before; a line over 16 MiB is refused.
    """
    while True:
        data = file.read(_CHUNK)
        whole = rest + data
        if not data:
            end = len(whole) if not whole.strip() else whole.rfind(b"\n") + 1
            yield np.frombuffer(whole[:end], np.uint8), end == len(whole)
            return
        end = whole.rfind(b"\n") + 1
        if not end and len(whole) > 4 * _CHUNK:
            raise ConfigurationError(f"{path}: a line is longer than {4 * _CHUNK >> 20} MiB")
        rest = whole[end:]
        yield np.frombuffer(whole[:end], np.uint8), True


@dataclass(slots=True)
class _VcdChannel:
    """The changes of value of one channel that were read so far."""

    level: int = -1  # the last one that is defined
    first: int = -1
    undefined: int = 0
    defined_from: int = 0
    times: list[_Numbers] = field(default_factory=list)

    def change(self, times: _Numbers, values: _Bytes) -> int:
        """Take changes to the characters *values*, in order; return how many are edges.

        An edge is a change between 0 and 1; x and z are counted.
        """
        defined = (values == _ZERO) | (values == _ONE)
        self.undefined += int((~defined).sum())
        if not defined.any():
            return 0
        if self.level < 0:
            first = int(defined.argmax())
            self.undefined = int((~defined[first:]).sum())
            self.defined_from = int(times[first])
            self.first = self.level = int(values[first] == _ONE)
        times, levels = times[defined], (values[defined] == _ONE).astype(np.int8)
        changed = np.diff(levels, prepend=np.int8(self.level)) != 0
        self.level = int(levels[-1])
        self.times.append(times[changed])
        return int(changed.sum())

    def take_edges(self) -> ChannelEdges:
        """Return the edges, which are kept no longer."""
        times = np.concatenate(self.times) if self.times else np.zeros(0, np.int64)
        self.times.clear()
        edges = _vcd_times_without_glitches(times)
        return ChannelEdges(edges, self.first == 1, self.undefined, self.defined_from)


class _VcdBody:
    """The changes of value that were read so far."""

    def __init__(self, path: Path, bits: list[VcdBit]) -> None:
        self.path, self.bits = path, bits  # of the channels, in order
        self.now: int | None = None  # the last time stamp
        self.first = self.edges = 0
        self.in_comment = False
        self.channels = [_VcdChannel() for _ in bits]

    def take(self, data: _Bytes) -> None:
        """Take whole lines."""
        solid = np.empty(len(data) + 2, np.bool_)
        solid[0] = solid[-1] = False
        np.greater(data, 32, out=solid[1:-1])
        bounds = np.flatnonzero(solid[1:] != solid[:-1])
        starts, ends = self._without_comments(data, bounds[0::2], bounds[1::2])
        if not len(starts):
            return
        kinds = data[starts]
        words = _vcd_words_before_identifiers(kinds)
        is_identifier = np.zeros(len(kinds) + 1, np.bool_)
        is_identifier[words + 1] = True
        is_identifier = is_identifier[:-1]
        times = self._times(data, starts, ends, (kinds == _HASH) & ~is_identifier)
        scalars = np.flatnonzero(np.isin(kinds, _SCALARS) & ~is_identifier)
        vectors = words[np.isin(kinds[words], _VECTORS) & (words + 1 < len(kinds))]
        found = [(scalars, self._channels(data, starts[scalars] + 1, ends[scalars], 0))]
        written = [kinds[scalars]]
        for bit in range(max(bit for _, bit in self.bits) + 1):
            channels = self._channels(data, starts[vectors + 1], ends[vectors + 1], bit)
            ours = channels >= 0
            found.append((vectors[ours], channels[ours]))
            written.append(_vcd_bits(data, starts[vectors[ours]], ends[vectors[ours]], bit))
        places, channels = (np.concatenate(part) for part in zip(*found, strict=True))
        order = np.argsort(places, kind="stable") if len(vectors) else slice(None)
        self._change(times[places[order]], channels[order], np.concatenate(written)[order])

    def _channels(self, data: _Bytes, starts: _Numbers, ends: _Numbers, bit: int) -> _Numbers:
        """Return (K,) the channel that bit number *bit* of each identifier belongs to; -1: none.

        The identifiers lie from *starts* to *ends* in *data*.
        """
        ours = [place for place, (_, number) in enumerate(self.bits) if number == bit]
        known = np.array([self.bits[place][0] for place in ours])
        if not len(known):
            return np.full(len(starts), -1)
        codes = _packed_vcd_tokens(data, starts, ends)
        if (few := int(known[-1]) + 2) <= _FEW_CODES:
            table = np.full(few, -1)
            table[known] = ours
            return table[np.minimum(codes, few - 1)]  # the last is none, that of -1 as well
        nearest = np.minimum(np.searchsorted(known, codes), len(known) - 1)
        return np.where(known[nearest] == codes, np.array(ours)[nearest], -1)

    def _without_comments(
        self, data: _Bytes, starts: _Numbers, ends: _Numbers
    ) -> tuple[_Numbers, _Numbers]:
        """Return begins and ends of tokens, except for $ words and everything in comments."""
        commands = np.flatnonzero(data[starts] == _DOLLAR) if len(starts) else starts
        # An identifier may begin with a dollar too, but only after its value.
        keep = np.ones(len(starts), np.bool_)
        begin = 0 if self.in_comment else None
        for place in commands.tolist():
            word = data[starts[place] : ends[place]].tobytes()
            if word == b"$comment" and begin is None:
                begin = place
            elif word == b"$end":
                keep[place if begin is None else begin : place + 1] = False
                begin = None
            elif word.startswith(b"$dump"):
                keep[place] = False
        if begin is not None:
            keep[begin:] = False
        self.in_comment = begin is not None
        return starts[keep], ends[keep]

    def _times(
        self, data: _Bytes, starts: _Numbers, ends: _Numbers, is_stamp: NDArray[np.bool_]
    ) -> _Numbers:
        """Return the time of every token: that of the last time stamp before it, less the first.

        *is_stamp* marks the tokens that are stamps; time that goes back is refused.
        """
        stamps = np.flatnonzero(is_stamp)
        values = self._decimals(data, starts[stamps] + 1, ends[stamps])
        if self.now is None:
            self.first = int(values[0]) if len(values) else 0
        before = self.first if self.now is None else self.now
        known = np.concatenate([[before], values])
        if (np.diff(known) < 0).any():
            late = int(values[np.flatnonzero(np.diff(known) < 0)[0]])
            raise ConfigurationError(f"{self.path}: time goes back at #{late}")
        if len(values):
            self.now = int(values[-1])
        return known[np.cumsum(is_stamp)] - self.first

    def _decimals(self, data: _Bytes, starts: _Numbers, ends: _Numbers) -> _Numbers:
        """Return the whole numbers written from *starts* to *ends*; refuse any other text."""
        digits = ends - starts
        if len(digits) and not 1 <= digits.min() <= digits.max() <= _MOST_DIGITS:
            raise ConfigurationError(f"{self.path}: a time has no digit, or over {_MOST_DIGITS}")
        values = np.zeros(len(starts), np.int64)
        for place in range(int(digits.max(initial=0))):
            has = digits > place
            digit = data[ends[has] - 1 - place].astype(np.int64) - _ZERO
            if ((digit < 0) | (digit > 9)).any():
                raise ConfigurationError(f"{self.path}: a time is no whole number")
            values[has] += digit * 10**place
        return values

    def _change(self, times: _Numbers, channels: _Numbers, values: _Bytes) -> None:
        """Append changes of value to their channels (-1: dropped); refuse over 50 million edges."""
        ours = channels >= 0
        channels, times, values = channels[ours], times[ours], values[ours]
        narrow = channels.astype(np.int16 if len(self.bits) <= _NARROW else np.int64)
        order = np.argsort(narrow, kind="stable")  # numbers of 16 bits need no comparison
        counts = np.bincount(channels, minlength=len(self.bits))
        times, values = times[order], values[order]
        for channel, end in enumerate(np.cumsum(counts).tolist()):
            begin = end - int(counts[channel])
            if begin < end:
                self.edges += self.channels[channel].change(times[begin:end], values[begin:end])
        if self.edges > MOST_EDGES:
            raise ConfigurationError(
                f"{self.path}: more than {MOST_EDGES} edges; capture a shorter time"
            )

    def capture(self, header: VcdHeader, cut: str) -> Capture:
        """Return everything that was read."""
        by_bit = {
            bit: channel.take_edges() for bit, channel in zip(self.bits, self.channels, strict=True)
        }
        channels = {name: by_bit[bit] for name, bit in header.names.items()}
        end = 0 if self.now is None else self.now - self.first
        return Capture(self.path, channels, header.tick_s, end, None, cut)


def _vcd_words_before_identifiers(kinds: _Bytes) -> _Numbers:
    """Return the indices of vector, real and string values, each followed by an identifier.

    *kinds* are the first characters of the tokens. An identifier may begin as they do, so of
    several in a row every second one is one.
    """
    places = np.flatnonzero(np.isin(kinds, _WORDS))
    begins = np.diff(places, prepend=-2) != 1
    begin_of = places[begins][np.cumsum(begins) - 1] if len(places) else places
    words: _Numbers = places[(places - begin_of) % 2 == 0]
    return words


def _vcd_bits(data: _Bytes, starts: _Numbers, ends: _Numbers, bit: int) -> _Bytes:
    """Return the character of one bit of each vector; digits left out are filled in.

    Digits that are left out are 0, or the x or z of the first one (clause 18.2.1).
    """
    digits = ends - starts - 1
    places = np.where(bit < digits, ends - 1 - bit, np.minimum(starts + 1, ends - 1))
    found = data[places]
    is_digit = (found == _ZERO) | (found == _ONE)
    return np.where((bit >= digits) & (digits > 0) & is_digit, np.uint8(_ZERO), found)


def _packed_vcd_tokens(data: _Bytes, starts: _Numbers, ends: _Numbers) -> _Numbers:
    """Return each token as an integer, its bytes in base 256; -1 for one that is too long."""
    lengths = ends - starts
    packed: _Numbers = data[starts].astype(np.int64)  # a token has a sign at least
    for place in range(1, min(int(lengths.max(initial=0)), LONGEST_ID)):
        has = lengths > place
        packed[has] = packed[has] * 256 + data[starts[has] + place]
    packed[lengths > LONGEST_ID] = -1
    return packed


def _vcd_times_without_glitches(times: _Numbers) -> _Numbers:
    """Return ascending *times* without pairs of equal ones: a pulse of no width."""
    if not len(times) or (np.diff(times) > 0).all():
        return times
    found, counts = np.unique(times, return_counts=True)
    wide: _Numbers = found[counts % 2 == 1]
    return wide
