"""A simulator in Python: SonicSurface's wire on a few pins, and what else a simulator may do.

``python_simulator.py PINS [WHAT]``; WHAT is one of the ways to misbehave in :data:`WAYS`, which
begins at the first frame.
"""

import sys
import time

PERIOD_NS, STEPS, START_NS = 25_000, 32, 100_000
WAYS = (
    "dies",
    "hangs",
    "late",
    "back",
    "ahead",
    "stops",
    "garbage",
    "skips",
    "bad-pins",
    "bad-byte",
    "echo",
    "no-clocks",
    "half",
    "same",
)


def period_text(codes, digits):
    """Return the changes of a period in which every pin is high for half of it."""
    changes = []
    for step in range(STEPS):
        high = sum(
            1 << pin
            for pin, code in enumerate(codes)
            if code < STEPS and (step - code) % STEPS < 16
        )
        changes.append(f"P {step * PERIOD_NS // STEPS} {high:0{digits}x}")
    return "\n".join(changes) + "\n|\n"


class Simulator:
    """The board between the lines of its input."""

    def __init__(self, pins, way):
        self.pins, self.way, self.misbehaves = pins, way, False
        self.bit_ns, self.line, self.reached, self.period = 0, [], 0, PERIOD_NS
        self.codes, self.next, self.channel = [0] * pins, [0] * pins, 0
        self.text, self.listens, self.clocked = "", True, True
        self.show()
        self.begun, self.told, self.same = self.text, None, 0  # the period now, the last, its like

    def show(self):
        codes = self.codes if self.clocked else [STEPS] * self.pins
        self.text = period_text(codes, -(-self.pins // 4))

    def take(self, byte):
        if byte in (0xC0, 0xC1):
            self.listens = byte == 0xC0
        elif byte in (0x96, 0x97) and self.way != "no-clocks":
            self.clocked = byte == 0x97
            self.show()
        elif byte == 0xFD:
            self.codes, self.next, self.channel = self.next, self.codes, 0
            self.show()
            self.misbehaves = self.way is not None
        elif self.listens:
            if byte == 0xFE:
                self.channel = -1
            elif self.channel < self.pins:
                self.next[self.channel] = byte if byte == STEPS else byte % STEPS
            self.channel = (self.channel + 1) % 256

    def run(self, until):
        """Return the lines of a grant."""
        lines = []
        while True:
            due = self.line[0][0] + 10 * self.bit_ns if self.line else until + 1
            while self.period <= min(due, until):
                if self.way == "half":
                    high = self.period // PERIOD_NS % 2 * (2**self.pins - 1)
                    self.begun = f"P 100 {high:0{-(-self.pins // 4)}x}\n|\n"
                self.tell_period(lines)
                self.period += PERIOD_NS
            if due > until:
                break
            byte = self.line.pop(0)[1]
            self.take(byte)
            if self.way == "echo":
                self.reached = due
                self.tell_same(lines)
                return "".join(lines) + f"R {due} {byte:02x}\n. {due}\n"
        self.tell_same(lines)
        stop, self.reached = until, until
        if self.misbehaves:
            stop = self.misbehave(lines, until)
        return "".join(lines) + f". {stop}\n"

    def tell_period(self, lines):
        """Tell of the period that has ended; "same" counts what is like the last one."""
        if self.way == "same" and self.begun == self.told:
            self.same += 1
        else:
            self.tell_same(lines)
            lines.append(self.begun)
        self.told, self.begun = self.begun, self.text

    def tell_same(self, lines):
        if self.same:
            lines.append(f"= {self.same}\n")
        self.same = 0

    def misbehave(self, lines, until):
        if self.way == "dies":
            sys.exit("out of memory in the 3rd process")
        if self.way == "hangs":
            time.sleep(600)
        if self.way == "late":
            time.sleep(0.2)
        if self.way == "garbage":
            lines.append("Warning: metavalue detected\n")
        if self.way == "bad-pins":
            lines.append("P 30000 0000\n|\n")
        if self.way == "bad-byte":
            lines.append(f"R {until} -1\n")
        if self.way == "skips":
            lines.clear()
        return until + {"back": -50_000_000, "ahead": 1_000, "stops": -1_000}.get(self.way, 0)


def main(pins, way=None, version="1"):
    simulator = Simulator(int(pins), way if way in WAYS else None)
    names = " ".join(f"out{pin}" for pin in range(int(pins)))
    hello = f"hello {version}\nby Python, a board of {pins} pins\npins {names}\n"
    hello += f"period {PERIOD_NS}\nstart {START_NS}\n. 0\n"
    for line in sys.stdin:
        word, number, *rest = line.split()
        answer = ""
        if word == "L":
            simulator.bit_ns, answer = int(number), hello
        elif word == "B":
            simulator.line.append((int(number), int(rest[0], 16)))
        else:
            answer = simulator.run(int(number))
        sys.stdout.write(answer)
        sys.stdout.flush()


if __name__ == "__main__":
    main(*sys.argv[1:])
