"""HG-4.6: what belongs to a session does not outlive it, nor come back when it is reopened."""

from __future__ import annotations

from typing import Final

from haptogram_protocol.messages import (
    DriveKind,
    ErrorCode,
    Feature,
    Trace,
    TraceDrive,
    TraceMode,
    UploadChunk,
    UploadCommit,
    UploadKind,
)

from ...case import Depth, case
from ...client.board_client import BoardClient
from ...client.capabilities import trace_modes
from ...client.latching import latch_now, latch_random, read_ring
from ...client.uploads import begin_upload
from ...judge.repetition import every_request_to_repeat
from ...judge.witness import judge_nothing_read_back
from ...outcome import SELF_REPORTED, check, check_equal, named

_UPLOADED: Final = 5
_LATCHES: Final = 3
_APART_US: Final = 500

#: The sessions that follow session A.
_PATHS: Final = {"B": "the next session", "BA": "A behind B", "BCA": "A behind B and C"}


def _paths_of_sessions(board: BoardClient) -> dict[str, str]:
    """Return all paths, at a wall clock the one that opens A again."""
    return _PATHS if board.wire.is_virtual else {"BA": _PATHS["BA"]}


def _open_sessions_in_turn(board: BoardClient, path: str, number: int) -> None:
    """Open the sessions of *path* one after the other, each by a HELLO of this number."""
    nonces = {"A": board.link.session}
    for name in path:
        if name not in nonces:
            nonces[name] = board.new_nonce()
        board.hello(nonces[name], seq=number & 0xFFFF)
    board.link.seq = number


@case("HG-4.6/4-replies", evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def replies_end_with_session(board: BoardClient) -> None:
    """a reply of every type, refusals too, is forgotten in the next session, and in A behind B"""
    for path, name in _paths_of_sessions(board).items():
        for message in every_request_to_repeat(board):
            board.arm()
            text = f"{message.TYPE.name}, and again in {name}"
            with named(text), board.counting(requests=len(path) + 2, repeated=0):
                first = board.link.ask_at_once(message)
                _open_sessions_in_turn(board, path, board.link.seq - 1)
                board.wire.idle(_APART_US)
                again = board.link.ask_at_once(message)  # the same bytes, if the session is A
            is_new = again.frame_header.time_us != first.frame_header.time_us
            check(is_new, f"{text}: the time is the first's")


# --- Everything else that a session owns -------------------------------------------------------


def _no_drive_in_session(board: BoardClient) -> None:
    if board.has(Feature.READ_LATCHED):
        judge_nothing_read_back(board, DriveKind.LATCHED, "behind another session")


def _no_latch_in_session(board: BoardClient) -> None:
    status = board.status()
    found = status.last_seq, status.last_latch_us, status.queued
    check_equal(found, (0, 0, 0), f"last_seq, last_latch_us, queued are {found}")


def _no_ring_in_session(board: BoardClient) -> None:
    if board.has(Feature.TRACE_RING):
        reply = read_ring(board)
        found = reply.oldest, reply.next, len(reply.records)
        check_equal(found, (0, 0, 0), f"oldest, next and records of the ring are {found}")


def _no_upload_in_session(board: BoardClient) -> None:
    if board.has(Feature.SEQUENCE_PHASES):
        board.link.refused(UploadChunk(0, b"\x00"), ErrorCode.BAD_STATE)
        board.link.refused(UploadCommit(_UPLOADED), ErrorCode.BAD_STATE)


def _numbers_of_session_anew(board: BoardClient) -> None:
    """FAILED unless frames count from 0xFFF0, events from 0, and the division begins anew."""
    can_trace = board.has(Feature.CONFIG)
    modes = trace_modes(board, TraceMode.DRIVE, TraceMode.CRC)[:1] if can_trace else []
    since = board.arm(trace_mode=modes[0]) if modes else board.arm()
    with board.counting(latched=1):
        latch_now(board)
    traces = [p for p in board.wire.received[since:] if isinstance(p.message, Trace | TraceDrive)]
    numbers = [piece.frame_header.seq for piece in traces]
    text = f"the first events of the session have the numbers {numbers}"
    check_equal(numbers, [0] * len(modes), text)


#: What belongs to a session: each judges that it is gone.
_OWNED: Final = (
    _no_drive_in_session,
    _no_latch_in_session,
    _no_ring_in_session,
    _no_upload_in_session,
    _numbers_of_session_anew,
)


@case("HG-4.6/4-owned", evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def possessions_end_with_session(board: BoardClient) -> None:
    """drive, latches, ring, upload and numbers of a session are gone in the next, and in A
    behind B
    """
    for path in _paths_of_sessions(board):
        for judge in _OWNED:
            if board.has(Feature.TRACE_RING | Feature.CONFIG):
                board.configure(trace_mode=TraceMode.RING)
            if board.has(Feature.SEQUENCE_PHASES):
                begin_upload(board, UploadKind.PHASES, _UPLOADED, bytes(board.identity.transducers))
            board.arm()
            latch_random(board, _LATCHES)
            waiting_us = board.clock.soon_us(bytes(2000), ahead_us=5_000_000)
            board.link.stream(board.flat_phases(), waiting_us)
            _open_sessions_in_turn(board, path, board.link.seq - 20)
            judge(board)
