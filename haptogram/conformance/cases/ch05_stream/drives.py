"""HG-5.1, HG-5.2, HG-5.3, HG-5.4, HG-7.9: phases and amplitudes for every transducer."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import replace
from typing import Final

from haptogram_protocol.messages import (
    MAX_TRANSDUCERS,
    Drives,
    Feature,
    FocalPoint,
    Phases,
    Points,
    UploadKind,
)
from haptogram_protocol.rules import READ_BACKS

from ...case import Depth, case, unobservable_case
from ...client.board_client import BoardClient
from ...client.drive_paths import DrivePath, drive_paths, registers_asked_for
from ...client.latching import ClientDrive, latch_now, read_back, read_back_radiated
from ...client.playback import period_to_play, play_out
from ...client.stream_kinds import random_point_to_send
from ...client.uploads import upload_to_board
from ...judge.witness import JudgeWitness
from ...outcome import EXTERNAL, SELF_REPORTED, check, check_equal, require
from .every_drop import judge_first_drop

amplitude_is_linear = unobservable_case(
    "HG-5.3/2", "the pressure itself: only a microphone shows it", EXTERNAL
)
_SPEEDS_MM_S: Final = (300_000, 331_300, 380_000)  # HG-7.1: least, 0 C, most
_CEILINGS: Final = (1, 100, 254)
_SEQUENCE: Final = 3
_COMPUTES: Final = Feature.POINTS | Feature.READ_LATCHED
_AT_SPEEDS: Final = _COMPUTES | Feature.CONFIG
_CORRECTED: Final = READ_BACKS | Feature.CORRECTION
_LIMITED: Final = READ_BACKS | Feature.CONFIG | Feature.AMPLITUDE


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
    wrong = [n for n, (a, b) in enumerate(itertools.pairwise(places)) if not a < b]
    check(not wrong, f"transducers {wrong[:4]} are before those behind, by column and row")


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
    judge_first_drop(board, "HG-3.2/4")


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


@case("HG-5.2/6-paths", needs=Feature.READ_LATCHED, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def every_path_of_streamed_codes(board: BoardClient) -> None:
    """PHASES and DRIVES of every format reach the registers, at once, at their time and played"""
    board.arm()
    for path in drive_paths(board):
        due = registers_asked_for(board, path.latch())
        shown = read_back(board)
        if due is not None:
            got = shown.phases, shown.amplitudes
            check_equal(got, due, f"{path.name}: another drive is latched than was sent")


@case("HG-5.4/1-paths", needs=_AT_SPEEDS, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def every_path_of_streamed_points(board: BoardClient) -> None:
    """focal points on every path at three speeds of sound, the same ones too: phases, amplitudes"""
    for speed in _SPEEDS_MM_S:
        board.arm(sound_speed_mm_s=speed)
        for path in drive_paths(board):
            message = path.latch()
            if isinstance(message, Points):
                _check_streamed_points(board, f"{path.name}, {speed / 1000:g} m/s", message)
    _judge_same_points_streamed_again(board)


def _judge_same_points_streamed_again(board: BoardClient) -> None:
    """FAILED unless the same points give another drive where something else changes it."""
    for number in sorted({1, board.most_points}):
        message = Points(tuple(random_point_to_send(board, number) for _ in range(number)))
        board.arm(sound_speed_mm_s=_SPEEDS_MM_S[0])
        for speed, between in itertools.product(_SPEEDS_MM_S, (False, True)):
            if between:  # the drive that is latched is another one
                latch_now(board)
            board.configure(sound_speed_mm_s=speed)
            index = latch_now(board, message)
            check_equal(board.status().last_seq, index, "frame lost: the number of the last latch")
            name = f"the same {number} points again, {speed / 1000:g} m/s"
            _check_streamed_points(board, name, message)


@case("HG-5.4/2-sums", needs=_COMPUTES, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def every_sum_of_streamed_points(board: BoardClient) -> None:
    """1 to max_points points of full amplitude that add up, cancel and mix, streamed and played"""
    board.arm()
    most = board.most_points
    for number in range(1, most + 1):
        board.wire.forget_received()  # the read-backs of a large array are a flood
        for name, group in _groups_of_full_points(board, number):
            latch_now(board, Points(group))
            _check_streamed_points(board, f"{number} {name}", Points(group))
    size = most * FocalPoint.LAYOUT.size
    if board.has(Feature.SEQUENCE_POINTS) and size <= board.identity.max_upload_bytes:
        for name, group in _groups_of_full_points(board, most):
            upload_to_board(board, UploadKind.POINTS, _SEQUENCE, Points(group).serialize(), most)
            play_out(board, _SEQUENCE, 1, period_us=period_to_play(board, most))
            _check_streamed_points(board, f"{most} {name}, played", Points(group))


def _groups_of_full_points(
    board: BoardClient, number: int
) -> Iterator[tuple[str, tuple[FocalPoint, ...]]]:
    """Yield points of full amplitude: their sum on each side of each axis, small, and any."""
    place = random_point_to_send(board)
    for quarter in range(4):
        lag = (0x4000 * quarter + board.random.randrange(0x4000)) & 0xFFFF
        full = replace(place, amplitude=0xFFFF, phase=lag)
        yield f"equal points, lag {lag:#06x}", (full,) * number
    opposed = replace(full, phase=full.phase ^ 0x8000)
    yield "points, half of them opposed", (full, opposed) * (number // 2) + (full,) * (number % 2)
    anywhere = (random_point_to_send(board) for _ in range(number))
    yield "points anywhere", tuple(replace(point, amplitude=0xFFFF) for point in anywhere)


def _check_streamed_points(board: BoardClient, name: str, message: Points) -> None:
    from ...judge.array_model import judged_model_of_board
    from ...judge.focusing import judge_drive_of_points

    model = judged_model_of_board(board)
    judge_drive_of_points(board, model, tuple(message.points), read_back(board), name)


@case("HG-7.9/1-paths", needs=_CORRECTED, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def every_drive_path_is_corrected(board: BoardClient) -> None:
    """on every path the radiated phases are the latched ones and the correction, modulo 256"""
    correction = board.random.randbytes(board.identity.transducers)
    upload_to_board(board, UploadKind.CORRECTION, 0, correction)
    board.arm()
    for path in drive_paths(board):
        latched, radiated = _drives_on_path(board, path)
        due = bytes((a + b) % 256 for a, b in zip(latched.phases, correction, strict=True))
        text = f"{path.name}: radiated phases are not latched + correction"
        check_equal(radiated.phases, due, text)
    upload_to_board(board, UploadKind.CORRECTION, 0, bytes(board.identity.transducers))


@case("HG-7.9/2-paths", needs=_LIMITED, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def every_drive_path_is_limited(board: BoardClient) -> None:
    """on every path no radiated amplitude is above ceilings of 1, 100 and 254, none below them
    less
    """
    for ceiling in _CEILINGS:
        board.arm(amplitude_ceiling=ceiling)
        for path in drive_paths(board):
            latched, radiated = _drives_on_path(board, path)
            loudest = max(radiated.amplitudes)
            check(loudest <= ceiling, f"{path.name}: ceiling {ceiling}, {loudest} is radiated")
            pairs = zip(latched.amplitudes, radiated.amplitudes, strict=True)
            quiet = [number for number, (a, b) in enumerate(pairs) if a <= ceiling and a != b]
            text = f"{path.name}: ceiling {ceiling} changes lower amplitudes, {quiet[:4]}"
            check(not quiet, text)


def _drives_on_path(board: BoardClient, path: DrivePath) -> tuple[ClientDrive, ClientDrive]:
    """Latch a drive; return the latched and the radiated one."""
    path.latch()
    return read_back(board), read_back_radiated(board)
