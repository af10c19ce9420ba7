"""Captures of the drive pins of virtual boards, with what the back door of the same board saw."""

from dataclasses import dataclass

import numpy as np

from dialect_boards import blueprint_of_options
from haptogram import Driver
from haptogram.acoustics import AcousticModel, Medium, Transducer, TransducerArray
from haptogram.driver.frames.dialect_frames import dialect_display_of
from haptogram.evidence.captures.channel_map import ChannelMap
from haptogram.evidence.captures.files import read_capture
from haptogram.evidence.captures.pin_record import pin_record_of_capture
from haptogram.records.frame import Focus
from haptogram.settings.board import PinCaptureConfig
from haptogram.settings.faults.plan import FaultPlan
from haptogram.verification.pins.held.drives import held_pin_drives
from haptogram_protocol.dialects.table import DIALECTS
from sim_device.backdoor.pin_capture import BackdoorPinCapture
from sim_device.simulation import Simulation
from virtual_ports import BoardPort

MAP = {"reference": "carrier", "latch": "latch", "elements": "e{}"}


@dataclass
class CapturedRun:
    """A run whose pins were captured."""

    path: object
    latches: list
    intended: list

    def measured(self, **keys):
        return measured(read_capture(self.path), {**MAP, **keys})

    def radiated(self):
        """Return the (L, N) weights of the back door."""
        return np.array([latch.radiated.weights() for latch in self.latches])


def measured(capture, keys):
    """Return the drives that the pins of *capture* hold."""
    return held_pin_drives(pin_record_of_capture(capture, ChannelMap.of("map.toml", keys)))


def captured_dialect_run(path, dialect, frames, gap_us=40_000, **options):
    """Show frames on a board of another dialect in virtual time, and capture its pins."""
    blueprint = blueprint_of_options(dialect, options)
    settings, wire = blueprint.settings, DIALECTS[dialect]
    config = PinCaptureConfig(capture=path, capture_ms=600.0, capture_elements="0,9,20,33,46,63")
    pins = BackdoorPinCapture(path, config, settings)
    parts = blueprint.parts
    simulation = Simulation(settings, pins, parts=parts, faults=blueprint.faults, probe=pins)
    display, host = dialect_display_of(wire, 1), wire.host()
    shown = [display.off(), *(display.frame(frame.codes) for frame in frames), display.off()]
    for operations in shown:
        simulation.advance_to(simulation.now_ns + 1000 * gap_us)
        data = b"".join(host.send(operation) for operation in operations)
        assert simulation.host_write(data, simulation.now_ns) == len(data)
    simulation.advance_to(simulation.now_ns + 1000 * gap_us)
    pins.close()
    return [frame.intended(number) for number, frame in enumerate(frames)]


_RUNS = {}


def captured_run(path, **options):
    """Stream random foci at 1 kHz in virtual time, and capture the pins: each run is made once."""
    kind = path.suffix, repr(options)
    if kind not in _RUNS:
        _RUNS[kind] = _captured_run(path, **options), path.read_bytes()
    run, content = _RUNS[kind]
    path.write_bytes(content)
    return CapturedRun(path, [*run.latches], [*run.intended])


def _captured_run(path, *, array="4x4", faults=(), mode="phases", frames=12, seed=1, **analyser):
    grid = TransducerArray.parse(array, pitch_m=0.01)
    model = AcousticModel(grid, Medium.air(20.0), Transducer())
    plan = FaultPlan.parse(list(faults)) if faults else None
    port = BoardPort(model=model, faults=plan)
    with Driver(port, seed=seed) as driver:
        driver.arm()
        random = np.random.default_rng(seed)
        places = random.uniform(-0.03, 0.03, (frames, 3)) + np.array([0.0, 0.0, 0.15])
        levels = random.uniform(0.1, 1.0, frames) if mode == "drives" else np.ones(frames)
        foci = [Focus.at(place, level) for place, level in zip(places, levels, strict=True)]
        made = driver.frames(foci, mode=mode)
        driver.stream(made, 1000.0)
        intended = list(driver.intended)
    port.simulation.power_down()
    config = PinCaptureConfig(capture=path, **analyser)
    pins = BackdoorPinCapture(path, config, port.simulation.settings)
    events = [(n.t_us, 0, pins.notice, n) for n in port.notices]
    events += [(latch.t_latch_us, 1, pins.latch, latch) for latch in port.latches]
    for _, _, take, event in sorted(events, key=lambda e: e[:2]):
        take(event)
    pins.close()
    return CapturedRun(path, port.latches, intended)
