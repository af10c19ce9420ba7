"""The capture that a virtual board writes of its own drive pins, as VCD."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Final, TextIO, TypeAlias

import numpy as np

from haptogram.acoustics.arrays import ComplexArray, FloatArray
from haptogram.errors import writing_file
from haptogram.settings.board import PinCaptureConfig
from haptogram_protocol.state import OutputState

from ..board import events
from ..board.events import CarrierState
from ..board.settings import BoardSettings
from ..line.vcd import vcd_identifier, write_vcd_head
from .pin_waveforms import (
    Edges,
    PinWaveformPulses,
    PinWaveformSampler,
    UartWaveform,
    starts_of_periods,
)

CARRIER: Final = "carrier"
LATCH: Final = "latch"
TO_BOARD: Final = "to_board"
TO_HOST: Final = "to_host"
_SIGNALS: Final = 2  # signals before the pins of the elements
_RAMP_STEP_US: Final = 1000  # HG-6.11/2: as often the amplitude of a ramp has to follow
_BITS_OF_A_BYTE: Final = 10
_FULL: Final = 255.0
_SECOND_US: Final = 1e6  # time at the end for which pins that never fall silent are shown
_QUIET_PERIODS: Final = 20.0  # silence before the first latch and after the last event
#: Device time in us, the drive of the pins from then on (None: silence), whether it is a latch, and
#: the carrier.
_Act: TypeAlias = tuple[int, ComplexArray | None, bool, CarrierState]
_Piece: TypeAlias = tuple[float, float, PinWaveformPulses, bool, CarrierState]


class BackdoorPinCapture:
    """A recorder that writes down what a logic analyser would see at all drive pins.

    It keeps drives while the board runs, and makes edges of them when it is closed: a board that
    has to be in time has none left for them. The channel ``carrier`` rises at every boundary of
    the carrier, ``latch`` at every latch, and ``e0``, ``e1``, ... are the pins of the elements.
    If the line of the board takes time, ``to_board`` and ``to_host`` are the lines of its UART.

    Parameters
    ----------
    path : Path
        The file.
    config : PinCaptureConfig
        Its length, its analyser, and what is wrong with the pins.
    settings : BoardSettings
        The board.

    Raises
    ------
    SettingError
        If *config* names an element that the board lacks.
    """

    def __init__(self, path: Path, config: PinCaptureConfig, settings: BoardSettings) -> None:
        self._path, self._config = path, config
        count = settings.truth.array.count
        self._elements = config.elements(count)
        self._count = len(self._elements)
        self._period_us = settings.carrier_us
        self._late = np.array(config.late_us(count))[self._elements]
        self._lingering = np.array(config.lingering_us(count))[self._elements]
        self._acts: list[_Act] = []
        # Begin, end, full drive, and what a ceiling leaves at most.
        self._ramp: tuple[int, int, ComplexArray, float] | None = None
        self._begin_us: float | None = None
        self._is_silent = True
        self._is_full = False  # it lasted longer than it was to be
        self._lines: dict[str, UartWaveform] = {}
        if settings.line.baud is not None:
            byte_us = _BITS_OF_A_BYTE * 1e6 / settings.line.baud
            self._lines = {name: UartWaveform(byte_us) for name in (TO_BOARD, TO_HOST)}

    def latch(self, latch: events.AnyLatch) -> None:
        """Keep what is radiated from now on."""
        carrier = latch.carrier if isinstance(latch, events.PulseLatch) else CarrierState.STEADY
        weights = latch.weights()[self._elements] / carrier.level
        if isinstance(latch, events.PulseLatch) and not self._acts and not weights.any():
            return  # power-up: the capture begins with the first sound
        if self._ramp is not None:
            begin_us, end_us, *_ = self._ramp
            self._follow_ramp(latch.t_latch_us)
            left = (end_us - latch.t_latch_us) / max(end_us - begin_us, 1)
            self._ramp = begin_us, end_us, weights / left if left > 0.0 else weights, 1.0
        self._queue_change(latch.t_latch_us, weights, carrier=carrier)

    def notice(self, notice: events.Notice) -> None:
        """Keep when the output fades, and when it falls silent."""
        if isinstance(notice, events.RampBegan) and self._acts and not self._is_silent:
            drive = self._acts[-1][1]
            self._ramp = None if drive is None else (notice.t_us, notice.end_us, drive, 1.0)
        if isinstance(notice, events.RadiatedAnew) and self._acts and not self._is_silent:
            self._record_radiated_change(notice)
        is_off = isinstance(notice, events.StateChange) and notice.state is not OutputState.ARMED
        if self._ramp is not None and (is_off or isinstance(notice, events.RampEnded)):
            self._follow_ramp(notice.t_us)
            _, _, full, _ = self._ramp
            self._ramp = None
            if isinstance(notice, events.RampEnded) and notice.restored:
                self._queue_change(notice.t_us, full)
        if is_off or (isinstance(notice, events.RampEnded) and not notice.restored):
            self._queue_change(notice.t_us, None)

    def _record_radiated_change(self, notice: events.RadiatedAnew) -> None:
        """Queue what the pins radiate after a change of settings, from the next carrier period on.

        A running ramp goes on from there with its new full drive.
        """
        if self._ramp is not None:
            self._follow_ramp(notice.t_us)
            begin_us, end_us, *_ = self._ramp
            full = notice.full.weights()[self._elements]
            self._ramp = begin_us, end_us, full, notice.cut / _FULL
        boundary_us = -(-notice.t_us // self._period_us) * self._period_us
        self._queue_change(boundary_us, notice.radiated.weights()[self._elements], is_latch=False)

    def carried(self, name: str, begin_us: float, data: bytes) -> None:
        """Keep bytes that a line of the UART carries back to back from *begin_us* on."""
        if name in self._lines and self._begin_or_is_within(begin_us):
            self._lines[name].carry(begin_us, data)

    def lines_cut(self, t_us: float) -> None:
        """Forget bytes that no longer arrive: the host has closed its port."""
        for line in self._lines.values():
            line.cut(t_us)

    def _follow_ramp(self, until_us: int) -> None:
        """Queue the amplitudes of the running ramp, in steps of 1 ms, up to *until_us*."""
        if self._ramp is None:
            return
        begin_us, end_us, full, cut = self._ramp
        sizes = np.abs(full)
        last_us = max(self._acts[-1][0], begin_us)
        steps = range(begin_us + _RAMP_STEP_US, min(until_us, end_us), _RAMP_STEP_US)
        for t_us in (step for step in steps if step > last_us):
            left = (end_us - t_us) / (end_us - begin_us)
            codes = np.minimum(np.floor(sizes * _FULL * left + 0.5) / _FULL, cut)
            weights = full * np.divide(codes, sizes, out=np.zeros_like(sizes), where=sizes > 0)
            self._queue_change(t_us, weights, is_latch=False)

    def _queue_change(
        self,
        t_us: int,
        weights: ComplexArray | None,
        *,
        is_latch: bool = True,
        carrier: CarrierState = CarrierState.STEADY,
    ) -> None:
        """Queue a change of the pins at *t_us*, unless the capture is full.

        *weights* (E,) is the complex drive of the captured pins, None silence. *is_latch*: the
        latch signal shows it too. *carrier*: how the carrier runs from then on.
        """
        if weights is None and self._is_silent:
            return
        if not self._begin_or_is_within(t_us):
            self._is_full = True
            return
        if self._acts and self._acts[-1][0] > t_us:
            self._acts.pop()  # settings that were to show in the carrier period after this one
        self._acts.append((t_us, weights, is_latch and weights is not None, carrier))
        self._is_silent = weights is None

    def _begin_or_is_within(self, t_us: float) -> bool:
        """Begin the capture at *t_us* if it has not; return True if *t_us* is before its end."""
        if self._begin_us is None:
            self._begin_us = t_us
        return t_us - self._begin_us < self._config.capture_ms * 1000.0

    def close(self) -> str:
        """Write the file; return in one line what it holds, or that nothing was radiated.

        Raises
        ------
        ConfigurationError
            If it cannot be written.
        """
        path = self._path
        with writing_file(path, "--capture"), path.open("w", encoding="ascii") as file:
            edges = self._write(file)
        return f"{path}: {edges} edges of {self._count} pins, {len(self._acts)} changes"

    # --- waveforms -----------------------------------------------------------------------------

    def _write(self, file: TextIO) -> int:
        """Write the capture as VCD; return the number of edges."""
        names = [CARRIER, LATCH, *(f"e{n}" for n in self._elements), *self._lines]
        file.write("$comment drive pins of a virtual board of Haptogram $end\n")
        write_vcd_head(file, names, self._lines)
        edges = 0
        ns_per_sample = 1e9 / self._config.capture_rate_hz
        for samples, channels, levels in self._segments():
            edges += len(samples)
            _write_pin_edges(
                file, np.rint(samples * ns_per_sample).astype(np.int64), channels, levels
            )
        return edges

    def _segments(self) -> Iterator[Edges]:
        """Yield sample, channel and level (M,) of the edges, piece by piece, in order."""
        if not self._acts:
            return
        first_us = int((self._begin_us or 0.0) // self._period_us) * self._period_us
        samples = self._period_us * 1e-6 * self._config.capture_rate_hz
        samples *= 1.0 + self._config.capture_ppm * 1e-6
        pins = PinWaveformSampler(self._count, samples)
        signals = PinWaveformSampler(_SIGNALS, samples)
        silent = PinWaveformPulses.of_weights(np.zeros(self._count, np.complex128))
        lines = self._line_edges(first_us - _QUIET_PERIODS * self._period_us, samples)
        for begin, end, pulses, is_latch, carrier in self._pieces(first_us, silent):
            starts = starts_of_periods(carrier, begin, end)
            # the timer of an Arduino goes on, where its outputs miss every second period
            is_halved = carrier is CarrierState.HALVED
            clock = starts_of_periods(CarrierState.STEADY, begin, end) if is_halved else starts
            latched = 0.5 if is_latch else 0.0
            once = PinWaveformPulses(np.array([0.0, begin % 1.0]), np.array([0.5, latched]))
            pieces = [pins.edges(pulses, begin, end, starts)]
            split = min(end, begin + 1.0)
            pieces.append(signals.edges(once, begin, split, clock))
            idle = PinWaveformPulses(np.array([0.0, 0.0]), np.array([0.5, 0.0]))
            pieces.append(signals.edges(idle, split, end, clock))
            bounds = np.ceil(np.array([begin, end]) * samples).astype(np.int64)
            low, high = np.searchsorted(lines[0], bounds)  # of another type, all are converted
            pieces.append((lines[0][low:high], lines[1][low:high], lines[2][low:high]))
            times = np.concatenate([piece[0] for piece in pieces])
            shifts = (_SIGNALS, 0, 0, 0)
            channels = np.concatenate(
                [p[1] + shift for p, shift in zip(pieces, shifts, strict=True)]
            )
            levels = np.concatenate([piece[2] for piece in pieces])
            order = np.argsort(times, kind="stable")
            yield times[order], channels[order], levels[order]

    def _line_edges(self, first_us: float, samples: float) -> Edges:
        """Return the edges of both UART lines as sample, channel, level (M,), sorted by time.

        *samples* is how many samples a carrier period has; sample 0 is at *first_us*.
        """
        found = [
            line.edges(_SIGNALS + self._count + number, first_us, samples / self._period_us)
            for number, line in enumerate(self._lines.values())
        ]
        nothing = np.zeros(0, np.int64)
        found.append((nothing, nothing, np.zeros(0, np.bool_)))
        times, channels, levels = (np.concatenate(parts) for parts in zip(*found, strict=True))
        order = np.argsort(times, kind="stable")
        return times[order], channels[order], levels[order]

    def _pieces(self, first_us: int, silent: PinWaveformPulses) -> Iterator[_Piece]:
        """Yield (begin, end, pulses, is a latch, carrier) of pieces without a change of any drive.

        Times count in carrier periods from 20 periods before *first_us*; until the first change the
        pins show *silent*, the pulses of no drive.
        """
        lead = _QUIET_PERIODS
        end = self._config.capture_ms * 1000.0 / self._period_us + lead
        if not self._is_full:
            carried_us = max((line.end_us for line in self._lines.values()), default=-math.inf)
            last_us = max(
                self._acts[-1][0] + min(float(self._lingering.max()), _SECOND_US), carried_us
            )
            end = min(end, (last_us - first_us) / self._period_us + 2.0 * lead)
        carrier = CarrierState.STEADY
        yield 0.0, (self._acts[0][0] - first_us) / self._period_us + lead, silent, False, carrier
        pulses = silent
        for place, (t_us, weights, is_latch, carrier) in enumerate(self._acts):
            begin = (t_us - first_us) / self._period_us + lead
            until = end
            if place + 1 < len(self._acts):
                until = (self._acts[place + 1][0] - first_us) / self._period_us + lead
            after = silent if weights is None else PinWaveformPulses.of_weights(weights)
            behind = self._lingering if weights is None else self._late
            for late, old in self._late_pins(pulses, after, behind):
                moment = min(begin + late, until)
                yield begin, moment, old, is_latch, carrier
                begin, is_latch = moment, False
            yield begin, until, after, is_latch, carrier
            pulses = after

    def _late_pins(
        self, before: PinWaveformPulses, after: PinWaveformPulses, behind: FloatArray
    ) -> Iterator[tuple[float, PinWaveformPulses]]:
        """Yield (length in carrier periods, pulses) of the time in which some pins still lag.

        In it late pins show the drive *before*, the others the one *after*. *behind* is how many µs
        each pin is late against the board.
        """
        passed = 0.0
        for late in np.unique(behind[behind > 0.0]).tolist():
            old = behind >= late
            mixed = PinWaveformPulses(
                np.where(old, before.rises, after.rises), np.where(old, before.duties, after.duties)
            )
            yield late / self._period_us - passed, mixed
            passed = late / self._period_us


def _write_pin_edges(
    file: TextIO, times_ns: np.ndarray, channels: np.ndarray, levels: np.ndarray
) -> None:
    """Write edges (M,), sorted by time, in VCD, with a time stamp before each new time."""
    codes = [vcd_identifier(number) for number in range(int(channels.max(initial=0)) + 1)]
    words = [[f"{level}{code}\n" for code in codes] for level in (0, 1)]
    begun = np.concatenate([[True], times_ns[1:] != times_ns[:-1]])[: len(times_ns)]
    file.writelines(
        f"#{t_ns}\n{words[level][channel]}" if is_new else words[level][channel]
        for t_ns, is_new, channel, level in zip(
            times_ns.tolist(), begun.tolist(), channels.tolist(), levels.tolist(), strict=True
        )
    )
