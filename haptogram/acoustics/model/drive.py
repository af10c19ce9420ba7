"""The drive of an array: a phase code and an amplitude code for each element.

A phase code c **delays** its element by c / 2^b of a carrier period. With the time factor
e^{-j w t} the weight is w = A e^{j phi}, phi = 2 pi c / 2^b: positive phi is a lag.
"""

from __future__ import annotations

import functools
import math
import zlib
from collections.abc import Mapping
from typing import Any, Final, Self, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from haptogram.acoustics.arrays import (
    MAX_TRANSDUCERS,
    ComplexArray,
    FloatArray,
    as_complex_array,
    as_float_array,
    check_array_magnitudes,
    read_only_array,
)
from haptogram.errors import ConfigurationError
from haptogram.settings.arguments import check_argument_kind, check_whole
from haptogram.settings.frozen import dataclass

PhaseCodes: TypeAlias = NDArray[np.uint8 | np.uint16]

MAX_PHASE_BITS: Final = 16
REGISTER_BITS: Final = 8  # phase bits of the registers of most boards, and of the wire
FULL_AMPLITUDE: Final = 255
_CEILING: Final = 1.0 + 1e-6  # a magnitude of 1, with the rounding of single precision

#: Half a step, and what rounding takes from it: half of full amplitude is between two codes, and
#: takes the upper one at any phase.
_UP: Final = 0.5 + 1e-10
_MAX_WEIGHT: Final = 1e6  # the field is linear; far above, single precision is not


_TURN_RAD: Final = 2.0 * math.pi
_MAX_PHASE_RAD: Final = 1e9  # beyond it a float64 no longer resolves a 16-bit step well


@dataclass(frozen=True, eq=False, slots=True)
class Drive:
    """One drive of the whole array; equal drives compare and hash equal.

    Attributes
    ----------
    phase_codes : (N,) numpy.ndarray of uint8, from 9 bits on of uint16
        Codes 0 .. 2^phase_bits - 1; copied, read-only.
    amplitude_codes : (N,) numpy.ndarray of uint8
        Codes 0 .. 255, linear in pressure; copied, read-only.
    phase_bits : int
        Bits of a phase code, 1 to 16.

    Raises
    ------
    ConfigurationError
        Lengths that differ, a code out of range, no element or more than 1024.

    Examples
    --------
    >>> drive == Drive.from_weights(weights, phase_bits=8), int(drive.amplitude_codes.max())
    (True, 255)
    """

    phase_codes: PhaseCodes
    amplitude_codes: NDArray[np.uint8]
    phase_bits: int = REGISTER_BITS

    def __post_init__(self) -> None:
        bits = check_phase_bits(self.phase_bits)
        kind = _phase_code_type(bits)
        phases = _as_drive_codes("phase_codes", self.phase_codes, (1 << bits) - 1, kind)
        amplitudes = _as_drive_codes(
            "amplitude_codes", self.amplitude_codes, FULL_AMPLITUDE, np.uint8
        )
        if len(phases) != len(amplitudes):
            raise ConfigurationError(
                f"{len(phases)} phase codes and {len(amplitudes)} amplitude codes, must be as many"
            )
        object.__setattr__(self, "phase_codes", phases)
        object.__setattr__(self, "amplitude_codes", amplitudes)
        object.__setattr__(self, "phase_bits", bits)

    @classmethod
    def muted(cls, count: int, phase_bits: int = REGISTER_BITS) -> Self:
        """Return the drive of *count* elements that radiates nothing."""
        codes = np.zeros(check_whole("count", count, 1, MAX_TRANSDUCERS), dtype=np.uint8)
        return cls(codes, codes, phase_bits)

    @classmethod
    def from_weights(cls, weights: ArrayLike, phase_bits: int = REGISTER_BITS) -> Self:
        """Return the drive nearest to the (N,) complex *weights*; one of 0 takes phase code 0.

        Raises
        ------
        ConfigurationError
            For a magnitude above 1, which no transducer can follow: see :func:`saturated_weights`.
        """
        values = as_weights(weights)
        levels = np.abs(values)
        if levels.size and levels.max() > _CEILING:
            element = int(levels.argmax())
            raise ConfigurationError(
                f"weights[{element}] has the magnitude {levels.max():g}, must be 1 at most"
            )
        amplitudes = np.floor(FULL_AMPLITUDE * np.minimum(levels, 1.0) + _UP)
        # np.angle(0) may be pi for a negative zero; where() keeps code 0 for a silent element.
        angles = np.where(values == 0.0, 0.0, np.angle(values))
        return cls(quantise_phase(angles, phase_bits), amplitudes.astype(np.uint8), phase_bits)

    @classmethod
    def from_bytes(cls, phases: bytes, amplitudes: bytes, phase_bits: int = REGISTER_BITS) -> Self:
        """Return the drive of :attr:`phase_bytes` and of a byte for each amplitude.

        Raises
        ------
        ConfigurationError
            Arguments that are no bytes, or those of :class:`Drive`.
        """
        for name, part in (("phases", phases), ("amplitudes", amplitudes)):
            if type(part) is not bytes:
                kinds = (bytes, bytearray, memoryview, np.ndarray)
                check_argument_kind(name, part, kinds, "bytes")
        are_bytes = type(phases) is bytes and type(amplitudes) is bytes
        is_usual = phase_bits == REGISTER_BITS and 0 < len(phases) <= MAX_TRANSDUCERS
        if are_bytes and is_usual and len(phases) == len(amplitudes):  # no code can be wrong
            drive = object.__new__(cls)
            object.__setattr__(drive, "phase_codes", np.frombuffer(phases, np.uint8))
            object.__setattr__(drive, "amplitude_codes", _codes_of_bytes(amplitudes))
            object.__setattr__(drive, "phase_bits", REGISTER_BITS)
            return drive
        kind = _CODES_IN_BYTES[_phase_code_type(check_phase_bits(phase_bits))]
        if len(phases) % kind.itemsize:
            raise ConfigurationError(f"{len(phases)} bytes of phases, must be whole codes of 2")
        codes = np.frombuffer(phases, kind), np.frombuffer(amplitudes, np.uint8)
        return cls(*codes, phase_bits)

    def in_bits(self, phase_bits: int) -> Self:
        """Return the drive with phase codes of another resolution, the nearest ones."""
        finer = check_phase_bits(phase_bits) - self.phase_bits
        if not finer:
            return self
        codes = self.phase_codes.astype(np.int64)
        codes = codes << finer if finer > 0 else (codes + (1 << -finer - 1)) >> -finer
        kind = _phase_code_type(phase_bits)
        return type(self)(
            (codes % (1 << phase_bits)).astype(kind), self.amplitude_codes, phase_bits
        )

    @property
    def phase_bytes(self) -> bytes:
        """The phase codes, a byte for each element; from 9 bits on two, the low one first."""
        if self.phase_bits <= REGISTER_BITS:
            return self.phase_codes.tobytes()
        return self.phase_codes.astype("<u2").tobytes()

    @property
    def count(self) -> int:
        """Number of elements."""
        return len(self.phase_codes)

    @property
    def is_muted(self) -> bool:
        """True if every amplitude is zero."""
        return not self.amplitude_codes.any()

    def weights(self) -> ComplexArray:
        """Return the (N,) complex weights A e^{+j phi}, with A = amplitude code / 255."""
        phasors = np.exp(1j * dequantise_phase(self.phase_codes, self.phase_bits))
        weights: ComplexArray = self.amplitude_codes / FULL_AMPLITUDE * phasors
        return weights

    def digest(self) -> int:
        """Return the u32 CRC-32 over :attr:`phase_bytes`, then a byte for each amplitude code."""
        return zlib.crc32(self.amplitude_codes.tobytes(), zlib.crc32(self.phase_bytes))

    def _key(self) -> tuple[int, bytes, bytes]:
        """Return the values that define equality."""
        return self.phase_bits, self.phase_bytes, self.amplitude_codes.tobytes()

    def __eq__(self, other: object) -> bool:
        return self._key() == other._key() if isinstance(other, Drive) else NotImplemented

    def __hash__(self) -> int:
        return hash(self._key())


def saturated_weights(weights: ArrayLike) -> ComplexArray:
    """Return *weights* with their phases, and magnitudes above 1 cut to 1, as in a drive.

    Examples
    --------
    >>> saturated_weights([2.0j, 0.5]).tolist()
    [1j, (0.5+0j)]
    """
    values = as_weights(weights)
    return values / np.maximum(np.abs(values), 1.0)


def quantise_phase(phases_rad: ArrayLike, bits: int) -> PhaseCodes:
    """Return the codes floor(phi / 2 pi * 2^bits + 1/2) mod 2^bits, in the shape given.

    Of uint8; from 9 bits on of uint16.

    Examples
    --------
    >>> quantise_phase([0.0, np.pi / 2, -np.pi / 2], 8).tolist()
    [0, 64, 192]
    """
    bits = check_phase_bits(bits)
    phases = as_float_array("phases_rad", phases_rad)
    check_array_magnitudes("phases_rad", phases, _MAX_PHASE_RAD)
    steps = np.floor(phases * ((1 << bits) / _TURN_RAD) + 0.5).astype(np.int64)
    # The remainder is taken among integers: casting a negative float is undefined.
    return (steps & ((1 << bits) - 1)).astype(_phase_code_type(bits))


def dequantise_phase(codes: PhaseCodes, bits: int) -> FloatArray:
    """Return the phases 2 pi c / 2^bits in [0, 2 pi), in radians.

    Examples
    --------
    >>> dequantise_phase(np.array([0, 64], dtype=np.uint8), 8).round(3).tolist()
    [0.0, 1.571]
    """
    return np.asarray(codes, dtype=np.float64) * phase_step_rad(bits)


def phase_step_rad(bits: int) -> float:
    """Return the least significant bit of a phase code, 2 pi / 2^bits.

    Examples
    --------
    >>> round(phase_step_rad(8), 4)
    0.0245
    """
    return _TURN_RAD / (1 << check_phase_bits(bits))


def check_phase_bits(bits: int) -> int:
    """Return *bits* as an int, or raise unless it is a whole number from 1 to 16."""
    if type(bits) is int and 1 <= bits <= MAX_PHASE_BITS:
        return bits
    return check_whole("phase_bits", bits, 1, MAX_PHASE_BITS)


def _phase_code_type(bits: int) -> type[np.uint8] | type[np.uint16]:
    """Return the integer type that holds codes of so many bits: uint8 up to 8, else uint16."""
    return np.uint8 if bits <= REGISTER_BITS else np.uint16


def as_weights(weights: ArrayLike) -> ComplexArray:
    """Return *weights* as complex128 of any shape, or raise.

    Raises
    ------
    ConfigurationError
        A value that is no number, not finite, or a million times what a transducer can follow.
    """
    values = as_complex_array("weights", weights)
    check_array_magnitudes("weights", values, _MAX_WEIGHT)
    return values


def as_drives(weights: ArrayLike, count: int) -> ComplexArray:
    """Return *weights* as one drive (N,) or several (F, N) of *count* elements, or raise."""
    drives = as_weights(weights)
    _check_drives(drives, count)
    return drives


def _check_drives(drives: NDArray[np.complexfloating], count: int) -> None:
    """Refuse drives whose last dimension is not the number of elements."""
    if drives.ndim not in (1, 2) or drives.shape[-1] != count:
        raise ConfigurationError(f"weights have shape {drives.shape}, must end in {count} elements")


def as_drive(weights: ArrayLike, count: int) -> ComplexArray:
    """Return *weights* as one drive (N,) of *count* elements, or raise."""
    drive = as_weights(weights)
    if drive.shape != (count,):
        raise ConfigurationError(f"weights have shape {drive.shape}, must be ({count},)")
    return drive


def as_drive_sequence(weights: ArrayLike, count: int) -> ComplexArray:
    """Return *weights* as a sequence (F, N) of at least one drive of *count* elements, or raise."""
    drives = as_weights(weights)
    if drives.ndim != 2 or not len(drives) or drives.shape[1] != count:
        raise ConfigurationError(
            f"weights have shape {drives.shape}, must be (F, {count}), F at least 1"
        )
    return drives


_MOST_CODES: Final = {np.uint8: 0xFF, np.uint16: 0xFFFF}
_CODES_IN_BYTES: Final[Mapping[type[Any], np.dtype[Any]]] = {
    np.uint8: np.dtype(np.uint8),
    np.uint16: np.dtype("<u2"),
}


@functools.lru_cache(maxsize=16)
def _codes_of_bytes(codes: bytes) -> NDArray[np.uint8]:
    """Return bytes as read-only codes of 8 bits; equal bytes give the same array, from a cache."""
    return np.frombuffer(codes, np.uint8)


def _as_drive_codes(
    name: str, values: ArrayLike, limit: int, kind: type[np.uint8] | type[np.uint16]
) -> NDArray[Any]:
    """Return codes as a read-only array, shared if already one; refuse codes above *limit*."""
    if isinstance(values, np.ndarray) and values.dtype == kind and limit == _MOST_CODES[kind]:
        # Nobody can change bytes, nor what is read-only and no view: those are shared.
        flags = values.flags
        if not flags.writeable and values.ndim == 1 and 1 <= len(values) <= MAX_TRANSDUCERS:
            base: object = values.base
            if flags.owndata or (isinstance(base, bytes) and flags.c_contiguous):
                return values
    try:
        array = np.asarray(values)
    except ValueError as error:  # rows of different lengths
        raise ConfigurationError(f"{name} is not an array of numbers: {error}") from error
    if array.ndim != 1 or array.dtype.kind not in "ui":
        raise ConfigurationError(
            f"{name} is {array.dtype} of shape {array.shape}, must be (N,) whole numbers"
        )
    if not 1 <= array.size <= MAX_TRANSDUCERS:
        raise ConfigurationError(f"{name} holds {array.size} codes, must be 1 to {MAX_TRANSDUCERS}")
    if array.dtype != kind or limit < _MOST_CODES[kind]:  # else there is nothing to find
        low, high = int(array.min()), int(array.max())
        if low < 0 or high > limit:
            worst = low if low < 0 else high
            raise ConfigurationError(f"{name} holds {worst}, must be 0 to {limit}")
    codes = array.astype(kind)
    read_only_array(codes)
    return codes
