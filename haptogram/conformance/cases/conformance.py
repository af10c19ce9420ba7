"""Chapter 1: capabilities are what the board can do, and all that it can do."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from haptogram_protocol.messages import (
    DriveKind,
    DriveReply,
    Drives,
    ErrorCode,
    Feature,
    FocalPoint,
    Message,
    PhaseFormat,
    Play,
    Points,
    ReadDrive,
    ReadTrace,
    SetConfig,
    SetConfigReply,
    Trace,
    TraceDrive,
    TraceMode,
    TraceReply,
    UploadBegin,
    UploadKind,
)

from ..case import case
from ..client.board_client import Bench
from ..client.latching import latch_now
from ..outcome import SELF_REPORTED, check, not_observed

_POINT: Final = FocalPoint(0, 0, 150_000, 65_535, 0)


def _drives(bench: Bench) -> Drives:
    return Drives(PhaseFormat.BITS_8, 0, bytes([255]) * 2 * bench.identity.transducers)


def _is_latched(bench: Bench, message: Message, name: str) -> None:
    bench.arm()
    with bench.counting(latched=1):
        latch_now(bench, message)
    check(bench.status().last_seq != 0, f"{name} is advertised, but nothing is latched")


def _tells(bench: Bench, mode: TraceMode, kind: type[Message], name: str) -> None:
    bench.configure(trace_mode=mode)
    bench.arm()
    since = bench.mark()
    latch_now(bench, bench.flat_phases())
    bench.barrier()
    check(bool(bench.events(kind, since)), f"{name} is advertised, but a latch gives no event")


def _stores(bench: Bench, kind: UploadKind, data: bytes, target: int, points: int) -> None:
    bench.upload(kind, target, data, points)


_USES: Final[dict[Feature, Callable[[Bench], object]]] = {
    Feature.AMPLITUDE: lambda b: _is_latched(b, _drives(b), "AMPLITUDE"),
    Feature.POINTS: lambda b: _is_latched(b, Points((_POINT,)), "POINTS"),
    Feature.SEQUENCE_PHASES: lambda b: _stores(
        b, UploadKind.PHASES, bytes(b.identity.transducers), 1, 0
    ),
    Feature.SEQUENCE_POINTS: lambda b: _stores(b, UploadKind.POINTS, _POINT.pack(), 2, 1),
    Feature.CONFIG: lambda b: b.call(SetConfig(b.base_config), SetConfigReply),
    Feature.CORRECTION: lambda b: _stores(
        b, UploadKind.CORRECTION, bytes(b.identity.transducers), 0, 0
    ),
    Feature.READ_LATCHED: lambda b: b.call(ReadDrive(DriveKind.LATCHED, 0, 1), DriveReply),
    Feature.READ_RADIATED: lambda b: b.call(ReadDrive(DriveKind.RADIATED, 0, 1), DriveReply),
    Feature.TRACE: lambda b: _tells(b, TraceMode.CRC, Trace, "TRACE"),
    Feature.TRACE_DRIVE: lambda b: _tells(b, TraceMode.DRIVE, TraceDrive, "TRACE_DRIVE"),
    Feature.TRACE_RING: lambda b: b.call(ReadTrace(0, 1), TraceReply),
}


@case("HG-1.2/1", "every capability that the board advertises is used once, and works")
def advertised_is_there(bench: Bench) -> None:
    for feature, use in _USES.items():
        if bench.has(feature):
            bench.hello()
            use(bench)


# What needs one of these capabilities: a request that is whole but for the capability.
_REQUESTS: Final[tuple[tuple[Feature, Callable[[Bench], Message]], ...]] = (
    (Feature.CONFIG, lambda b: SetConfig(b.config)),
    (Feature.READ_LATCHED, lambda _: ReadDrive(DriveKind.LATCHED, 0, 1)),
    (Feature.READ_RADIATED, lambda _: ReadDrive(DriveKind.RADIATED, 0, 1)),
    (Feature.TRACE_RING, lambda _: ReadTrace(0, 1)),
    (Feature.SEQUENCE_PHASES | Feature.SEQUENCE_POINTS, lambda _: Play(1, 1000, 1, 100)),
    (
        Feature.SEQUENCE_PHASES,
        lambda b: UploadBegin(UploadKind.PHASES, 0, 1, b.identity.transducers, 0),
    ),
    (Feature.SEQUENCE_POINTS, lambda _: UploadBegin(UploadKind.POINTS, 1, 1, 16, 0)),
    (
        Feature.CORRECTION,
        lambda b: UploadBegin(UploadKind.CORRECTION, 0, 0, b.identity.transducers, 0),
    ),
)


@case("HG-1.2/2", "a request of every capability that is not advertised is refused: UNSUPPORTED")
def refuses_what_it_lacks(bench: Bench) -> None:
    lacking = [make for any_of, make in _REQUESTS if not bench.identity.features & any_of]
    if not lacking:
        not_observed("the board advertises every capability that a request can need")
    for make in lacking:
        message = make(bench)
        bench.refused(message, ErrorCode.UNSUPPORTED, message.TYPE)


@case(
    "HG-1.2/3",
    "DRIVES and POINTS are dropped and counted in unsupported where they are not advertised",
    evidence=SELF_REPORTED,
)
def drops_what_it_lacks(bench: Bench) -> None:
    frames: dict[Feature, Message] = {
        Feature.AMPLITUDE: _drives(bench),
        Feature.POINTS: Points((_POINT,)),
    }
    lacking = [message for feature, message in frames.items() if not bench.has(feature)]
    if not lacking:
        not_observed("the board advertises every capability that a stream frame can need")
    bench.arm()
    with bench.counting(unsupported=len(lacking), latched=0):
        for message in lacking:
            bench.send(bench.stream_wire(message))
        bench.rest()
