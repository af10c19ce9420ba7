"""A logic analyser of our own, for tests: random drives as levels of pins, in VCD and .sr.

It imports nothing of the program: pulses are sampled one sample after the other from a formula, and
what is wrong with them is known because it was put there.
"""

import configparser
import io
import zipfile
from dataclasses import dataclass, field

import numpy as np

CARRIER_HZ = 40_000.0


@dataclass
class Analyser:
    """How the pins are seen."""

    rate_hz: float = 24e6
    ppm: float = 0.0  # of its clock
    jitter_ns: float = 0.0
    glitches: int = 0  # pulses, anywhere
    glitch_samples: int = 1
    skew_ns: float = 0.0  # between channels
    lost: tuple = ()  # (first, count) of samples that never reach the file
    begin_ms: float = -0.5  # of the capture, from the first frame on
    end_ms: float = 0.5  # after the end of the last frame


@dataclass
class Board:
    """What the pins do: (F, N) turns and amplitudes, and what is wrong."""

    turns: np.ndarray
    amplitudes: np.ndarray
    period_ms: float = 1.0
    offset_turn: float = 0.1  # of the carrier's clock
    late_ms: dict = field(default_factory=dict)  # by frame
    lost: tuple = ()
    kept: dict = field(default_factory=dict)  # frames that one pin alone does not latch, by pin
    pin_late_ms: dict = field(default_factory=dict)  # by pin, of every latch
    low: tuple = ()
    high: tuple = ()
    inverted: tuple = ()
    shifted: dict = field(default_factory=dict)  # turns by pin
    stuck: dict = field(default_factory=dict)
    drop: dict = field(default_factory=dict)  # share of the frames in which a pin is silent
    carrier_hz: float = CARRIER_HZ
    mute: bool = True


def edges_of(board, analyser, pins, random):
    """Return (samples of rising and falling edges in order, level at the begin) by channel."""
    period_s = 1.0 / board.carrier_hz
    frame_s = board.period_ms * 1e-3
    count = len(board.turns)
    begin_s = analyser.begin_ms * 1e-3
    end_s = count * frame_s + analyser.end_ms * 1e-3
    found = {}
    cycles = np.arange(np.floor(begin_s / period_s) - 1, np.ceil(end_s / period_s) + 2)
    found["clk"] = _sampled(
        np.stack([cycles * period_s, (cycles + 0.5) * period_s], axis=1),
        analyser,
        random,
        0.0,
        begin_s,
        end_s,
    )
    for pin in pins:
        skew = random.uniform(-0.5, 0.5) * analyser.skew_ns * 1e-9
        pulses = _pulses(board, pin, cycles, period_s, frame_s, random)
        edges, level = _sampled(pulses, analyser, random, skew, begin_s, end_s)
        if pin in board.low or pin in board.high:
            edges, level = edges[:0], pin in board.high
        if pin in board.inverted:
            level = not level
        found[f"p{pin}"] = edges, level
    return found


def _pulses(board, pin, cycles, period_s, frame_s, random):
    """Return the (P, 2) begin and end of the pulses of a pin, cut where the drive changes."""
    count = len(board.turns)
    starts, frames = [], []
    for frame in range(count):
        if frame in board.lost or frame in board.kept.get(pin, ()):
            continue
        late = board.late_ms.get(frame, 0.0) * 1e-3 + board.pin_late_ms.get(pin, 0.0) * 1e-3
        starts.append(np.ceil((frame * frame_s + late) / period_s - 1e-6) * period_s)
        frames.append(frame)
    stop = (count + 0.2) * frame_s if board.mute else np.inf
    starts.append(np.ceil(stop / period_s) * period_s if board.mute else np.inf)
    silent = random.random(count) < board.drop.get(pin, 0.0)
    rows = []
    for number, frame in enumerate(frames):
        begin, end = starts[number], starts[number + 1]
        amplitude = board.amplitudes[frame, pin]
        duty = np.arcsin(amplitude) / np.pi
        turn = board.stuck.get(pin, board.turns[frame, pin]) + board.shifted.get(pin, 0.0)
        if duty <= 0.0 or silent[frame]:
            continue
        middle = (cycles + turn + board.offset_turn) * period_s
        pulses = np.stack([middle - duty / 2 * period_s, middle + duty / 2 * period_s], axis=1)
        pulses = pulses[(pulses[:, 1] > begin) & (pulses[:, 0] < end)]
        rows.append(np.clip(pulses, begin, end))
    return np.concatenate(rows) if rows else np.zeros((0, 2))


def _sampled(pulses, analyser, random, skew_s, begin_s, end_s):
    times = pulses + skew_s + random.normal(0.0, analyser.jitter_ns * 1e-9, pulses.shape)
    times = (times - begin_s) * (1.0 + analyser.ppm * 1e-6)
    samples = np.ceil(times * analyser.rate_hz).astype(np.int64)
    total = int((end_s - begin_s) * analyser.rate_hz)
    change = np.zeros(total + 2, np.int8)
    inside = np.clip(samples, 0, total)
    np.add.at(change, inside[:, 0], 1)
    np.add.at(change, inside[:, 1], -1)
    levels = np.cumsum(change)[:total] > 0
    for place in random.integers(1, total - 1, analyser.glitches):
        levels[place : place + analyser.glitch_samples] ^= True
    for first, count in analyser.lost:
        levels = np.delete(levels, slice(first, first + count))
    edges = np.flatnonzero(np.diff(levels)) + 1
    return edges, bool(levels[0])


def write_vcd(path, found, analyser, total_s):
    """Write the edges with a timescale of 1 ns."""
    names = list(found)
    lines = ["$timescale 1 ns $end", "$scope module pins $end"]
    lines += [f"$var wire 1 {chr(33 + n)} {name} $end" for n, name in enumerate(names)]
    lines += ["$upscope $end", "$enddefinitions $end", "#0", "$dumpvars"]
    lines += [f"{int(found[name][1])}{chr(33 + n)}" for n, name in enumerate(names)]
    lines.append("$end")
    samples = np.concatenate([found[name][0] for name in names])
    texts = [
        f"{int(level) ^ 1 ^ k % 2}{chr(33 + number)}"
        for number, (edges, level) in enumerate(found.values())
        for k in range(len(edges))
    ]
    order = np.argsort(samples, kind="stable").tolist()
    last = None
    for sample, place in zip(samples[order].tolist(), order, strict=True):
        if sample != last:
            lines.append(f"#{round(sample * 1e9 / analyser.rate_hz)}")
            last = sample
        lines.append(texts[place])
    lines.append(f"#{round(total_s * 1e9)}")
    path.write_text("\n".join(lines) + "\n")


def write_sr(path, found, analyser, total_s):
    """Write a session of sigrok: bits of a byte or two for each sample."""
    names = list(found)
    unit = (len(names) + 7) // 8
    total = int(total_s * analyser.rate_hz)
    data = np.zeros((total, unit), np.uint8)
    for number, (edges, level) in enumerate(found.values()):
        bit = np.uint8(1 << number % 8)
        data[edges[edges < total], number // 8] ^= bit
        data[0, number // 8] ^= bit * np.uint8(level)
    np.bitwise_xor.accumulate(data, out=data)  # from flips to levels
    meta = configparser.ConfigParser()
    meta["global"] = {"sigrok version": "0.5.2"}
    meta["device 1"] = {
        "capturefile": "logic-1",
        "total probes": str(len(names)),
        "samplerate": f"{analyser.rate_hz / 1e6:g} MHz",
        **{f"probe{n + 1}": name for n, name in enumerate(names)},
        "unitsize": str(unit),
    }
    text = io.StringIO()
    meta.write(text)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        archive.writestr("version", "2")
        archive.writestr("metadata", text.getvalue())
        archive.writestr("logic-1-1", data.tobytes())
