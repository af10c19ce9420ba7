"""Boards that do the right thing and say something else: faults of their clock and status reports.

Frames of the board are changed on their way to the host, and sealed with a CRC that is right.
"""

from __future__ import annotations

import dataclasses
import random
from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from haptogram_protocol import messages
from haptogram_protocol.state import MuteReason, OutputState

from .frames import fault_on_frames, sealed_by_fault
from .line import LineFault, Values

_TRUE_COUNTERS: Final = ("frames", "latched", "requests")  # those that rise when all is well


def _clock_report_fault(body: bytes, values: Values, source: random.Random) -> bytes | None:
    header, message = messages.parse_body(body)
    by_us = round(values["us"] + values["jitter_us"] * source.uniform(-1, 1))
    if isinstance(message, messages.Pong):
        times = {name: (getattr(message, name) + by_us) & 0xFFFFFFFF for name in _PONG_TIMES}
        message = dataclasses.replace(message, **times)
    return _rebuilt_faulty_report(header, message, by_us) if by_us else None


def _status_report_fault(body: bytes, _: Values, __: random.Random) -> bytes | None:
    header, message = messages.parse_body(body)
    if not isinstance(message, messages.Status | messages.StatusReply):
        return None
    true = {name: getattr(message.counters, name) for name in _TRUE_COUNTERS}
    counters = messages.Counters(**{**dict.fromkeys(messages.Counters.WIRE, 0), **true})
    lie = dataclasses.replace(
        message, state=OutputState.ARMED, reason=MuteReason.NONE, counters=counters
    )
    return None if lie == message else _rebuilt_faulty_report(header, lie, 0)


def _rebuilt_faulty_report(header: messages.Header, message: messages.Message, by_us: int) -> bytes:
    return sealed_by_fault(
        messages.build_body(
            message,
            flags=header.flags,
            seq=header.seq,
            time_us=header.time_us + by_us,
            session=header.session,
        )
    )


_PONG_TIMES: Final = ("t_rx_us", "t_tx_us")

REPORT_FAULTS: Final[Mapping[str, LineFault]] = MappingProxyType(
    {
        "device.clock": fault_on_frames(_clock_report_fault),
        "device.status": fault_on_frames(_status_report_fault),
    }
)
