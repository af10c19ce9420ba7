"""A program of pyautd3's, unmodified, for :mod:`live_clients`; runs in an environment of its own.

::

    python pyautd3_program.py emulate [TIMES [DEVICES]]
                                                   what autd3's own emulator radiates, as JSON
    python pyautd3_program.py record               what pyautd3 sends, as JSON
    python pyautd3_program.py live HOST:PORT CASE [DEVICES]
                                                   one case, against whatever listens there

A case is a function of a session, which sends, waits and knows the time. But for the cases of the
silencer it is told to jump, as the virtual board does.
"""

from __future__ import annotations

import base64
import contextlib
import json
import socket
import struct
import sys
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any, Protocol

import numpy as np
import pyautd3 as autd3
from pyautd3.driver.firmware.fpga.transition_mode import Ext, Immediate, Later, SyncIdx, SysTime
from pyautd3.gain.custom import Custom
from pyautd3.link.remote import Remote, RemoteOption
from pyautd3.modulation.custom import Custom as Samples
from pyautd3_emulator import Emulator

PERIOD_NS = 25_000
START = 40_000  # period in which emulator and recording begin
SECONDS_TO_2000 = 946_684_800
FRAME_BYTES = 626
POSE_BYTES = 28
JUMP = autd3.Silencer(config=autd3.FixedUpdateRate(intensity=65_535, phase=65_535))
FULL = autd3.Static(intensity=0xFF)
TARGET_MM = np.array([96.6, 76.7, 150.0])  # off the planes of symmetry of a device
SECOND, FIRST = autd3.Segment.S1, autd3.Segment.S0


class Session(Protocol):
    """Something to send to."""

    def send(self, datagram: Any) -> None:
        """Send *datagram*; raise AUTDError if a device refuses it."""

    def wait(self, periods: int) -> None:
        """Let *periods* of 25 µs pass."""

    def system_time(self, periods: int) -> Any:
        """Return the system time in *periods* from now."""


def at(point_mm: Any) -> Any:
    """Return a gain with one focus."""
    return autd3.Focus(pos=point_mm, option=autd3.FocusOption())


def sequence(points_mm: list[Any], divider: int) -> Any:
    """Return a sequence of one focus at a time."""
    return autd3.FociSTM(foci=points_mm, config=autd3.SamplingConfig(divider))


def focus(autd: Session) -> None:
    """Send a gain: one focus."""
    autd.send((FULL, at(TARGET_MM)))
    autd.wait(4)


def every_code(autd: Session) -> None:
    """Send gains with every phase and every intensity."""
    for first in (0, 7):

        def drive(_: Any, first: int = first) -> Callable[[Any], Any]:
            return lambda element: autd3.Drive(
                phase=autd3.Phase((element.idx() * 5 + first) % 256),
                intensity=autd3.Intensity((element.idx() + first) % 256),
            )

        autd.send(Custom(drive))
        autd.wait(4)


def foci(autd: Session) -> None:
    """Send sequences of patterns of one focus to eight foci, with phase offsets."""
    random = np.random.default_rng(5)
    for number in range(1, 9):
        places = np.round(random.uniform((-50, -50, 80), (200, 180, 300), (3, number, 3)) * 40)
        offsets = random.integers(0, 256, (3, number))
        patterns = [
            autd3.ControlPoints(
                [
                    autd3.ControlPoint(place / 40, autd3.Phase(int(offset)))
                    for place, offset in zip(of_one, of_offsets, strict=True)
                ],
                intensity=autd3.Intensity(255 - 20 * number),
            )
            for of_one, of_offsets in zip(places, offsets, strict=True)
        ]
        autd.send(autd3.FociSTM(foci=patterns, config=autd3.SamplingConfig(2)))
        autd.wait(9)


def circle(autd: Session) -> None:
    """Send a sequence that takes several frames: 100 places, at 4 kHz."""
    angles = np.linspace(0, 2 * np.pi, 100, endpoint=False)
    ring = np.stack([30 * np.cos(angles), 30 * np.sin(angles), 0 * angles], axis=1)
    autd.send(sequence(list(TARGET_MM + ring), 10))
    autd.wait(95)


def modulation(autd: Session) -> None:
    """Modulate by a sine of 200 Hz at 4 kHz, then by one of 4 kHz at 40 kHz."""
    autd.send(autd3.Uniform(intensity=autd3.Intensity(200), phase=autd3.Phase(17)))
    autd.send(autd3.Sine(freq=200 * autd3.Hz, option=autd3.SineOption()))
    autd.wait(215)
    quick = autd3.SineOption(sampling_config=autd3.SamplingConfig(1))
    autd.send(autd3.Sine(freq=4 * autd3.kHz, option=quick))
    autd.wait(25)


def segments(autd: Session) -> None:
    """Fill both segments, and swap them in every way that needs no pin."""
    a, b = TARGET_MM, TARGET_MM + np.array([0, 20.0, 30.0])
    autd.send(at(a))
    autd.send(autd3.WithSegment(at(b), SECOND, Later()))
    autd.wait(5)
    autd.send(autd3.SwapSegmentGain(SECOND))
    autd.wait(5)
    autd.send(autd3.SwapSegmentGain(FIRST))
    autd.wait(5)
    once = sequence([a, b, a + 5], 3)
    autd.send(autd3.WithFiniteLoop(once, SECOND, SyncIdx(), loop_count=2))
    autd.wait(40)
    autd.send(autd3.WithSegment(sequence([b, a], 3), FIRST, Immediate()))
    autd.wait(20)
    timed = sequence([a + 1, b + 1, a + 2, b + 2], 3)
    start = SysTime(autd.system_time(700))
    autd.send(autd3.WithFiniteLoop(timed, SECOND, start, loop_count=1))
    autd.wait(760)
    autd.send(autd3.SwapSegmentFociSTM(FIRST, Immediate()))
    autd.wait(10)


def turns(autd: Session) -> None:
    """Let two sequences take turns; in autd3's emulator they go by the laps of another one."""
    a, b = TARGET_MM, TARGET_MM + np.array([0, 20.0, 30.0])
    autd.send(autd3.WithSegment(sequence([a, b, a + 5], 3), SECOND, Later()))
    autd.send(sequence([b, a], 4))
    autd.send(autd3.SwapSegmentFociSTM(FIRST, Ext()))
    autd.wait(40)


def modulation_segments(autd: Session) -> None:
    """Modulate from both segments, each a number of times."""
    autd.send(at(TARGET_MM))
    for segment, samples in ((SECOND, [10, 20, 30]), (FIRST, [200, 100])):
        some = Samples(samples, autd3.SamplingConfig(4))
        autd.send(autd3.WithFiniteLoop(some, segment, SyncIdx(), loop_count=2))
        autd.wait(60)
    autd.send(autd3.WithSegment(Samples([0, 255], autd3.SamplingConfig(4)), SECOND, Later()))
    autd.wait(5)
    autd.send(autd3.SwapSegmentModulation(SECOND, Immediate()))
    autd.wait(20)


def refused(autd: Session, datagram: Any) -> None:
    """Send what the device refuses; what it says is kept."""
    try:
        autd.send(datagram)
    except autd3.autd_error.AUTDError as error:
        REFUSALS.append(str(error))
    else:
        REFUSALS.append("")


REFUSALS: list[str] = []


def refusals(autd: Session) -> None:
    """Ask for what the device refuses by its state: errors 5 to 8, in another order."""
    points = [TARGET_MM, TARGET_MM + 1]
    autd.send(autd3.Silencer())
    autd.send(at(TARGET_MM))
    autd.wait(2)
    refused(autd, sequence(points, 39))
    refused(autd, autd3.SwapSegmentFociSTM(SECOND, Immediate()))
    late = SysTime(autd.system_time(300))
    refused(autd, autd3.WithFiniteLoop(sequence(points, 40), SECOND, late, loop_count=1))
    refused(autd, autd3.SwapSegmentModulation(SECOND, SyncIdx()))
    autd.wait(4)


CASES: dict[str, Callable[[Session], None]] = {
    case.__name__: case
    for case in (
        focus,
        every_code,
        foci,
        circle,
        modulation,
        segments,
        turns,
        modulation_segments,
        refusals,
    )
}


def prepared(case: Callable[[Session], None], autd: Session) -> None:
    """Run *case* with a silencer that lets everything jump."""
    if case is not refusals:
        autd.send(JUMP)
    autd.send(FULL)
    autd.wait(4)
    case(autd)


class Emulated:
    """The emulator of autd3 as a session; its time is told."""

    def __init__(self, recorder: Any, times: int) -> None:
        self._recorder, self._times, self.periods = recorder, times, START

    def send(self, datagram: Any) -> None:
        """Send to the emulated devices."""
        self._recorder.send(datagram)

    def wait(self, periods: int) -> None:
        """Let time pass, *times* as much."""
        periods *= self._times
        self._recorder.tick(autd3.Duration.from_nanos(periods * PERIOD_NS))
        self.periods += periods

    def system_time(self, periods: int) -> Any:
        """Return a time that is told."""
        return system_time(self.periods + self._times * periods)


def system_time(periods: int) -> Any:
    """Return the system time that *periods* of 25 µs make."""
    return autd3.DcSysTime.ZERO + autd3.Duration.from_nanos(periods * PERIOD_NS)


def played(case: Callable[[Session], None], times: int) -> Callable[[Any], None]:
    """Return what the emulator calls to have *case* played."""
    return lambda recorder: prepared(case, Emulated(recorder, times))


def geometry(devices: str) -> list[Any]:
    """Return devices in a row, 192 mm apart."""
    places = [[192.0 * number, 0, 0] for number in range(int(devices))]
    return [autd3.AUTD3(pos=place, rot=[1, 0, 0, 0]) for place in places]


def emulate(times: str = "1", devices: str = "1") -> dict[str, Any]:
    """Return for each case what changes when, if all takes *times* as long."""
    found = {}
    for name, case in CASES.items():
        REFUSALS.clear()
        with Emulator(geometry(devices)) as emulator:
            record = emulator.record_from(system_time(START), played(case, int(times)))
            phases, widths = record.phase().to_numpy().T, record.pulse_width().to_numpy().T
        found[name] = {"changes": changes(phases, widths), "refusals": list(REFUSALS)}
        found[name]["periods"] = len(phases)
    return found


def changes(phases: Any, widths: Any) -> list[dict[str, Any]]:
    """Return the periods with another drive than the one before; equal widths are one number."""
    rows = []
    for period in range(len(phases)):
        same = period and (phases[period] == phases[period - 1]).all()
        if same and (widths[period] == widths[period - 1]).all():
            continue
        few = np.unique(widths[period])
        row = {"period": START + period, "widths": [int(width) for width in widths[period]]}
        if len(few) == 1:
            row["widths"] = int(few[0])
        if not same:
            row["phases"] = base64.b64encode(phases[period].astype(np.uint8).tobytes()).decode()
        rows.append(row)
    return rows


class Acknowledging:
    """A server of the link that accepts everything, and keeps what came."""

    def __init__(self) -> None:
        self._server = socket.create_server(("127.0.0.1", 0))
        self.address = "{}:{}".format(*self._server.getsockname())
        self._taken = bytearray()
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def take(self) -> bytes:
        """Return what came since the last call."""
        taken = bytes(self._taken)
        self._taken.clear()
        return taken

    def close(self) -> None:
        """End."""
        self._thread.join(5)
        self._server.close()

    def _serve(self) -> None:
        client, _ = self._server.accept()
        with client, client.makefile("rb") as stream:
            self._answer(client, stream)

    def _read(self, stream: Any, size: int) -> bytes:
        data = stream.read(size)
        self._taken += data
        return bytes(data)

    def _answer(self, client: socket.socket, stream: Any) -> None:
        devices, ids = 0, [0]
        while kind := self._read(stream, 1):
            if kind == b"\x10":
                self._read(stream, 13)
            elif kind in (b"\x01", b"\x02"):
                (devices,) = struct.unpack("<I", self._read(stream, 4))
                self._read(stream, POSE_BYTES * devices)
            elif kind == b"\x03":
                ids = [self._read(stream, FRAME_BYTES)[0] for _ in range(devices)]
            states = b"".join(bytes([0, number]) for number in ids) if kind == b"\x04" else b""
            client.sendall(b"\0" + states)
            if kind == b"\x05":
                return


class Recorded:
    """A controller whose bytes are kept, with the period in which they are sent; no time passes."""

    def __init__(self, controller: Any, server: Acknowledging) -> None:
        self._controller, self._server, self.periods = controller, server, START
        self.sent = [(START, server.take())]

    def send(self, datagram: Any) -> None:
        """Send, and keep the bytes."""
        self._controller.send(datagram)
        self.sent.append((self.periods, self._server.take()))

    def wait(self, periods: int) -> None:
        """Count."""
        self.periods += periods

    def system_time(self, periods: int) -> Any:
        """Return a time that is told."""
        return system_time(self.periods + periods)


def record() -> dict[str, Any]:
    """Return for each case what pyautd3 sends: period and bytes."""
    found = {}
    for name, case in CASES.items():
        server = Acknowledging()
        with opened(server.address) as controller:
            recorded = Recorded(controller, server)
            prepared(case, recorded)
        recorded.sent.append((recorded.periods, server.take()))
        server.close()
        found[name] = [
            {"period": period, "bytes": base64.b64encode(data).decode()}
            for period, data in recorded.sent
        ]
    return found


class Live:
    """A controller on the wall clock."""

    def __init__(self, controller: Any) -> None:
        self._controller = controller

    def send(self, datagram: Any) -> None:
        """Send."""
        self._controller.send(datagram)

    def wait(self, periods: int) -> None:
        """Sleep, at least 10 ms."""
        time.sleep(max(0.01, periods * PERIOD_NS * 1e-9))

    def system_time(self, periods: int) -> Any:
        """Return a time of this computer's clock."""
        now_ns = time.time_ns() - SECONDS_TO_2000 * 1_000_000_000
        return system_time(now_ns // PERIOD_NS + periods)


def live(address: str, name: str, devices: str = "1") -> dict[str, Any]:
    """Run one case on what listens at *address*; return what it said."""
    with opened(address, devices) as controller:
        firmware = [str(info) for info in controller.firmware_version()]
        prepared(CASES[name], Live(controller))
    return {"firmware": firmware, "refusals": list(REFUSALS)}


@contextlib.contextmanager
def opened(address: str, devices: str = "1") -> Iterator[Any]:
    """Open devices at the other end of *address*."""
    link = Remote(address, RemoteOption())
    with autd3.Controller.open(geometry(devices), link) as controller:
        yield controller


def main() -> None:
    """Do what the command line says; print JSON."""
    command, *rest = sys.argv[1:]
    commands: dict[str, Callable[..., dict[str, Any]]] = {
        "emulate": emulate,
        "record": record,
        "live": live,
    }
    json.dump(commands[command](*rest), sys.stdout)


if __name__ == "__main__":
    main()
