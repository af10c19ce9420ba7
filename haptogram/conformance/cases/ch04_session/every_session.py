"""HG-4.6: a new session at every moment, and a repeated HELLO."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from functools import partial
from typing import Final

from haptogram_protocol.messages import (
    Config,
    Feature,
    Hello,
    Mute,
    Ping,
    PlaybackEnded,
    Pong,
    TraceMode,
    UploadChunk,
    UploadCommit,
    UploadCommitReply,
    UploadKind,
)
from haptogram_protocol.state import OutputState

from ...case import case
from ...client.board_client import BoardClient
from ...client.latching import latch_now
from ...client.playback import (
    play_now,
    play_out,
    send_phases_to_store,
)
from ...client.uploads import begin_upload, upload_correction
from ...judge.repetition import judge_repeated_reply
from ...outcome import SELF_REPORTED, check, check_equal, named

_SEQUENCE: Final = 5
_FRAMES: Final = 4
_PLAYED: Final = 6
_EDGES: Final = (0x7FFF, 0x8000, 0x00FF, 0xFF00, 0xFFFF, 0x0100)


def _session_with_everything_set(board: BoardClient) -> Config:
    """Set every field of the configuration away from its default and return it."""
    return board.configure(
        hold_ms=4321,
        ramp_ms=0 if not board.has(Feature.AMPLITUDE) else 33,
        host_timeout_ms=7654,
        status_period_ms=0,
        late_window_us=12_345,
        sound_speed_mm_s=355_555,
        trace_mode=TraceMode.OFF,
        amplitude_ceiling=77,
        trace_divider=515,
    )


def _streaming_session(board: BoardClient) -> None:
    board.arm()
    latch_now(board, board.flat_phases(7))
    board.link.stream(board.flat_phases(), board.clock.ahead_us(2_000_000))


def _playing_session(board: BoardClient) -> None:
    board.arm()
    play_now(board, _SEQUENCE, loops=0)


def _uploading_session(board: BoardClient) -> None:
    data = bytes(2 * board.identity.transducers)
    begin_upload(board, UploadKind.PHASES, _SEQUENCE, data)
    board.link.ask(UploadChunk(0, data[:1]))


_MOMENTS: Final[dict[str, Callable[[BoardClient], object]]] = {
    "while DISARMED": BoardClient.disarm,
    "while MUTED": lambda board: board.link.ask(Mute()),
    "with frames queued": _streaming_session,
    "during a playback": _playing_session,
    "during an upload": _uploading_session,
}


@case("HG-4.6/5-moments", needs=Feature.CONFIG | Feature.SEQUENCE_PHASES, evidence=SELF_REPORTED)
def settings_outlive_every_session(board: BoardClient) -> None:
    """a new session, idle, muted, streaming, playing, uploading, leaves every setting as it is"""
    if board.has(Feature.CORRECTION):
        upload_correction(board)
    send_phases_to_store(board, _SEQUENCE, frames=_FRAMES)
    config = _session_with_everything_set(board)
    crc = board.status().config_crc
    for name, bring in _MOMENTS.items():
        bring(board)
        before = board.status().counters
        reply = board.hello()
        check(reply.config_crc == crc, f"{name}: config_crc is {reply.config_crc:#x}, was {crc:#x}")
        check_equal(board.read_config(), config, f"{name}: the configuration has changed")
        board.check_counters_kept(before, name)
        check_equal(board.status().queued, 0, f"{name}: frames are still queued")
        is_armed = reply.state is OutputState.ARMED
        check(not is_armed, f"{name}: the board is ARMED in a new session")
        board.arm()
        text = f"{name}: the stored sequence in a new session"
        with named(text), board.counting(latched=_FRAMES):
            play_out(board, _SEQUENCE, _FRAMES)
        board.disarm()


# --- A repeated HELLO --------------------------------------------------------------------------


@case("HG-4.6/2-nonces")
def each_nonce_opens_session(board: BoardClient) -> None:
    """nonces one bit from the open one, and the least and greatest, each open a session,
    DISARMED
    """
    for step in (*range(16), *_EDGES):
        board.arm()
        nonce = step if step in _EDGES else board.link.session ^ 1 << step
        if nonce and nonce != board.link.session:
            _check_hello_opens(board, nonce)
    nonces = [board.new_nonce()]
    for number in range(12):  # each of the two to four sessions before comes again
        if number < 4:
            board.hello()
            nonces.append(board.link.session)
        old = nonces[-2 - number % 3]
        if old == board.link.session:
            continue
        board.arm()
        _check_hello_opens(board, old)
        nonces.append(old)
        board.link.call(Ping(number), Pong)


def _check_hello_opens(board: BoardClient, nonce: int) -> None:
    """FAILED unless HELLO with a nonce that is not open opens a session, DISARMED."""
    reply = board.hello(nonce)
    found, due = (reply.nonce, reply.state), (nonce, OutputState.DISARMED)
    check_equal(found, due, f"HELLO with {nonce:#06x} opens {reply.nonce:#06x}")


@case("HG-4.6/1-effects")
def repeated_hello_does_nothing(board: BoardClient) -> None:
    """a HELLO of the open nonce of any number leaves numbers, remembered reply, playback, upload"""
    board.hello()
    board.arm()
    hello = board.hello_message(board.link.session)
    for ahead in (0, 1, 9, 20_000, 40_000, -1):
        ping = Ping(ahead & 0xFF)
        first = board.link.ask(ping)
        board.link.ask(hello, seq=board.link.seq + ahead)
        judge_repeated_reply(board, ping, first, f"HELLO of the open nonce {ahead} numbers on")
        board.link.call(Ping(1), Pong)  # the next number, which is not used up
    if board.has(Feature.SEQUENCE_PHASES):
        _check_playback_goes_on(board, hello)


def _check_playback_goes_on(board: BoardClient, hello: Hello) -> None:
    frames = send_phases_to_store(board, _PLAYED, frames=2)
    since = board.link.mark()
    play_now(board, _PLAYED, loops=0)
    data = b"".join(frames)
    begin_upload(board, UploadKind.PHASES, _PLAYED + 1, data)
    half = min(len(data) // 2, board.identity.max_chunk)
    board.link.ask(UploadChunk(0, data[:half]))
    board.link.ask(hello)
    board.check_state(OutputState.ARMED, "HELLO of the open nonce has led to")
    ended = board.link.events(PlaybackEnded, since)
    check(not ended, "HELLO of the open nonce has ended the playback")
    for start in range(half, len(data), max(1, half)):
        board.link.ask(UploadChunk(start, data[start : start + half]))
    taken = board.link.call(UploadCommit(_PLAYED + 1), UploadCommitReply).frames
    check_equal(taken, len(frames), f"an upload around HELLO of the open nonce: {taken} frames")


@case("HG-4.6/1-reply", needs=Feature.CONFIG)
def first_hello_reply_stays(board: BoardClient) -> None:
    """a repeated HELLO gets the first reply, with the state and settings of then, after any
    change
    """
    happenings: dict[str, Callable[[], object]] = {
        "ARM": board.arm,
        "SET_CONFIG": lambda: _session_with_everything_set(board),
        "a latch": lambda: latch_now(board, board.flat_phases(3)),
        "MUTE": lambda: board.link.ask(Mute()),
    }
    if board.has(Feature.SEQUENCE_PHASES):
        happenings["an upload that begins"] = partial(_uploading_session, board)
    if board.has(Feature.CORRECTION):
        happenings["a new correction"] = partial(upload_correction, board)
    board.configure(sound_speed_mm_s=331_300)
    first = board.hello()
    for name, happen in happenings.items():
        happen()
        again = board.hello(board.link.session)
        check_equal(again, first, f"after {name}: another HELLO_REPLY than the first")
    last = board.hello()
    due = (board.config.sound_speed_mm_s, board.status().config_crc, OutputState.MUTED)
    told = (last.sound_speed_mm_s, last.config_crc, last.state)
    check(told == due, f"a new session tells (speed, config_crc, state) {told}, due is {due}")
    changed = {"sound_speed_mm_s": 0, "config_crc": 0, "state": OutputState.MUTED, "nonce": 1}
    same = [dataclasses.replace(reply, **changed) for reply in (first, last)]  # type: ignore[arg-type]
    check_equal(same[1], same[0], "the identity has changed with settings")
    if board.has(Feature.CORRECTION):
        upload_correction(board, bytes(board.identity.transducers))
