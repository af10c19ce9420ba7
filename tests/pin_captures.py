"""Captures of the drive pins of virtual boards, with what the back door of the same board saw."""

from dataclasses import dataclass

import numpy as np

from haptogram import Driver
from haptogram.acoustics import AcousticModel, Medium, Transducer, TransducerArray
from haptogram.evidence.captures.channel_map import ChannelMap
from haptogram.evidence.captures.files import read_capture
from haptogram.evidence.captures.pin_record import pin_record_of_capture
from haptogram.records.frame import Focus
from haptogram.settings.board import PinCaptureConfig
from haptogram.settings.faults.plan import FaultPlan
from haptogram.verification.pins.held.drives import held_pin_drives
from sim_device.backdoor.pin_capture import BackdoorPinCapture
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


def captured_run(path, *, array="4x4", faults=(), mode="phases", frames=12, seed=1, **analyser):
    """Stream random foci at 1 kHz in virtual time, and capture the pins."""
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
