"""HG-8.6: read-backs before the first latch of a session, of both kinds, whatever is set."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Final

from haptogram_protocol.messages import (
    DriveKind,
    DriveReply,
    Feature,
    LatchKey,
    Mute,
    ReadDrive,
    UploadKind,
)

from ...case import case
from ...client.board_client import BoardClient
from ...client.latching import latch_now
from ...client.playback import play_later, play_now, send_phases_to_store_if_supported
from ...client.uploads import upload_to_board
from ...outcome import SELF_REPORTED, check_equal

_SEQUENCE: Final = 3
_CEILING: Final = 77
_AHEAD_US: Final = 2_000_000
_KINDS: Final = (
    (Feature.READ_LATCHED, DriveKind.LATCHED),
    (Feature.READ_RADIATED, DriveKind.RADIATED),
)

_Bring = Callable[[BoardClient], object]


def _wait_with_a_frame(board: BoardClient) -> None:
    board.arm()
    t_us = board.clock.ahead_us(_AHEAD_US)
    board.link.stream(board.phases(board.random_registers()), t_us)


def _wait_with_a_playback(board: BoardClient) -> None:
    board.arm()
    play_later(board, _SEQUENCE, _AHEAD_US, loops=1, unattended_ms=2000)


def _drop_a_frame(board: BoardClient) -> None:
    board.link.stream(board.phases(board.random_registers()))


def _correct_again(board: BoardClient) -> None:
    if board.has(Feature.CORRECTION):
        codes = bytes(1 + code % 255 for code in board.random.randbytes(board.identity.transducers))
        upload_to_board(board, UploadKind.CORRECTION, 0, codes)


def _states_without_a_latch(board: BoardClient) -> Iterator[tuple[str, _Bring]]:
    """Yield what a board may be in before its first latch, one behind the other."""
    yield "as the session begins", lambda _: None
    yield "a frame dropped while DISARMED", _drop_a_frame
    yield "ARMED", BoardClient.arm
    yield "with a frame that waits", _wait_with_a_frame
    yield "MUTED", lambda board: board.link.ask(Mute())
    yield "with another correction", _correct_again
    if board.has(Feature.SEQUENCE_PHASES):
        yield "with a playback that waits", _wait_with_a_playback
    yield "DISARMED", BoardClient.disarm


def _states_of_the_session_before(board: BoardClient) -> Iterator[tuple[str, _Bring]]:
    """Yield what the session before ends in."""
    yield "a drive", lambda board: latch_now(board, board.phases(board.random_registers()))
    if board.has(Feature.SEQUENCE_PHASES):
        yield "a playback", lambda board: play_now(board, _SEQUENCE, loops=0)
    yield "MUTE", lambda board: board.link.ask(Mute())
    yield "nothing", lambda _: None


@case("HG-8.6/4-kinds", evidence=SELF_REPORTED)
def both_kinds_show_nothing_before_the_first_latch(board: BoardClient) -> None:
    """before a session's first latch both kinds show 0, armed, muted, waiting, under a
    correction
    """
    kinds = [kind for feature, kind in _KINDS if board.has(feature)]
    if not kinds:
        board.need_any(Feature.READ_LATCHED | Feature.READ_RADIATED)
    send_phases_to_store_if_supported(board, _SEQUENCE, frames=2)
    if board.has(Feature.CONFIG | Feature.AMPLITUDE):
        board.configure(amplitude_ceiling=_CEILING)
    _correct_again(board)
    for before, leave in _states_of_the_session_before(board):
        board.arm()
        leave(board)
        board.hello()
        for name, bring in _states_without_a_latch(board):
            bring(board)
            for kind in kinds:
                _check_nothing_is_shown(board, kind, f"behind {before}, {name}")
    if board.has(Feature.CORRECTION):
        upload_to_board(board, UploadKind.CORRECTION, 0, bytes(board.identity.transducers))


def _check_nothing_is_shown(board: BoardClient, kind: DriveKind, text: str) -> None:
    """FAILED unless codes, key and time of the whole and of its last transducer are 0."""
    for first in (0, board.identity.transducers - 1):
        reply = board.link.call(ReadDrive(kind, first, 0xFFFF), DriveReply)
        name = f"{text}: READ_DRIVE({kind.name}) from {first}"
        codes = sum(code != 0 for code in reply.data)
        check_equal(codes, 0, f"{name} shows {codes} codes of {len(reply.data)} that are not 0")
        found = reply.key, reply.t_latch_us
        check_equal(found, (LatchKey(0, 0, 0), 0), f"{name} shows key and time {found}")
