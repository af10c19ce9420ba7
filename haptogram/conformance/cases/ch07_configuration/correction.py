"""HG-7.9: phase correction and amplitude ceiling."""

from __future__ import annotations

from haptogram_protocol.messages import Feature

from ...case import case
from ...client.board_client import BoardClient
from ...client.latching import latch_now, read_back, read_back_radiated
from ...client.uploads import upload_correction
from ...judge.witness import expect_witnessed_drive
from ...outcome import SELF_REPORTED, check, check_equal


@case(
    "HG-7.9/1",
    needs=Feature.CORRECTION | Feature.READ_RADIATED | Feature.READ_LATCHED,
    evidence=SELF_REPORTED,
)
def adds_the_phase_correction(board: BoardClient) -> None:
    """the correction is added to the radiated phases, modulo 256; the latched drive stays"""
    count = board.identity.transducers
    correction = board.random_registers()
    upload_correction(board, correction)
    registers = board.random_registers()
    board.arm()
    latch_now(board, board.phases(registers))
    full = b"\xff" * count
    expect_witnessed_drive(board, read_back(board), registers, full)
    shown = read_back_radiated(board)
    due = bytes((a + b) % 256 for a, b in zip(registers, correction, strict=True))
    check_equal(shown.phases, due, "radiated phases are not latched + correction")
    upload_correction(board, bytes(count))
    shown = read_back_radiated(board)
    check_equal(shown.phases, registers, "a correction of 0 is not in force after its commit")


@case(
    "HG-7.9/2",
    needs=Feature.CONFIG | Feature.AMPLITUDE | Feature.READ_RADIATED | Feature.READ_LATCHED,
    evidence=SELF_REPORTED,
)
def keeps_under_the_amplitude_ceiling(board: BoardClient) -> None:
    """with a ceiling of 100 no radiated amplitude is above 100; the latched drive stays"""
    board.arm()
    for ceiling in (100, 1, 255):
        board.configure(amplitude_ceiling=ceiling)
        latch_now(board)
        loudest = read_back_radiated(board).loudest
        check(loudest <= ceiling, f"ceiling {ceiling}: amplitude {loudest} is radiated")
        check(loudest > 0, f"ceiling {ceiling}: nothing is radiated")
        check_equal(read_back(board).loudest, 255, f"ceiling {ceiling} changes the latched drive")
