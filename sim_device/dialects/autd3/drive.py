"""From phase, intensity and modulation of each channel to its pulse.

A pulse lies symmetrically around its phase: the FPGA computes 512 steps of a period from phases of
256. Its width follows the intensity by an arcsine, so that the pressure is linear in it.

Checked, all 249 channels, against ``pyautd3_emulator`` 38.0.1 (its phases, pulse widths and output
voltage); the source is shinolab/autd3-firmware 03314c4, ``pwm_preconditioner.sv``. The table that
PulseWidthEncoder would change, phase correction and output mask are not emulated.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from haptogram.acoustics.model.pulses import PulseDrive

STEPS: Final = 512
FULL: Final = 255
_WIDTHS: Final = np.array(
    [round(math.asin(intensity / FULL) / math.pi * STEPS) for intensity in range(FULL + 1)],
    dtype=np.int64,
)


def autd3_pulses_of(
    phases: NDArray[np.uint8], intensities: NDArray[np.uint8], modulation: NDArray[np.uint8]
) -> PulseDrive:
    """Return the pulses of (N,) channels.

    Parameters
    ----------
    phases : (N,) numpy.ndarray of uint8
        In 1/256 of a period.
    intensities, modulation : (N,) numpy.ndarray of uint8
        Their product over 255 is the intensity that is out.
    """
    widths = _WIDTHS[intensities.astype(np.int64) * modulation // FULL]
    rises = (2 * phases.astype(np.int64) - widths // 2) % STEPS
    return PulseDrive(np.where(widths > 0, rises, 0), widths, STEPS)
