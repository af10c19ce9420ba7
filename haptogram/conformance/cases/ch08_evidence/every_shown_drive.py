"""HG-8.3, HG-8.4, HG-8.6: traces and read-backs of every drive, under ceiling and ramp."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Final

from haptogram_protocol.messages import (
    DriveKind,
    Feature,
    TraceDrive,
    TraceMode,
)

from ...case import Depth, case
from ...client.board_client import BoardClient
from ...client.capabilities import drive_kinds, trace_modes
from ...client.drive_paths import drive_paths, registers_asked_for
from ...client.latching import (
    ClientDrive,
    drive_crc,
    latch_now,
    latch_random,
    latches_received_from_board,
    read_back,
    read_drive,
)
from ...client.playback import (
    play_out,
    send_phases_to_store,
    send_phases_to_store_if_supported,
)
from ...client.stream_kinds import stream_kinds
from ...client.uploads import upload_correction
from ...outcome import SELF_REPORTED, check, check_equal

_MS: Final = 1000
_SEQUENCE: Final = 2
_CEILING: Final = 100
_READ: Final = Feature.CONFIG | Feature.READ_LATCHED
_DIMMED: Final = _READ | Feature.AMPLITUDE
_PLAYED: Final = Feature.CONFIG | Feature.SEQUENCE_PHASES
#: Sequences of one frame each, whose keys differ in nothing else.
_ALIKE: Final = (2, 3, 0x0101)
#: Which of them is played, and whether it is stored anew before; None: a frame of the stream.
_STEPS_WITH_LIKE_KEYS: Final = (
    *((number, False) for number in (2, 3, 0x0101, 2, 2)),
    *((2, True), (3, True), (3, True), None, (3, False), None, (2, True)),
)


@contextmanager
def _shown_under_ceiling(board: BoardClient, **changes: Any) -> Iterator[None]:
    """Let the radiated drive differ from the latched one in every phase and loud amplitude."""
    if board.has(Feature.AMPLITUDE):
        changes = {"amplitude_ceiling": _CEILING} | changes
    if board.has(Feature.CORRECTION):
        upload_correction(board)
    board.configure(**changes)
    yield
    if board.has(Feature.CORRECTION):
        upload_correction(board, bytes(board.identity.transducers))


@case("HG-8.3/2-paths", needs=_READ, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def traces_show_latched_drive(board: BoardClient) -> None:
    """drives of every format and path, under ceiling and correction: every trace shows the
    latched
    """
    for mode in trace_modes(board):
        with _shown_under_ceiling(board, trace_mode=mode):
            board.arm()
            for path in drive_paths(board):
                since = board.link.mark()
                due = registers_asked_for(board, path.latch())
                shown = read_back(board)
                name = f"{path.name}, trace {mode.name}"
                if due is not None:
                    same = (shown.phases, shown.amplitudes) == due
                    check(same, f"{name}: the latched drive read back is not the one sent")
                seen = latches_received_from_board(board, since, mode)
                check(bool(seen), f"{name}: no latch is traced")
                check_equal(seen[-1].crc, shown.crc, f"{name}: traced is not the latched drive")


@case("HG-8.6/1-shaded", needs=_READ, evidence=SELF_REPORTED)
def spans_under_a_ceiling(board: BoardClient) -> None:
    """READ_DRIVE of every span, of drives of every format under ceiling, correction and a ramp"""
    with _shown_under_ceiling(board):
        board.arm()
        for stream in stream_kinds(board):
            message = stream.make()
            latch_now(board, message)
            due = registers_asked_for(board, message)
            for kind in drive_kinds(board):
                whole = read_back(board, kind)
                name = f"{stream.name}, {kind.name}"
                if due is not None and kind is DriveKind.LATCHED:
                    got = whole.phases, whole.amplitudes
                    check_equal(got, due, f"{name}: not the drive sent")
                _check_spans(board, name, whole, kind)


def _check_spans(board: BoardClient, name: str, whole: ClientDrive, kind: DriveKind) -> None:
    count = board.identity.transducers
    for first in sorted({1, count // 3, count // 2, count - 1} & set(range(count))):
        for number in (1, 3, 0xFFFF):
            got, span = read_drive(board, kind, first, number).data, slice(first, first + number)
            due = whole.phases[span] + whole.amplitudes[span]
            check_equal(got, due, f"{name}: {number} from {first} are other codes than the whole's")


@case("HG-8.3/2-ramp", needs=_DIMMED, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def traces_show_no_ramp(board: BoardClient) -> None:
    """latches in a ramp, and while the ceiling is 0 and changes, are traced as they are latched"""
    send_phases_to_store_if_supported(board, _SEQUENCE, frames=4)
    for mode in trace_modes(board):
        for ceiling in (0, _CEILING):
            # The host is silent, so that the lease's ramp goes on while queued frames are latched.
            board.hello()
            changes = {"amplitude_ceiling": ceiling, "host_timeout_ms": 30, "ramp_ms": 400}
            since, first = board.arm(trace_mode=mode, **changes), board.link.stream_next
            registers = [board.random_registers() for _ in range(3)]
            last_us = board.clock.soon_us(bytes(4 * board.identity.transducers), ahead_us=120 * _MS)
            times = [last_us - 20 * _MS * place for place in (2, 1, 0)]
            frames = zip(map(board.phases, registers), times, strict=True)
            board.link.send(*(board.link.stream_wire(frame, t_us) for frame, t_us in frames))
            board.clock.end_exchange()
            board.wire.idle(max(0, times[-1] + 5 * _MS - board.clock.device_estimate_us()))
            seen = latches_received_from_board(board, since, mode)
            got = [latch.crc for latch in seen if latch.index >= first]
            text = f"trace {mode.name}, ceiling {ceiling}, during a ramp: other drives"
            check_equal(got, list(map(drive_crc, registers)), text)


@case("HG-8.3/2-keys", needs=_PLAYED, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def traces_of_like_keys(board: BoardClient) -> None:
    """sequences of one frame, played in turn, stored anew, stream frames between: each has its
    CRC
    """
    for mode in trace_modes(board):
        board.hello()
        since, due = board.arm(trace_mode=mode), []
        stored = {number: send_phases_to_store(board, number, frames=1) for number in _ALIKE}
        for step in _STEPS_WITH_LIKE_KEYS:
            if step is None:
                latch_random(board, 1)
                continue
            number, is_new = step
            if is_new:
                stored[number] = send_phases_to_store(board, number, frames=1)
            play_out(board, number, 1)
            due.append(drive_crc(stored[number][0]))
            if board.has(Feature.READ_LATCHED):
                shown = read_back(board)
                text = f"trace {mode.name}: sequence {number} is read back as another drive"
                check(shown.crc == due[-1], text)
        seen = latches_received_from_board(board, since, mode)
        got = [latch.crc for latch in seen if latch.sequence]
        pairs = enumerate(zip(got, due, strict=False))
        wrong = [place for place, (told, sent) in pairs if told != sent]
        text = f"trace {mode.name}: of {len(due)} playbacks of one frame {len(got)} are told"
        check(len(got) == len(due) and not wrong, f"{text}, those at {wrong} as other drives")


@case("HG-8.4/1-restarts", needs=_PLAYED | Feature.TRACE_DRIVE, evidence=SELF_REPORTED)
def trace_divisions_start_anew(board: BoardClient) -> None:
    """a divider counts the latches of stream and playback from SET_CONFIG and from HELLO on,
    each
    """
    send_phases_to_store(board, _SEQUENCE, frames=2)
    for before in range(4):
        for name in ("SET_CONFIG", "HELLO"):
            board.arm(trace_mode=TraceMode.DRIVE, trace_divider=3)
            latch_random(board, before)
            if name == "HELLO":
                board.hello()
            else:
                board.configure(trace_mode=TraceMode.DRIVE, trace_divider=3)
            since = board.arm()
            latch_now(board)
            play_out(board, _SEQUENCE, 2, loops=3)  # 7 latches: 0, 3 and 6 of them are traced
            board.link.barrier()
            keys = [event.key for _, event in board.link.events(TraceDrive, since)]
            got = [2 * key.loop + key.index + 1 if key.sequence else 0 for key in keys]
            check_equal(got, [0, 3, 6], f"{before} latches, {name}, 7 latches: traced are {got}")
