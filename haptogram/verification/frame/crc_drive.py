"""The drive behind a CRC: what a board with a known fault would have latched."""

from __future__ import annotations

import functools
import zlib

import numpy as np
from numpy.typing import NDArray

from haptogram.acoustics import AcousticModel, Drive
from haptogram.acoustics.model.drive import REGISTER_BITS
from haptogram.records.frame import Intended

from ..faults import drive_fault_candidates


def drive_of_crc(model: AcousticModel, intended: Intended, crc: int) -> Drive | None:
    """Return the wrong drive that has this CRC; None: none that is known to be made by mistake.

    Tried are the candidates of :mod:`..faults`, the elements rolled by any number, one element with
    any other code, and two that are exchanged.
    """
    wanted = intended.drive
    if wanted.phase_bits > REGISTER_BITS:  # no wire carries the CRC of finer codes
        return None
    for codes in drive_fault_candidates(model, intended):
        drive = Drive(codes.astype(np.uint8), wanted.amplitude_codes)
        if drive.digest() == crc:
            return drive
    inverted = Drive(np.negative(wanted.phase_codes), wanted.amplitude_codes)
    found = (_rolled_drive(drive, crc) for drive in (wanted, inverted))
    return next(filter(None, found), None) or _nearly_right_drive(wanted, crc)


def _rolled_drive(drive: Drive, crc: int) -> Drive | None:
    """Return *drive* with its elements rolled by any number of places to match *crc*; else None."""
    count = drive.count
    twice, levels = drive.phase_codes.tobytes() * 2, drive.amplitude_codes.tobytes() * 2
    for begin in range(1, count):
        phases, amplitudes = twice[begin : begin + count], levels[begin : begin + count]
        if zlib.crc32(amplitudes, zlib.crc32(phases)) == crc:
            return Drive(np.frombuffer(phases, np.uint8), np.frombuffer(amplitudes, np.uint8))
    return None


def _nearly_right_drive(wanted: Drive, crc: int) -> Drive | None:
    """Return *wanted* with one wrong element or two swapped that matches the CRC; else None.

    The CRC is linear: what a changed byte adds depends on its place and on the bits that differ.
    """
    phases, count = wanted.phase_codes.astype(np.uint8), wanted.count
    difference = wanted.digest() ^ crc
    codes = np.concatenate((phases, wanted.amplitude_codes))
    changes = _crc_change_table(len(codes))
    for place, changed in np.argwhere(changes == difference):
        codes[place] ^= np.uint8(changed)
        return Drive(codes[:count], codes[count:])
    bits, places = phases[:, None] ^ phases, np.arange(count)
    swapped = changes[places[:, None], bits] ^ changes[places, bits]
    for first, second in np.argwhere(swapped == difference):
        codes[[first, second]] = codes[[second, first]]
        return Drive(codes[:count], codes[count:])
    return None


@functools.cache
def _crc_change_table(length: int) -> NDArray[np.uint32]:
    """Return (length, 256): how each XOR of each of *length* bytes changes the CRC-32.

    The rows are those of XOR: a change of several bits is the XOR of the changes of each.
    """
    none = zlib.crc32(bytes(length))
    table = np.zeros((length, 256), dtype=np.uint32)
    for place in range(length):
        behind = bytes(length - place - 1)
        before = zlib.crc32(bytes(place))
        for bit in range(8):
            one = zlib.crc32(behind, zlib.crc32(bytes([1 << bit]), before)) ^ none
            half = 1 << bit
            table[place, half : 2 * half] = table[place, :half] ^ np.uint32(one)
    return table
