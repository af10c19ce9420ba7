"""HG-8.6: the read-back of a drive, and before the first latch of a session."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Final

from haptogram_protocol.messages import (
    DriveKind,
    ErrorCode,
    Feature,
    LatchKey,
    Message,
    Mute,
    ReadDrive,
    TraceMode,
)
from haptogram_protocol.rules import READ_BACKS

from ...case import case
from ...client.board_client import BoardClient
from ...client.capabilities import drive_kinds
from ...client.latching import (
    ask_for_board_latches_if_supported,
    full_client_drive,
    latch_now,
    latch_random,
    latches_received_from_board,
    read_back,
    read_drive,
)
from ...client.playback import play_later, play_now, send_phases_to_store_if_supported
from ...client.stream_kinds import stream_kinds
from ...client.uploads import upload_correction
from ...judge.witness import expect_witnessed_drive, judge_nothing_read_back
from ...outcome import SELF_REPORTED, check, check_fields
from ..ch07_configuration.geometry import spans_of_elements

_SEQUENCE: Final = 3
_CEILING: Final = 77
_AHEAD_US: Final = 2_000_000
_HOUR_US: Final = 3_600_000_000

_Bring = Callable[[BoardClient], object]


@case("HG-8.6/1", evidence=SELF_REPORTED)
def reads_back_a_span(board: BoardClient) -> None:
    """READ_DRIVE of one, some and too many transducers shows those from first on"""
    board.need_any(READ_BACKS)
    registers = board.random_registers()
    due = full_client_drive(registers)
    judge_spans(board, drive_kinds(board)[0], board.phases(registers), due)


@case("HG-8.6/1-spans", needs=Feature.READ_LATCHED, evidence=SELF_REPORTED)
def every_span_of_drive_and_geometry(board: BoardClient) -> None:
    """READ_DRIVE of spans at and around every edge shows the codes that the whole shows"""
    frame = stream_kinds(board)[-1].make()  # with amplitudes that differ, where it can
    for kind in drive_kinds(board):
        judge_spans(board, kind, frame)


def judge_spans(
    board: BoardClient, kind: DriveKind, frame: Message, due: bytes | None = None
) -> None:
    """FAILED unless READ_DRIVE shows of every span what the whole shows, and of that *due*."""
    latched_us, total = -_HOUR_US, board.identity.transducers
    for first, count in spans_of_elements(total):
        if board.wire.now_us() - latched_us > 250 * board.config.hold_ms:
            board.arm_anew()
            latched_us = board.wire.now_us()
            latch_now(board, frame)
            whole = read_back(board, kind)
            same = due in (None, whole.phases + whole.amplitudes)
            check(same, f"READ_DRIVE({kind.name}) shows other codes than were sent")
        reply = read_drive(board, kind, first, count)
        end = min(first + count, total)
        codes = whole.phases[first:end] + whole.amplitudes[first:end]
        text = f"READ_DRIVE({kind.name}) of {count} from {first}"
        check_fields(reply, text, first=first, data=codes, key=whole.reply.key)


@case("HG-8.6/2")
def reads_back_no_more(board: BoardClient) -> None:
    """READ_DRIVE from N on is refused with NOT_FOUND, detail N"""
    board.need_any(READ_BACKS)
    count = board.identity.transducers
    for kind in drive_kinds(board):
        for first in (count, 0xFFFF):
            board.link.refused(ReadDrive(kind, first, 1), ErrorCode.NOT_FOUND, count)


@case("HG-8.6/3", needs=Feature.READ_LATCHED, evidence=SELF_REPORTED)
def reads_back_one_latch(board: BoardClient) -> None:
    """codes, key and time of a read-back belong to one latch, as in trace and STATUS"""
    mode = ask_for_board_latches_if_supported(board, Feature.TRACE)
    board.arm()
    for _ in range(8):
        index, since = board.link.stream_next, board.link.mark()
        (registers,) = latch_random(board, 1)
        shown = read_back(board)
        expect_witnessed_drive(board, shown, registers, b"\xff" * len(registers))
        last = {"key": LatchKey(0, 0, index), "t_latch_us": board.status().last_latch_us}
        check_fields(shown.reply, "DRIVE_REPLY", **last)
        if mode is not TraceMode.OFF:
            seen = latches_received_from_board(board, since, mode)
            check(bool(seen) and seen[-1].crc == shown.crc, "trace and read-back disagree")


# --- Before the first latch --------------------------------------------------------------------


@case("HG-8.6/4", needs=Feature.READ_LATCHED, evidence=SELF_REPORTED)
def reads_back_nothing_first(board: BoardClient) -> None:
    """before the first latch of a session codes, key and time are 0"""
    board.arm()
    latch_random(board, 1)
    board.hello()
    judge_nothing_read_back(board, DriveKind.LATCHED, "behind the session before")


def _wait_with_a_frame(board: BoardClient) -> None:
    board.arm()
    board.link.stream(board.phases(board.random_registers()), board.clock.ahead_us(_AHEAD_US))


def _wait_with_a_playback(board: BoardClient) -> None:
    board.arm()
    play_later(board, _SEQUENCE, _AHEAD_US, loops=1, unattended_ms=2000)


def _states_without_a_latch(board: BoardClient) -> Iterator[tuple[str, _Bring]]:
    """Yield what a board may be in before its first latch, one behind the other."""
    yield "as the session begins", BoardClient.status
    yield "a frame dropped while DISARMED", lambda board: board.link.stream(board.flat_phases(9))
    yield "ARMED", BoardClient.arm
    yield "with a frame that waits", _wait_with_a_frame
    yield "MUTED", lambda board: board.link.ask(Mute())
    if board.has(Feature.CORRECTION):
        yield "with another correction", upload_correction
    if board.has(Feature.SEQUENCE_PHASES):
        yield "with a playback that waits", _wait_with_a_playback
    yield "DISARMED", BoardClient.disarm


def _ends_of_session_before(board: BoardClient) -> Iterator[tuple[str, _Bring]]:
    """Yield what the session before ends in."""
    yield "a drive", lambda board: latch_random(board, 1)
    if board.has(Feature.SEQUENCE_PHASES):
        yield "a playback", lambda board: play_now(board, _SEQUENCE, loops=0)
    yield "MUTE", lambda board: board.link.ask(Mute())
    yield "nothing", BoardClient.status


@case("HG-8.6/4-kinds", evidence=SELF_REPORTED)
def every_empty_read_back(board: BoardClient) -> None:
    """before a session's first latch both kinds show 0, armed, muted, waiting, under a
    correction
    """
    board.need_any(READ_BACKS)
    send_phases_to_store_if_supported(board, _SEQUENCE, frames=2)
    if board.has(Feature.CONFIG | Feature.AMPLITUDE):
        board.configure(amplitude_ceiling=_CEILING)
    if board.has(Feature.CORRECTION):
        upload_correction(board)
    for before, leave in _ends_of_session_before(board):
        board.arm()
        leave(board)
        board.hello()
        for name, bring in _states_without_a_latch(board):
            bring(board)
            for kind in drive_kinds(board):
                judge_nothing_read_back(board, kind, f"behind {before}, {name}")
    if board.has(Feature.CORRECTION):
        upload_correction(board, bytes(board.identity.transducers))
