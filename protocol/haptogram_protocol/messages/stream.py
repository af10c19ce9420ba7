"""Frames of the stream, host to board.  SPEC.md chapter 5."""

from __future__ import annotations

from typing import ClassVar, Final

from ..documented import DocumentedEnum
from ..errors import LocalProtocolError, RemoteProtocolError
from ..record import Record, record, repeated, tail, wire
from .header import Message, MessageType

_FULL: Final = 255  # amplitude code


class PhaseFormat(DocumentedEnum):
    """Bits per phase.  HG-5.2."""

    BITS_8 = 8, "256 steps a turn"
    BITS_6 = 6, "64 steps a turn"
    BITS_5 = 5, "32 steps a turn"


def packed_size(transducers: int, bits: int) -> int:
    """Return the number of bytes of *transducers* phases of *bits* bits each.  HG-5.2."""
    return (transducers * bits + 7) // 8


def pack_phases(codes: bytes, bits: int) -> bytes:
    """Pack phase codes, first transducer in the lowest bits.  HG-5.2.

    Parameters
    ----------
    codes : (N,) bytes
        One code per transducer, each below ``2**bits``.
    bits : int
        Bits per phase: 8, 6 or 5.

    Returns
    -------
    (packed_size(N, bits),) bytes
        Packed codes; spare bits are 0.

    Raises
    ------
    LocalProtocolError
        If a code does not fit.
    """
    if bits == 8:
        return codes
    if codes and max(codes) >> bits:
        raise LocalProtocolError(f"phase code {max(codes)}; {bits} bits hold at most {2**bits - 1}")
    # A number in base 2^bits, the first transducer its last digit: Python's integers pack it.
    digits = "".join(f"{code:0{bits}b}" for code in reversed(codes))
    return int(digits or "0", 2).to_bytes(packed_size(len(codes), bits), "little")


def unpack_phases(packed: bytes, bits: int, transducers: int) -> bytes:
    """Return one phase code per transducer.  HG-5.2.

    Parameters
    ----------
    packed : bytes
        Packed codes.
    bits : int
        Bits per phase: 8, 6 or 5.
    transducers : int
        Number of codes, N.

    Returns
    -------
    (N,) bytes
        One code per transducer.

    Raises
    ------
    RemoteProtocolError
        If the length is not that of *transducers* phases (``bad_length``), or a spare bit of the
        last byte is set (``bad_value``).
    """
    if len(packed) != packed_size(transducers, bits):
        raise RemoteProtocolError(
            f"{len(packed)} bytes of phases; {transducers} x {bits} bits take "
            f"{packed_size(transducers, bits)}",
            reason="bad_length",
        )
    if bits == 8:
        return packed
    digits = f"{int.from_bytes(packed, 'little'):0{len(packed) * 8}b}"
    used = transducers * bits
    if "1" in digits[: len(digits) - used]:
        raise RemoteProtocolError("a spare bit behind the last phase is set", reason="bad_value")
    digits = digits[len(digits) - used :]
    return bytes(int(digits[i : i + bits], 2) for i in range(used - bits, -1, -bits))


@record
class Phases(Message):
    """Phases of every transducer at full amplitude.  HG-5.2."""

    TYPE: ClassVar[MessageType] = MessageType.PHASES
    bits: PhaseFormat = wire("B", "bits per phase: 8, 6 or 5", enum=PhaseFormat)
    bank: int = wire("B", "bank of transducers; 0 in this version")
    data: bytes = tail("N phases, packed")


@record
class Drives(Message):
    """Phase and amplitude of every transducer.  HG-5.3."""

    TYPE: ClassVar[MessageType] = MessageType.DRIVES
    bits: PhaseFormat = wire("B", "bits per phase: 8", enum=PhaseFormat)
    bank: int = wire("B", "bank of transducers; 0 in this version")
    data: bytes = tail("N phases u8, then N amplitudes u8, linear in pressure, 255 = full", unit=2)


@record
class FocalPoint(Record):
    """One focal point.  HG-5.4."""

    x_um: int = wire("i", "position, micrometres from the array's centre")
    y_um: int = wire("i", "position, micrometres")
    z_um: int = wire("i", "position, micrometres, along the emission side")
    amplitude: int = wire("H", "share of the drive, 65535 = full")
    phase: int = wire("H", "phase of the pressure at the point, 1/65536 of a turn, lag positive")


@record
class Points(Message):
    """Focal points whose drive the board computes.  HG-5.4."""

    TYPE: ClassVar[MessageType] = MessageType.POINTS
    points: tuple[FocalPoint, ...] = repeated(FocalPoint, "focal points", least=1)


def drive_codes(message: Message, transducers: int) -> tuple[bytes, bytes] | None:
    r"""Return the phase and amplitude codes of 8 bits that a frame asks for.

    Codes of fewer bits are widened (HG-5.2/7).

    Returns
    -------
    tuple of (N,) bytes, or None
        None for a message that holds no drive, and for POINTS, whose drive the board computes.

    Raises
    ------
    RemoteProtocolError
        As :func:`unpack_phases`.

    Examples
    --------
    >>> drive_codes(Phases(PhaseFormat.BITS_6, 0, pack_phases(bytes([1, 2]), 6)), 2)
    (b'\x04\x08', b'\xff\xff')
    """
    if isinstance(message, Drives):
        half = len(message.data) // 2
        return message.data[:half], message.data[half:]
    if isinstance(message, Phases):
        bits = int(message.bits)
        codes = unpack_phases(message.data, bits, transducers)
        return bytes(code << (8 - bits) for code in codes), bytes([_FULL]) * transducers
    return None
