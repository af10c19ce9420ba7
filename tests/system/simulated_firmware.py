"""A simulator of any board that is emulated here, at the end of a real line.

``simulated_firmware.py [DIALECT|own] [lingers]``: with it the pins sound on for 2 ms when the
output is off.
"""

import sys

import numpy as np

from haptogram.acoustics import AcousticModel
from haptogram.settings.board import BoardConfig
from haptogram_protocol.state import OutputState
from sim_device.assembly import HEALTHY
from sim_device.backdoor.pin_waveforms import PinWaveformPulses
from sim_device.blueprint import blueprint_of
from sim_device.board.events import Latch, StateChange
from sim_device.board.settings import BOOT_US, BoardSettings

PERIOD_NS, NX, NY = 25_000, 5, 3


def period_text(weights):
    """Return the changes of a period with the pulses of *weights*, which begins a quarter late."""
    count = len(weights)
    if not weights.any():
        return ""
    pulses = PinWaveformPulses.of_weights(weights)
    rises = np.rint(pulses.rises * PERIOD_NS).astype(int) % PERIOD_NS
    falls = np.rint((pulses.rises + pulses.duties) * PERIOD_NS).astype(int) % PERIOD_NS
    on = pulses.duties > 0
    lines = []
    for t_ns in sorted({*rises[on].tolist(), *falls[on].tolist()}):
        since, width = (t_ns - rises) % PERIOD_NS, (falls - rises) % PERIOD_NS
        high = sum(1 << pin for pin in np.flatnonzero(on & (since < width)).tolist())
        lines.append(f"P {t_ns} {high:0{-(-count // 4)}x}")
    return "\n".join(lines) + "\n"


class Firmware:
    """The board, which takes whole bytes, and sends them one after the other."""

    def __init__(self, dialect, way):
        settings, parts = BoardSettings(model=AcousticModel.default(NX, NY)), HEALTHY
        if dialect != "own":
            blueprint = blueprint_of(BoardConfig.of(dialect=dialect))
            settings, parts = blueprint.settings, blueprint.parts
        self.count = settings.count if settings.wiring is None else settings.wiring.channel_count
        self.board = parts.assemble(settings)
        self.lingers_us = 2_000 if way == "lingers" else 0
        self.bit_ns, self.line, self.period, self.free_ns = 0, [], 0, 0
        self.sending = bytearray()
        self.silent = self.text = period_text(np.zeros(self.count))
        self.changes = []

    def step(self, t_ns, data=b""):
        if not self.sending:
            self.free_ns = max(self.free_ns, t_ns)
        sent_ns = self.free_ns + 10 * self.bit_ns * len(self.sending)
        self.board.line_free_us = BOOT_US + sent_ns // 1000
        self.board.receive(data, BOOT_US + t_ns // 1000)
        self.sending += self.board.take_output()
        for seen in self.board.take_latches():
            own = isinstance(seen, Latch)
            weights = seen.radiated.weights() if own else seen.pulses.weights()
            self.changes.append((seen.t_latch_us, period_text(weights)))
        for notice in self.board.take_notices():
            if isinstance(notice, StateChange) and notice.state is not OutputState.ARMED:
                self.changes.append((notice.t_us + self.lingers_us, self.silent))

    def run(self, until_ns):
        """Return the lines of a grant."""
        lines, sent, now = [], "", 0
        while not sent:
            next_us = self.board.next_event_us()
            own = until_ns if next_us is None else (next_us - BOOT_US) * 1000
            comes = self.line[0][0] + 10 * self.bit_ns if self.line else until_ns
            goes = self.free_ns + 10 * self.bit_ns if self.sending else until_ns
            now = min(own, -(-comes // 1000) * 1000, goes, until_ns)
            if self.sending and now == goes:
                self.free_ns = now
                sent = f"R {now} {self.sending.pop(0):02x}\n"
            if self.line and now >= comes:
                self.step(now, bytes([self.line.pop(0)[1]]))
            elif now % 1000 == 0 and now >= own:
                self.step(now)
            self.lines_up_to(now, lines)
            if now >= until_ns:
                break
        return "".join(lines) + sent + f". {now}\n"

    def lines_up_to(self, now, lines):
        while self.period <= now:
            if self.period:
                lines.append(f"{self.text}|\n")
            while self.changes and self.changes[0][0] - BOOT_US <= self.period // 1000:
                self.text = self.changes.pop(0)[1]
            self.period += PERIOD_NS


def main(dialect="own", way=None):
    firmware = Firmware(dialect, way)
    names = " ".join(f"e{pin}" for pin in range(firmware.count))
    hello = f"hello 1\nby the virtual board\npins {names}\nperiod {PERIOD_NS}\n. 0\n"
    for line in sys.stdin:
        word, number, *rest = line.split()
        answer = ""
        if word == "L":
            firmware.bit_ns, answer = int(number), hello
        elif word == "B":
            firmware.line.append((int(number), int(rest[0], 16)))
        else:
            answer = firmware.run(int(number))
        sys.stdout.write(answer)
        sys.stdout.flush()


if __name__ == "__main__":
    main(*sys.argv[1:])
