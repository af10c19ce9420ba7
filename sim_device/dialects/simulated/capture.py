"""The pins and the line of a simulated board in a VCD file, as a logic analyser sees them."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Final

from haptogram.errors import ConfigurationError, writing_file

from ...line.vcd import vcd_identifier, write_vcd_head
from .process import PERIOD, SAME, SimulatedHello, count_of_same

_LINES: Final = ("carrier", "to_board", "to_host")
_BITS: Final = 10  # bits of a byte on the line
_LAST_TIME: Final = re.compile(r"#([0-9]{1,18})\n[^#]*\Z")
_OFF_NS: Final = 1_000_000  # gap in the capture for a reset of the board


class SimulatedCapture:
    """A VCD file, to which each power-up of a board is appended.

    Parameters
    ----------
    path : Path
        The file; it is made if there is none.
    hello : SimulatedHello
        The board.
    byte_ns : float
        Time of a byte on the line.

    Raises
    ------
    ConfigurationError
        If it cannot be written, or is there and no capture.
    """

    def __init__(self, path: Path, hello: SimulatedHello, byte_ns: float) -> None:
        self._path, self._period_ns, self._bit_ns = path, hello.period_ns, byte_ns / _BITS
        names = [*_LINES, *hello.pins]
        self._codes = [vcd_identifier(number) for number in range(len(names))]
        self._all = (1 << len(hello.pins)) - 1
        self._hold_ns = max(round(byte_ns), hello.period_ns)  # until all of a time is known
        self._high = self._periods = 0
        self._changes: list[tuple[int, int]] = []  # since the period began, and levels
        self._last = self._changes
        self._edges: list[tuple[int, str]] = []  # that are not written yet
        with writing_file(path, "--simulator-capture"):
            self._file = path.open("a+", encoding="ascii", errors="replace")
        self._offset_ns = self._end_of_file_ns()
        if not self._offset_ns:
            write_vcd_head(self._file, names, _LINES[1:])

    def _end_of_file_ns(self) -> int:
        """Return when to continue the capture in the file: 1 ms after its end, 0 if empty.

        ConfigurationError if the file is there and no capture.
        """
        size = self._file.seek(0, os.SEEK_END)
        self._file.seek(max(0, size - 100))
        last = _LAST_TIME.search(self._file.read())
        if size and last is None:
            self._file.close()
            raise ConfigurationError(f"--simulator-capture {self._path}: is there and no capture")
        return int(last[1]) + _OFF_NS if last else 0

    def carried(self, line: str, begin_ns: float, value: int) -> None:
        """Take down a byte, whose start bit begins at a time."""
        code, before = self._codes[_LINES.index(line)], 1
        for place, bit in enumerate((0, *(value >> n & 1 for n in range(8)), 1)):
            if bit != before:
                self._edges.append((round(begin_ns + place * self._bit_ns), f"{bit}{code}\n"))
            before = bit

    def changed(self, text: bytes) -> None:
        """Take down changes of pins, as they come; see :meth:`SimulatedPins.take`."""
        for line in text.splitlines(keepends=True):
            if line == PERIOD:
                self._last, self._changes = self._changes, []
                self._end_periods(1)
            elif line.startswith(SAME):
                self._end_periods(count_of_same(line.rstrip()))
            elif line.strip():
                _, since, levels = line.split()
                self._changes.append((int(since), int(levels, 16) & self._all))

    def _end_periods(self, count: int) -> None:
        """Append *count* whole carrier periods to the capture, each with the last pin changes."""
        edges: list[tuple[int, str]] = []
        for number in range(count):
            if number < 2:
                edges = [(since_ns, self._edges_to(levels)) for since_ns, levels in self._last]
            begin_ns = self._periods * self._period_ns
            self._periods += 1
            self._edges.append((begin_ns, f"1{self._codes[0]}\n"))
            self._edges.append((begin_ns + self._period_ns // 2, f"0{self._codes[0]}\n"))
            self._edges += [(begin_ns + since_ns, text) for since_ns, text in edges]

    def _edges_to(self, high: int) -> str:
        """Return VCD text of the pins whose level *high* (a bit for each) changes; store *high*."""
        changed, self._high = high ^ self._high, high
        edges = ""
        while changed:
            pin = (changed & -changed).bit_length() - 1
            edges += f"{high >> pin & 1}{self._codes[len(_LINES) + pin]}\n"
            changed &= changed - 1
        return edges

    def write(self, up_to_ns: int) -> None:
        """Write what happened up to a time; bytes and periods that last are written later."""
        self._edges.sort(key=lambda edge: edge[0])
        last_ns = -1
        for count, (t_ns, text) in enumerate(self._edges):
            if t_ns > up_to_ns - self._hold_ns:
                self._edges = self._edges[count:]
                return
            self._file.write(f"#{t_ns + self._offset_ns}\n{text}" if t_ns > last_ns else text)
            last_ns = t_ns
        self._edges = []

    def close(self, now_ns: int) -> None:
        """Write the rest: the pins of a board without power are low."""
        self._last = [*self._changes, (now_ns - self._periods * self._period_ns, 0)]
        self._end_periods(1)
        self.write(now_ns + self._hold_ns)
        self._file.write(f"#{now_ns + self._offset_ns}\n")
        self._file.close()
