"""Session files of sigrok and PulseView (.sr), version 2: a zip of metadata and raw samples."""

from __future__ import annotations

import configparser
import re
import zipfile
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from haptogram.errors import ConfigurationError, unreadable_file

from .capture import MOST_EDGES, Capture, ChannelEdges

_BLOCK: Final = 4 << 20  # bytes of samples at a time
_RATE: Final = re.compile(r"\s*([0-9.]{1,30})\s*([kMG]?)(?:Hz)?\s*")
_FACTORS: Final = {"": 1.0, "k": 1e3, "M": 1e6, "G": 1e9}
_MOST_BYTES: Final = 4 << 30
_MOST_METADATA: Final = 1 << 20


@dataclass(frozen=True, slots=True)
class _Metadata:
    prefix: str
    rate_hz: float
    unit_size: int
    probes: dict[int, str]  # bit -> name


def read_sigrok(path: Path) -> Capture:
    """Return the edges of all logic channels; a tick is a sample.

    Raises
    ------
    ConfigurationError
        A file that cannot be read, is no such session, or was cut off.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            return _read_whole_sigrok(path, archive)
    except ConfigurationError:
        raise
    except OSError as error:
        raise unreadable_file(path, error, "capture") from error
    except (zipfile.BadZipFile, EOFError) as error:
        raise ConfigurationError(
            f"{path}: no session file of sigrok, or one that was cut off ({error}); save it again"
        ) from error
    except Exception as error:  # what the parsers of the library happen to raise
        raise ConfigurationError(f"{path}: the samples are damaged; capture again") from error


def _read_whole_sigrok(path: Path, archive: zipfile.ZipFile) -> Capture:
    """Read metadata and all sample files of a sigrok session into a capture.

    Refuses no metadata, over 1 MiB of it, or over 4 GiB of samples.
    """
    names = archive.namelist()
    if "metadata" not in names:
        raise ConfigurationError(f"{path}: a zip without metadata, no session file of sigrok")
    if archive.getinfo("metadata").file_size > _MOST_METADATA:
        raise ConfigurationError(f"{path}: its metadata are over {_MOST_METADATA >> 20} MiB")
    found = _sigrok_metadata(path, archive.read("metadata"))
    samples = _SigrokSamples(path, found)
    parts = [(_sigrok_part(found.prefix, name), name) for name in names]
    size = sum(archive.getinfo(name).file_size for part, name in parts if part is not None)
    if size > _MOST_BYTES:
        raise ConfigurationError(
            f"{path}: {size / 2**30:.3g} GiB of samples, can be {_MOST_BYTES >> 30} GiB; capture "
            "a shorter time, fewer channels, or at a lower rate"
        )
    for _, name in sorted((part, name) for part, name in parts if part is not None):
        with archive.open(name) as entry:
            while block := entry.read(_BLOCK // found.unit_size * found.unit_size):
                samples.take(block)
    return samples.capture()


def _sigrok_metadata(path: Path, data: bytes) -> _Metadata:
    """Return files, sampling rate and channels that a sigrok session has.

    Refuses one without device or logic channel, and channels of one name.
    """
    parser = configparser.ConfigParser(interpolation=None, strict=False)
    try:
        parser.read_string(data.decode("utf-8", "replace"))
        device = next(parser[name] for name in parser.sections() if name.startswith("device"))
        prefix, unit_size = device["capturefile"], int(device.get("unitsize", "1"))
        rate = _RATE.fullmatch(device["samplerate"])
        if rate is None or not 1 <= unit_size <= 64:
            raise ValueError(device["samplerate"])
        rate_hz = float(rate[1]) * _FACTORS[rate[2]]
        probes = {
            int(key.removeprefix("probe")) - 1: name
            for key, name in device.items()
            if re.fullmatch(r"probe\d+", key)
        }
    except (configparser.Error, StopIteration, KeyError, ValueError) as error:
        raise ConfigurationError(
            f"{path}: metadata without a device that has capturefile, samplerate and unitsize"
        ) from error
    probes = {bit: name for bit, name in probes.items() if 0 <= bit < 8 * unit_size}
    if rate_hz <= 0.0 or not probes:
        raise ConfigurationError(f"{path}: no logic channel, or a sampling rate of 0")
    ((name, count),) = Counter(probes.values()).most_common(1)
    if count > 1:
        raise ConfigurationError(f"{path}: {count} channels are named {name!r}; give each its own")
    return _Metadata(prefix, rate_hz, unit_size, probes)


def _sigrok_part(prefix: str, name: str) -> int | None:
    """Return the number of a sample file, 0 if there is one alone; None for other entries.

    *prefix* is the name of the only one, or what stands before "-1".
    """
    if name == prefix:
        return 0
    found = re.fullmatch(rf"{re.escape(prefix)}-(\d{{1,9}})", name)
    return None if found is None else int(found[1])


class _SigrokSamples:
    """The edges of the samples that were read so far."""

    def __init__(self, path: Path, metadata: _Metadata) -> None:
        self._path, self._metadata = path, metadata
        self._taken = self._edges = 0
        self._rest = b""
        self._last: NDArray[np.uint8] | None = None
        self._firsts = np.zeros(metadata.unit_size, np.uint8)
        self._times: dict[int, list[NDArray[np.int64]]] = {bit: [] for bit in metadata.probes}

    def take(self, block: bytes) -> None:
        """Take the next bytes; part of a sample waits for the rest of it."""
        size = self._metadata.unit_size
        data = self._rest + block
        whole = len(data) // size * size
        self._rest = data[whole:]
        if not whole:
            return
        samples = np.frombuffer(data[:whole], np.uint8).reshape(-1, size)
        if self._last is None:
            self._firsts = self._last = samples[0].copy()
        for byte in range(size):
            self._take_byte(byte, samples[:, byte])
        self._last = samples[-1].copy()
        self._taken += len(samples)
        if self._edges > MOST_EDGES:
            raise ConfigurationError(
                f"{self._path}: more than {MOST_EDGES} edges; capture a shorter time"
            )

    def _take_byte(self, byte: int, samples: NDArray[np.uint8]) -> None:
        """Append the edges of the eight channels in byte number *byte* of the *samples*."""
        assert self._last is not None  # take() sets it
        changed = np.empty(len(samples), np.uint8)
        changed[0] = samples[0] ^ self._last[byte]
        np.bitwise_xor(samples[1:], samples[:-1], out=changed[1:])
        places = np.flatnonzero(changed)
        bits = changed[places]
        for bit in range(8 * byte, 8 * byte + 8):
            if bit in self._times:
                found = places[(bits >> (bit - 8 * byte)) & 1 == 1]
                self._times[bit].append(found + self._taken)
                self._edges += len(found)

    def capture(self) -> Capture:
        """Return everything that was taken; refuse a file without samples."""
        if not self._taken:
            raise ConfigurationError(f"{self._path}: no samples")
        channels = {}
        for bit, name in self._metadata.probes.items():
            first = bool(self._firsts[bit // 8] >> (bit % 8) & 1)
            channels[name] = ChannelEdges(np.concatenate(self._times.pop(bit)), first)
        rate_hz = self._metadata.rate_hz
        cut = "the last sample is not whole" if self._rest else ""
        return Capture(self._path, channels, 1.0 / rate_hz, self._taken - 1, rate_hz, cut)
