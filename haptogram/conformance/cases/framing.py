"""Chapter 2, framing: what a receiver accepts, drops and counts, and what a sender sends."""

from __future__ import annotations

from typing import Final

from haptogram_protocol.framing import HEADER_BYTES, MAX_ENCODED_BYTES, cobs_encode, encode_frame
from haptogram_protocol.messages import Arm, Error, Feature, HelloReply, Ping, StateChanged

from ..case import case
from ..client import malformed_frames as crafting
from ..client.board_client import Bench
from ..client.dialogue import talk, unstuffed_crc
from ..client.recording import describe
from ..client.wire import Received
from ..outcome import SELF_REPORTED, check, fail, inconclusive

_RUNS: Final = (252, 253, 254, 255, 256, 507, 508, 509, 762)


@case("HG-2.1/1", "in a whole conversation no two frames share a delimiter")
def sends_both_delimiters(bench: Bench) -> None:
    pieces = talk(bench)
    shared = [describe(piece.piece) for piece in pieces if piece.shared]
    check(not shared, f"{len(shared)} frames share a zero with the one before: {shared[:1]}")


@case("HG-2.1/2", "a stream frame and a PING that share a zero are both taken")
def accepts_a_shared_delimiter(bench: Bench) -> None:
    frames = [bench.stream_wire(bench.flat_phases()) for _ in range(3)]
    with bench.counting(dropped_state=3, requests=1):
        ping, seq = bench.request_wire(Ping(1))
        since = bench.mark()
        bench.send(*(frame[:-1] for frame in frames), ping)
        bench.answer_to(Ping.TYPE, seq, since)


@case("HG-2.1/3", "a PING is answered right behind noise, halves of frames and runs too long")
def accepts_whatever_came_before(bench: Bench) -> None:
    half = encode_frame(bench.body(Ping.TYPE, bytes(8), seq=0x4444))[:-6]
    junk = [crafting.noise(bench.random, size) for size in (1, 3, 17, 300, 4095, 5000)]
    for before in [b"\xff", b"\x01", half, b"boot: ok\r\n", *junk]:
        ping, seq = bench.request_wire(Ping(len(before)))
        since = bench.mark()
        bench.send(before, ping)  # without a pause: a board that waits for one loses the PING
        if bench.try_answer(seq, since, bench.wire.line_us(len(before))) is None:
            fail(f"a PING right behind {len(before)} bytes ({before[:8].hex(' ')} ...) is lost")


@case("HG-2.2/1", "every frame in a whole conversation is the COBS encoding of what it holds")
def sends_cobs(bench: Bench) -> None:
    pieces = talk(bench)
    broken = [piece for piece in pieces if not piece.unstuffed]
    check(not broken, f"no COBS: {broken[0].piece[:16].hex(' ') if broken else ''} ...")
    odd = [p for p in pieces if p.piece != cobs_encode(p.unstuffed)]
    check(not odd, f"stuffed in another way: {describe(odd[0].piece) if odd else ''}")


@case(
    "HG-2.2/1",
    "frames that end with 252 to 762 bytes without a zero are read, each as it was sent",
    variant="runs",
)
def reads_long_runs(bench: Bench) -> None:
    for run in _RUNS:
        data, seq = crafting.mute_with_run(bench, run)
        since = bench.mark()
        bench.send(crafting.framed(data))
        if bench.try_answer(seq, since) is None:
            fail(f"a frame that ends with {run} bytes without a zero is not read")


@case(
    "HG-2.2/2",
    "a code byte that points past the end is counted in cobs, once; the frame has no effect",
    evidence=SELF_REPORTED,
)
def drops_what_is_no_cobs(bench: Bench) -> None:
    good = cobs_encode(crafting.with_crc(bench.body(Ping.TYPE, bytes(8), seq=bench.next_seq())))
    broken = [b"\x05\x01\x02", b"\xff" + b"\x07" * 40, good[:-1], good + b"\x02", b"\x02"]
    with bench.counting(cobs=len(broken)):
        bench.unanswered("what is no COBS", *(b"\x00" + piece + b"\x00" for piece in broken))


@case("HG-2.2/3", "a frame that ends with a full piece and a code byte 01 is read")
def accepts_a_spare_code_byte(bench: Bench) -> None:
    for run in (crafting.BLOCK, 2 * crafting.BLOCK):
        data, seq = crafting.mute_with_run(bench, run)
        encoded = cobs_encode(data)
        since = bench.mark()
        bench.send(b"\x00", encoded, b"\x01", b"\x00")
        if bench.try_answer(seq, since) is None:
            fail(f"a code byte 01 behind a full piece ({run} bytes without a zero) is refused")


@case(
    "HG-2.3/1",
    "100 zeros in a row move no counter, and the next request is answered",
    evidence=SELF_REPORTED,
)
def ignores_empty_frames(bench: Bench) -> None:
    with bench.counting(frames=0, requests=0):
        bench.send(b"\x00" * 100)


@case(
    "HG-2.4/1",
    "HELLO with a CRC-32 is answered by a frame with a CRC-32; another checksum is named",
    needs_session=False,
)
def has_crc32(bench: Bench) -> None:
    bench.session = 0
    for _ in range(3):
        reply = bench.greet()
        if isinstance(reply, HelloReply):
            _check_crc(bench)
            return
        if reply is not None:
            inconclusive(f"HELLO is answered by {reply}, with its CRC-32")
    wrong = [piece for piece in _greetings(bench, 0) if piece.reason == "crc"]
    check(not wrong, f"frames come, but none with its CRC-32: {wrong[0].fault if wrong else ''}")
    for name, data in crafting.other_checksums(_hello_body(bench)).items():
        since = bench.mark()
        bench.send(crafting.framed(data))
        bench.wire.wait_for(_is_greeting, since, bench.wire.limits.answer_us)
        answered = _greetings(bench, since)
        check(not answered, f"HELLO is answered if it ends with {name} instead of CRC-32")
    inconclusive("no HELLO is answered, with whatever checksum")


def _greetings(bench: Bench, since: int) -> list[Received]:
    """Return what may be an answer to HELLO, its checksum apart: no echo, no text."""
    return [piece for piece in bench.wire.received[since:] if _is_greeting(piece)]


def _is_greeting(piece: Received) -> bool:
    return piece.unstuffed[:1] in (bytes([HelloReply.TYPE]), bytes([Error.TYPE]))


def _hello_body(bench: Bench) -> bytes:
    hello = bench.hello_message(bench.new_nonce())
    return bench.body(hello.TYPE, hello.serialize(), seq=bench.next_seq(), session=0)


def _check_crc(bench: Bench) -> None:
    bench.settle()
    wrong = [piece for piece in talk(bench) if piece.reason in ("crc", "short")]
    check(not wrong, f"a frame without its CRC-32: {wrong[0].fault if wrong else ''}")


@case(
    "HG-2.4/2",
    "frames with a wrong CRC are counted in crc; they get no answer and use up no number",
    evidence=SELF_REPORTED,
)
def drops_a_wrong_crc(bench: Bench) -> None:
    flips = (1, 0x80000000, 0x00010000, 0xFFFFFFFF)
    body = bench.body(Ping.TYPE, bytes(8), seq=bench.next_seq())
    stream = bench.body(
        bench.flat_phases().TYPE, bench.flat_phases().serialize(), seq=bench.stream_next
    )
    others = [
        data for name, data in crafting.other_checksums(body).items() if name != "no checksum"
    ]
    frames = [crafting.with_wrong_crc(body, flip) for flip in flips] + others
    for bit in (0, 13, 77, 100):  # damage in the body instead
        damaged = bytearray(crafting.with_crc(body))
        damaged[bit // 8] ^= 1 << bit % 8
        frames.append(bytes(damaged))
    long = [frame for frame in [*frames, crafting.with_wrong_crc(stream)] if len(frame) >= 14]
    with bench.counting(crc=len(long), dropped_state=1):
        bench.unanswered("a frame with a wrong CRC", *map(crafting.framed, long))
        # Its number is still free: the next frame takes it, without a gap or a duplicate.
        bench.send(bench.stream_wire(bench.flat_phases()))


@case(
    "HG-2.4/2",
    "frames with a wrong CRC do not keep an ARMED board alive",
    variant="lease",
    needs=Feature.CONFIG,
)
def a_wrong_crc_renews_no_lease(bench: Bench) -> None:
    timeout_ms = 200
    bench.configure(host_timeout_ms=timeout_ms)
    body = bench.body(Ping.TYPE, bytes(8), seq=bench.next_seq())
    bench.arm()
    since = bench.mark()
    for _ in range(2 * timeout_ms // 40):
        bench.send(crafting.framed(crafting.with_wrong_crc(body)))
        bench.wire.idle(40_000)
    bench.wire.idle(bench.wire.limits.slack_us)
    check(bool(bench.events(StateChanged, since)), "damaged frames have renewed the lease")


@case(
    "HG-2.5/1",
    "1 to 13 bytes, some with a right CRC-32, are counted in short, once each",
    evidence=SELF_REPORTED,
)
def drops_short_frames(bench: Bench) -> None:
    pieces = [crafting.noise(bench.random, size) for size in range(1, 14)]
    pieces += [crafting.with_crc(bytes([Ping.TYPE] * size)) for size in range(10)]
    with bench.counting(short=len(pieces), frames=0):
        bench.send(*(crafting.framed(piece) for piece in pieces))


@case("HG-2.6/1", "no frame of a whole conversation is longer than 4096 bytes")
def sends_no_frame_too_long(bench: Bench) -> None:
    longest = max((len(piece.piece) for piece in talk(bench)), default=0)
    check(longest <= MAX_ENCODED_BYTES, f"{longest} bytes between two delimiters")


@case("HG-2.6/2", "frames of 4090 to 4096 bytes between their delimiters are read")
def reads_the_longest_frames(bench: Bench) -> None:
    for size in (2048, MAX_ENCODED_BYTES - 6, MAX_ENCODED_BYTES - 1, MAX_ENCODED_BYTES):
        encoded, seq = crafting.mute_of_encoded_size(bench, size)
        since = bench.mark()
        bench.send(b"\x00", encoded, b"\x00")
        if bench.try_answer(seq, since, bench.wire.line_us(size)) is None:
            fail(f"a frame of {size} bytes between its delimiters is not read")


@case(
    "HG-2.6/3",
    "runs of 4097 to 20000 bytes are counted in oversize, once; what they hold has no effect",
    evidence=SELF_REPORTED,
)
def discards_a_run_too_long(bench: Bench) -> None:
    inside = cobs_encode(crafting.with_crc(bench.body(Arm.TYPE, seq=0x7000)))
    runs = [crafting.noise(bench.random, size) for size in (4097, 5000, 8192, 20_000)]
    with bench.counting(oversize=len(runs) + 1):
        for run in [*runs, crafting.noise(bench.random, 4096) + inside]:
            ping, seq = bench.request_wire(Ping(len(run)))
            since = bench.mark()
            bench.send(b"\x00", run, b"\x00", ping)
            bench.answer_to(Ping.TYPE, seq, since, bench.wire.line_us(len(run)))
            extra = bench.responses(since)[:-1]
            check(not extra, f"what a run of {len(run)} bytes holds was answered")


@case("HG-3.1/1", "every frame of a whole conversation begins with a header of ten bytes")
def begins_with_a_header(bench: Bench) -> None:
    for piece in talk(bench):
        _, body = unstuffed_crc(piece)
        check(len(body) >= HEADER_BYTES, f"a frame without a header: {describe(piece.piece)}")
        check(body[0] >= 0x80, f"the board sends a frame of the host: {describe(piece.piece)}")
