"""Mutes by a timer of the board: which timer, and when."""

from __future__ import annotations

import itertools
from typing import Final

from haptogram_protocol.annotation.words import annotated_type_name
from haptogram_protocol.messages import (
    ArmReply,
    Header,
    StateChanged,
    Status,
    signed_difference,
)
from haptogram_protocol.state import MuteReason, OutputState

from ..client.board_client import BoardClient
from ..outcome import HeldUpError, check, fail

EXACT_US: Final = 1000  # HG-12.1: timers are within 1 ms
_MS: Final = 1000
_AT_ONCE_US: Final = 50


def judged_mute_by_timer(
    board: BoardClient, since: int, timeout_us: int, reason: MuteReason
) -> tuple[Header, StateChanged]:
    """Return the STATE_CHANGED of a timer; FAILED if none comes, or one of another timer."""
    found = board.link.await_event(StateChanged, since, timeout_us)
    if found is None:
        _require_not_muted_before(board, since)
        board.lacks_event(StateChanged, since, timeout_us, reason.name)
    header, event = found
    judge_in_time(
        board,
        (event.state, event.reason) == (OutputState.MUTED, reason),
        f"due is MUTED, {reason.name}; STATE_CHANGED says {event.state.name}, {event.reason.name}",
    )
    return header, event


def _require_not_muted_before(board: BoardClient, since: int) -> None:
    """End the case, not judged, if a timer ended behind ARM, when the host had not looked yet."""
    for piece in () if board.wire.is_virtual else reversed(board.wire.received[:since]):
        if isinstance(piece.message, ArmReply):
            return
        if isinstance(piece.message, StateChanged) and piece.message.state is OutputState.MUTED:
            raise HeldUpError("muted before the case looked")


def judge_mute_time(
    board: BoardClient,
    start_us: int,
    header: Header,
    due_ms: int,
    timer: str,
    *,
    asked_us: int | None = None,
) -> None:
    """FAILED unless the mute in *header* came *due_ms* after *start_us*, within 1 ms.

    A request that started the timer came at *asked_us* or later; its reply began at *start_us*.
    """
    late_us = board.clock.unwrap(header.time_us) - start_us - due_ms * _MS
    least_us = 0 if asked_us is None else asked_us - start_us
    judge_in_time(
        board,
        least_us - EXACT_US <= late_us <= EXACT_US,
        f"{timer}: muted {late_us / _MS + due_ms:.3f} ms after, due is {due_ms} ms within 1 ms"
        f"{_begin_text(board, header, due_ms)}",
    )


def _begin_text(board: BoardClient, muted: Header, due_ms: int) -> str:
    """Return in words behind which frames of the board a timer of that length has run."""
    begun_us = (muted.time_us - due_ms * _MS) & 0xFFFFFFFF
    headers = [piece.header for piece in board.wire.received if piece.header is not None]
    names = {
        annotated_type_name(header.type)
        for header in headers
        if abs(signed_difference(header.time_us, begun_us, 32)) <= _AT_ONCE_US
    }
    return f"; it is {due_ms} ms behind {' and '.join(sorted(names))}" if names else ""


def judge_status_period(
    board: BoardClient, since: int, period_ms: int, least: int, name: str = ""
) -> None:
    """FAILED unless STATUS came, *least* at least, a period apart within 1 ms."""
    name = f"status_period_ms = {period_ms}{name and ', '}{name}"
    pieces = [p for p in board.wire.received[since:] if p.header and isinstance(p.message, Status)]
    for one, two in itertools.pairwise(pieces):
        assert one.header is not None  # above
        assert two.header is not None
        step_ms = signed_difference(two.header.time_us, one.header.time_us, 32) / _MS
        if abs(step_ms - period_ms) * _MS > EXACT_US:
            sent = board.wire.recording.between(one.t_us, two.t_us)
            text = f"{name}: STATUS {step_ms:.3f} ms after the one before, due within 1 ms; {sent}"
            judge_in_time(board, False, text)
    check(len(pieces) >= least, f"{name}: {len(pieces)} STATUS came; due are {least} at least")


def judge_lease_ends(board: BoardClient, since: int, text: str) -> None:
    """FAILED with *text* unless a timer has muted the board; it must do so without any frame."""
    if board.link.events(StateChanged, since):
        return
    lease_ms = board.config.host_timeout_ms
    board.wire.idle(2 * (lease_ms + board.config.ramp_ms) * _MS)
    muted = board.link.events(StateChanged, since)
    check(bool(muted), f"a lease of {lease_ms} ms does not end, without any frame either")
    fail(
        f"{text}: MUTED only when none came any more; due is {lease_ms} ms after the last good one"
    )


def judge_within_hold(board: BoardClient, latched_us: int, holds: bool, text: str) -> None:
    """FAILED unless *holds*; INCONCLUSIVE if the hold may have run out since a latch."""
    lasted_ms = (board.wire.now_us() - latched_us) / _MS
    hold_ms = board.config.hold_ms
    if not holds and lasted_ms >= hold_ms:
        raise HeldUpError(f"{lasted_ms:.0f} ms after a latch, the hold is {hold_ms} ms: {text}")
    judge_in_time(board, holds, text)


def judge_in_time(board: BoardClient, holds: bool, text: str) -> None:
    """FAILED unless *holds*; INCONCLUSIVE if the host was held up, and perhaps an emulator too."""
    board.wire.check_in_time(holds, text)
