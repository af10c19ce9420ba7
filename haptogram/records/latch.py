"""One latch: its join key, its times and its drives."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Final, Self
from zlib import crc32

from haptogram.settings.frozen import dataclass, fields

if TYPE_CHECKING:
    from haptogram.acoustics.model.drive import Drive


@dataclass(frozen=True, slots=True)
class Codes:
    """A drive: its codes as bytes, see ``Drive.phase_bytes``; one byte for each amplitude."""

    phases: bytes
    amplitudes: bytes
    bits: int = 8

    @classmethod
    def of(cls, drive: Drive) -> Self:
        """Return the codes of *drive*."""
        return cls(drive.phase_bytes, drive.amplitude_codes.tobytes(), drive.phase_bits)

    @classmethod
    def from_record(cls, record: Mapping[str, Any]) -> Self:
        """Return the codes among the fields of a record."""
        phases, amplitudes = (
            base64.b64decode(record[name]) for name in ("phase_codes", "amplitude_codes")
        )
        return cls(phases, amplitudes, record["phase_bits"])

    def as_record(self) -> dict[str, Any]:
        """Return the fields by which every record holds a drive."""
        return {
            "phase_bits": self.bits,
            "phase_codes": base64.b64encode(self.phases).decode(),
            "amplitude_codes": base64.b64encode(self.amplitudes).decode(),
        }

    @property
    def crc(self) -> int:
        """CRC-32 of the drive, as a TRACE event carries it."""
        return crc32(self.phases + self.amplitudes)


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

    @classmethod
    def from_record(cls, record: Mapping[str, Any]) -> Self:
        """Return the latch in a ``latch`` record of a back door (docs/backdoor.md)."""
        radiated = record["radiated"]
        return cls(
            **{name: record[name] for name in _PLAIN_FIELDS},
            latched=Codes.from_record(record),
            radiated=None if radiated is None else Codes.from_record(radiated),
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
            **self.latched.as_record(),
            "drive_crc": self.latched.crc,
            "radiated": None if self.radiated is None else self.radiated.as_record(),
            "ramping": self.ramping,
            "reconstruction": None if reconstruction is None else dict(reconstruction),
        }


#: Fields of a latch that a record holds by the same name and value.
_PLAIN_FIELDS: Final = tuple(
    field.name for field in fields(LatchRecord) if field.name not in ("latched", "radiated")
)
