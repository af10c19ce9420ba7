"""The acoustics of the board under test: its array, and drives for foci."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from haptogram.acoustics import AcousticModel, Drive, PointSource, TransducerArray
from haptogram.driver.frames import with_sound_speed
from haptogram.driver.identity import model_of
from haptogram.records.frame import Focus, FrameKey, Intended

from ..client.board_client import Bench


def model_of_board(bench: Bench, elements: Sequence[tuple[int, ...]]) -> AcousticModel:
    """Return the model of the array that a board says it has, at its speed of sound.

    Parameters
    ----------
    elements : (N, 6) sequence
        Position in micrometres and normal, 32767 = 1, of every transducer.
    """
    identity = bench.identity
    grid = None
    if identity.grid_nx and identity.grid_ny:
        grid = TransducerArray.grid(
            identity.grid_nx, identity.grid_ny, pitch_m=identity.pitch_um / 1e6
        )
    read = np.array(elements, dtype=np.float64)
    array = TransducerArray.from_positions(read[:, :3] / 1e6, read[:, 3:] / 32767)
    if grid is not None and np.array_equal(grid.positions_um(), array.positions_um()):
        array = grid
    model = model_of(array, identity)
    # Phases do not depend on how a transducer beams, and that of a piston needs scipy.
    transducer = dataclasses.replace(model.transducer, directivity=PointSource())
    model = dataclasses.replace(model, transducer=transducer)
    return with_sound_speed(model, bench.config.sound_speed_mm_s)


def intended_drive(
    registers: bytes,
    amplitudes: bytes,
    bits: int,
    foci: tuple[Focus, ...] = (),
    *,
    board_computed: bool = False,
) -> Intended:
    """Return a drive that was asked for, in the form that verification takes."""
    drive = Drive(np.frombuffer(registers, np.uint8), np.frombuffer(amplitudes, np.uint8))
    key = FrameKey(session=0, sequence=0, loop=0, index=0)
    return Intended(0, key, None, foci, drive, bits, board_computed)
