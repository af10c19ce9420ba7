"""Frames of the stream, host to board.  SPEC.md chapter 5."""

from __future__ import annotations

from typing import Final

from ..errors import RemoteProtocolError
from ..record import Record, record, repeated, tail, wire
from .header import Message

_FULL: Final = 255  # amplitude code


@record
class Phases(Message):
    """Phases of every transducer at full amplitude.  HG-5.2."""

    data: bytes = tail("N phases u8, 256 steps a turn")


@record
class Drives(Message):
    """Phase and amplitude of every transducer.  HG-5.3."""

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

    points: tuple[FocalPoint, ...] = repeated(FocalPoint, "focal points", least=1)


def drive_codes(message: Message, transducers: int) -> tuple[bytes, bytes] | None:
    r"""Return the phase and amplitude codes that a frame asks for.

    Returns
    -------
    tuple of (N,) bytes, or None
        None for a message that holds no drive, and for POINTS, whose drive the board computes.

    Raises
    ------
    RemoteProtocolError
        If there are not N phases, and amplitudes (``bad_length``).

    Examples
    --------
    >>> drive_codes(Phases(bytes([1, 2])), 2)
    (b'\x01\x02', b'\xff\xff')
    """
    if not isinstance(message, (Phases, Drives)):
        return None
    count = transducers * (1 if isinstance(message, Phases) else 2)
    if len(message.data) != count:
        raise RemoteProtocolError(
            f"{len(message.data)} bytes of codes; {transducers} transducers take {count}",
            reason="bad_length",
        )
    amplitudes = message.data[transducers:] or bytes([_FULL]) * transducers
    return message.data[:transducers], amplitudes
