"""Boards that are wrong in exactly one way: what a test of firmware has to find.

``MUTANTS`` names some to show. Each is the healthy board with one part replaced (see
:class:`~sim_device.assembly.BoardAssembly`) and names the requirement of SPEC.md that it violates.
``MODULE:CLASS`` in place of a name takes the wrong part from any module that Python finds.
"""

from __future__ import annotations

import dataclasses
import importlib
import inspect
import re
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any, Final, Self, TypeAlias
from zlib import crc32

import numpy as np

from haptogram.acoustics import Drive
from haptogram.errors import ConfigurationError
from haptogram.records.frame import Evidence
from haptogram.settings.arguments import did_you_mean
from haptogram.settings.frozen import dataclass
from haptogram_protocol.cobs import Cobs, cobs_decode
from haptogram_protocol.framing import CRC_BYTES, FrameDecoder
from haptogram_protocol.messages import Config, FocalPoint

from .assembly import HEALTHY, BoardAssembly
from .board.board import Board
from .board.output import BoardOutput
from .board.registers import BoardFocuser
from .board.timers import BoardTimers

Part: TypeAlias = type[Any]
#: The part of :class:`~sim_device.assembly.BoardAssembly` that a subclass of its class replaces.
_NAMES: Final = {field.default: field.name for field in dataclasses.fields(BoardAssembly)}
_NEVER_US: Final = 1 << 60


@dataclass(frozen=True, slots=True)
class Mutant:
    """A board that is wrong in exactly one way.

    Attributes
    ----------
    name : str
        As it is given on a command line or in a URL, if it is one of :data:`MUTANTS`.
    clause : str
        Requirement of SPEC.md that it violates.
    evidence : Evidence
        Bytes on the wire, the board's own report, or only a measurement.
    part : type
        The wrong part.
    array : str
        Array of which the frames are long enough to show it; empty: any.
    """

    name: str
    clause: str
    evidence: Evidence
    part: Part
    array: str = ""

    @classmethod
    def of(cls, part: Part, clause: str, evidence: Evidence, array: str = "") -> Self:
        """Return the mutant whose wrong part is *part*, named after it."""
        name = re.sub(r"(?<=[a-z])(?=[A-Z0-9])|(?<=[0-9])(?=[A-Z])", "-", part.__name__).lower()
        return cls(name, clause, evidence, part, array)

    @property
    def docstring(self) -> str:
        """One sentence about the error."""
        return inspect.getdoc(self.part) or ""

    @property
    def address(self) -> str:
        """``MODULE:CLASS`` of the wrong part, which takes the place of the name anywhere."""
        return f"{self.part.__module__}:{self.part.__qualname__}"


def mutant_parts(name: str | None) -> BoardAssembly:
    """Return the parts of the mutant *name* or ``MODULE:CLASS``; None: of the healthy board.

    Raises
    ------
    ConfigurationError
        If there is no such mutant, or the class is no part of a board.
    """
    if name is None:
        return HEALTHY
    if ":" in name:
        return _assembly_with(_imported_class(name), name)
    if name not in MUTANTS:
        raise ConfigurationError(
            f"mutant is {name!r}; known are {', '.join(MUTANTS)}, and MODULE:CLASS of your own"
            f"{did_you_mean(name, MUTANTS)}"
        )
    return _assembly_with(MUTANTS[name].part, name)


def _assembly_with(part: Part, name: str) -> BoardAssembly:
    """Return a board's parts, all healthy but *part*, a mutant called *name*.

    It replaces the part from whose class it is derived; ConfigurationError if there is none.
    """
    for kind in getattr(part, "__mro__", ()):
        if kind in _NAMES:
            return BoardAssembly(**{_NAMES[kind]: part})
    known = ", ".join(_NAMES.values())
    raise ConfigurationError(
        f"mutant {name} is no part of a board; derive it from the class of one: {known}"
    )


def _imported_class(address: str) -> Part:
    """Import a class by MODULE:CLASS; ConfigurationError if that is impossible."""
    module, _, name = address.partition(":")
    try:
        part: Part = getattr(importlib.import_module(module), name)
    except (ImportError, AttributeError, ValueError) as error:
        raise ConfigurationError(
            f"mutant {address} cannot be loaded ({error}); give MODULE:CLASS of a module that "
            "Python finds (PYTHONPATH)"
        ) from error
    return part


# --- Boards to show ----------------------------------------------------------------------------


class CrcUnchecked(FrameDecoder):
    """Takes frames whatever their CRC says."""

    def __init__(self) -> None:
        super().__init__(Cobs(decode=_decoded_with_right_crc))


def _decoded_with_right_crc(encoded: bytes) -> bytes:
    """Return the body of a COBS frame, its CRC replaced by the right one."""
    body = cobs_decode(encoded)[:-CRC_BYTES]
    return body + crc32(body).to_bytes(CRC_BYTES, "little")


class LatchesOnePeriodLate(BoardOutput):
    """Latches one carrier period after the right one."""

    def boundary_us(self, t_us: int) -> int:
        """Return the boundary after the right one."""
        return super().boundary_us(t_us + self.settings.carrier_us)


class NonAtomic(BoardOutput):
    """Swaps the second half of the transducers one latch after the first half."""

    _pending: Drive | None = None

    def latch(self, key: Any, drive: Drive, bits: int, **how: Any) -> None:
        """Latch one half of *drive* and one half of the drive before."""
        previous = self._pending
        if previous is None:
            previous = self.latched.drive if self.latched else Drive.muted(self.settings.count)
        half = len(drive.phase_codes) // 2
        phases, amplitudes = drive.phase_codes.copy(), drive.amplitude_codes.copy()
        phases[half:] = previous.phase_codes[half:]
        amplitudes[half:] = previous.amplitude_codes[half:]
        self._pending = drive
        super().latch(key, Drive(phases, amplitudes), bits, **how)


class PointsOfOppositePhase(BoardFocuser):
    """Computes the drive of focal points with the opposite sign of the phase."""

    def drive(self, points: Sequence[FocalPoint]) -> Drive:
        """Return the codes of the conjugate weights."""
        right = super().drive(points)
        return Drive(np.uint8(0) - right.phase_codes, right.amplitude_codes)


class MuteIgnored(Board):
    """Answers MUTE and does nothing."""

    def mute(self, *, requested: bool = True) -> None:
        """Do nothing."""


class HoldMissing(BoardTimers):
    """Holds the last drive for ever when the stream stops."""

    def latched(self, _: int, config: Config) -> None:
        """Let the hold last for ever."""
        super().latched(_NEVER_US, config)


class StuckColumn(BoardOutput):
    """The first column is driven by phase 0 whatever was latched."""

    def sounded(self, radiated: Drive) -> Drive:
        """Return *radiated* without the phases of the first column."""
        _, ny = self.settings.model.array.grid_shape or (1, 1)
        phases = radiated.phase_codes.copy()
        phases[:ny] = 0
        return Drive(phases, radiated.amplitude_codes)


class PhaseInverted(BoardOutput):
    """A phase code advances its transducer: the wires of the outputs are crossed."""

    def sounded(self, radiated: Drive) -> Drive:
        """Return *radiated* with phases of the opposite sign."""
        return Drive(np.uint8(0) - radiated.phase_codes, radiated.amplitude_codes)


_WIRE, _SELF, _EXTERNAL, _ = Evidence

MUTANTS: Final[Mapping[str, Mutant]] = MappingProxyType(
    {
        mutant.name: mutant
        for mutant in (
            Mutant.of(CrcUnchecked, "HG-2.4/2", _WIRE),
            Mutant.of(LatchesOnePeriodLate, "HG-5.8/1", _SELF),
            Mutant.of(NonAtomic, "HG-5.8/2", _SELF),
            Mutant.of(PointsOfOppositePhase, "HG-5.4/1", _SELF),
            Mutant.of(MuteIgnored, "HG-6.2/1", _WIRE),
            Mutant.of(HoldMissing, "HG-6.10/1", _WIRE),
            Mutant.of(StuckColumn, "HG-5.8/2", _EXTERNAL),
            Mutant.of(PhaseInverted, "HG-7.9/1", _EXTERNAL),
        )
    }
)
