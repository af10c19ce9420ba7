"""Frames of foreign boards as operations."""

from haptogram_protocol.dialects.fpga_bytes.operations import (
    Begin,
    BeginAmplitudes,
    Select,
    SetAmplitudes,
    SetPhases,
    Swap,
)
from haptogram_protocol.dialects.ultraino.arduino import operations as nibbles


def sonicsurface_frame(codes):
    """Return a whole frame for the primary."""
    return [Begin(), SetPhases((0,), 0, codes), Swap()]


def ultraino_fpga_frame(codes, amplitudes=None):
    """Return SimpleFPGA's frame; with *amplitudes* for ``fb="amplitude"``."""
    made = [Begin(), SetPhases((0,), 0, codes)]
    if amplitudes is not None:
        made += [BeginAmplitudes(), SetAmplitudes((0,), 0, amplitudes)]
    return [*made, Swap()]


def chained_ultraino_frame(codes):
    """Return ChainedFPGA's frame from the codes of each board."""
    made = []
    for number, of_board in enumerate(codes):
        made += [Select(number), SetPhases((number,), 0, of_board)]
    return [*made, Swap()]


def mega64_frame(patterns, durations=b"\x01\x00"):
    """Return the frame of MEGA64 from the slot bytes of each board of a chain."""
    return [
        *(nibbles.SetPattern(board, 0, slots) for board, slots in enumerate(patterns)),
        nibbles.SetDurations(durations),
        nibbles.CommitDurations(),
        nibbles.Swap(),
    ]
