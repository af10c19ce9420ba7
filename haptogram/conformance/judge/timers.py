"""Mutes by a timer of the board: which timer, and when."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

from haptogram_protocol import messages as m
from haptogram_protocol.annotation.frames import annotated_type_name
from haptogram_protocol.rules import CONFIG_BOUNDS
from haptogram_protocol.state import MuteReason, OutputState

from ..client import latching, playback
from ..client.board_client import BoardClient
from ..outcome import HeldUpError, check, fail, named

EXACT_US: Final = 1000  # HG-12.1: timers are within 1 ms
_MS: Final = 1000
_AT_ONCE_US: Final = 50
_PATIENCE_MS: Final = 1000
_PERIOD_US: Final = 4_000_000  # frame period of a playback without a host
_SHORT_MS: Final = 1000
_LONGEST_MS: Final = 1 << 21  # longest timer that is awaited, and at a wall clock
_LONGEST_WALL_MS: Final = 70_000
#: Sequence that is stored, for a playback that is left alone.
TIMED: Final = 2


@dataclass(frozen=True, slots=True)
class TimerKind:
    """A timer that mutes.

    Attributes
    ----------
    name : str
        Name of its length.
    reason : MuteReason
        Reason of the mute at its end.
    needs : Feature
        Capabilities that it needs.
    beside : dict
        Lengths of other timers, which end before or after it.
    """

    name: str
    reason: MuteReason
    needs: m.Feature = m.Feature.CONFIG
    beside: Mapping[str, int] = field(default_factory=dict)

    def start(self, board: BoardClient, length_ms: int, **changes: int) -> int:
        """Configure and start it on a board that is ARMED for it; return the device time of that.

        A lease begins without a latch, so that no hold runs, unless a ramp follows.
        """
        plays = self.reason is MuteReason.UNATTENDED
        if plays:
            playback.send_phases_that_fit(board, TIMED, frames=2)
        board.arm(**{**self.beside, **({} if plays else {self.name: length_ms}), **changes})
        if plays:
            period_us = _PERIOD_US if length_ms > _SHORT_MS else None
            playback.play_now(board, TIMED, loops=0, period_us=period_us, unattended_ms=length_ms)
        elif self.reason is MuteReason.HOLD_EXPIRED or board.config.ramp_ms:
            latching.latch_now(board)
        if self.reason is not MuteReason.HOLD_EXPIRED:
            return board.clock.device_us()
        return board.last_latch_us() + (self is RAMP) * board.config.hold_ms * _MS

    def judge(
        self,
        board: BoardClient,
        since: int,
        start_us: int,
        due_ms: int,
        name: str = "",
        *,
        asked_us: int | None = None,
    ) -> None:
        """FAILED unless it mutes *due_ms* after *start_us*; see :func:`judge_mute_time`."""
        name = name or f"{self.name} = {due_ms}"
        timeout_us = (due_ms + _PATIENCE_MS) * _MS
        with named(name):
            header, _ = judged_mute_by_timer(board, since, timeout_us, self.reason)
        judge_mute_time(board, start_us, header, due_ms, name, asked_us=asked_us)

    def judge_whole(
        self, board: BoardClient, length_ms: int, name: str = "", **changes: int
    ) -> None:
        """Start it; FAILED unless it mutes after its length, and the ramp that *changes* set."""
        since = board.link.mark()
        start_us = self.start(board, length_ms, **changes)
        self.judge(board, since, start_us, length_ms + changes.get("ramp_ms", 0), name)

    def most_ms(self, board: BoardClient) -> int:
        """Return its greatest length on a board."""
        limit_ms = _LONGEST_MS if board.wire.is_virtual else _LONGEST_WALL_MS
        longest_ms = min(board.identity.max_unattended_ms, limit_ms)
        return CONFIG_BOUNDS.get(self.name, (1, longest_ms))[1]


LEASE: Final = TimerKind("host_timeout_ms", MuteReason.HOST_SILENT)
HOLD: Final = TimerKind("hold_ms", MuteReason.HOLD_EXPIRED)
RAMP: Final = TimerKind(
    "ramp_ms", MuteReason.HOLD_EXPIRED, m.Feature.CONFIG | m.Feature.AMPLITUDE, {"hold_ms": 5}
)
UNATTENDED: Final = TimerKind(
    "unattended_ms",
    MuteReason.UNATTENDED,
    m.Feature.CONFIG | m.Feature.SEQUENCE_PHASES,
    {"host_timeout_ms": 50, "hold_ms": 10_000},
)


def timer_kinds(board: BoardClient, *wanted: TimerKind) -> list[TimerKind]:
    """Return those of the *wanted* timers, or of all, that the board has."""
    return [t for t in wanted or (LEASE, HOLD, RAMP, UNATTENDED) if board.has(t.needs)]


def judge_ramp_with_configuration(
    board: BoardClient, hold_ms: int, ramp_ms: int, changes: Mapping[str, int]
) -> None:
    """FAILED unless a ramp of the hold goes on as it began, whatever is set in it."""
    since = board.link.mark()
    start_us = HOLD.start(board, hold_ms, ramp_ms=ramp_ms)
    board.clock.idle_until(start_us + (hold_ms + ramp_ms // 3) * _MS)
    board.clock.require_before(start_us + (hold_ms + ramp_ms) * _MS, "the middle of a ramp")
    board.configure(**{"hold_ms": hold_ms, "ramp_ms": ramp_ms, **changes})
    name = f"a ramp of {hold_ms} + {ramp_ms} ms, {dict(changes)} meanwhile"
    HOLD.judge(board, since, start_us, hold_ms + ramp_ms, name)


def judged_mute_by_timer(
    board: BoardClient, since: int, timeout_us: int, reason: MuteReason
) -> tuple[m.Header, m.StateChanged]:
    """Return the STATE_CHANGED of a timer; FAILED if none comes, or one of another timer."""
    found = board.link.await_event(m.StateChanged, since, timeout_us)
    if found is None:
        _require_not_muted_before(board, since)
        board.lacks_event(m.StateChanged, since, timeout_us, f"due is MUTED, {reason.name}")
    header, event = found
    judge_in_time(
        board,
        (event.state, event.reason) == (OutputState.MUTED, reason),
        f"due is MUTED, {reason.name}; STATE_CHANGED says {event.state.name}, {event.reason.name}",
    )
    return header, event


def _require_not_muted_before(board: BoardClient, since: int) -> None:
    """End the case as not judged if the board was muted from the last ARM_REPLY to *since*.

    *since* is an index of received frames; nothing is checked in virtual time.
    """
    for piece in () if board.wire.is_virtual else reversed(board.wire.received[:since]):
        if isinstance(piece.message, m.ArmReply):
            return
        if isinstance(piece.message, m.StateChanged) and piece.message.state is OutputState.MUTED:
            raise HeldUpError("muted before the case looked")


def judge_mute_time(
    board: BoardClient,
    start_us: int,
    header: m.Header,
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


def _begin_text(board: BoardClient, muted: m.Header, due_ms: int) -> str:
    """Return a text that names the board's frames *due_ms* before the mute, to 50 µs, or ''."""
    begun_us = (muted.time_us - due_ms * _MS) & 0xFFFFFFFF
    headers = [piece.header for piece in board.wire.received if piece.header is not None]
    names = {
        annotated_type_name(header.type)
        for header in headers
        if abs(m.signed_difference(header.time_us, begun_us, 32)) <= _AT_ONCE_US
    }
    return f"; it is {due_ms} ms behind {' and '.join(sorted(names))}" if names else ""


def judge_unmoved(name: str, late_us: Callable[[Sequence[str]], int], sent: Sequence[str]) -> None:
    """FAILED with the name of those *sent* meanwhile that move the end of a timer.

    It ends *late_us* with those named sent.
    """
    if abs(late_us(sent)) <= EXACT_US:
        return
    for one in sent:
        late = late_us([one])
        check(abs(late) <= EXACT_US, f"{one}: the mute, {name}, is late by {late / _MS:+.1f} ms")
    late = late_us(())
    how = "without any frame too" if abs(late) > EXACT_US else "by several together"
    fail(f"the mute, {name}, is moved by {late / _MS:+.1f} ms {how}; due is 0")


def judge_status_period(
    board: BoardClient, since: int, period_ms: int, least: int, name: str = ""
) -> None:
    """FAILED unless STATUS came, *least* at least, a period apart within 1 ms."""
    name = f"status_period_ms = {period_ms}{name and ', '}{name}"
    pieces = [
        p for p in board.wire.received[since:] if p.header and isinstance(p.message, m.Status)
    ]
    for one, two in itertools.pairwise(pieces):
        assert one.header is not None  # above
        assert two.header is not None
        step_ms = m.signed_difference(two.header.time_us, one.header.time_us, 32) / _MS
        if abs(step_ms - period_ms) * _MS > EXACT_US:
            sent = board.wire.recording.between(one.t_us, two.t_us)
            text = f"{name}: STATUS {step_ms:.3f} ms after the one before, due within 1 ms; {sent}"
            judge_in_time(board, False, text)
    check(len(pieces) >= least, f"{name}: {len(pieces)} STATUS came; due are {least} at least")


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
