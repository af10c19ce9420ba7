"""Chapter 2, the line itself: every byte, at full rate, and silence before the first HELLO."""

from __future__ import annotations

from typing import Final

from haptogram_protocol.messages import Ping, Pong

from ..case import case
from ..client import malformed_frames as crafting
from ..client.board_client import Bench
from ..client.recording import describe
from ..outcome import SELF_REPORTED, check

_LISTEN_US: Final = 300_000
_JUNK_BYTES: Final = 2 << 20
_JUNK_S: Final = 20
_JUNK_PIECES: Final = 50  # between two PINGs
_NOISE: Final = 2000


@case("HG-2.7/1", "all 256 byte values come back from PING as they were sent")
def carries_every_byte(bench: Bench) -> None:
    for start in range(0, 256, 8):
        echo = int.from_bytes(bytes(range(start, start + 8)), "little")
        got = bench.call(Ping(echo), Pong).echo
        check(got == echo, f"sent {echo:016x}, came back {got:016x}: the line changes bytes")


@case(
    "HG-2.7/2",
    "stream frames of rx_window bytes, sent without a pause, are all counted",
    evidence=SELF_REPORTED,
)
def takes_a_full_window(bench: Bench) -> None:
    first = bench.stream_wire(bench.flat_phases())
    count = max(1, bench.identity.rx_window // len(first))
    frames = [first, *(bench.stream_wire(bench.flat_phases()) for _ in range(count - 1))]
    with bench.counting(dropped_state=count, frames=count):
        bench.send(*frames)
        bench.wire.idle(bench.wire.line_us(sum(map(len, frames))))


@case(
    "HG-2.7/3",
    "for 0.3 s after a reset the board sends no frame; boot text is tolerated",
    needs_reset=True,
)
def is_silent_before_hello(bench: Bench) -> None:
    bench.wire.idle(_LISTEN_US)
    frames = [piece for piece in bench.wire.received if piece.header is not None]
    check(not frames, f"before the first HELLO: {describe(frames[0].piece) if frames else ''}")


@case(
    "HG-9.4/1",
    "stream frames of free_bytes bytes, sent without a pause, are all counted",
    evidence=SELF_REPORTED,
)
def free_bytes_are_free(bench: Bench) -> None:
    frames = bench.stream_wire(bench.flat_phases())
    count = max(1, bench.status().free_bytes // len(frames))
    with bench.counting(dropped_state=count):
        bench.send(frames, *(bench.stream_wire(bench.flat_phases()) for _ in range(count - 1)))
        bench.wire.idle(bench.wire.line_us(count * len(frames)))


@case(
    "HG-3.9/3",
    "junk of every kind neither restarts the board nor moves a counter back nor disarms it",
    evidence=SELF_REPORTED,
)
def survives_junk(bench: Bench) -> None:
    boot_id, before = bench.identity.boot_id, bench.status()
    bench.arm()
    for _ in range(40):
        size = bench.random.randrange(1, 600)
        bench.send(b"\x00", bench.random.randbytes(size), b"\x00")
        bench.wire.idle(bench.wire.line_us(size))
    after = bench.status()
    check(after.state.name == "ARMED", f"junk has moved the board to {after.state.name}")
    check(after.counters.frames > before.counters.frames, "the counters began anew: a restart")
    check(bench.hello().boot_id == boot_id, "boot_id is another one: junk restarts the board")


@case(
    "HG-3.9/4",
    "2 MiB of junk (what the line carries in 20 s, if less): PINGs answered, free_bytes as before",
)
def does_not_leak(bench: Bench) -> None:
    before = bench.status()
    left = min(_JUNK_BYTES, bench.wire.baudrate // 10 * _JUNK_S)
    while left > 0:
        block = b"".join(_junk(bench) for _ in range(_JUNK_PIECES))
        bench.send(block)
        bench.wire.idle(bench.wire.line_us(len(block)))
        bench.call(Ping(left), Pong)
        left -= len(block)
    after = bench.status()
    check(
        after.free_bytes == before.free_bytes,
        f"free_bytes was {before.free_bytes}, after junk {after.free_bytes}: it leaks",
    )


def _junk(bench: Bench) -> bytes:
    """Return what a receiver has to drop, one of every kind: short, no COBS, wrong CRC, endless."""
    body = bench.body(Ping.TYPE, bench.random.randbytes(8), seq=0)
    wrong = crafting.framed(crafting.with_wrong_crc(body, 1 << bench.random.randrange(32)))
    noise = bench.random.randbytes(_NOISE).replace(b"\x00", b"\x01")
    return b"".join(
        (crafting.framed(noise[:5]), b"\xf0" + noise[:20] + b"\x00", wrong, noise + b"\x00")
    )
