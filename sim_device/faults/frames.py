"""Effects of the faults of frames and of reports.

A frame is taken apart on its way to the board, changed in one field and sealed with a CRC that is
right again: no receiver can tell it from one that a host built wrong.  Only frames that are whole
within a chunk are seen; a host writes whole frames unless the line is full.

Faults of reports change frames of the board on their way to the host in the same way: a board that
does the right thing and says something else.
"""

from __future__ import annotations

import dataclasses
import random
import zlib
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, Final, TypeAlias

from haptogram_protocol import framing, messages
from haptogram_protocol.cobs import cobs_encode
from haptogram_protocol.errors import ProtocolError
from haptogram_protocol.messages import STREAM_RANGE, Flag, Header
from haptogram_protocol.state import MuteReason, OutputState

from .line import LineFault, Values, fault_on_bytes

# A body in, what follows the first delimiter out (COBS and the last delimiter); None: unchanged.
Rewrite: TypeAlias = Callable[[bytes, Values, random.Random], bytes | None]
_Change: TypeAlias = Callable[[Header, Values], dict[str, int]]
_TIMES: Final = frozenset({"t_rx_us", "t_tx_us", "t_latch_us", "last_latch_us"})


def fault_on_frames(rewrite: Rewrite) -> LineFault:
    """Return a fault of chunks that applies *rewrite* to each frame, with probability ``p``."""

    def edit(data: bytearray, values: Values, source: random.Random) -> int:
        pieces, fired = bytes(data).split(framing.DELIMITER), 0
        for place in range(1, len(pieces) - 1):  # what has a delimiter on both sides
            if not pieces[place] or source.random() >= values["p"]:
                continue
            try:
                new = rewrite(framing.decode_frame(pieces[place]), values, source)
            except ProtocolError:  # damaged already, no message, or too long to be sent
                continue
            if new is not None:
                pieces[place], fired = new, fired + 1
        data[:] = framing.DELIMITER.join(pieces)
        return fired

    return fault_on_bytes(edit)


def sealed_by_fault(body: bytes) -> bytes:
    """Return the stuffed bytes of *body*, as they stand between the delimiters."""
    return framing.encode_frame(body)[1:-1]


def _crc_fault(body: bytes, _: Values, source: random.Random) -> bytes:
    """Return the frame with one bit of its CRC flipped."""
    wrong = zlib.crc32(body) ^ 1 << source.randrange(8 * framing.CRC_BYTES)
    return cobs_encode(body + wrong.to_bytes(framing.CRC_BYTES, "little"))


def _length_fault(body: bytes, values: Values, source: random.Random) -> bytes | None:
    """Return the frame with "bytes" bytes more (or fewer) and a right CRC; None if unchanged."""
    more = round(values["bytes"])
    if more < 0:
        cut = body[: max(framing.HEADER_BYTES, len(body) + more)]
        return sealed_by_fault(cut) if cut != body else None
    return sealed_by_fault(body + source.randbytes(more)) if more else None


def _header_fault(change: _Change) -> LineFault:
    """Return a fault that changes fields of a frame's header and seals it with a right CRC.

    *change* gives the new values of fields; a frame in which none differs stays as it is.
    """

    def rewrite(body: bytes, values: Values, _: random.Random) -> bytes | None:
        header, payload = Header.unpack(body[: framing.HEADER_BYTES]), body[framing.HEADER_BYTES :]
        fields = {name: getattr(header, name) for name in Header.WIRE}
        changed = Header(**{**fields, **change(header, values)})
        return None if changed == header else sealed_by_fault(changed.pack() + payload)

    return fault_on_frames(rewrite)


def _shifted_header_by_fault(by_us: float, header: Header) -> dict[str, int]:
    """Return {"time_us": time later by *by_us*} for a timed stream frame, {} for others."""
    timed = header.type in STREAM_RANGE and not header.flags & Flag.IMMEDIATE
    return {"time_us": (header.time_us + round(by_us)) & 0xFFFFFFFF} if timed else {}


FRAME_FAULTS: Final[Mapping[str, LineFault]] = MappingProxyType(
    {
        "frame.crc": fault_on_frames(_crc_fault),
        "frame.length": fault_on_frames(_length_fault),
        "frame.sequence": _header_fault(
            lambda header, values: {"seq": (header.seq + round(values["by"])) & 0xFFFF}
        ),
        "frame.session": _header_fault(
            lambda header, values: {"session": (header.session + round(values["by"])) & 0xFFFF}
        ),
        "frame.flags": _header_fault(
            lambda header, values: {"flags": header.flags | round(values["bits"])}
        ),
        "frame.type": _header_fault(lambda _, values: {"type": round(values["type"])}),
        "frame.past": _header_fault(
            lambda header, values: _shifted_header_by_fault(-values["us"], header)
        ),
        "frame.future": _header_fault(
            lambda header, values: _shifted_header_by_fault(values["us"], header)
        ),
    }
)


def _clock_report_fault(body: bytes, values: Values, source: random.Random) -> bytes | None:
    """Return a board's frame, its times shifted by "us" and up to "jitter_us"; None if by 0."""
    header, message = messages.parse_body(body)
    by_us = round(values["us"] + values["jitter_us"] * source.uniform(-1, 1))
    return _rebuilt_faulty_report(header, _told_later(message, by_us), by_us) if by_us else None


def _told_later(record: Any, by_us: int) -> Any:
    """Return a message record with every time in it, also in nested records, later by *by_us*."""
    values = {field.name: getattr(record, field.name) for field in dataclasses.fields(record)}
    times = {name: (values[name] + by_us) & 0xFFFFFFFF for name in _TIMES & values.keys()}
    inner = {
        name: tuple(_told_later(one, by_us) for one in value)
        for name, value in values.items()
        if isinstance(value, tuple)
    }
    return dataclasses.replace(record, **times, **inner)


def _status_report_fault(body: bytes, _: Values, __: random.Random) -> bytes | None:
    """Return a STATUS that lies: ARMED, no errors; None for other frames or if that is true.

    STATUS_REPLY lies, too; counters that always grow stay.
    """
    header, message = messages.parse_body(body)
    if not isinstance(message, messages.Status | messages.StatusReply):
        return None
    true = {name: getattr(message.counters, name) for name in messages.GROWING_COUNTERS}
    counters = messages.Counters(**{**dict.fromkeys(messages.Counters.WIRE, 0), **true})
    lie = dataclasses.replace(
        message, state=OutputState.ARMED, reason=MuteReason.NONE, counters=counters
    )
    return None if lie == message else _rebuilt_faulty_report(header, lie, 0)


def _rebuilt_faulty_report(header: messages.Header, message: messages.Message, by_us: int) -> bytes:
    """Return the frame of a changed message, its time later by *by_us*, with a right CRC."""
    return sealed_by_fault(
        messages.build_body(
            message,
            flags=header.flags,
            seq=header.seq,
            time_us=header.time_us + by_us,
            session=header.session,
        )
    )


REPORT_FAULTS: Final[Mapping[str, LineFault]] = MappingProxyType(
    {
        "device.clock": fault_on_frames(_clock_report_fault),
        "device.status": fault_on_frames(_status_report_fault),
    }
)
