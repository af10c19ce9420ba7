"""Boards that are not what they say: geometry, limits, clock.  SPEC.md chapters 4 to 7."""

from __future__ import annotations

import dataclasses
from typing import Any, Final

from haptogram.records.frame import Evidence
from haptogram_protocol.messages import Element, GeometryReply, HelloReply
from sim_device.board.clock import BoardClock
from sim_device.board.output import BoardOutput
from sim_device.mutants import Mutant

from .replies import LyingMutant

_WRAP: Final = 2**32


class _OtherGeometry(LyingMutant):
    """Shows other places than those of its transducers."""

    of = GeometryReply

    def place(self, element: Element) -> Element:
        """Return the transducer as it is shown."""
        raise NotImplementedError

    def lie(self, message: Any) -> dict[str, Any]:
        """Return other places."""
        return {"elements": tuple(map(self.place, message.elements))}


class GeometryByRows(_OtherGeometry):
    """Shows its transducers with x and y exchanged."""

    def place(self, element: Element) -> Element:
        """Return the mirror image at the diagonal."""
        return dataclasses.replace(element, x_um=element.y_um, y_um=element.x_um)


class GeometryFromTheCorner(_OtherGeometry):
    """Measures the places of its transducers from a corner of the board."""

    def place(self, element: Element) -> Element:
        """Return the transducer, shifted."""
        return dataclasses.replace(element, x_um=element.x_um + 20_000, y_um=element.y_um + 20_000)


class GeometryFacingDown(_OtherGeometry):
    """Shows normals that point behind the board."""

    def place(self, element: Element) -> Element:
        """Return the transducer, turned over."""
        return dataclasses.replace(element, nz=-element.nz)


class PitchOfAnother(LyingMutant):
    """Advertises a pitch that is not that of its geometry."""

    of = HelloReply

    def lie(self, message: Any) -> dict[str, Any]:
        """Return another pitch."""
        return {"pitch_um": message.pitch_um + 160}


class QueueOfTwo(LyingMutant):
    """Advertises a queue of two frames."""

    def lie(self, _: Any) -> dict[str, Any]:
        """Return a short queue."""
        return {"queue_depth": 2}


class RingOfEight(LyingMutant):
    """Advertises a trace ring of eight latches."""

    def lie(self, _: Any) -> dict[str, Any]:
        """Return a short ring."""
        return {"trace_ring": 8}


class ChunksBeyondTheFrame(LyingMutant):
    """Advertises chunks that are longer than any frame."""

    def lie(self, _: Any) -> dict[str, Any]:
        """Return long chunks."""
        return {"max_chunk": 4062}


class WindowBeyondTheBuffer(LyingMutant):
    """Advertises a window of more chunks than it can take without a pause."""

    def lie(self, message: Any) -> dict[str, Any]:
        """Return a long window."""
        return {"upload_window": message.rx_window // message.max_chunk}


class ClockFromTheWrap(BoardClock):
    """Starts its clock at 2^32: no run crosses the wrap."""

    def device_us(self, t_ns: int) -> int:
        """Return the reading of the clock at *t_ns*."""
        return super().device_us(t_ns) - self.boot_us + _WRAP

    def reached_ns(self, device_us: int) -> int:
        """Return the first time at which it shows *device_us* or more."""
        return super().reached_ns(device_us + self.boot_us - _WRAP)


class CarrierOf32Bits(BoardOutput):
    """Counts its carrier periods in 32 bits: behind the wrap they begin anew."""

    def boundary_us(self, t_us: int) -> int:
        """Return the first multiple of the carrier period since the last wrap."""
        since_us = max(t_us, self.now_us) // _WRAP * _WRAP
        carrier_us = self.settings.carrier_us
        return since_us - (since_us - max(t_us, self.now_us)) // carrier_us * carrier_us


_WIRE, _SELF = Evidence.WIRE, Evidence.SELF_REPORTED

MUTANTS: Final = (
    Mutant.of(GeometryByRows, "HG-5.1/2", _WIRE),
    Mutant.of(GeometryFromTheCorner, "HG-5.1/3", _WIRE),
    Mutant.of(GeometryFacingDown, "HG-5.1/3", _WIRE),
    Mutant.of(PitchOfAnother, "HG-7.5/3", _WIRE),
    Mutant.of(QueueOfTwo, "HG-4.3/8", _WIRE),
    Mutant.of(RingOfEight, "HG-4.3/8", _WIRE),
    Mutant.of(ChunksBeyondTheFrame, "HG-4.3/8", _WIRE),
    Mutant.of(WindowBeyondTheBuffer, "HG-4.3/9", _WIRE),
    Mutant.of(ClockFromTheWrap, "HG-6.9/4", _WIRE),
    Mutant.of(CarrierOf32Bits, "HG-6.9/5", _SELF),
)
