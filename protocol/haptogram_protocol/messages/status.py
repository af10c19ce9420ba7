"""Counters and arrival margin.  SPEC.md chapter 9."""

from __future__ import annotations

from typing import Final

from ..record import Record, nested, record, wire
from ..state import MuteReason, OutputState
from .header import Message


@record
class Counters(Record):
    """Counters of the board since it started, each modulo 2^32.  HG-9.2."""

    frames: int = wire("I", "frames with a valid CRC")
    accepted: int = wire("I", "stream frames taken into the queue")
    latched: int = wire("I", "drives latched, from stream and playback")
    late: int = wire("I", "of these, latched late, within the late window")
    dropped_late: int = wire("I", "stream frames that came too late for their t_apply")
    dropped_future: int = wire("I", "stream frames beyond the horizon")
    dropped_order: int = wire("I", "stream frames whose t_apply is not after the last queued one")
    dropped_full: int = wire("I", "stream frames that met a full queue")
    dropped_state: int = wire("I", "stream frames while not armed, or while a sequence plays")
    flushed: int = wire(
        "I", "queued frames discarded, or replaced by a later one on the same carrier period"
    )
    duplicate: int = wire("I", "stream frames numbered up to 32 before the one expected")
    gap: int = wire("I", "stream sequence numbers that never came")
    stale_session: int = wire("I", "stream frames of another session")
    crc: int = wire("I", "frames whose CRC is wrong")
    cobs: int = wire("I", "frames that are not COBS")
    short: int = wire("I", "frames shorter than header and CRC")
    oversize: int = wire("I", "runs of bytes longer than any frame")
    bad_length: int = wire("I", "stream frames whose payload has a wrong length")
    bad_value: int = wire("I", "stream frames with a value outside its range")
    unknown_type: int = wire(
        "I", "frames of a type that no request has and the board does not take"
    )
    unsupported: int = wire("I", "stream frames with must-understand flags that are not known")
    requests: int = wire("I", "requests, carried out or refused, whatever refused them")
    repeated: int = wire("I", "requests, HELLO among them, answered again from memory")
    trace_dropped: int = wire("I", "trace events that found no room on the line")
    timeouts: int = wire("I", "mutes by a timer")


#: Counters that grow while nothing is wrong.
GROWING_COUNTERS: Final = frozenset({"frames", "accepted", "requests", "latched"})


@record
class _StatusBody(Message):
    state: OutputState = wire("B", "output state", enum=OutputState)
    reason: MuteReason = wire("B", "why the output is off", enum=MuteReason)
    queued: int = wire("H", "frames that wait for their t_apply")
    free_bytes: int = wire("I", "encoded bytes that the board can take now")
    last_seq: int = wire("I", "unwrapped sequence number of the last latched stream frame")
    last_latch_us: int = wire("I", "device time of the last latch")
    margins: int = wire("H", "stream frames that the two margins speak of; then they start anew")
    margin_min_us: int = wire("i", "least margin, t_apply - ready, since the last status")
    margin_mean_us: int = wire("i", "mean margin, t_apply - ready, since the last status")
    config_crc: int = wire("I", "CRC-32 of configuration and phase correction")
    counters: Counters = nested(Counters, "counters")


@record
class Status(_StatusBody):
    """Counters and arrival margin, sent by itself every ``status_period_ms``.  HG-9.1."""


@record
class GetStatus(Message):
    """Ask for the status."""


@record
class StatusReply(_StatusBody):
    """Answer to GET_STATUS."""
