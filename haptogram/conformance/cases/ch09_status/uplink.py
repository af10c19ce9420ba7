"""HG-9.4, HG-9.5, HG-9.6: room for frames, and frames that give way on the uplink."""

from __future__ import annotations

from typing import Final

from haptogram_protocol import messages as m
from haptogram_protocol.state import OutputState

from ...case import Depth, case
from ...client import playback
from ...client.board_client import BoardClient
from ...client.capabilities import trace_modes
from ...client.request_client import LONGEST_BURST_BYTES
from ...judge.events import judge_event_numbers
from ...outcome import SELF_REPORTED, check

_PLAYED: Final = m.Feature.SEQUENCE_PHASES | m.Feature.CONFIG
_ASKED: Final = 40
_MS: Final = 1000
_SEQUENCE: Final = 2
_SILENT_MS: Final = 8000  # STATUS of 50 ms are more than a board has room for
_TRACED_US: Final = 10_000
_TRACES: Final = (m.TraceMode.CRC, m.TraceMode.DRIVE)
_STATUS_TOLD: Final = 4  # STATUS while the uplink is full


@case("HG-9.4/1", evidence=SELF_REPORTED)
def free_bytes_are_free(board: BoardClient) -> None:
    """stream frames of free_bytes bytes, sent without a pause, are all counted"""
    good = board.flat_phases()
    size = len(board.link.stream_wire(good, seq=0))
    count = max(1, min(board.status().free_bytes, LONGEST_BURST_BYTES) // size)
    with board.counting(dropped_state=count):
        board.link.send(*(board.link.stream_wire(good) for _ in range(count)))
        board.wire.idle_while_sending()


@case("HG-9.5/1", needs=_PLAYED | m.Feature.TRACE_DRIVE)
def uplink_keeps_event_numbers(board: BoardClient) -> None:
    """events count up without a gap, even where traces were dropped at the board"""
    since = board.link.mark()
    playback.flood_with_traces(board)
    judge_event_numbers(board, board.wire.received[since:])


@case("HG-9.6/1-traces", needs=_PLAYED, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def only_traces_give_way(board: BoardClient) -> None:
    """while traces of every mode fill the uplink no STATUS and no other event gives way before
    them
    """
    for mode in trace_modes(board, *_TRACES):
        _flood_uplink(board, mode)


def _flood_uplink(board: BoardClient, mode: m.TraceMode) -> None:
    """Let a playback saturate the uplink until the unattended timer mutes; then read all.

    FAILED if the mute, a STATUS that was due before it, or an event number is missing.
    """
    period_ms = board.quick_status_ms
    board.configure(trace_mode=mode, status_period_ms=period_ms)
    board.hello()
    playback.send_phases_that_fit(board, _SEQUENCE, frames=2)
    board.arm()
    before = board.status().counters
    period_us = board.clock.on_carrier(playback.shortest_period_to_play_us(board))
    alone_ms = min(_STATUS_TOLD * period_ms + period_ms // 2, board.identity.max_unattended_ms)
    since = board.link.mark()
    start_us = board.clock.device_us()  # an answer behind the first traces may wait for the line
    playback.play_now(board, _SEQUENCE, loops=0, period_us=period_us, unattended_ms=alone_ms)
    board.wire.look_away((alone_ms + 5) * _MS)
    timeout_us = 20 * alone_ms * _MS
    for event in (m.StateChanged, m.PlaybackEnded):
        board.due_event(event, since, timeout_us, f"trace {mode.name}, a full uplink")
    board.link.barrier()
    dropped = board.counted_since(before)["trace_dropped"]
    name = f"trace {mode.name}, {dropped} traces dropped"
    found = board.link.events(m.Status, since)
    end_us = start_us + alone_ms * _MS
    told = [t for header, _ in found if (t := board.clock.unwrap(header.time_us)) <= end_us]
    due = (end_us - start_us) // (period_ms * _MS)
    check(len(told) >= due, f"{name}: {len(told)} STATUS came in {alone_ms} ms, due are {due}")
    judge_event_numbers(board, board.wire.received[since:], name)


# the buffers of an operating system take seconds to fill
@case("HG-9.5/1-full", needs=m.Feature.CONFIG, evidence=SELF_REPORTED, wall_depth=Depth.FULL)
def full_uplink_keeps_numbers(board: BoardClient) -> None:
    """a host reads nothing until no event finds room: numbers of every kind go on without a gap"""
    plays = board.has(m.Feature.SEQUENCE_PHASES)
    if plays:
        playback.send_phases_that_fit(board, _SEQUENCE, frames=2)
    for state in (OutputState.DISARMED, OutputState.ARMED):
        _fill_uplink(board, state, m.TraceMode.OFF)
    for mode in trace_modes(board, *_TRACES) if plays else ():
        _fill_uplink(board, OutputState.ARMED, mode)


def _fill_uplink(board: BoardClient, state: OutputState, mode: m.TraceMode) -> None:
    """Let STATUS saturate the uplink until a timer mutes; FAILED if an event number is missing.

    *state* is that of the output before.  Unless *mode* is OFF, a sequence plays meanwhile.
    """
    period_ms, alone_ms = board.quick_status_ms, _SILENT_MS
    if mode is not m.TraceMode.OFF:
        alone_ms = min(alone_ms, board.identity.max_unattended_ms)
    board.hello()
    board.configure(trace_mode=mode, status_period_ms=period_ms, host_timeout_ms=alone_ms)
    board.bring_to(state)
    since, before = board.link.mark(), board.status().counters
    if mode is not m.TraceMode.OFF:
        playback.play_now(board, _SEQUENCE, loops=0, period_us=_TRACED_US, unattended_ms=alone_ms)
    board.wire.look_away((_SILENT_MS + 5 * period_ms) * _MS)
    board.link.barrier()
    board.wire.idle(3 * period_ms * _MS)
    counted, pieces = board.counted_since(before), board.wire.received[since:]
    name = f"{state.name}, trace {mode.name}, the host reads again"
    judge_event_numbers(board, pieces, name)
    traces = sum(isinstance(piece.message, m.TracePlayback | m.TraceDrive) for piece in pieces)
    latched, dropped = counted["latched"], counted["trace_dropped"]
    text = f"{name}: {latched} latches, {dropped} traces dropped; {traces} traces came"
    check(mode is m.TraceMode.OFF or traces == latched - dropped, text)
    expected = OutputState.MUTED if state is OutputState.ARMED else state
    board.check_status(f"{name}: behind a silence of {_SILENT_MS} ms", state=expected)


@case("HG-9.6/1", depth=Depth.DEFAULT)
def bounds_its_uplink(board: BoardClient) -> None:
    """40 GET_GEOMETRY without a pause: whole frames come, then the board answers as before"""
    wires = [board.link.request_wire(m.GetGeometry(0, 0xFFFF))[0] for _ in range(_ASKED)]
    since = board.link.mark()
    board.link.send(*wires)
    board.wire.idle(board.wire.period_us(_ASKED * 4200))
    broken = [piece for piece in board.wire.received[since:] if piece.fault]
    check(not broken, f"a frame came in pieces: {broken[0].fault if broken else ''}")
    board.link.ping(3)
    check(board.status().free_bytes > 0, "free_bytes is 0 although nothing waits")
