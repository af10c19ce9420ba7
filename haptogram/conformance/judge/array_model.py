"""The acoustics of the board under test: its array, and drives for foci."""

from __future__ import annotations

import dataclasses

import numpy as np

from haptogram.acoustics import AcousticModel, Drive, PointSource, TransducerArray
from haptogram.driver.identity import array_of_geometry, model_of_identity
from haptogram.records.frame import FrameKey, Intended

from ..client.board_client import BoardClient


def judged_model_of_board(board: BoardClient) -> AcousticModel:
    """Return the model of the array that a board shows, at the board's speed of sound."""
    identity = board.identity
    array = array_of_geometry(board.read_geometry())
    if identity.grid_nx and identity.grid_ny:
        pitch_m = identity.pitch_um / 1e6
        grid = TransducerArray.grid(identity.grid_nx, identity.grid_ny, pitch_m=pitch_m)
        if np.array_equal(grid.positions_um(), array.positions_um()):
            array = grid  # which knows its rows and columns
    model = model_of_identity(array, identity)
    # Phases do not depend on the directivity of a transducer, and a piston's needs scipy.
    transducer = dataclasses.replace(model.transducer, directivity=PointSource())
    model = dataclasses.replace(model, transducer=transducer)
    return model.with_sound_speed(board.config.sound_speed_mm_s / 1000)


def judged_drive_of_registers(registers: bytes, amplitudes: bytes) -> Intended:
    """Return a drive that was sent, as verification takes intended frames."""
    drive = Drive(np.frombuffer(registers, np.uint8), np.frombuffer(amplitudes, np.uint8))
    key = FrameKey(session=0, sequence=0, loop=0, index=0)
    return Intended(0, key, None, (), drive, 8)
