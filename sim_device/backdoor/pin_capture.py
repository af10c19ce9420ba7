"""The capture that a virtual board writes of its own drive pins, as VCD."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Final, TextIO, TypeAlias

import numpy as np

from haptogram.acoustics.arrays import ComplexArray
from haptogram.errors import ConfigurationError
from haptogram.settings.board import PinCaptureConfig
from haptogram_protocol.state import OutputState

from ..board.events import AnyLatch, Latch, Notice, PulseLatch, RampEnded, StateChange
from ..board.settings import BoardSettings
from .pin_waveforms import PinSampler, Pulses

CARRIER: Final = "carrier"
LATCH: Final = "latch"
_SIGNALS: Final = 2  # before the pins of the elements
_QUIET_PERIODS: Final = 20.0  # before the first latch and after the last event
_CODES: Final = [chr(code) for code in range(33, 127)]
#: From device time in us: what the pins do from then on; None: no latch, silence.
_Act: TypeAlias = tuple[int, ComplexArray | None]


class PinCapture:
    """A recorder that writes down what a logic analyser would see at all drive pins.

    It keeps drives while the board runs, and makes edges of them when it is closed: a board that
    has to be in time has none left for them. The channel ``carrier`` rises at every boundary of
    the carrier, ``latch`` at every latch, and ``e0``, ``e1``, ... are the pins of the elements.

    Parameters
    ----------
    path : Path
        The file.
    config : PinCaptureConfig
        Its length and its analyser.
    settings : BoardSettings
        The board.
    late_us : sequence of float, optional
        How much later than the board each pin latches; by default not at all.
    """

    def __init__(
        self,
        path: Path,
        config: PinCaptureConfig,
        settings: BoardSettings,
        late_us: list[float] | None = None,
    ) -> None:
        self._path, self._config = path, config
        self._count = settings.truth.array.count
        self._period_us = settings.carrier_us
        self._late = np.zeros(self._count) if late_us is None else np.array(late_us)
        self._acts: list[_Act] = []
        self._is_silent = True
        self._is_full = False  # it lasted longer than it was to be

    def latch(self, latch: AnyLatch) -> None:
        """Keep what is radiated from now on."""
        weights = _weights_of(latch)
        if isinstance(latch, PulseLatch) and not self._acts and not weights.any():
            return  # power-up: the capture begins with the first sound
        self._act(latch.t_latch_us, weights)

    def notice(self, notice: Notice) -> None:
        """Keep when the output falls silent."""
        is_off = isinstance(notice, StateChange) and notice.state is not OutputState.ARMED
        if is_off or (isinstance(notice, RampEnded) and not notice.restored):
            self._act(notice.t_us, None)

    def _act(self, t_us: int, weights: ComplexArray | None) -> None:
        if weights is None and self._is_silent:
            return
        if self._acts and t_us - self._acts[0][0] >= self._config.capture_ms * 1000.0:
            self._is_full = True
            return
        self._acts.append((t_us, weights))
        self._is_silent = weights is None

    def close(self) -> str:
        """Write the file; return in one line what it holds, or that nothing was radiated.

        Raises
        ------
        ConfigurationError
            If it cannot be written.
        """
        try:
            with self._path.open("w", encoding="ascii") as file:
                edges = self._write(file)
        except OSError as error:
            raise ConfigurationError(
                f"--capture {self._path}: {os.strerror(error.errno or 0)}"
            ) from error
        return f"{self._path}: {edges} edges of {self._count} pins, {len(self._acts)} changes"

    # --- waveforms -----------------------------------------------------------------------------

    def _write(self, file: TextIO) -> int:
        names = [CARRIER, LATCH, *(f"e{n}" for n in range(self._count))]
        codes = [_code(number) for number in range(len(names))]
        file.write("$comment drive pins of a virtual board of Haptogram $end\n")
        file.write("$timescale 1 ns $end\n$scope module pins $end\n")
        for name, code in zip(names, codes, strict=True):
            file.write(f"$var wire 1 {code} {name} $end\n")
        file.write("$upscope $end\n$enddefinitions $end\n#0\n$dumpvars\n")
        file.writelines(f"0{code}\n" for code in codes)
        file.write("$end\n")
        edges = 0
        ns_per_sample = 1e9 / self._config.capture_rate_hz
        for samples, channels, levels in self._segments():
            edges += len(samples)
            _write_edges(file, np.rint(samples * ns_per_sample).astype(np.int64), channels, levels)
        return edges

    def _segments(self) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
        """Yield sample, channel and level of the edges, piece by piece, in order."""
        if not self._acts:
            return
        first_us = self._acts[0][0] // self._period_us * self._period_us
        samples = self._period_us * 1e-6 * self._config.capture_rate_hz
        samples *= 1.0 + self._config.capture_ppm * 1e-6
        pins = PinSampler(self._count, samples)
        signals = PinSampler(_SIGNALS, samples)
        silent = Pulses.of_weights(np.zeros(self._count, np.complex128))
        for begin, end, pulses, is_latch in self._pieces(first_us, silent):
            latched = 0.5 if is_latch else 0.0
            once = Pulses(np.array([0.0, begin % 1.0]), np.array([0.5, latched]))
            pieces = [pins.edges(pulses, begin, end)]
            split = min(end, begin + 1.0)
            pieces.append(signals.edges(once, begin, split))
            idle = Pulses(np.array([0.0, 0.0]), np.array([0.5, 0.0]))
            pieces.append(signals.edges(idle, split, end))
            times = np.concatenate([piece[0] for piece in pieces])
            shifts = (_SIGNALS, 0, 0)
            channels = np.concatenate(
                [p[1] + shift for p, shift in zip(pieces, shifts, strict=True)]
            )
            levels = np.concatenate([piece[2] for piece in pieces])
            order = np.argsort(times, kind="stable")
            yield times[order], channels[order], levels[order]

    def _pieces(self, first_us: int, silent: Pulses) -> Iterator[tuple[float, float, Pulses, bool]]:
        """Yield begin, end and pulses of every piece in which no pin changes its drive."""
        lead = _QUIET_PERIODS
        end = self._config.capture_ms * 1000.0 / self._period_us + lead
        if not self._is_full:
            end = (self._acts[-1][0] - first_us) / self._period_us + 2.0 * lead
        yield 0.0, lead, silent, False
        pulses = silent
        for place, (t_us, weights) in enumerate(self._acts):
            begin = (t_us - first_us) / self._period_us + lead
            until = end
            if place + 1 < len(self._acts):
                until = (self._acts[place + 1][0] - first_us) / self._period_us + lead
            after = silent if weights is None else Pulses.of_weights(weights)
            is_latch = weights is not None
            for late, old in self._late_pins(pulses, after):
                moment = min(begin + late, until)
                yield begin, moment, old, is_latch
                begin, is_latch = moment, False
            yield begin, until, after, is_latch
            pulses = after

    def _late_pins(self, before: Pulses, after: Pulses) -> Iterator[tuple[float, Pulses]]:
        """Yield how long the pins are mixed of old and new drive, and that mixture."""
        passed = 0.0
        for late in np.unique(self._late[self._late > 0.0]).tolist():
            old = self._late >= late
            mixed = Pulses(
                np.where(old, before.rises, after.rises), np.where(old, before.duties, after.duties)
            )
            yield late / self._period_us - passed, mixed
            passed = late / self._period_us


def _weights_of(latch: AnyLatch) -> ComplexArray:
    if isinstance(latch, Latch):
        return latch.radiated.weights()
    if latch.radiated is None:
        raise TypeError("a unit's own latch; only a dialect knows which emitters its pulses drive")
    return latch.radiated


def _code(number: int) -> str:
    """Return an identifier of VCD: one or two printable characters."""
    base = len(_CODES)
    return _CODES[number] if number < base else _CODES[number // base - 1] + _CODES[number % base]


def _write_edges(
    file: TextIO, times_ns: np.ndarray, channels: np.ndarray, levels: np.ndarray
) -> None:
    codes = [_code(number) for number in range(int(channels.max(initial=0)) + 1)]
    last = -1
    words = []
    for t_ns, channel, level in zip(
        times_ns.tolist(), channels.tolist(), levels.tolist(), strict=True
    ):
        if t_ns != last:
            words.append(f"#{t_ns}\n")
            last = t_ns
        words.append(f"{int(level)}{codes[channel]}\n")
    file.write("".join(words))
