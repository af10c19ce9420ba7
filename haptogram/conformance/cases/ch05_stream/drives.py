"""HG-5.1, HG-5.2, HG-5.3: phases and amplitudes for every transducer."""

from __future__ import annotations

import itertools

from haptogram_protocol.messages import MAX_TRANSDUCERS, Drives, Feature, Phases

from ...case import case, unobservable_case
from ...client.board_client import BoardClient
from ...client.latching import latch_now
from ...judge.witness import JudgeWitness
from ...outcome import EXTERNAL, SELF_REPORTED, check, require

amplitude_is_linear = unobservable_case(
    "HG-5.3/2", "the pressure itself: only a microphone shows it", EXTERNAL
)


@case("HG-5.1/1")
def drives_have_a_count_in_range(board: BoardClient) -> None:
    """N is 1 to 1024"""
    count = board.identity.transducers
    check(1 <= count <= MAX_TRANSDUCERS, f"N is {count}")


@case("HG-5.1/2")
def drives_count_along_y_first(board: BoardClient) -> None:
    """on a grid GET_GEOMETRY counts the rows of a column before the next column"""
    nx, ny = board.identity.grid_nx, board.identity.grid_ny
    require(nx * ny > 1, "this board is no grid of two transducers or more")
    places = [(element.x_um, element.y_um) for element in board.read_geometry()]
    wrong = next((n for n, (a, b) in enumerate(itertools.pairwise(places)) if not a < b), None)
    check(
        wrong is None,
        f"transducer {(wrong or 0) + 1} is not behind {wrong}, in its column or in the next one",
    )


@case("HG-5.1/3")
def points_have_their_origin_in_the_centre(board: BoardClient) -> None:
    """the origin is the centre of all transducers, and their normals point to +z"""
    elements = board.read_geometry()
    check(all(element.nz > 0 for element in elements), "a normal points away from +z")
    for axis in ("x_um", "y_um"):
        values = [getattr(element, axis) for element in elements]
        middle_um = (min(values) + max(values)) / 2
        check(abs(middle_um) <= 1, f"the middle of all {axis} is {middle_um:g}, not 0")


@case("HG-5.2/1", evidence=SELF_REPORTED)
def stream_phases_reach_their_registers(board: BoardClient) -> None:
    """random codes reach the registers of their transducers"""
    witness = JudgeWitness.of(board)
    board.arm()
    for _ in range(3):
        registers, since = board.random_registers(), board.link.mark()
        latch_now(board, Phases(registers))
        witness.expect(registers, since=since)


@case("HG-5.2/3", evidence=SELF_REPORTED)
def stream_phases_have_their_length(board: BoardClient) -> None:
    """PHASES with a byte less or more than N are counted in bad_length"""
    count = board.identity.transducers
    board.arm()
    with board.counting(bad_length=2, latched=1):
        for wrong in (count - 1, count + 1):
            board.link.stream(Phases(bytes(wrong)))
        latch_now(board, Phases(bytes(count)))


@case("HG-5.2/6", evidence=SELF_REPORTED)
def stream_phases_have_full_amplitude(board: BoardClient) -> None:
    """after DRIVES of amplitude 10, PHASES has amplitude 255 again"""
    witness = JudgeWitness.of(board)
    board.arm()
    registers = board.random_registers()
    if board.has(Feature.AMPLITUDE):
        latch_now(board, Drives(registers + b"\x0a" * len(registers)))
    since = board.link.mark()
    latch_now(board, board.phases(registers))
    witness.expect(registers, since=since)


@case("HG-5.3/1", needs=Feature.AMPLITUDE, evidence=SELF_REPORTED)
def takes_stream_drives(board: BoardClient) -> None:
    """DRIVES are latched with phase and amplitude; other lengths are counted"""
    witness = JudgeWitness.of(board)
    count = board.identity.transducers
    board.arm()
    phases, amplitudes = board.random.randbytes(count), board.random.randbytes(count)
    since = board.link.mark()
    with board.counting(latched=1, bad_length=2):
        latch_now(board, Drives(phases + amplitudes))
        for size in (2 * count - 2, 2 * count + 2):
            board.link.send(board.link.stream_raw(Drives.TYPE, bytes(size)))
    witness.expect(phases, amplitudes, since=since)
