"""HG-4.6: what belongs to a session does not outlive it, nor come back when it is reopened."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from haptogram_protocol.messages import (
    ErrorCode,
    Feature,
    ReadTrace,
    Trace,
    TraceDrive,
    TraceMode,
    TraceReply,
    UploadChunk,
    UploadCommit,
    UploadKind,
)

from ...case import Depth, case
from ...client.board_client import BoardClient
from ...client.latching import latch_now, read_back
from ...client.uploads import begin_upload
from ...judge.repetition import every_request_to_repeat
from ...outcome import SELF_REPORTED, check, check_equal

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
def remembered_replies_do_not_outlive_a_session(board: BoardClient) -> None:
    """a reply of every type, refusals too, is forgotten in the next session, and in A behind B"""
    for path, name in _paths_of_sessions(board).items():
        for message in every_request_to_repeat(board):
            board.arm()
            before = board.status().counters
            first = board.link.ask_at_once(message)
            seq = board.link.seq
            _open_sessions_in_turn(board, path, seq - 1)
            board.wire.idle(_APART_US)
            again = board.link.ask_at_once(message)  # the same bytes, if the session is A
            counted = board.counted_since(before)
            found, due = (counted["requests"], counted["repeated"]), (len(path) + 2, 0)
            text = f"{message.TYPE.name}, and again in {name}"
            check(found == due, f"{text}: requests, repeated count {found}, due is {due}")
            is_new = again.frame_header.time_us != first.frame_header.time_us
            check(is_new, f"{text}: the time is the first's")


# --- Everything else that a session owns -------------------------------------------------------


def _no_drive_in_session(board: BoardClient) -> None:
    if not board.has(Feature.READ_LATCHED):
        return
    shown = read_back(board)
    key = shown.reply.key
    codes = any(shown.phases + shown.amplitudes)
    found = (codes, key.sequence, key.loop, key.index)
    check_equal(found, (False, 0, 0, 0), f"a drive is latched, of frame {key}")


def _no_latch_in_session(board: BoardClient) -> None:
    status = board.status()
    found = status.last_seq, status.last_latch_us, status.queued
    check_equal(found, (0, 0, 0), f"last_seq, last_latch_us, queued are {found}")


def _no_ring_in_session(board: BoardClient) -> None:
    if board.has(Feature.TRACE_RING):
        reply = board.link.call(ReadTrace(0, 100), TraceReply)
        found = reply.oldest, reply.next, len(reply.records)
        check_equal(found, (0, 0, 0), f"oldest, next and records of the ring are {found}")


def _no_upload_in_session(board: BoardClient) -> None:
    if board.has(Feature.SEQUENCE_PHASES):
        board.link.refused(UploadChunk(0, b"\x00"), ErrorCode.BAD_STATE)
        board.link.refused(UploadCommit(_UPLOADED), ErrorCode.BAD_STATE)


def _numbers_of_session_anew(board: BoardClient) -> None:
    """FAILED unless frames count from 0xFFF0, events from 0, and the division begins anew."""
    mode, kind = next(
        (
            (mode, kind)
            for feature, mode, kind in (
                (Feature.TRACE_DRIVE, TraceMode.DRIVE, TraceDrive),
                (Feature.TRACE, TraceMode.CRC, Trace),
            )
            if board.has(feature | Feature.CONFIG)
        ),
        (TraceMode.OFF, None),
    )
    if kind is not None:
        board.configure(trace_mode=mode)
    board.arm()
    since = board.link.mark()
    with board.counting(latched=1):
        latch_now(board)
    numbers = [header.seq for header, _ in board.link.events(kind, since)] if kind else [0]
    check_equal(numbers, [0], f"the first events of the session have the numbers {numbers}")


_OWNED: Final[dict[str, Callable[[BoardClient], None]]] = {
    "the latched drive": _no_drive_in_session,
    "latch and queue of the status": _no_latch_in_session,
    "the trace ring": _no_ring_in_session,
    "the upload": _no_upload_in_session,
    "the numbers": _numbers_of_session_anew,
}


@case("HG-4.6/4-owned", evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def nothing_owned_outlives_a_session(board: BoardClient) -> None:
    """drive, latches, ring, upload and numbers of a session are gone in the next, and in A
    behind B
    """
    for path in _paths_of_sessions(board):
        for judge in _OWNED.values():
            if board.has(Feature.TRACE_RING | Feature.CONFIG):
                board.configure(trace_mode=TraceMode.RING)
            if board.has(Feature.SEQUENCE_PHASES):
                begin_upload(board, UploadKind.PHASES, _UPLOADED, bytes(board.identity.transducers))
            board.arm()
            for number in range(_LATCHES):
                latch_now(board, board.flat_phases(0x20 + number))
            waiting_us = board.clock.soon_us(bytes(2000), ahead_us=5_000_000)
            board.link.stream(board.flat_phases(), waiting_us)
            _open_sessions_in_turn(board, path, board.link.seq - 20)
            judge(board)
