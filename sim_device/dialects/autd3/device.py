"""One device of AUTD3: 249 channels, two memories, and what it answers.

A device does the operations of a frame in order, up to the first that it refuses. What it shows
changes when an operation asks for it: data that is written meanwhile waits, where a real FPGA would
radiate a sequence while it is overwritten. Source of the rules: shinolab/autd3-rs,
``autd3-firmware-emulator/src/cpu/operation``.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from haptogram_protocol.dialects.autd3 import frame as frames
from haptogram_protocol.dialects.autd3 import operations
from haptogram_protocol.dialects.codec import Operation

from .foci import MAX_FOCI_OF_PATTERN, Autd3Foci, read_autd3_foci
from .memory import Autd3Memory
from .refusals import Autd3Limits, autd3_segment_refusal, autd3_silencer_refusal
from .segments import Autd3Sampling

FULL: Final = 255  # largest intensity and modulation
_FOCUS_BYTES: Final = 8
# v12.1.0, the newest firmware that autd3 38 knows
_FIRMWARE: Final = {
    operations.InfoType.CPU_MAJOR: 0xA5,
    operations.InfoType.CPU_MINOR: 0,
    operations.InfoType.FPGA_MAJOR: 0xA5,
    operations.InfoType.FPGA_MINOR: 0,
    operations.InfoType.FPGA_FUNCTIONS: 0,
    operations.InfoType.CLEAR: 0,
}


@dataclass(frozen=True, eq=False, slots=True)
class Autd3Patterns:
    """Patterns of a segment; *cause* is the operation that wrote it."""

    cause: str
    data: bytes | Autd3Foci

    @property
    def phase_steps(self) -> int | None:
        """Steps of a period: the device computes phases to half of one; None: it computes none."""
        return self.data.steps if isinstance(self.data, Autd3Foci) else None

    def drive(self, index: int) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
        """Return the (249,) phases and intensities of pattern *index*."""
        if isinstance(self.data, Autd3Foci):
            return self.data.drive(index)
        drives = np.frombuffer(self.data, np.uint8)
        return drives[0::2], drives[1::2]


@dataclass(frozen=True, slots=True)
class Output:
    """Pulses of a device in one period.

    Attributes
    ----------
    patterns : Autd3Patterns
        The same object until an operation shows something else.
    index : int
        Pattern of the sequence.
    modulation : int
        Share of the intensity, 0 to 255.
    """

    patterns: Autd3Patterns
    index: int
    modulation: int


class Autd3Device:
    """A device at power-up.

    Parameters
    ----------
    counters : Counter
        Counts ``refused_...``, each error by name, ``sequences_impossible`` and
        ``sequences_empty``, and those of :class:`~sim_device.dialects.autd3.memory.Autd3Memory`.
    """

    def __init__(self, counters: Counter[str]) -> None:
        self._counters = counters
        self._state = frames.Autd3DeviceState(0)
        self._power_up()

    def _power_up(self) -> None:
        """Reset limits, sequences and modulation."""
        self._limits = Autd3Limits()
        self._sequences: Autd3Memory[Autd3Patterns, operations.FociStart] = Autd3Memory(
            Autd3Patterns("clear", bytes(2 * operations.CHANNELS)), _FOCUS_BYTES, self._counters
        )
        self._modulation: Autd3Memory[bytes, operations.ModulationStart] = Autd3Memory(
            bytes([FULL]), 1, self._counters
        )

    @property
    def state(self) -> frames.Autd3DeviceState:
        """Answer of the device."""
        return self._state

    def take(self, frame: frames.Autd3DeviceFrame, now_ns: int) -> None:
        """Do the operations of *frame* at the system time *now_ns*."""
        if frame.repeated:
            return
        error, data = operations.ErrorCode.NONE, self._state.data
        if frame.message_id > frames.MAX_MESSAGE_ID:
            error = operations.ErrorCode.INVALID_MESSAGE_ID
        for operation in frame.operations:
            error = self._do(operation, now_ns)
            if error:
                break
            if isinstance(operation, operations.FirmwareInfo):
                data = _FIRMWARE[operations.InfoType(operation.kind)]
        if error:
            self._counters[f"refused_{error.name.lower()}"] += 1
        self._state = frames.Autd3DeviceState(frame.message_id, error, data)

    def output(self, period: int) -> Output:
        """Return the output of the device in *period*; never earlier than asked before."""
        samples, place = self._modulation.output(period)
        return Output(*self._sequences.output(period), samples[place])

    def next_change(self, period: int) -> int | None:
        """Return the next period after *period* that may have another output, or None."""
        times = (self._sequences.next_change(period), self._modulation.next_change(period))
        return min((time for time in times if time is not None), default=None)

    def _do(self, operation: Operation, now_ns: int) -> operations.ErrorCode:
        """Execute an operation; return its error code, NONE if it was accepted."""
        if error := operations.autd3_refusal(operation):
            return error
        doers: dict[type, Callable[[Any, int], operations.ErrorCode]] = {
            operations.Clear: self._clear,
            operations.Silencer: self._silence,
            operations.Gain: self._write_gain,
            operations.Modulation: self._write_modulation,
            operations.FociSTM: self._write_foci,
            operations.SwapSegment: self._swap,
        }
        doer = doers.get(type(operation))
        if doer is not None:
            return doer(operation, now_ns)
        known = isinstance(operation, operations.Nop | operations.Sync | operations.FirmwareInfo)
        return operations.ErrorCode.NONE if known else operations.ErrorCode.NOT_SUPPORTED_TAG

    def _clear(self, *_: object) -> operations.ErrorCode:
        """Reset the device as at power-up; return NONE, no error."""
        self._power_up()
        return operations.ErrorCode.NONE

    def _silence(self, operation: operations.Silencer, _: int) -> operations.ErrorCode:
        """Set the silencer's limits; return an error if segments are sampled too fast for them."""
        limits = Autd3Limits.of(operation, self._limits)
        error = autd3_silencer_refusal(limits, self._sequences.divider, self._modulation.divider)
        if not error:
            self._limits = limits
        return error

    def _write_gain(self, operation: operations.Gain, now_ns: int) -> operations.ErrorCode:
        """Write one drive to a segment; latch it at once if the operation says so.

        Returns the error that refuses it, or NONE.
        """
        segment = operation.segment
        if error := autd3_segment_refusal(segment):
            return error
        self._sequences.write(segment, Autd3Patterns("gain", operation.drives), Autd3Sampling())
        self._sequences.select(segment)
        if not operation.update:
            return operations.ErrorCode.NONE
        return self._sequences.show(segment, operations.TransitionMode.IMMEDIATE, 0, now_ns)

    def _write_foci(self, operation: operations.FociSTM, now_ns: int) -> operations.ErrorCode:
        """Add a part of a sequence of foci; after the last part, write it to its segment.

        Returns the error that refuses it, or NONE.
        """
        memory, segment = self._sequences, operation.segment
        error = autd3_segment_refusal(segment)
        if operation.start is not None and not error:
            error = self._begin_foci(segment, operation.start)
        if error:
            memory.abandon()
            return error
        if not memory.extend(operation.foci) or not operation.end or memory.start is None:
            return operations.ErrorCode.NONE
        start, of_pattern = memory.start, memory.start.foci_of_pattern
        count = len(memory.part) // (of_pattern * _FOCUS_BYTES)
        if not count:
            self._counters["sequences_empty"] += 1
            memory.part += bytes(of_pattern * _FOCUS_BYTES)
        packed = bytes(memory.part[: max(1, count) * of_pattern * _FOCUS_BYTES])
        memory.abandon()
        foci = read_autd3_foci(packed, of_pattern, start.sound_speed)
        sampling = Autd3Sampling(start.divider, len(foci), start.repeat)
        memory.write(segment, Autd3Patterns("foci", foci), sampling)
        if not operation.update:
            return operations.ErrorCode.NONE
        return memory.show(segment, start.transition_mode, start.transition_value, now_ns)

    def _begin_foci(self, segment: int, start: operations.FociStart) -> operations.ErrorCode:
        """Begin a sequence of foci; return the error that refuses it, or NONE."""
        if not 1 <= start.foci_of_pattern <= MAX_FOCI_OF_PATTERN or not start.sound_speed:
            self._counters["sequences_impossible"] += 1  # the FPGA would divide by zero
            return operations.ErrorCode.NOT_SUPPORTED_TAG
        error = self._sequences.refusal(
            segment, start.transition_mode, start.repeat
        ) or autd3_silencer_refusal(self._limits, start.divider, self._modulation.divider)
        if not error:
            self._sequences.begin(segment, start)
        return error

    def _write_modulation(
        self, operation: operations.Modulation, now_ns: int
    ) -> operations.ErrorCode:
        """Add a part of a modulation; after the last part, write it to its segment.

        Returns the error that refuses it, or NONE.
        """
        memory, segment, start = self._modulation, operation.segment, operation.start
        if start is not None:
            error = memory.refusal(
                segment, start.transition_mode, start.repeat
            ) or autd3_silencer_refusal(self._limits, self._sequences.divider, start.divider)
            if error:
                memory.abandon()
                return error
            memory.begin(segment, start)
        if not memory.extend(operation.samples) or not operation.end or memory.start is None:
            return operations.ErrorCode.NONE
        begun, samples = memory.start, bytes(memory.part)
        memory.abandon()
        if not samples:
            self._counters["sequences_empty"] += 1
            samples = bytes([FULL])
        memory.write(segment, samples, Autd3Sampling(begun.divider, len(samples), begun.repeat))
        if not operation.update:
            return operations.ErrorCode.NONE
        return memory.show(segment, begun.transition_mode, begun.transition_value, now_ns)

    def _swap(self, operation: operations.SwapSegment, now_ns: int) -> operations.ErrorCode:
        """Show another segment of drives or modulation; return the error that refuses it.

        NONE if nothing refuses it.
        """
        segment, mode = operation.segment, operation.transition_mode
        if operation.tag is operations.Tag.GAIN_SWAP:
            mode = operations.TransitionMode.IMMEDIATE
        if error := autd3_segment_refusal(segment):
            return error
        if operation.tag is operations.Tag.MODULATION_SWAP:
            memory: Autd3Memory[Any, Any] = self._modulation
            dividers = self._sequences.divider, memory.divider_of(segment)
        else:
            memory = self._sequences
            holds_foci = isinstance(self._sequences.written(segment).data, Autd3Foci)
            is_of_kind = holds_foci is (operation.tag is operations.Tag.FOCI_STM_SWAP)
            if error := autd3_segment_refusal(segment, is_of_kind=is_of_kind):
                return error
            dividers = memory.divider_of(segment), self._modulation.divider
        error = memory.refusal(segment, mode) or autd3_silencer_refusal(self._limits, *dividers)
        return error or memory.show(segment, mode, operation.transition_value, now_ns)
