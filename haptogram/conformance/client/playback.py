"""Sequences: stored and played."""

from __future__ import annotations

from typing import Final

from haptogram_protocol import messages as m

from ..outcome import check, not_observed
from .board_client import BoardClient
from .uploads import upload_to_board

PERIOD_US: Final = 1000
UNATTENDED_MS: Final = 2000
_UNATTENDED_PERIODS: Final = 2000
_SEEN_PERIODS: Final = 5  # periods that a case waits after the last latch
_FLOOD_FRAMES: Final = 400
_BUFFERS_BYTES: Final = 1 << 17  # buffered drives of traces: more than a pty and a board hold
_TRACE_BYTES: Final = 24  # size of TRACE_DRIVE on the line, without its drive
_FLOOD_RATE_HZ: Final = 10_000


def send_phases_to_store(board: BoardClient, sequence: int, *, frames: int) -> list[bytes]:
    """Upload a sequence of random drives and return the registers that each leads to."""
    registers = [board.random.randbytes(board.identity.transducers) for _ in range(frames)]
    upload_to_board(board, m.UploadKind.PHASES, sequence, b"".join(registers))
    return registers


def send_phases_that_fit(board: BoardClient, sequence: int, *, frames: int) -> None:
    """Upload a sequence of *frames* random drives, or fewer if one upload takes no more."""
    send_phases_to_store(board, sequence, frames=phases_that_fit(board, frames))


def phases_that_fit(board: BoardClient, frames: int) -> int:
    """Return the number of drives for a sequence: *frames*, or fewer if one upload has no room."""
    room = board.identity.max_upload_bytes // board.identity.transducers
    return max(1, min(frames, room))


def send_phases_to_store_if_supported(board: BoardClient, sequence: int, *, frames: int) -> None:
    """Upload a sequence of random drives, for requests to name, unless the board takes none."""
    if board.has(m.Feature.SEQUENCE_PHASES):
        send_phases_that_fit(board, sequence, frames=frames)


def least_period_us(board: BoardClient) -> int:
    """Return the shortest period that max_playback_rate_hz allows (HG-7.6/2).

    A board that stores no sequences may advertise 0; it refuses PLAY for another reason.
    """
    return -(-1_000_000 // max(1, board.identity.max_playback_rate_hz))


def shortest_period_to_play_us(board: BoardClient, least_us: int = 1) -> int:
    """Return the shortest period that the board takes, or *least_us* if that is longer.

    A latch in each period of the carrier is the most there can be (HG-5.8/3).
    """
    return max(least_us, board.clock.carrier_us, least_period_us(board))


def period_to_play(board: BoardClient, points: int = 0) -> int:
    """Return the usual period, or the shortest one that the board plays with *points* points."""
    return shortest_period_to_play_us(board, max(PERIOD_US, points * board.identity.point_time_us))


def play_request(
    board: BoardClient,
    sequence: int,
    *,
    loops: int,
    period_us: int | None = None,
    unattended_ms: int | None = None,
) -> m.Play:
    """Return a PLAY that the board takes while ARMED; NOT-OBSERVED if it plays no *period_us*.

    None as period: the usual one, and as unattended time: that of 2000 periods, 2 s at least.  A
    board that is left alone for less gets the longest time that it takes.
    """
    period_us = period_to_play(board) if period_us is None else period_us
    if period_us < least_period_us(board):
        rate = board.identity.max_playback_rate_hz
        not_observed(f"the case plays a frame every {period_us} µs; max_playback_rate_hz is {rate}")
    if unattended_ms is None:
        unattended_ms = max(UNATTENDED_MS, _UNATTENDED_PERIODS * period_us // 1000)
    alone_ms = min(unattended_ms, board.identity.max_unattended_ms)
    return m.Play(sequence, period_us, loops, alone_ms)


def _require_hold(board: BoardClient, period_us: int) -> None:
    """End the case as NOT-OBSERVED if the hold is shorter than 5 periods of *period_us*."""
    board.require_hold(_SEEN_PERIODS * period_us, f"a frame every {period_us} µs")


def play_now(
    board: BoardClient,
    sequence: int,
    *,
    loops: int,
    period_us: int | None = None,
    unattended_ms: int | None = None,
) -> m.PlayReply:
    """Play a sequence of phases from now on; return when its first frame is ready."""
    play = play_request(
        board, sequence, loops=loops, period_us=period_us, unattended_ms=unattended_ms
    )
    _require_hold(board, play.period_us)
    reply = board.link.call(play, m.PlayReply, flags=m.Flag.IMMEDIATE)
    board.wire.idle(board.clock.ready_us(0))
    return reply


def play_at(
    board: BoardClient,
    sequence: int,
    start_us: int,
    *,
    loops: int,
    period_us: int | None = None,
    unattended_ms: int | None = None,
) -> m.PlayReply:
    """Play a sequence from *start_us* on; INCONCLUSIVE if PLAY came too late for that."""
    play = play_request(
        board, sequence, loops=loops, period_us=period_us, unattended_ms=unattended_ms
    )
    _require_hold(board, play.period_us)
    answer = board.link.ask(play, time_us=start_us)
    if isinstance(answer.message, m.Error):
        board.clock.require_before(start_us - board.clock.ready_us(0), "PLAY came too late")
    return board.link.reply_in(answer, m.PlayReply, m.Play.TYPE)


def play_later(
    board: BoardClient,
    sequence: int,
    ahead_us: int,
    *,
    loops: int = 0,
    period_us: int | None = None,
    unattended_ms: int | None = None,
) -> m.PlayReply:
    """Schedule a playback *ahead_us* ahead; NOT-OBSERVED if the horizon is nearer."""
    start_us = board.clock.ahead_us(ahead_us)
    play = play_request(
        board, sequence, loops=loops, period_us=period_us, unattended_ms=unattended_ms
    )
    return board.link.call(play, m.PlayReply, time_us=start_us)


def play_out(
    board: BoardClient,
    sequence: int,
    frames: int,
    *,
    loops: int = 1,
    period_us: int | None = None,
) -> m.PlaybackEnded:
    """Play a stored sequence of *frames* frames now, to its end; FAILED without an end.

    NOT-OBSERVED if that outlasts the board, which is left alone meanwhile, or the case.
    """
    period_us = period_to_play(board) if period_us is None else period_us
    since, lasts_us = board.link.mark(), frames * loops * period_us
    require_time_to_play(board, lasts_us)
    alone_ms = max(UNATTENDED_MS, 2 * lasts_us // 1000)
    play_now(board, sequence, loops=loops, period_us=period_us, unattended_ms=alone_ms)
    return await_playback_end(board, since, lasts_us)


def let_play(board: BoardClient, periods: int) -> None:
    """Let a playback that was started with its usual period go on for *periods* periods.

    NOT-OBSERVED if that takes longer than the board plays without a frame from the host.
    """
    lasts_us = periods * period_to_play(board)
    require_time_to_play(board, lasts_us)
    board.wire.idle(lasts_us)


def wait_for_no_latch(board: BoardClient, least_us: int) -> None:
    """Wait until a playback with the usual period would have latched again, had it gone on."""
    board.wire.idle(max(least_us, 2 * period_to_play(board)))


def most_periods_to_play(board: BoardClient, period_us: int) -> int:
    """Return the number of periods, 1 at least, that end while the board is left alone."""
    return max(1, (1000 * board.identity.max_unattended_ms - 1) // period_us)


def require_time_to_play(board: BoardClient, lasts_us: int) -> None:
    """End the case as NOT-OBSERVED if a playback of *lasts_us* outlasts the board or the case."""
    most_ms = board.identity.max_unattended_ms
    if lasts_us >= 1000 * most_ms:
        not_observed(f"{lasts_us / 1000:g} ms of playback; max_unattended_ms is {most_ms}")
    if lasts_us > board.wire.limits.case_us // 2:
        not_observed(
            f"{lasts_us / 1e6:g} s of playback at {board.identity.max_playback_rate_hz} frames per "
            f"second; a case lasts {board.wire.limits.case_us / 1e6:g} s at most"
        )


def await_playback_end(board: BoardClient, since: int, lasts_us: int) -> m.PlaybackEnded:
    """Return PLAYBACK_ENDED of a playback of *lasts_us*, from piece *since* on; FAILED without it.

    NOT-OBSERVED if the board, which is left alone meanwhile, mutes before the end.
    """
    require_time_to_play(board, lasts_us)
    name = f"a playback of {lasts_us / 1000:g} ms"
    return board.due_event(m.PlaybackEnded, since, 2 * lasts_us + 300_000, name)[1]


def flood_with_traces(board: BoardClient) -> tuple[int, int]:
    """Latch faster than the line can trace; return the numbers of trace events and of latches.

    NOT-OBSERVED if the board plays too slowly for the time that it is left alone.

    A port of the system may take bytes faster than any line: there the host does not read
    meanwhile, and the traces are more than the buffers on the way hold.
    """
    board.configure(trace_mode=m.TraceMode.DRIVE)
    send_phases_to_store(board, 1, frames=2)
    rate = min(board.identity.max_playback_rate_hz, _FLOOD_RATE_HZ)
    period_us = board.clock.on_carrier(-(-1_000_000 // rate))
    frames = _FLOOD_FRAMES
    if not board.wire.is_virtual:
        trace = _TRACE_BYTES + 2 * board.identity.transducers
        frames = max(frames, 2 * (_BUFFERS_BYTES // (2 * trace)))
    require_time_to_play(board, frames * period_us)
    board.arm()
    since = board.link.mark()
    alone_ms = max(UNATTENDED_MS, 2 * frames * period_us // 1000)
    play_now(board, 1, loops=frames // 2, period_us=period_us, unattended_ms=alone_ms)
    board.wire.look_away(frames * period_us)
    timeout_us = frames * period_us * 20 + 500_000
    found = board.link.await_event(m.PlaybackEnded, since, timeout_us)
    check(found is not None, "PLAYBACK_ENDED is lost among the traces")
    board.link.barrier()
    return len(board.link.events(m.TraceDrive, since)), frames
