"""The boards on a line, if another process simulates them: bytes in, pins and bytes out."""

from __future__ import annotations

import dataclasses
import logging
from collections import Counter, deque
from collections.abc import Mapping
from typing import Final

from haptogram.acoustics.model.pulses import PulseDrive
from haptogram_protocol.dialects.codec import Operation

from ...board.clock import earliest_board_time
from ...board.events import PulseLatch
from ...board.settings import BoardSettings
from ..unit import Unit
from ..virtual_dialect import VirtualDialect
from .capture import SimulatedCapture
from .pins import STEPS, SimulatedPins
from .process import SentByte, SimulatorProcess

POWER_UP: Final = "power-up"
PINS: Final = "pins"
_POLL_US: Final = 5_000  # period of polls at the wall clock: delay of the board's own messages
_PERIODS_AHEAD: Final = 4  # periods after the power-up until the drive is known
_NS_PER_US: Final = 1_000
_LOG: Final = logging.getLogger(__name__)


class SimulatedUnit:
    """A unit whose drives are those of the pins of a simulator; see :class:`~..unit.Unit`.

    The unit of the dialect goes along: it says which operations change nothing, and yet are a latch
    of the drive that the pins show.

    Parameters
    ----------
    settings : BoardSettings
        The board, which takes bytes from its power-up on: its simulator, its line, its pins, and
        the file that takes down what they do.
    expected : Unit or None
        The unit of the dialect.

    Raises
    ------
    ConfigurationError
        There is no such simulator, or its board has too few pins.
    LinkLostError
        It has ended, does not answer, or makes no sense.
    """

    def __init__(self, settings: BoardSettings, expected: Unit | None = None) -> None:
        baud, capture, wiring = settings.line.baud, settings.simulator_capture, settings.wiring
        channels = 1 if wiring is None else 1 + max(wiring.channels)
        self._process = SimulatorProcess(settings.simulator or "", baud, channels)
        hello = self._process.hello
        self._byte_ns = 1e10 / baud if baud else 0.0
        self._capture = None if capture is None else SimulatedCapture(capture, hello, self._byte_ns)
        self._pins = SimulatedPins(len(hello.pins), hello.period_ns)
        self._expected = expected
        self._expected_pins = None if expected is None else self._power_up_drive(expected)
        self._latches: list[PulseLatch] = []  # in their order
        self._sent: deque[SentByte] = deque()
        self._now_us = self._boot_us = settings.boot_us
        self._is_lost = self._has_warned = False
        periods = -(-hello.start_ns // hello.period_ns) + _PERIODS_AHEAD
        self._boot_ns = periods * hello.period_ns
        self._power_up()
        _LOG.info("simulated by %s", hello.by or settings.simulator)

    def _power_up(self) -> None:
        """Boot the board; its drive then counts as the power-up drive."""
        self._run(self._boot_ns)
        shown = self._latches[-1:] or [PulseLatch(0, PulseDrive.off(self._pins.count, STEPS), "")]
        self._shown = dataclasses.replace(shown[0], t_latch_us=self._now_us, cause=POWER_UP)
        self._latches = [self._shown]
        self._sent.clear()  # nobody has heard it

    @property
    def counters(self) -> Counter[str]:
        """Counts of the operations that the boards cannot do, and of pins that do not repeat."""
        pins = {"pins_unsteady": self._pins.unsteady, "pins_at_half_carrier": self._pins.halved}
        return Counter(pins) + (Counter() if self._expected is None else self._expected.counters)

    def announce(self, begin_us: float, data: bytes) -> None:
        """Put *data* on the line, back to back, from a device time on."""
        begin_ns = self._ns_at(begin_us)
        times = [begin_ns + round(place * self._byte_ns) for place in range(len(data))]
        self._process.announce(times, data)
        if self._capture is not None:
            for t_ns, value in zip(times, data, strict=True):
                self._capture.carried("to_board", t_ns, value)

    def run_ahead(self, until_us: int) -> None:
        """Let time pass at the board, up to *until_us* or to the first byte that it sends."""
        if not self._sent:
            self._run(self._ns_at(until_us), stops=True)

    def take(self, operation: Operation, t_us: int) -> list[bytes]:
        """Note a latch of the same drive, if *operation* changes nothing by the dialect."""
        sent = self.advance_to(t_us)
        if self._expected is None or self._is_lost:
            return sent
        self._expected.advance_to(t_us)
        self._expected.take(operation, t_us)
        for latch in self._expected.take_latches():
            before, self._expected_pins = self._expected_pins, self._on_pins(latch.pulses)
            if self._expected_pins == before:
                past = [known for known in self._latches if known.t_latch_us <= t_us]
                again = dataclasses.replace((past or [self._shown])[-1], cause=latch.cause)
                self._latches.insert(len(past), dataclasses.replace(again, t_latch_us=t_us))
        return sent

    def next_event_us(self) -> int | None:
        """Return the time of what is known to come, else of the next look at the board."""
        latch_us = self._latches[0].t_latch_us if self._latches else None
        sent_us = self._us_at(self._sent[0].t_ns) if self._sent else None
        look_us = None if self._is_lost else self._us_at(self._process.now_ns) + _POLL_US
        return earliest_board_time(latch_us, sent_us, look_us)

    def advance_to(self, t_us: int) -> list[bytes]:
        """Let time pass at the board; return the bytes that it sends."""
        t_ns, sent = self._ns_at(t_us), bytearray()
        self._run(t_ns)
        self._now_us = max(self._now_us, t_us)
        while self._sent and self._sent[0].t_ns <= t_ns:
            sent.append(self._sent.popleft().value)
        return [bytes(sent)]

    def take_latches(self) -> list[PulseLatch]:
        """Return the latches since the last call, in order."""
        taken = [latch for latch in self._latches if latch.t_latch_us <= self._now_us]
        self._latches = self._latches[len(taken) :]
        self._shown = (taken or [self._shown])[-1]
        return taken

    def power_down(self) -> None:
        """End the simulator."""
        if self._capture is not None:
            self._capture.close(self._process.now_ns)
            self._capture = None
        self._is_lost = True
        self._process.close()

    def _run(self, until_ns: int, *, stops: bool = False) -> None:
        """Run the process to *until_ns*; with *stops* no further than the first byte it sends.

        Pin changes become latches; sent bytes are kept until they are taken.
        """
        while not self._is_lost and self._process.now_ns < until_ns:
            self._is_lost = True  # unless it answers
            text, sent = self._process.grant(until_ns)
            try:
                self._take_pins(text)
                if self._capture is not None:
                    self._write_capture(self._capture, text, sent)
            except ValueError as error:
                self._process.fail(f"wrote {error}")
            self._is_lost = False
            self._sent += sent
            if sent and stops:
                return

    def _write_capture(self, capture: SimulatedCapture, text: bytes, sent: list[SentByte]) -> None:
        """Write pin changes and sent bytes of the simulator to the capture."""
        capture.changed(text)
        for t_ns, value in sent:
            capture.carried("to_host", t_ns - self._byte_ns, value)
        capture.write(self._process.now_ns)

    def _take_pins(self, text: bytes) -> None:
        """Append latches for changes of pins; end the process if its periods are miscounted.

        Their number must be that of the whole carrier periods that have passed.
        """
        for t_ns, pulses in self._pins.take(text):
            self._latches.append(PulseLatch(self._us_at(t_ns), pulses, PINS))
        if self._pins.halved and not self._has_warned:
            self._has_warned = True
            _LOG.warning("half the carrier: pins repeat after %d ns", 2 * self._pins.period_ns)
        due = self._process.now_ns // self._pins.period_ns
        if self._pins.periods != due:
            self._process.fail(
                f"told of {self._pins.periods} periods of the carrier up to "
                f"{self._process.now_ns} ns, must be {due}"
            )

    def _ns_at(self, t_us: float) -> int:
        """Return the time of the simulator at a device time."""
        return self._boot_ns + round((t_us - self._boot_us) * _NS_PER_US)

    def _us_at(self, t_ns: int) -> int:
        """Return the device time at which the simulator's clock shows *t_ns*."""
        return self._boot_us - (self._boot_ns - t_ns) // _NS_PER_US

    def _power_up_drive(self, unit: Unit) -> PulseDrive:
        """Return the drive that a unit of our emulation shows at power-up, on connected pins."""
        return self._on_pins(unit.take_latches()[-1].pulses)

    def _on_pins(self, pulses: PulseDrive) -> PulseDrive:
        """Return the pulses without channels that have no pin."""
        count = self._pins.count
        levels = {channel: text for channel, text in pulses.levels.items() if channel < count}
        return PulseDrive(pulses.rises[:count], pulses.widths[:count], pulses.steps, levels)


class SimulatedBoard(VirtualDialect):
    """A simulator at the end of the line.

    Only its own trace tells which number a latch has.

    Parameters
    ----------
    settings : BoardSettings
        Its simulator and its line.
    """

    def __init__(self, settings: BoardSettings) -> None:
        super().__init__(settings.boot_us)
        self._unit = self.ahead = SimulatedUnit(settings)
        self.announce = self._unit.announce

    @property
    def counters(self) -> Mapping[str, int]:
        """Counts of pins that do not repeat."""
        return self._unit.counters

    def next_frame_end(self, data: bytes, at: int) -> int:  # noqa: ARG002  the board has them
        """Return the end of *data*."""
        return len(data)

    def receive(self, data: bytes, t_us: int) -> None:  # noqa: ARG002  the board has them
        """Let time pass."""
        self.advance_to(t_us)

    def next_event_us(self) -> int | None:
        """Return the time of what is known to come, else of the next look at the board."""
        return self._unit.next_event_us()

    def advance_to(self, t_us: int) -> None:
        """Let time pass at the board."""
        for sent in self._unit.advance_to(t_us):
            self._output += sent
        self._unit.take_latches()
        self._now_us = max(self._now_us, t_us)
