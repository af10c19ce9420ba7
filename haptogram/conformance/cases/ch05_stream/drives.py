"""HG-5.1, HG-5.2, HG-5.3: packed phases and amplitudes for every transducer."""

from __future__ import annotations

import itertools
from typing import Final

from haptogram_protocol.messages import (
    MAX_TRANSDUCERS,
    PHASE_FORMAT_BIT,
    Drives,
    Feature,
    PhaseFormat,
    Phases,
    pack_phases,
    packed_size,
)

from ...case import case, unobservable_case
from ...client.board_client import BoardClient
from ...client.latching import latch_now
from ...judge.witness import JudgeWitness
from ...outcome import EXTERNAL, SELF_REPORTED, check, not_observed

_UNKNOWN_BITS: Final = (0, 1, 4, 7, 9, 16, 255)


amplitude_is_linear = unobservable_case(
    "HG-5.3/2", "the pressure itself: only a microphone shows it", EXTERNAL
)


def _stream_formats_of_drives(board: BoardClient) -> list[PhaseFormat]:
    return [form for form, bit in PHASE_FORMAT_BIT.items() if board.identity.phase_formats & bit]


@case("HG-5.1/1", "N is 1 to 1024")
def drives_have_a_count_in_range(board: BoardClient) -> None:
    count = board.identity.transducers
    check(1 <= count <= MAX_TRANSDUCERS, f"N is {count}")


@case("HG-5.1/2", "on a grid GET_GEOMETRY counts the rows of a column before the next column")
def drives_count_along_y_first(board: BoardClient) -> None:
    nx, ny = board.identity.grid_nx, board.identity.grid_ny
    if not nx * ny > 1:
        not_observed("this board is no grid of two transducers or more")
    places = [(element.x_um, element.y_um) for element in board.read_geometry()]
    wrong = next((n for n, (a, b) in enumerate(itertools.pairwise(places)) if not a < b), None)
    check(
        wrong is None,
        f"transducer {(wrong or 0) + 1} is not behind {wrong}, in its column or in the next one",
    )


@case("HG-5.1/3", "the origin is the centre of all transducers, and their normals point to +z")
def points_have_their_origin_in_the_centre(board: BoardClient) -> None:
    elements = board.read_geometry()
    check(all(element.nz > 0 for element in elements), "a normal points away from +z")
    for axis in ("x_um", "y_um"):
        values = [getattr(element, axis) for element in elements]
        middle_um = (min(values) + max(values)) / 2
        check(abs(middle_um) <= 1, f"the middle of all {axis} is {middle_um:g}, not 0")


@case(
    "HG-5.2/1",
    "random codes in every format reach the registers as they were packed",
    evidence=SELF_REPORTED,
)
def stream_phases_are_unpacked(board: BoardClient) -> None:
    witness = JudgeWitness.of(board)
    board.arm()
    for form in _stream_formats_of_drives(board):
        for _ in range(3):
            codes = bytes(
                board.random.randrange(1 << form) for _ in range(board.identity.transducers)
            )
            since = board.link.mark()
            latch_now(board, Phases(form, 0, pack_phases(codes, form)))
            registers = bytes(code << (8 - form) for code in codes)
            witness.expect(registers, bits=form, since=since)


@case(
    "HG-5.2/2",
    "a PHASES frame with a spare bit set is counted in bad_value",
    evidence=SELF_REPORTED,
)
def drives_with_spare_bits_are_dropped(board: BoardClient) -> None:
    count = board.identity.transducers
    spare = [form for form in _stream_formats_of_drives(board) if count * form % 8]
    if not spare:
        not_observed(f"{count} phases leave no spare bit in the formats of this board")
    board.arm()
    with board.counting(bad_value=2 * len(spare), latched=0):
        for form in spare:
            for bit in (7, count * form % 8):
                data = bytearray(packed_size(count, form))
                data[-1] |= 1 << bit
                board.link.send(board.link.stream_wire(Phases(form, 0, bytes(data))))
        board.clock.wait_latched()


@case(
    "HG-5.2/3",
    "PHASES with a byte less or more than ceil(N b / 8) are counted in bad_length",
    evidence=SELF_REPORTED,
)
def stream_phases_have_their_length(board: BoardClient) -> None:
    board.arm()
    offered = _stream_formats_of_drives(board)
    with board.counting(bad_length=2 * len(offered), latched=len(offered)):
        for form in offered:
            size = packed_size(board.identity.transducers, form)
            for wrong in (size - 1, size + 1):
                board.link.send(board.link.stream_wire(Phases(form, 0, bytes(wrong))))
            latch_now(board, Phases(form, 0, bytes(size)))


@case("HG-5.2/4", "banks other than 0 are counted in bad_value", evidence=SELF_REPORTED)
def drives_have_bank_0(board: BoardClient) -> None:
    payload = board.flat_phases().serialize()
    board.arm()
    with board.counting(bad_value=3, latched=0):
        for bank in (1, 2, 255):
            board.link.send(
                board.link.stream_raw(Phases.TYPE, bytes([payload[0], bank]) + payload[2:])
            )
        board.clock.wait_latched()


@case(
    "HG-5.2/5",
    "each format advertised is latched, each other one is counted in bad_value",
    evidence=SELF_REPORTED,
)
def takes_stream_drives_of_each_format(board: BoardClient) -> None:
    count, offered = board.identity.transducers, _stream_formats_of_drives(board)
    others = [*_UNKNOWN_BITS, *(form for form in PhaseFormat if form not in offered)]
    board.arm()
    with board.counting(bad_value=len(others), latched=len(offered)):
        for bits in others:
            payload = bytes([bits, 0]) + bytes(packed_size(count, bits))
            board.link.send(board.link.stream_raw(Phases.TYPE, payload[: 2 + 2048]))
        for form in offered:
            latch_now(board, Phases(form, 0, bytes(packed_size(count, form))))


@case(
    "HG-5.2/6",
    "after DRIVES of amplitude 10, PHASES has amplitude 255 again",
    evidence=SELF_REPORTED,
)
def stream_phases_have_full_amplitude(board: BoardClient) -> None:
    witness = JudgeWitness.of(board)
    board.arm()
    registers = board.random_registers()
    if board.has(Feature.AMPLITUDE):
        latch_now(board, Drives(PhaseFormat.BITS_8, 0, registers + b"\x0a" * len(registers)))
    since = board.link.mark()
    latch_now(board, board.phases(registers))
    witness.expect(registers, bits=board.finest, since=since)


@case(
    "HG-5.2/7",
    "every code of 6 bits is latched as 4 c, every one of 5 bits as 8 c",
    evidence=SELF_REPORTED,
)
def widens_codes_of_stream_drives(board: BoardClient) -> None:
    witness = JudgeWitness.of(board)
    coarse = [form for form in _stream_formats_of_drives(board) if form < PhaseFormat.BITS_8]
    if not coarse:
        not_observed("the board takes 8 bits only")
    board.arm()
    count = board.identity.transducers
    for form in coarse:
        for first in range(0, 1 << form, count):
            codes = bytes((first + number) % (1 << form) for number in range(count))
            since = board.link.mark()
            latch_now(board, Phases(form, 0, pack_phases(codes, form)))
            registers = bytes(code << (8 - form) for code in codes)
            witness.expect(registers, bits=form, since=since)


@case(
    "HG-5.3/1",
    "DRIVES are latched with phase and amplitude; other bits and lengths are counted",
    needs=Feature.AMPLITUDE,
    evidence=SELF_REPORTED,
)
def takes_stream_drives(board: BoardClient) -> None:
    witness = JudgeWitness.of(board)
    count = board.identity.transducers
    board.arm()
    phases, amplitudes = board.random.randbytes(count), board.random.randbytes(count)
    since = board.link.mark()
    with board.counting(latched=1, bad_value=3, bad_length=2):
        latch_now(board, Drives(PhaseFormat.BITS_8, 0, phases + amplitudes))
        for head in (b"\x06\x00", b"\x05\x00", b"\x08\x01"):
            board.link.send(board.link.stream_raw(Drives.TYPE, head + bytes(2 * count)))
        for size in (2 * count - 2, 2 * count + 2):
            board.link.send(board.link.stream_raw(Drives.TYPE, b"\x08\x00" + bytes(size)))
    witness.expect(phases, amplitudes, since=since)
