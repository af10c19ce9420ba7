"""HG-2.1, HG-2.3, HG-2.5, HG-2.6, HG-2.7, HG-6.7: delimiters, lengths of frames, and the line."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Final, TypeAlias

from haptogram_protocol import messages as m
from haptogram_protocol.annotation.frames import annotated_frame_text
from haptogram_protocol.cobs import cobs_encode
from haptogram_protocol.framing import MAX_ENCODED_BYTES, encode_frame

from ...case import Depth, case
from ...client import uploads
from ...client.board_client import BoardClient
from ...client.dialogue import full_client_dialogue
from ...client.malformed_frames import (
    malformed_frame,
    malformed_mute_of_size,
    malformed_noise,
    malformed_ping,
    malformed_with_crc,
)
from ...client.request_client import LONGEST_BURST_BYTES
from ...client.stream_kinds import stream_kinds
from ...judge.line_rules import judge_line_rule
from ...judge.timers import HOLD, LEASE, judge_status_period
from ...outcome import SELF_REPORTED, CaseEndedError, check, check_equal, fail, named

_PAUSE_US: Final = 120_000
_BYTE_US: Final = 1_000
_LISTEN_US: Final = 300_000
_PING_BYTES: Final = 26  # largest size of a PING on the line
_MS: Final = 1000
_PAUSES_MS: Final = (1, 100, 1_500, 10_000, 70_000)
_PAUSES_AT_WALL_MS: Final = (1, 100, 1_500)
_LONG_MS: Final = 1_500
_PLACES: Final = (
    "in the middle",
    "behind the first byte",
    "behind the second byte",
    "before the last byte",
)
_SEQUENCE: Final = 6
_CHUNK: Final = 8
_TOO_LONG: Final = 5_000
_HOLD_MS: Final = 450
_STATUS_MS: Final = 220
_LEASE_MS: Final = 160
_STEP_MS: Final = 10
#: Bytes that the line pauses in, with both delimiters: name, counter that they move by one, maker.
Paused: TypeAlias = tuple[str, str, Callable[[], bytes]]

# --- Delimiters --------------------------------------------------------------------------------


@case("HG-2.1/1")
def sends_both_delimiters(board: BoardClient) -> None:
    """in a full dialogue no two frames share a delimiter"""
    judge_line_rule(full_client_dialogue(board), "HG-2.1/1")


@case("HG-2.1/2")
def frames_may_share_a_delimiter(board: BoardClient) -> None:
    """a stream frame and a PING that share a zero are both taken"""
    frames = [board.link.stream_wire(board.flat_phases()) for _ in range(3)]
    with board.counting(dropped_state=3, requests=1):
        ping, _ = board.link.request_wire(m.Ping(1))
        board.link.exchange(*(frame[:-1] for frame in frames), ping)


@case("HG-2.1/3")
def frames_are_read_behind_junk(board: BoardClient) -> None:
    """a PING is answered right behind noise, halves of frames and runs too long"""
    half = encode_frame(board.link.body(m.Ping.TYPE, bytes(8), seq=0x4444))[:-6]
    junk = [malformed_noise(board.random, size) for size in (1, 3, 17, 300, 4095, 5000)]
    for before in [b"\xff", b"\x01", half, b"boot: ok\r\n", *junk]:
        ping, seq = board.link.request_wire(m.Ping(len(before)))
        text = f"a PING right behind {len(before)} bytes ({before[:8].hex(' ')} ...) is lost"
        # Without a pause: a board that waits for one loses the PING.
        board.link.check_answered(seq, text, before, ping)


@case("HG-2.1/3-pieces")
def every_cut_frame_is_read(board: BoardClient) -> None:
    """PINGs in two pieces cut at every byte, byte by byte, and with a pause of 120 ms are
    answered
    """
    size = len(board.link.request_wire(m.Ping(0), seq=0)[0])
    cuts: list[list[int]] = [[at] for at in range(1, size)]
    for at in cuts if board.thorough else cuts[::5]:
        _ask_in_pieces(board, at, _BYTE_US)
    _ask_in_pieces(board, list(range(1, size)), _BYTE_US)
    _ask_in_pieces(board, [size // 2], _PAUSE_US)


def _ask_in_pieces(board: BoardClient, cuts: list[int], pause_us: int) -> None:
    """Send a PING cut at the byte offsets *cuts*, with pauses; FAILED unless the board answers."""
    wire, seq = board.link.request_wire(m.Ping(board.random.getrandbits(64)))
    since = board.link.mark()
    for start, stop in zip([0, *cuts], [*cuts, len(wire)], strict=True):
        board.link.send(wire[start:stop])
        if stop < len(wire):
            board.wire.idle(pause_us)
    with named(f"a PING cut at {cuts[:3]} of {len(wire)} bytes, with pauses of {pause_us} µs"):
        board.link.reply_in(board.link.answer_to(m.Ping.TYPE, seq, since), m.Pong, m.Ping.TYPE)


@case("HG-2.3/1", evidence=SELF_REPORTED)
def ignores_empty_frames(board: BoardClient) -> None:
    """100 zeros in a row move no counter, and the next request is answered"""
    with board.counting(frames=0, requests=0):
        board.link.send(b"\x00" * 100)


# --- Lengths -----------------------------------------------------------------------------------


@case("HG-2.5/1", evidence=SELF_REPORTED)
def drops_frames_of_short_length(board: BoardClient) -> None:
    """1 to 13 bytes, some with a right CRC-32, are counted in short, once each"""
    pieces = [malformed_noise(board.random, size) for size in range(1, 14)]
    pieces += [malformed_with_crc(bytes([m.Ping.TYPE] * size)) for size in range(10)]
    with board.counting(short=len(pieces), frames=0):
        board.link.send(*map(malformed_frame, pieces))


@case("HG-2.6/1", depth=Depth.DEFAULT)
def frames_keep_the_longest_length(board: BoardClient) -> None:
    """no frame of a full dialogue is longer than 4096 bytes"""
    longest = max((len(piece.piece) for piece in full_client_dialogue(board)), default=0)
    check(longest <= MAX_ENCODED_BYTES, f"{longest} bytes between two delimiters")


@case("HG-2.6/2")
def reads_frames_of_longest_length(board: BoardClient) -> None:
    """frames of 4090 to 4096 bytes between their delimiters are read"""
    for size in (2048, MAX_ENCODED_BYTES - 6, MAX_ENCODED_BYTES - 1, MAX_ENCODED_BYTES):
        encoded, seq = malformed_mute_of_size(board.link, size)
        text = f"a frame of {size} bytes between its delimiters is not read"
        board.link.check_answered(seq, text, b"\x00", encoded, b"\x00")


@case("HG-2.6/3", evidence=SELF_REPORTED)
def discards_frames_beyond_the_longest_length(board: BoardClient) -> None:
    """runs of 4097 to 20000 bytes are counted in oversize, once; frames inside have no effect"""
    inside = cobs_encode(malformed_with_crc(board.link.body(m.Arm.TYPE, seq=0x7000)))
    runs = [malformed_noise(board.random, size) for size in (4097, 5000, 8192, 20_000)]
    with board.counting(oversize=len(runs) + 1):
        for run in [*runs, malformed_noise(board.random, 4096) + inside]:
            text = f"a frame inside a run of {len(run)} bytes"
            board.link.unanswered(text, b"\x00" + run + b"\x00")


@case("HG-2.6/3-lengths", evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def every_long_run_counts_once(board: BoardClient) -> None:
    """runs of 65 536 to 200 000 bytes count once in oversize, and in nothing else"""
    for size in (65_536, 65_536 + 4_096, 70_000, 131_072 + 4_097, 200_000):
        board.wire.require_carried(2 * size, board.wire.limits.case_us // 5)
        with board.counting(oversize=1):
            board.link.send(b"\x00" + malformed_noise(board.random, size) + b"\x00")
            board.wire.idle_while_sending()
            board.link.barrier()


# --- The line ----------------------------------------------------------------------------------


@case("HG-2.7/1")
def line_carries_every_byte(board: BoardClient) -> None:
    """all 256 byte values come back from PING as they were sent"""
    for start in range(0, 256, 8):
        echo = int.from_bytes(bytes(range(start, start + 8)), "little")
        got = board.link.ping(echo).echo
        check_equal(got, echo, f"sent {echo:016x}, came back {got:016x}: the line changes bytes")


@case("HG-2.7/2", evidence=SELF_REPORTED)
def line_takes_a_full_window(board: BoardClient) -> None:
    """stream frames of rx_window bytes, sent without a pause, are all counted"""
    first = board.link.stream_wire(board.flat_phases())
    count = max(1, min(board.identity.rx_window, LONGEST_BURST_BYTES) // len(first))
    frames = [first, *(board.link.stream_wire(board.flat_phases()) for _ in range(count - 1))]
    with board.counting(dropped_state=count, frames=count):
        board.link.send(*frames)
        board.wire.idle_while_sending()


@case("HG-2.7/2-shortest", evidence=SELF_REPORTED)
def line_takes_a_window_of_shortest_frames(board: BoardClient) -> None:
    """the shortest stream frames, rx_window bytes of them without a pause: each is counted"""
    first = board.link.stream_raw(m.Phases.TYPE, b"")  # of a wrong length: 14 bytes before stuffing
    count = (min(board.identity.rx_window, LONGEST_BURST_BYTES) - _PING_BYTES) // len(first)
    frames = [first, *(board.link.stream_raw(m.Phases.TYPE, b"") for _ in range(count - 1))]
    since = board.link.mark()
    with board.counting(bad_length=count, frames=count + 1, requests=1, gap=0):
        ping, seq = board.link.request_wire(m.Ping(1))
        board.wire.send(b"".join([*frames, ping]))
        board.link.answer_to(m.Ping.TYPE, seq, since)


@case("HG-2.7/3", needs_reset=True, depth=Depth.DEFAULT)
def line_is_silent_before_hello(board: BoardClient) -> None:
    """for 0.3 s after a reset the board sends no frame; boot text is tolerated"""
    board.wire.idle(_LISTEN_US)
    for piece in board.wire.received:
        if piece.header is not None:
            fail(f"before the first HELLO: {annotated_frame_text(piece.piece)}")


def _paused_bytes(board: BoardClient) -> Iterator[Paused]:
    """Yield requests, stream frames and malformed frames: name, counter, function that builds it.

    The counter is the one in STATUS that the frame increments.
    """
    link = board.link
    yield "PING", "requests", lambda: link.request_wire(m.Ping(7))[0]
    if board.has(m.Feature.SEQUENCE_PHASES):
        chunk = m.UploadChunk(0, bytes(range(1, 1 + _CHUNK)))
        yield "UPLOAD_CHUNK", "requests", lambda: link.request_wire(chunk)[0]
    for kind in stream_kinds(board):
        yield kind.name, "dropped_state", partial(link.stream_wire, kind.make())
    yield "a wrong CRC", "crc", lambda: malformed_ping(link)
    yield "wrong stuffing", "cobs", lambda: b"\x00\xff\x01\x02\x03\x04\x05\x00"
    yield "a short frame", "short", lambda: malformed_frame(malformed_with_crc(b"too short"))
    noise = malformed_noise(board.random, _TOO_LONG)
    yield "a run that is too long", "oversize", lambda: b"\x00" + noise + b"\x00"


@case("HG-2.1/3-pauses", evidence=SELF_REPORTED, depth=Depth.DEFAULT, wall_depth=Depth.FULL)
def every_pause_ends_no_frame(board: BoardClient) -> None:
    """frames of every kind and junk with a pause within, of 1 ms to 70 s: each taken, counted
    once
    """
    at_wall = not board.wire.is_virtual
    if board.has(m.Feature.SEQUENCE_PHASES):
        count = board.identity.transducers
        uploads.begin_upload(board, m.UploadKind.PHASES, _SEQUENCE, bytes(_CHUNK * count))
    for pause_ms in _pauses_ms(board):
        for paused in _paused_bytes(board):
            for place in _PLACES[:1] if at_wall and pause_ms >= _LONG_MS else _PLACES:
                _judge_pause(board, paused, place, pause_ms)


def _pauses_ms(board: BoardClient) -> tuple[int, ...]:
    """Return the pauses to test in ms, up to 1.5 s at a wall clock, else up to 70 s.

    If the board sends STATUS periodically, none is longer than 10 s.
    """
    if not board.wire.is_virtual:
        return _PAUSES_AT_WALL_MS
    return _PAUSES_MS[:-1] if board.config.status_period_ms else _PAUSES_MS


def _judge_pause(board: BoardClient, paused: Paused, place: str, pause_ms: int) -> None:
    """FAILED unless a frame with a pause at *place*, and the next PING, are counted once each.

    On failure the frame is sent again without a pause: if that fails too, that is the finding.
    """
    name, counter, make = paused
    counts = {counter: 1} | {"requests": 1 + (counter == "requests")}
    text = f"with a pause of {pause_ms} ms {place}" if pause_ms else "without a pause"
    try:
        with named(f"{name} {text}"), board.counting(**counts):
            data = make()
            cut = {_PLACES[0]: len(data) // 2, _PLACES[1]: 1, _PLACES[2]: 2}.get(place, -1)
            board.link.send(data[:cut])
            board.wire.idle(pause_ms * _MS)
            board.link.send(data[cut:])
            board.wire.idle_while_sending()
            board.link.barrier()
    except CaseEndedError:
        if pause_ms:
            _judge_pause(board, paused, place, 0)  # is the pause the cause?
        raise


# --- What goes on meanwhile --------------------------------------------------------------------


@case("HG-2.1/3-meanwhile", needs=m.Feature.CONFIG, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def every_timer_goes_on_in_a_pause(board: BoardClient) -> None:
    """in a pause of 1.5 s within a PING frames are latched, STATUS comes, the hold ends, in time"""
    status_ms = max(_STATUS_MS, board.quick_status_ms)
    board.arm(hold_ms=_HOLD_MS, status_period_ms=status_ms)
    payloads = 2 * (board.flat_phases().serialize(),)
    last_us = board.clock.soon_us(*payloads, ahead_us=300 * _MS)
    times = (last_us - 200 * _MS, last_us)
    with board.counting(latched=2, timeouts=1, requests=1):
        board.link.send(*(board.link.stream_wire(board.flat_phases(), t_us) for t_us in times))
        ping, seq = board.link.request_wire(m.Ping(board.random.getrandbits(64)))
        since, half = board.link.mark(), len(ping) // 2
        board.link.send(ping[:half])
        now_us = board.clock.device_estimate_us()  # a PING would end the pause
        board.clock.require_before(times[0], "the frames and half a PING", now_us)
        board.wire.idle(_LONG_MS * _MS)
        on_carrier_us = board.clock.on_carrier(times[1])
        HOLD.judge(board, since, on_carrier_us, _HOLD_MS, "hold_ms in a pause within a PING")
        board.link.send(ping[half:])
        board.link.reply_in(board.link.answer_to(m.Ping.TYPE, seq, since), m.Pong, m.Ping.TYPE)
    due = _LONG_MS // status_ms
    judge_status_period(board, since, status_ms, due - 1, f"a pause of {due} within a PING")


@case("HG-6.7/1-pauses", needs=m.Feature.CONFIG, depth=Depth.DEFAULT)
def every_byte_of_a_frame_renews_no_lease(board: BoardClient) -> None:
    """a frame renews the lease when it is complete, not with its first bytes; half a frame never"""
    board.configure(host_timeout_ms=_LEASE_MS)
    for name, late_ms in (("bytes that make no frame yet", None), ("a PING in two parts", 100)):
        since = board.link.mark()
        board.arm()
        start_us = board.clock.device_us()
        ping, seq = board.link.request_wire(m.Ping(board.random.getrandbits(64)))
        if late_ms is None:
            for byte in ping[:-1]:  # as far as they last until the lease is over
                board.link.send(bytes([byte]))
                board.wire.idle(_STEP_MS * _MS)
        else:
            board.link.send(ping[:-5])
            board.wire.idle(late_ms * _MS)
            board.link.send(ping[-5:])
            answer = board.link.answer_to(m.Ping.TYPE, seq, since)
            pong = board.link.reply_in(answer, m.Pong, m.Ping.TYPE)
            start_us = board.clock.unwrap(pong.t_rx_us)
        LEASE.judge(board, since, start_us, _LEASE_MS, f"the lease, and {name}")
        if late_ms is None:
            board.link.send(ping[-1:])
            board.link.answer_to(m.Ping.TYPE, seq, since)
