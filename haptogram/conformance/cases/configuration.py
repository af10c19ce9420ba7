"""Chapter 7, configuration, geometry, correction and ceiling."""

from __future__ import annotations

import dataclasses
import zlib
from typing import Any, Final

from haptogram_protocol.messages import (
    Config,
    ConfigReply,
    DriveKind,
    ErrorCode,
    Feature,
    GeometryReply,
    GetConfig,
    GetGeometry,
    SetConfig,
    StateChanged,
    Status,
    TraceMode,
    UploadKind,
)

from ..case import case
from ..client.board_client import Bench
from ..client.latching import latch_now, radiated, read_back
from ..judge.witness import expect_shown
from ..outcome import SELF_REPORTED, check, informational, not_observed

_MS: Final = 1000
_TOO_FAR: Final = (
    ("hold_ms", 0),
    ("hold_ms", 10_001),
    ("ramp_ms", 2001),
    ("host_timeout_ms", 19),
    ("host_timeout_ms", 10_001),
    ("status_period_ms", 9),
    ("late_window_us", 100_001),
    ("sound_speed_mm_s", 299_999),
    ("sound_speed_mm_s", 380_001),
    ("trace_divider", 0),
)
_JUST_RIGHT: Final[tuple[dict[str, Any], ...]] = (
    {"hold_ms": 1, "host_timeout_ms": 20, "sound_speed_mm_s": 300_000, "late_window_us": 0},
    {"hold_ms": 10_000, "ramp_ms": 2000, "host_timeout_ms": 10_000, "late_window_us": 100_000},
    {"sound_speed_mm_s": 380_000, "trace_divider": 0xFFFF, "status_period_ms": 65_535},
)
_MODES: Final = {
    TraceMode.CRC: Feature.TRACE,
    TraceMode.DRIVE: Feature.TRACE_DRIVE,
    TraceMode.RING: Feature.TRACE_RING,
}
_STATUS_BYTES: Final = 143
_ELEMENTS: Final = 18


def _in_force(bench: Bench) -> Config:
    return bench.call(GetConfig(), ConfigReply).config


@case(
    "HG-7.1/1",
    "values one beyond a bound are refused by their offset and change nothing; bounds are taken",
    needs=Feature.CONFIG,
)
def keeps_its_bounds(bench: Bench) -> None:
    before = _in_force(bench)
    for name, value in _TOO_FAR:
        changes: dict[str, Any] = {"hold_ms": 777, name: value}
        wrong = dataclasses.replace(bench.base_config, **changes)
        offset = Config.WIRE[name].offset
        bench.refused(SetConfig(wrong), ErrorCode.BAD_VALUE, offset)
        check(_in_force(bench) == before, f"{name} = {value} is refused, but has changed something")
    for values in _JUST_RIGHT:
        bench.configure(**values)


@case(
    "HG-7.1/2",
    "a status_period_ms at which STATUS takes more than a tenth of the line is refused",
    needs=Feature.CONFIG,
)
def spares_the_line(bench: Bench) -> None:
    least_ms = _STATUS_BYTES * 10 * 10 * 1000 // bench.wire.baudrate
    if least_ms <= 10:
        not_observed("on a line this fast STATUS every 10 ms takes less than a tenth")
    if bench.wire.limits.slack_us:
        informational("whether this port is a line of that rate is not known here")
    period_ms = max(10, least_ms * 9 // 10)
    wrong = dataclasses.replace(bench.base_config, status_period_ms=period_ms)
    offset = Config.WIRE["status_period_ms"].offset
    bench.refused(SetConfig(wrong), ErrorCode.BAD_VALUE, offset)


@case(
    "HG-7.1/3",
    "a hold, a STATUS period and a late window are in force for the frame behind SET_CONFIG",
    needs=Feature.CONFIG,
    evidence=SELF_REPORTED,
)
def is_in_force_at_once(bench: Bench) -> None:
    bench.arm()
    period_ms = bench.quick_status_ms
    wanted = dataclasses.replace(
        bench.base_config, late_window_us=100_000, status_period_ms=period_ms
    )
    late_us = bench.device_us() - 1000
    with bench.counting(late=1, latched=1):
        order, seq = bench.request_wire(SetConfig(wanted))
        since = bench.mark()
        bench.send(order, bench.stream_wire(bench.flat_phases(), late_us))
        bench.answer_to(SetConfig.TYPE, seq, since)
        bench.rest(400)
    bench.config = wanted
    check(_in_force(bench) == wanted, "GET_CONFIG shows another configuration than was set")
    found = bench.await_event(Status, since, 3 * period_ms * _MS + bench.wire.limits.slack_us)
    check(found is not None, f"status_period_ms = {period_ms} is not in force")


@case(
    "HG-7.1/3",
    "a ramp that has begun goes on as it began",
    variant="ramp",
    needs=Feature.CONFIG | Feature.AMPLITUDE,
)
def a_ramp_goes_on(bench: Bench) -> None:
    bench.configure(hold_ms=50, ramp_ms=400)
    bench.arm()
    since = bench.mark()
    latch_now(bench, bench.flat_phases())
    start_us = bench.unwrap(bench.status().last_latch_us)
    bench.wire.idle(150 * _MS)
    bench.configure(hold_ms=5000, ramp_ms=0)
    found = bench.await_event(StateChanged, since, 600 * _MS + bench.wire.limits.slack_us)
    took_ms = (bench.unwrap(found[0].time_us) - start_us) / _MS if found else float("inf")
    check(abs(took_ms - 450) <= 1.0, f"a ramp of 50 + 400 ms ended after {took_ms:.1f} ms")


@case(
    "HG-7.1/4",
    "what was set before a reset is gone, unless CONFIG_KEPT is advertised",
    needs_reset=True,
)
def starts_with_its_default(bench: Bench) -> None:
    bench.hello()
    bench.need(Feature.CONFIG)
    found, set_before = _in_force(bench), bench.last_config
    if set_before is None:
        not_observed("nothing was set before the reset")
    kept = found == set_before
    if bench.has(Feature.CONFIG_KEPT):
        check(kept, f"CONFIG_KEPT is advertised; before the reset {set_before}, now {found}")
    else:
        check(not kept, f"{found} has survived a reset, but CONFIG_KEPT is not advertised")


@case("HG-7.1/5", "config_crc is that of the 20 bytes in force and N bytes of the correction")
def config_crc_is_right(bench: Bench) -> None:
    none = bytes(bench.identity.transducers)
    corrections = [none]
    if bench.has(Feature.CORRECTION):
        corrections.append(bench.random.randbytes(len(none)))
    for correction in corrections:
        if bench.has(Feature.CORRECTION):
            bench.upload(UploadKind.CORRECTION, 0, correction)
        reply = bench.call(GetConfig(), ConfigReply)
        due = zlib.crc32(reply.config.pack() + correction)
        places = {
            "CONFIG_REPLY": reply.config_crc,
            "STATUS_REPLY": bench.status().config_crc,
            "HELLO_REPLY": bench.hello().config_crc,
        }
        for name, got in places.items():
            check(got == due, f"config_crc in {name} is {got:#010x}, due is {due:#010x}")


@case(
    "HG-7.1/6",
    "trace modes that are not advertised, those of no version included, are refused",
    needs=Feature.CONFIG,
)
def refuses_other_traces(bench: Bench) -> None:
    lacking = [int(mode) for mode, feature in _MODES.items() if not bench.has(feature)]
    offset = Config.WIRE["trace_mode"].offset
    for mode in (*lacking, max(TraceMode) + 1, 0xFF):
        payload = bytearray(SetConfig(bench.base_config).serialize())
        payload[offset] = mode
        bench.refused_raw(SetConfig.TYPE, bytes(payload), ErrorCode.BAD_VALUE, offset)
    config = bench.call(GetConfig(), ConfigReply).config
    check(config == bench.base_config, f"a refused SET_CONFIG has led to {config}")


@case("HG-7.5/1", "GET_GEOMETRY of 1, of some and of too many transducers shows those from first")
def shows_its_geometry(bench: Bench) -> None:
    count = bench.identity.transducers
    room = (4075 - 14) // _ELEMENTS
    whole = bench.call(GetGeometry(0, 0xFFFF), GeometryReply)
    for first in {0, 1, count // 2, count - 1} & set(range(count)):
        for asked in (0, 1, 5, 0xFFFF):
            reply = bench.call(GetGeometry(first, asked), GeometryReply)
            got = (reply.total, reply.first, len(reply.elements))
            due = (count, first, min(asked, count - first, room))
            check(got == due, f"{asked} from {first}: (total, first, count) is {got}, due {due}")
            known = whole.elements[first : first + asked]
            check(
                reply.elements[: len(known)] == known,
                f"transducer {first} and on are others than in a reply from 0 on",
            )


@case("HG-7.5/2", "GET_GEOMETRY from N on is refused with NOT_FOUND, detail N")
def has_no_more_transducers(bench: Bench) -> None:
    count = bench.identity.transducers
    for first in (count, count + 1, 0xFFFF):
        bench.refused(GetGeometry(first, 1), ErrorCode.NOT_FOUND, count)


@case(
    "HG-7.9/1",
    "a correction is added to what is radiated, modulo 256; the latched drive stays",
    needs=Feature.CORRECTION | Feature.READ_RADIATED | Feature.READ_LATCHED,
    evidence=SELF_REPORTED,
)
def adds_the_correction(bench: Bench) -> None:
    count = bench.identity.transducers
    correction = bench.random.randbytes(count)
    bench.upload(UploadKind.CORRECTION, 0, correction)
    registers = bench.random_registers()
    bench.arm()
    latch_now(bench, bench.phases(registers))
    full = b"\xff" * count
    expect_shown(bench, read_back(bench), registers, full)
    shown = radiated(bench)
    due = bytes((a + b) % 256 for a, b in zip(registers, correction, strict=True))
    wrong = sum(a != b for a, b in zip(shown.phases, due, strict=True))
    check(wrong == 0, f"{wrong} of {count} radiated phases are not latched + correction")
    bench.upload(UploadKind.CORRECTION, 0, bytes(count))
    shown = radiated(bench)
    check(shown.phases == registers, "a correction of 0 is not in force after its commit")


@case(
    "HG-7.9/2",
    "with a ceiling of 100 no radiated amplitude is above 100; the latched drive stays",
    needs=Feature.CONFIG | Feature.AMPLITUDE | Feature.READ_RADIATED | Feature.READ_LATCHED,
    evidence=SELF_REPORTED,
)
def keeps_under_the_ceiling(bench: Bench) -> None:
    bench.arm()
    for ceiling in (100, 1, 255):
        bench.configure(amplitude_ceiling=ceiling)
        latch_now(bench, bench.flat_phases())
        loudest = read_back(bench, DriveKind.RADIATED).loudest
        check(loudest <= ceiling, f"ceiling {ceiling}: amplitude {loudest} is radiated")
        check(loudest > 0, f"ceiling {ceiling}: nothing is radiated")
        check(read_back(bench).loudest == 255, f"ceiling {ceiling} changes the latched drive")
