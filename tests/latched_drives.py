"""Frames as the host intends them, and boards that latch something else."""

import math

import numpy as np
from hypothesis import strategies as st

from haptogram.acoustics import AcousticModel, Drive, focus_phases
from haptogram.records.frame import Evidence, Focus, FrameKey, Intended, Observation
from haptogram.verification import Tolerance
from haptogram.verification.frame.target import FrameTarget

SESSION = 0x5EED


def registers(phases_rad, bits=8):
    """Drive at full amplitude whose phases are rounded to *bits*, in 8-bit registers."""
    codes = np.floor(np.asarray(phases_rad) / (2.0 * math.pi) * 2**bits + 0.5).astype(int)
    return drive_of(codes % 2**bits * 2 ** (8 - bits))


def drive_of(codes, amplitudes=255):
    codes = np.asarray(codes, dtype=int).ravel() % 256
    return Drive(codes.astype(np.uint8), np.broadcast_to(np.uint8(amplitudes), codes.shape).copy())


def intend(model: AcousticModel, target, bits=8, number=0, **changes) -> Intended:
    """Intend a focus on *target*."""
    fields = {
        "number": number,
        "key": FrameKey.of_stream(SESSION, 65_520 + number),
        "t_apply_us": 1000 * number,
        "foci": (Focus.at(target),),
        "drive": registers(focus_phases(model, target), bits),
        "phase_bits": bits,
    }
    return Intended(**(fields | changes))


def field_of(model: AcousticModel, target, bits=8, amplitudes=1.0, **tolerance) -> FrameTarget:
    """What a target asks of the field, of phases that are rounded to *bits* and no more."""
    levels = np.broadcast_to(np.float64(amplitudes), model.array.count).copy()
    limit_rad = math.pi / 2**bits + 1e-9
    return FrameTarget(
        model, np.array(target, dtype=float), levels, limit_rad, Tolerance(**tolerance)
    )


def seen(intended, drive=None, **changes) -> Observation:
    """See *drive* latched, by default the one that was intended, at its time."""
    fields = {
        "key": intended.key,
        "t_latch_us": intended.t_apply_us or 0,
        "late": False,
        "evidence": Evidence.EXTERNAL,
        "drive": intended.drive if drive is None else drive,
    }
    return Observation(**(fields | changes))


def codes(intended):
    """Return the phase codes as a grid of 16 x 16 whole numbers."""
    return intended.drive.phase_codes.astype(int).reshape(16, 16)


@st.composite
def working_volume(draw, off_x=0.0, off_y=0.0, off_diagonal=0.0):
    """Points over a 16 x 16 array, at least that far, in metres, from the planes of symmetry."""
    x, y = draw(lateral), draw(lateral)
    far = abs(x) >= off_x and abs(y) >= off_y and abs(x - y) / math.sqrt(2.0) >= off_diagonal
    if not far:  # on the spot, instead of drawing again
        x, y = 0.010 + abs(x) / 2.0, -0.010 - abs(y) / 2.0
    return x, y, draw(st.floats(0.050, 0.250))


lateral = st.one_of(st.just(0.0), st.floats(-0.060, 0.060))
