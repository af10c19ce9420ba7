"""From what a frame carries to the codes in the board's 8-bit registers.  SPEC.md chapter 5."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Sequence
from typing import Final, TypeAlias

import numpy as np

from haptogram.acoustics import Drive, saturated_weights, superpose_foci
from haptogram_protocol.messages import Feature, FocalPoint

from .settings import BoardSettings
from .timers import Fade

REGISTER_BITS: Final = 8
_FULL_POINT: Final = 65_535  # HG-5.4: amplitude of a focal point at its full share
_TURN: Final = 65_536  # HG-5.4: steps of its phase
_KEPT: Final = 1024  # drives that may come again: of a sequence, of a test

Content: TypeAlias = Drive | Sequence[FocalPoint]


@functools.lru_cache(maxsize=_KEPT)
def drive_of_registers(phase_codes: bytes, amplitude_codes: bytes) -> Drive:
    """Return the drive of a byte of phase and one of amplitude for each transducer."""
    return Drive.from_bytes(phase_codes, amplitude_codes)


def full_amplitude_registers(phase_codes: bytes) -> Drive:
    """Return the drive of a PHASES frame: every amplitude 255.  HG-5.2."""
    return drive_of_registers(phase_codes, _full_register_codes(len(phase_codes)))


@functools.cache
def _full_register_codes(count: int) -> bytes:
    """Return the amplitude code 255 for each of *count* transducers."""
    return bytes([255]) * count


def to_registers(drive: Drive) -> Drive:
    """Return *drive* in 8-bit codes: the missing low bits are 0."""
    return drive.in_bits(REGISTER_BITS)


class BoardFocuser:
    """Computes the drive of focal points: the naive superposition of HG-5.4."""

    def __init__(self, settings: BoardSettings, sound_speed_mm_s: int) -> None:
        model = settings.model
        medium = dataclasses.replace(model.medium, sound_speed_m_s=sound_speed_mm_s / 1000)
        self._model = dataclasses.replace(model, medium=medium)
        self._graded = bool(settings.features & Feature.AMPLITUDE)
        self._known: dict[tuple[FocalPoint, ...], Drive] = {}  # of a sequence, in every loop

    def drive(self, points: Sequence[FocalPoint]) -> Drive:
        """Return the codes nearest to w_n = sum_i a_i e^{j psi_i} e^{-j k r_n(i)}, |w_n| <= 1."""
        positions_m = np.array([(p.x_um, p.y_um, p.z_um) for p in points]) * 1e-6
        amplitudes = np.array([p.amplitude for p in points]) / _FULL_POINT
        phases_rad = np.array([p.phase for p in points]) * (2 * math.pi / _TURN)
        weights = superpose_foci(self._model, positions_m, amplitudes, phases_rad)
        drive = Drive.from_weights(saturated_weights(weights))
        return drive if self._graded else full_amplitude_registers(drive.phase_codes.tobytes())

    def registers(self, content: Content) -> tuple[Drive, int]:
        """Return the register codes of *content*, and the resolution it was commanded in."""
        if isinstance(content, Drive):
            bits = content.phase_bits
            return content if bits == REGISTER_BITS else to_registers(content), bits
        points = tuple(content)
        drive = self._known.get(points)
        if drive is None:
            if len(self._known) >= _KEPT:
                self._known.clear()
            drive = self._known[points] = self.drive(points)
        return drive, REGISTER_BITS


def radiated_drive_of_registers(
    latched: Drive, correction: bytes, ceiling: int, fade: Fade | None = None
) -> Drive:
    """Return the radiated drive: correction added, ceiling and ramp applied.

    Parameters
    ----------
    latched : Drive
        Register codes; returned as it is where nothing changes it.
    correction : (N,) bytes
        Added to the phase codes, modulo 256.
    ceiling : int
        Largest amplitude code.
    fade : Fade or None
        Share of the amplitude that a ramp leaves; None: there is no ramp.
    """
    phases, amplitudes = latched.phase_codes, latched.amplitude_codes
    if correction.count(0) < len(correction):  # soon found, unlike by any()
        phases = phases + np.frombuffer(correction, dtype=np.uint8)  # wraps, as it should
    if ceiling < 255:
        amplitudes = np.minimum(amplitudes, np.uint8(ceiling))
    if fade is not None:
        begins = np.minimum(latched.amplitude_codes, np.uint8(fade.ceiling))
        line = np.floor(begins * fade.share + 0.5).astype(np.uint8)
        amplitudes = np.minimum(amplitudes, line)
    if phases is latched.phase_codes and amplitudes is latched.amplitude_codes:
        return latched
    return Drive(phases, amplitudes)
