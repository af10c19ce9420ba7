"""Chapter 5, stream frames: formats, packing, numbers."""

from __future__ import annotations

from typing import Final

from haptogram_protocol.messages import (
    MAX_TRANSDUCERS,
    PHASE_FORMAT_BIT,
    Drives,
    Feature,
    PhaseFormat,
    Phases,
    pack_phases,
    packed_size,
)

from ..case import case, unobservable
from ..client.board_client import Bench
from ..client.latching import latch_now
from ..judge.witness import Witness
from ..outcome import EXTERNAL, SELF_REPORTED, check, not_observed

_UNKNOWN_BITS: Final = (0, 1, 4, 7, 9, 16, 255)

amplitude_is_linear = unobservable(
    "HG-5.3/2", "the pressure itself: only a microphone shows it", EXTERNAL
)


def _offered(bench: Bench) -> list[PhaseFormat]:
    return [form for form, bit in PHASE_FORMAT_BIT.items() if bench.identity.phase_formats & bit]


@case("HG-5.1/1", "N is 1 to 1024")
def count_is_in_range(bench: Bench) -> None:
    count = bench.identity.transducers
    check(1 <= count <= MAX_TRANSDUCERS, f"N is {count}")


@case(
    "HG-5.2/1",
    "random codes in every format come into the registers as they were packed",
    evidence=SELF_REPORTED,
)
def unpacks_phases(bench: Bench) -> None:
    witness = Witness.of(bench)
    bench.arm()
    for form in _offered(bench):
        for _ in range(3):
            codes = bytes(
                bench.random.randrange(1 << form) for _ in range(bench.identity.transducers)
            )
            since = bench.mark()
            latch_now(bench, Phases(form, 0, pack_phases(codes, form)))
            registers = bytes(code << (8 - form) for code in codes)
            witness.expect(registers, bits=form, since=since)


@case(
    "HG-5.2/2",
    "a PHASES frame with a spare bit set is counted in bad_value",
    evidence=SELF_REPORTED,
)
def refuses_spare_bits(bench: Bench) -> None:
    count = bench.identity.transducers
    spare = [form for form in _offered(bench) if count * form % 8]
    if not spare:
        not_observed(f"{count} phases leave no spare bit in the formats of this board")
    bench.arm()
    with bench.counting(bad_value=2 * len(spare), latched=0):
        for form in spare:
            for bit in (7, count * form % 8):
                data = bytearray(packed_size(count, form))
                data[-1] |= 1 << bit
                bench.send(bench.stream_wire(Phases(form, 0, bytes(data))))
        bench.rest()


@case(
    "HG-5.2/3",
    "PHASES with a byte less or more than ceil(N b / 8) are counted in bad_length",
    evidence=SELF_REPORTED,
)
def phases_have_their_length(bench: Bench) -> None:
    bench.arm()
    offered = _offered(bench)
    with bench.counting(bad_length=2 * len(offered), latched=len(offered)):
        for form in offered:
            size = packed_size(bench.identity.transducers, form)
            for wrong in (size - 1, size + 1):
                bench.send(bench.stream_wire(Phases(form, 0, bytes(wrong))))
            latch_now(bench, Phases(form, 0, bytes(size)))


@case("HG-5.2/4", "banks other than 0 are counted in bad_value", evidence=SELF_REPORTED)
def bank_is_0(bench: Bench) -> None:
    payload = bench.flat_phases().serialize()
    bench.arm()
    with bench.counting(bad_value=3, latched=0):
        for bank in (1, 2, 255):
            bench.send(bench.stream_raw(Phases.TYPE, bytes([payload[0], bank]) + payload[2:]))
        bench.rest()


@case(
    "HG-5.2/5",
    "each format advertised is latched, each other one is counted in bad_value",
    evidence=SELF_REPORTED,
)
def takes_its_formats(bench: Bench) -> None:
    count, offered = bench.identity.transducers, _offered(bench)
    others = [*_UNKNOWN_BITS, *(form for form in PhaseFormat if form not in offered)]
    bench.arm()
    with bench.counting(bad_value=len(others), latched=len(offered)):
        for bits in others:
            payload = bytes([bits, 0]) + bytes(packed_size(count, bits))
            bench.send(bench.stream_raw(Phases.TYPE, payload[: 2 + 2048]))
        for form in offered:
            latch_now(bench, Phases(form, 0, bytes(packed_size(count, form))))


@case(
    "HG-5.2/6",
    "after DRIVES of amplitude 10, PHASES has amplitude 255 again",
    evidence=SELF_REPORTED,
)
def phases_are_full(bench: Bench) -> None:
    witness = Witness.of(bench)
    bench.arm()
    registers = bench.random_registers()
    if bench.has(Feature.AMPLITUDE):
        latch_now(bench, Drives(PhaseFormat.BITS_8, 0, registers + b"\x0a" * len(registers)))
    since = bench.mark()
    latch_now(bench, bench.phases(registers))
    witness.expect(registers, bits=bench.finest, since=since)


@case(
    "HG-5.2/7",
    "every code of 6 bits is latched as 4 c, every one of 5 bits as 8 c",
    evidence=SELF_REPORTED,
)
def widens_codes(bench: Bench) -> None:
    witness = Witness.of(bench)
    coarse = [form for form in _offered(bench) if form < PhaseFormat.BITS_8]
    if not coarse:
        not_observed("the board takes 8 bits only")
    bench.arm()
    count = bench.identity.transducers
    for form in coarse:
        for first in range(0, 1 << form, count):
            codes = bytes((first + number) % (1 << form) for number in range(count))
            since = bench.mark()
            latch_now(bench, Phases(form, 0, pack_phases(codes, form)))
            registers = bytes(code << (8 - form) for code in codes)
            witness.expect(registers, bits=form, since=since)


@case(
    "HG-5.3/1",
    "DRIVES are latched with phase and amplitude; other bits and lengths are counted",
    needs=Feature.AMPLITUDE,
    evidence=SELF_REPORTED,
)
def takes_drives(bench: Bench) -> None:
    witness = Witness.of(bench)
    count = bench.identity.transducers
    bench.arm()
    phases, amplitudes = bench.random.randbytes(count), bench.random.randbytes(count)
    since = bench.mark()
    with bench.counting(latched=1, bad_value=3, bad_length=2):
        latch_now(bench, Drives(PhaseFormat.BITS_8, 0, phases + amplitudes))
        for head in (b"\x06\x00", b"\x05\x00", b"\x08\x01"):
            bench.send(bench.stream_raw(Drives.TYPE, head + bytes(2 * count)))
        for size in (2 * count - 2, 2 * count + 2):
            bench.send(bench.stream_raw(Drives.TYPE, b"\x08\x00" + bytes(size)))
    witness.expect(phases, amplitudes, since=since)


@case(
    "HG-5.5/1",
    "frames 1 to 32767 behind the newest are counted in duplicate and not latched",
    evidence=SELF_REPORTED,
)
def drops_duplicates(bench: Bench) -> None:
    bench.arm()
    for _ in range(20):
        latch_now(bench, bench.flat_phases())
    behind = (1, 2, 17, 255, 256, 257, 5000, 32_768)
    with bench.counting(duplicate=len(behind), latched=1):
        for back in behind:
            bench.send(bench.stream_wire(bench.flat_phases(), seq=bench.stream_next - back))
        bench.rest()
        latch_now(bench, bench.flat_phases())


@case("HG-5.5/2", "frames ahead by 1 to 32767 add to gap and are latched", evidence=SELF_REPORTED)
def counts_gaps(bench: Bench) -> None:
    bench.arm()
    for ahead in (1, 15, 16, 255, 256, 300, 32_767):
        bench.stream_next += ahead
        with bench.counting(gap=ahead, latched=1):
            latch_now(bench, bench.flat_phases())


@case(
    "HG-5.6/1",
    "frames dropped for type, flags, length, value, state and time have used up their numbers",
    evidence=SELF_REPORTED,
)
def numbers_are_used_up(bench: Bench) -> None:
    good = bench.flat_phases()
    payload = good.serialize()
    bench.send(bench.stream_wire(good))  # not armed: dropped_state
    bench.arm()
    past_us = bench.device_us() - 1_000_000
    beyond_us = bench.device_us() + bench.identity.max_horizon_us + 10_000_000
    dropped = {
        "unknown_type": bench.stream_raw(0x3B, b""),
        "unsupported": bench.stream_wire(good, flags=0x40),
        "bad_length": bench.stream_raw(Phases.TYPE, payload + b"\x00"),
        "bad_value": bench.stream_raw(Phases.TYPE, bytes([payload[0], 9]) + payload[2:]),
        "dropped_late": bench.stream_wire(good, past_us),
        "dropped_future": bench.stream_wire(good, beyond_us),
    }
    with bench.counting(latched=1, **dict.fromkeys(dropped, 1)):
        bench.send(*dropped.values())
        latch_now(bench, good)
    used = range(bench.stream_next - 1 - len(dropped), bench.stream_next)
    with bench.counting(duplicate=len(used)):
        for seq in used:
            bench.send(bench.stream_wire(good, seq=seq))
