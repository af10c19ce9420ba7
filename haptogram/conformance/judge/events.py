"""Events that a board meets, each brought about, and over when the call returns; those it sends."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Sequence
from typing import Final, TypeAlias

from haptogram_protocol import messages as m
from haptogram_protocol.annotation.frames import annotated_type_name

from ..client import malformed_frames, playback, uploads
from ..client.board_client import BoardClient
from ..client.wire import ReceivedByClient
from ..outcome import check, fail
from .refused_requests import STORED

#: An event: brought about by a call.
Event: TypeAlias = Callable[[BoardClient], object]

_MS: Final = 1000
_SHORT_MS: Final = 20
_AHEAD_US: Final = 8_000_000


def judge_event_numbers(
    board: BoardClient, pieces: Sequence[ReceivedByClient], name: str = ""
) -> None:
    """FAILED unless the events among *pieces* count up by 1."""
    events = [piece for piece in pieces if piece.is_event]
    for one, two in itertools.pairwise(events):
        assert one.header is not None  # is_event
        assert two.header is not None
        if two.header.seq != (due := (one.header.seq + 1) & 0xFFFF):
            kinds = [annotated_type_name(header.type) for header in (one.header, two.header)]
            fail(
                f"{name and name + ': '}{kinds[1]} has the event number {two.header.seq} behind "
                f"{kinds[0]} with {one.header.seq}; due is {due}; "
                f"{board.wire.recording.between(one.t_us, two.t_us)}"
            )


def event_of_correction(board: BoardClient) -> None:
    """Upload a random phase correction."""
    codes = board.random.randbytes(board.identity.transducers)
    uploads.upload_to_board(board, m.UploadKind.CORRECTION, 0, codes)


def event_of_waiting_playback(board: BoardClient, alone_ms: int = 9_999) -> None:
    """Let a playback wait for its start."""
    playback.play_later(board, STORED, _AHEAD_US, loops=1, unattended_ms=alone_ms)


def event_of_hold(board: BoardClient) -> None:
    """Let the hold run out, and the output go off."""
    _run_out_timer(board, dataclasses.replace(board.config, hold_ms=_SHORT_MS))


def event_of_lease(board: BoardClient) -> None:
    """Let the lease run out, and the output go off."""
    _run_out_timer(board, dataclasses.replace(board.config, host_timeout_ms=_SHORT_MS))


def event_of_unattended_time(board: BoardClient) -> None:
    """Let the unattended time of a playback run out, and the output go off."""
    _without_ramp(board, board.config)
    board.link.ask(m.Stop())
    event_of_waiting_playback(board, _SHORT_MS)
    _wait_for_short_timer(board)


def _run_out_timer(board: BoardClient, config: m.Config) -> None:
    """Set the ramp of *config* to zero, and wait until a timer of 20 ms has expired."""
    _without_ramp(board, config)
    _wait_for_short_timer(board)


def _without_ramp(board: BoardClient, config: m.Config) -> None:
    """Configure the board as *config* says, with a ramp length of zero."""
    board.config = dataclasses.replace(config, ramp_ms=0)
    board.link.ask(m.SetConfig(board.config))


def _wait_for_short_timer(board: BoardClient) -> None:
    """Idle for 25 ms, until a timer of the shortest length, 20 ms, has expired."""
    board.wire.idle_beyond((_SHORT_MS + 5) * _MS)


def event_of_damage(counter: str) -> Event:
    """Return the event of a frame that only *counter* counts."""

    def send(board: BoardClient) -> None:
        board.link.send(malformed_frames.malformed_by_counter(board.link)[counter])

    return send


def played_keys(sequence: int, frames: int, loops: int) -> list[m.LatchKey]:
    """Return the keys of all latches of a playback, in order."""
    return [m.LatchKey(sequence, *divmod(place, frames)) for place in range(frames * loops)]


def judge_division(
    board: BoardClient, since: int, latches: Sequence[m.LatchKey], divider: int, text: str = ""
) -> None:
    """FAILED unless TRACE_DRIVE tells of the first of *latches* and each *divider*-th behind it."""
    board.link.barrier()
    got = [event.key for _, event in board.link.events(m.TraceDrive, since)]
    due = list(latches[::divider])
    wrong = [pair for pair in itertools.zip_longest(got, due) if pair[0] != pair[1]]
    text = f"{text}{len(latches)} latches, trace_divider {divider}: {len(got)} are traced"
    check(not wrong, f"{text}; seen and due {wrong[:1]}")
