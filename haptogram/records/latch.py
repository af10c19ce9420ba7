"""One latch in bytes: its join key, its times and its drives, in a layout of fixed fields."""

from __future__ import annotations

import base64
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Protocol, Self
from zlib import crc32

from haptogram.errors import ConfigurationError

if TYPE_CHECKING:
    from haptogram.acoustics.model.drive import Drive
    from haptogram_protocol.messages import LatchKey

LATCH_VERSION: Final = 1
_HEAD: Final = struct.Struct("<HHIIIqqBBBBH")
#: The layout in words, as the channel's metadata hold it.
LATCH_LAYOUT: Final = (
    "little-endian: session u16, sequence u16, loop u32, index u32, number u32, t_latch_us i64, "
    "t_received_us i64 (-1: out of a sequence), flags u8 (1 late, 2 ramping, 4 radiated differs), "
    "commanded_bits u8, phase_bits u8, radiated_bits u8, N u16, then N phase codes u8 and N "
    "amplitude codes u8 as latched, and the same as radiated if flag 4 is set"
)
_LATE, _RAMPING, _RADIATED = 1, 2, 4
_UNKNOWN: Final = -1


@dataclass(frozen=True, slots=True)
class Codes:
    """A drive: codes of the phases and of the amplitudes, one byte for each element."""

    phases: bytes
    amplitudes: bytes
    bits: int = 8

    @property
    def crc(self) -> int:
        """CRC-32 of the drive, as a TRACE event carries it."""
        return crc32(self.phases + self.amplitudes)


class LatchSeen(Protocol):
    """A latch as the virtual board tells it; see ``sim_device.board.events.Latch``."""

    @property
    def key(self) -> LatchKey: ...  # noqa: D102
    @property
    def session(self) -> int: ...  # noqa: D102
    @property
    def number(self) -> int: ...  # noqa: D102
    @property
    def t_latch_us(self) -> int: ...  # noqa: D102
    @property
    def t_received_us(self) -> int | None: ...  # noqa: D102
    @property
    def late(self) -> bool: ...  # noqa: D102
    @property
    def ramping(self) -> bool: ...  # noqa: D102
    @property
    def commanded_bits(self) -> int: ...  # noqa: D102
    @property
    def drive(self) -> Drive: ...  # noqa: D102
    @property
    def radiated(self) -> Drive: ...  # noqa: D102


@dataclass(frozen=True, slots=True)
class LatchRecord:
    """One latch of a board.

    Attributes
    ----------
    session, sequence, loop, index : int
        Join key.
    number : int
        Count of latches in the session, from 0.
    t_latch_us : int
        Device time, unwrapped, in microseconds.
    t_received_us : int or None
        Device time at which the frame was complete; None: it came out of a sequence.
    late, ramping : bool
        Whether it latched after its time, and whether a ramp to silence was under way.
    commanded_bits : int
        Bits per phase of the frame.
    latched : Codes
        Drive in the registers.
    radiated : Codes or None
        Drive that left the transducers; None: the latched one.
    """

    session: int
    sequence: int
    loop: int
    index: int
    number: int
    t_latch_us: int
    t_received_us: int | None
    late: bool
    ramping: bool
    commanded_bits: int
    latched: Codes
    radiated: Codes | None = None

    @property
    def key(self) -> tuple[int, int, int, int]:
        """Join key: session, sequence, loop, index."""
        return self.session, self.sequence, self.loop, self.index

    def pack(self) -> bytes:
        """Return the bytes of :data:`LATCH_LAYOUT`."""
        radiated = self.radiated
        flags = self.late * _LATE + self.ramping * _RAMPING + (radiated is not None) * _RADIATED
        head = _HEAD.pack(
            self.session,
            self.sequence,
            self.loop,
            self.index,
            self.number,
            self.t_latch_us,
            _UNKNOWN if self.t_received_us is None else self.t_received_us,
            flags,
            self.commanded_bits,
            self.latched.bits,
            self.latched.bits if radiated is None else radiated.bits,
            len(self.latched.phases),
        )
        codes = head + self.latched.phases + self.latched.amplitudes
        return codes if radiated is None else codes + radiated.phases + radiated.amplitudes

    @classmethod
    def unpack(cls, data: bytes) -> Self:
        """Return the latch whose bytes are *data*.

        Raises
        ------
        ConfigurationError
            If the length is not that of the layout.
        """
        if len(data) < _HEAD.size:
            raise ConfigurationError(f"latch of {len(data)} bytes; it has {_HEAD.size} at least")
        *fields, flags, commanded, bits, radiated_bits, n = _HEAD.unpack_from(data)
        drives = 2 if flags & _RADIATED else 1
        if len(data) != _HEAD.size + 2 * n * drives:
            raise ConfigurationError(
                f"latch of {len(data)} bytes; {n} transducers need {_HEAD.size + 2 * n * drives}"
            )
        session, sequence, loop, index, number, t_latch_us, t_received_us = fields
        return cls(
            session,
            sequence,
            loop,
            index,
            number,
            t_latch_us,
            None if t_received_us == _UNKNOWN else t_received_us,
            bool(flags & _LATE),
            bool(flags & _RAMPING),
            commanded,
            _latch_codes_at(data, _HEAD.size, n, bits),
            _latch_codes_at(data, _HEAD.size + 2 * n, n, radiated_bits) if drives == 2 else None,
        )

    @classmethod
    def of(cls, latch: LatchSeen) -> Self:
        """Return the record of a latch of the virtual board."""
        key, drive, radiated = latch.key, latch.drive, latch.radiated
        same = radiated is drive or radiated == drive
        return cls(
            latch.session,
            key.sequence,
            key.loop,
            key.index,
            latch.number,
            latch.t_latch_us,
            latch.t_received_us,
            latch.late,
            latch.ramping,
            latch.commanded_bits,
            _latch_codes_of(drive),
            None if same else _latch_codes_of(radiated),
        )

    @classmethod
    def from_record(cls, record: Mapping[str, Any]) -> Self:
        """Return the latch in a ``latch`` record of a back door (docs/backdoor.md)."""
        radiated = record["radiated"]
        return cls(
            record["session"],
            record["sequence"],
            record["loop"],
            record["index"],
            record["number"],
            record["t_latch_us"],
            record["t_received_us"],
            record["late"],
            record["ramping"],
            record["commanded_bits"],
            _latch_codes_in(record),
            None if radiated is None else _latch_codes_in(radiated),
        )

    def as_record(self, reconstruction: Mapping[str, Any] | None = None) -> dict[str, Any]:
        """Return the ``latch`` record of a back door that says the same."""
        return {
            "kind": "latch",
            "session": self.session,
            "sequence": self.sequence,
            "loop": self.loop,
            "index": self.index,
            "number": self.number,
            "t_latch_us": self.t_latch_us,
            "late": self.late,
            "t_received_us": self.t_received_us,
            "commanded_bits": self.commanded_bits,
            **_record_of_latch_codes(self.latched),
            "drive_crc": self.latched.crc,
            "radiated": None if self.radiated is None else _record_of_latch_codes(self.radiated),
            "ramping": self.ramping,
            "reconstruction": None if reconstruction is None else dict(reconstruction),
        }


def _latch_codes_of(drive: Drive) -> Codes:
    return Codes(drive.phase_codes.tobytes(), drive.amplitude_codes.tobytes(), drive.phase_bits)


def _latch_codes_at(data: bytes, start: int, count: int, bits: int) -> Codes:
    middle = start + count
    return Codes(data[start:middle], data[middle : middle + count], bits)


def _latch_codes_in(record: Mapping[str, Any]) -> Codes:
    phases, amplitudes = (
        base64.b64decode(record[name]) for name in ("phase_codes", "amplitude_codes")
    )
    return Codes(phases, amplitudes, record["phase_bits"])


def _record_of_latch_codes(codes: Codes) -> dict[str, Any]:
    return {
        "phase_bits": codes.bits,
        "phase_codes": base64.b64encode(codes.phases).decode(),
        "amplitude_codes": base64.b64encode(codes.amplitudes).decode(),
    }
