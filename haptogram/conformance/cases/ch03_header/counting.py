"""HG-3.9: every dropped frame is counted once, and junk does no harm."""

from __future__ import annotations

from typing import Final

from haptogram_protocol.messages import (
    Flag,
    Phases,
    Ping,
    Pong,
)

from ...case import Depth, case
from ...client import malformed_frames
from ...client.board_client import PARTS_OF_FRAMES, BoardClient
from ...outcome import SELF_REPORTED, check, check_equal

_JUNK_BYTES: Final = 1 << 20
_JUNK_S: Final = 20
_JUNK_PIECES: Final = 50  # between two PINGs
_NOISE: Final = 500
_STALE: Final = 0x0F0F
_UNKNOWN_STREAM: Final = 0x3D


@case("HG-3.9/3", evidence=SELF_REPORTED)
def junk_headers_are_survived(board: BoardClient) -> None:
    """junk of every kind neither restarts the board nor moves a counter back nor disarms it"""
    boot_id, before = board.identity.boot_id, board.status()
    board.arm()
    asked_us = board.wire.now_us()
    for _ in range(40):
        size = board.random.randrange(1, 600)
        board.link.send(b"\x00", board.random.randbytes(size), b"\x00")
        board.wire.idle_while_sending()
        if board.wire.now_us() - asked_us > 250 * board.config.host_timeout_ms:
            asked_us = board.wire.now_us()
            board.link.call(Ping(size), Pong)  # junk restarts no lease
    after = board.status()
    check_equal(after.state.name, "ARMED", f"junk has moved the board to {after.state.name}")
    check(after.counters.frames > before.counters.frames, "the counters began anew: a restart")
    check_equal(board.hello().boot_id, boot_id, "boot_id is another one: junk restarts the board")


@case("HG-3.9/4", depth=Depth.DEFAULT)
def junk_headers_leak_no_memory(board: BoardClient) -> None:
    """1 MiB of junk, or 20 s of it: PINGs are answered, and free_bytes is as before"""
    before = board.status()
    left = min(_JUNK_BYTES, board.wire.baudrate // 10 * _JUNK_S)
    while left > 0:
        junk = [_counted_junk_headers(board) for _ in range(_JUNK_PIECES)]
        board.link.send(*junk)
        board.link.call(Ping(left), Pong)
        left -= sum(map(len, junk))
    after = board.status()
    check(
        after.free_bytes == before.free_bytes,
        f"free_bytes was {before.free_bytes}, after junk {after.free_bytes}: it leaks",
    )


def _counted_junk_headers(board: BoardClient) -> bytes:
    """Return junk of every kind: a short frame, no COBS, a wrong CRC, a run without an end."""
    body = board.link.body(Ping.TYPE, board.random.randbytes(8), seq=0)
    wrong = malformed_frames.malformed_frame(
        malformed_frames.malformed_with_wrong_crc(body, 1 << board.random.randrange(32))
    )
    noise = board.random.randbytes(_NOISE).replace(b"\x00", b"\x01")
    return b"".join(
        (
            malformed_frames.malformed_frame(noise[:5]),
            b"\xf0" + noise[:20] + b"\x00",
            wrong,
            noise + b"\x00",
        )
    )


@case("HG-3.9/1", evidence=SELF_REPORTED)
def header_defects_count_once(board: BoardClient) -> None:
    """of one frame with each defect every counter grows by 1, and frames by their number"""
    good, old = board.flat_phases(), board.link.session ^ _STALE
    used = board.link.stream_next
    ping = board.link.body(Ping.TYPE, bytes(8), seq=board.link.next_seq())
    wires = [
        board.link.stream_wire(good),
        board.link.stream_wire(good, seq=used),
        board.link.stream_wire(good, seq=used, session=old),
        board.link.stream_raw(_UNKNOWN_STREAM, b""),
        board.link.stream_wire(good, flags=0x40),
        board.link.stream_raw(Phases.TYPE, good.serialize() + b"\x00"),
        malformed_frames.malformed_frame(malformed_frames.malformed_with_wrong_crc(ping)),
        malformed_frames.malformed_frame(b"\x40\x01\x02"),
        b"\x00\xff\x01\x02\x00",
        b"\x00" + malformed_frames.malformed_noise(board.random, 4200) + b"\x00",
    ]
    names = (
        "dropped_state duplicate stale_session unknown_type unsupported bad_length "
        "crc short cobs oversize"
    )
    with board.counting(frames=6, requests=0, **dict.fromkeys(names.split(), 1)):
        board.link.send(*wires)
        board.wire.idle_while_sending()


@case("HG-3.9/2", evidence=SELF_REPORTED)
def header_counts_add_up(board: BoardClient) -> None:
    """frames = accepted + requests + repeated + every drop, over 60 frames of all sorts"""
    board.arm()
    before = board.status().counters
    good, queued, sent = board.flat_phases(), 0, 0
    for number in range(15):
        board.link.stream(good)
        queued += 1
        board.link.stream(good, seq=board.link.stream_next - 1)
        board.link.call(Ping(number), Pong)
        board.link.stream(good, flags=Flag.IMMEDIATE | 0x40)
        sent += 4
    counted = board.counted_since(before)
    check_equal(
        counted["frames"], sent, f"{sent} frames were sent, frames counts {counted['frames']}"
    )
    parts = {name: counted[name] for name in PARTS_OF_FRAMES if counted[name]}
    total = sum(parts.values())
    check_equal(total, sent, f"{sent} frames were sent, the parts of the sum are {total}: {parts}")
    accepted = counted["accepted"]
    check_equal(accepted, queued, f"{queued} frames were queued, accepted counts {accepted}")
