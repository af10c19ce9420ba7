"""Pins of emulated boards of other makers, as an analyser sees them, with defects of real ones.

Codes go to a board as the host sends them; what the board latches becomes levels of pins, step by
step of its carrier, sampled at the rate of an analyser.
"""

from dataclasses import dataclass, field

import numpy as np

from haptogram.acoustics import AcousticModel, Medium, Transducer
from haptogram.acoustics.model.boards.table import LAYOUTS
from haptogram.driver.frames.dialect_frames import DialectFrameBuilder, dialect_display_of
from haptogram.records.frame import Focus
from haptogram_protocol.dialects.table import DIALECTS
from pin_oracle import Analyser, write_sr, write_vcd
from sim_device.dialects.table import EMULATIONS


def model_of(dialect):
    return AcousticModel(LAYOUTS[DIALECTS[dialect].layout].array(), Medium.air(20.0), Transducer())


def frames_of(dialect, count, seed=1):
    """Return frames of random foci, as the driver of this dialect makes them."""
    model = model_of(dialect)
    display = dialect_display_of(DIALECTS[dialect], 1)
    places = np.random.default_rng(seed).uniform(-0.03, 0.03, (count, 3)) + np.array(
        [0.0, 0.0, 0.13]
    )
    builder = DialectFrameBuilder(model, display, tuple(range(model.array.count)))
    return builder.build([(Focus.at(place),) for place in places], "naive")


@dataclass
class CapturedBoard:
    """A run on an emulated board, and what its pins do."""

    dialect: str
    frames: list
    gap_s: float = 12e-3  # from frame to frame
    carrier_hz: float = 40_000.0
    late_step: tuple = ()  # channels that are one step late
    late_us: dict = field(default_factory=dict)  # by channel
    every: int = 1  # periods in which pins pulse
    busy_s: float = 0.0  # before each latch, in which bytes arrive and periods are drawn out
    left_out: tuple = ()  # frames that the board does not get
    seed: int = 1

    def __post_init__(self):
        emulation, dialect = EMULATIONS[self.dialect], DIALECTS[self.dialect]
        options = emulation.options.of()
        unit, end, host = emulation.unit(options, 0), emulation.end(options), dialect.host()
        display = dialect_display_of(dialect, 1)
        shown = [display.off(), *(display.frame(frame.codes) for frame in self.frames)]
        for number, operations in enumerate(shown):
            if number - 1 in self.left_out:
                continue
            for operation in operations:
                for taken in end.receive_data(host.send(operation)):
                    unit.take(taken, round((number + 0.5) * self.gap_s * 1e6))
        for operation in display.off():
            for taken in end.receive_data(host.send(operation)):
                unit.take(taken, round((len(shown) + 0.5) * self.gap_s * 1e6))
        self.latches = unit.take_latches()
        self.end_s = (len(shown) + 1) * self.gap_s
        self.intended = [frame.intended(number) for number, frame in enumerate(self.frames)]
        self.steps = self.latches[0].pulses.steps

    def grid_s(self):
        """Return (K, steps) the times at which the steps of the periods begin."""
        random = np.random.default_rng(self.seed)
        count = int(self.end_s * self.carrier_hz)
        slots = np.full((count, self.steps), 1.0 / self.carrier_hz / self.steps)
        if self.busy_s:
            begins = np.arange(count) / self.carrier_hz
            to_latch = (begins / self.gap_s - 0.5) % 1.0 * self.gap_s
            busy = np.flatnonzero(self.gap_s - to_latch < self.busy_s)
            for _ in range(4):
                drawn = random.integers(0, self.steps, len(busy))
                slots[busy, drawn] += random.uniform(0.0, 0.12, len(busy)) / self.carrier_hz
        flat = np.concatenate([[0.0], np.cumsum(slots)[:-1]])
        return flat.reshape(slots.shape)

    def edges_s(self):
        """Return begin and end of all pulses of each channel, (P, 2) seconds."""
        grid = self.grid_s()
        flat = np.append(grid.ravel(), grid[-1, -1] + np.arange(1, 2 * self.steps) * 1e-6)
        found = [[] for _ in range(self.latches[0].pulses.count)]
        times = np.array([latch.t_latch_us for latch in self.latches]) * 1e-6
        firsts = np.append(np.searchsorted(grid[:, 0], times), len(grid))
        for number, latch in enumerate(self.latches):
            periods = np.arange(firsts[number], firsts[number + 1], self.every)
            for channel in np.flatnonzero(latch.pulses.widths):
                rise = int(latch.pulses.rises[channel]) + (channel in self.late_step)
                begin = periods * self.steps + rise
                pulses = np.stack([flat[begin], flat[begin + latch.pulses.widths[channel]]], axis=1)
                end = flat[firsts[number + 1] * self.steps] if number + 1 < len(times) else np.inf
                pulses = pulses[pulses[:, 0] < end]
                pulses[:, 1] = np.minimum(pulses[:, 1], end)
                found[channel].append(pulses + self.late_us.get(channel, 0.0) * 1e-6)
        return [np.concatenate(one) if one else np.zeros((0, 2)) for one in found]

    def bytes_s(self):
        """Return (P, 2) the times at which the line of the host is low: bytes 55h, at 115 200."""
        bit_s = 1.0 / 115_200
        periods = self.grid_s()[:, 0]
        ends = periods[np.searchsorted(np.arange(len(periods)) / self.carrier_hz, self.swaps_s())]
        starts = [np.arange(end - self.busy_s, end - 10 * bit_s, 10 * bit_s) for end in ends]
        lows = np.concatenate(starts)[:, None] + bit_s * np.arange(0, 10, 2)
        return np.stack([lows.ravel(), lows.ravel() + bit_s], axis=1)

    def swaps_s(self):
        """Return when the host's frames take their place, in undisturbed time."""
        return np.array([latch.t_latch_us for latch in self.latches if latch.t_latch_us]) * 1e-6

    def levels(self):
        """Return (steps in all, channels) the levels of the pins, step by step."""
        step_s = 1.0 / self.carrier_hz / self.steps
        total = int(self.end_s / step_s)
        change = np.zeros((total + 2, self.latches[0].pulses.count), np.int8)
        for channel, pulses in enumerate(self.edges_s()):
            at = np.minimum(np.rint(pulses / step_s).astype(np.int64), total)
            np.add.at(change[:, channel], at[:, 0], 1)
            np.add.at(change[:, channel], at[:, 1], -1)
        return np.cumsum(change, axis=0)[:total] > 0

    def capture(self, path, channels=None, rate_hz=24e6, *, clock=True):
        """Write what an analyser sees of some pins, ``p0``, ``p1``, ... and the clock ``sync``."""
        analyser = Analyser(rate_hz)
        edges = self.edges_s()
        wanted = range(len(edges)) if channels is None else channels
        found = {f"p{channel}": sampled(edges[channel], rate_hz) for channel in wanted}
        if clock:
            starts = self.grid_s()[:: self.every, [0, self.steps // 2]]
            found["sync"] = sampled(starts, rate_hz)
        if self.busy_s:
            found["rx"] = sampled(self.bytes_s(), rate_hz)[0], True
        write = write_sr if path.suffix == ".sr" else write_vcd
        write(path, found, analyser, self.end_s)
        return path

    def capture_shift(self, path, chains, rate_hz=200e6, *, late_bit=False, until_s=None):
        """Write DATA, SHIFT and LATCH lines of chains of 74HC595: elements from output 0 on.

        With *late_bit* the last bit of each group comes behind the edge of LATCH.
        """
        levels = self.levels()
        count = len(chains[0])
        step_s = 1.0 / self.carrier_hz / self.steps
        total_s = until_s or self.end_s
        levels = levels[: int(total_s / step_s) - 1]
        slot_s = step_s / (count + 1)
        begins = np.arange(len(levels)) * step_s
        moments = begins[:, None] + slot_s * (np.arange(count) + 0.5)
        latch = begins + step_s - slot_s * (2.0 if late_bit else 0.4)
        shift = np.stack([moments.ravel(), moments.ravel() + slot_s * 0.4], axis=1)
        found = {
            "SHIFT": sampled(shift, rate_hz),
            "LATCH": sampled(np.stack([latch, latch + slot_s * 0.3], axis=1), rate_hz),
        }
        if late_bit:  # what the register holds by then: it lags by a bit
            order = [*range(count - 2, -1, -1), count - 1]
        else:
            order = list(range(count - 1, -1, -1))
        for number, elements in enumerate(chains):
            bits = levels[:, [elements[place] for place in order]].ravel()
            at = (moments - slot_s * 0.4).ravel()
            changed = np.flatnonzero(np.diff(bits, prepend=False))
            samples = np.ceil(at[changed] * rate_hz).astype(np.int64)
            found[f"DATA{number}"] = samples, False
        write = write_sr if path.suffix == ".sr" else write_vcd
        write(path, found, Analyser(rate_hz), total_s)
        return path


def sampled(pulses_s, rate_hz):
    """Return the samples at which a channel changes, and its first level."""
    samples = np.ceil(np.sort(pulses_s.ravel()) * rate_hz - 1e-6).astype(np.int64)
    values, counts = np.unique(samples, return_counts=True)
    return values[counts % 2 == 1], False
