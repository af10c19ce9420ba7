"""The drive pins of firmware in QEMU: what its registers held, as a capture of an analyser."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Final

import numpy as np

from haptogram.acoustics import AcousticModel, Drive
from haptogram.errors import ConfigurationError
from haptogram.settings.board import PinCaptureConfig
from haptogram_protocol.messages import LatchKey
from haptogram_protocol.state import MuteReason, OutputState
from sim_device.backdoor.pin_capture import BackdoorPinCapture
from sim_device.board.events import Latch, StateChange
from sim_device.board.settings import BoardSettings

#: The channels of the capture, for ``haptogram verify --channels``.
CHANNELS: Final = 'reference = "carrier"\nelements = "e{}"\n'
_HEADER: Final = struct.Struct("<IHH")  # protocol/c/ports/common/pin_trace.h
_TICKS: Final = 2**32
_PINS: Final = 16  # as an analyser has
_LONGEST_MS: Final = 600_000.0
#: A record comes every 10 s; ticks of 40 MHz come again after 107 s.
_LONGEST_GAP_S: Final = 30.0
_LATEST_S: Final = 5.0


def write_capture(records: Path, count: int, path: Path) -> str:
    """Write what firmware told of its registers as the pins of 16 of its elements, in VCD.

    A drive sounds from the next boundary of the carrier on, as drivers with two sets of registers
    take it; a gate that is shut silences the pins at once.

    Parameters
    ----------
    records : Path
        What ``emulate --pins`` wrote; a last record that is cut off is left out.
    count : int
        Elements of the array.
    path : Path
        The capture.

    Returns
    -------
    str
        What the capture holds, in a line.

    Raises
    ------
    ConfigurationError
        If *records* holds none: the firmware was built without them, or drove nothing.  If two of
        them are further apart than their clock can tell.
    """
    data = records.read_bytes() if records.exists() else b""
    size = _HEADER.size + 2 * count
    if len(data) < size:
        raise ConfigurationError(
            f"{records}: no record of the drive registers; the firmware is built with "
            "DEFINES=-DPORT_TRACES_PINS=1"
        )
    told = _times_us(records, data, size)
    settings = BoardSettings(model=AcousticModel.default(count, 1))
    captured = ",".join(map(str, np.unique(np.linspace(0, count - 1, _PINS).astype(int))))
    config = PinCaptureConfig(capture=path, capture_ms=_LONGEST_MS, capture_elements=captured)
    capture = BackdoorPinCapture(path, config, settings)
    for at, (after_us, is_open) in zip(range(0, len(data), size), told, strict=False):
        t_us = settings.boot_us + after_us
        if is_open:
            codes = np.frombuffer(data, np.uint8, 2 * count, at + _HEADER.size)
            drive = Drive(codes[:count], codes[count:])
            on_carrier_us = -(-t_us // settings.carrier_us) * settings.carrier_us
            key = LatchKey(0, 0, at // size)
            capture.latch(Latch(key, 0, key.index, on_carrier_us, False, drive, 8, drive, False))
        else:
            capture.notice(StateChange(t_us, OutputState.MUTED, MuteReason.MUTE, requested=True))
    return capture.close()


def _times_us(records: Path, data: bytes, size: int) -> list[tuple[int, bool]]:
    """Return the time of every record since the start of the chip, and whether the gate is open."""
    told = []
    elapsed = newest = _HEADER.unpack_from(data)[0]
    for number in range(len(data) // size):
        ticks, ticks_per_us, is_open = _HEADER.unpack_from(data, number * size)
        step = (ticks - newest + _TICKS // 2) % _TICKS - _TICKS // 2  # what was due may come late
        if not -_LATEST_S <= step / ticks_per_us / 1e6 <= _LONGEST_GAP_S:
            raise ConfigurationError(
                f"{records}: record {number} comes {step / ticks_per_us / 1e6:.1f} s after the one "
                f"before it, where its clock, which wraps, tells {-_LATEST_S:g} to "
                f"{_LONGEST_GAP_S:g} s: the emulator was held up; run it with less beside it"
            )
        elapsed, newest = elapsed + step, ticks
        told.append((elapsed // ticks_per_us, bool(is_open)))
    return told
