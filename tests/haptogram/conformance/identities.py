"""Boards with any identity that SPEC.md allows: limits, array, carrier, capabilities."""

import dataclasses

from haptogram.acoustics import AcousticModel, Medium, Transducer, TransducerArray
from haptogram.conformance.run.access import VirtualAccess
from haptogram.driver.line.port import DEFAULT_BAUDRATE, PyserialTransport
from sim_device.assembly import BoardAssembly
from sim_device.board.output import BoardOutput
from sim_device.protocol_haptogram import Serial


class OwnDefaults(BoardOutput):
    """Latches late frames and ramps for 2 s by default: that is left to the board."""

    def __init__(self, *args, **kwargs):
        super().__init__(*args, **kwargs)
        self.config = dataclasses.replace(self.config, late_window_us=5000, ramp_ms=2000)


class IdentityPort(Serial):
    """A port to a virtual board whose settings and output are changed before it is built."""

    def __init__(self, changes, output):
        super().__init__(timeout=0)
        self.changes, self.parts = changes, BoardAssembly(output=output)

    def _blueprint(self, board):
        return self.changed(super()._blueprint(board))

    def changed(self, blueprint):
        """Return the board with its changes."""
        settings = dataclasses.replace(blueprint.settings, **self.changes)
        return dataclasses.replace(blueprint, settings=settings, parts=self.parts)


def identity_port(*, grid=(3, 2), carrier_us=25, output=BoardOutput, **changes):
    """The port of a board with these fields of its settings, to be opened."""
    carrier_hz = 1_000_000 // carrier_us
    transducer = Transducer(frequency_hz=carrier_hz)
    medium = Medium.air(20, frequency_hz=carrier_hz)
    changes["model"] = AcousticModel(TransducerArray.grid(*grid, pitch_m=0.01), medium, transducer)
    return IdentityPort(changes, output)


def identity(*, baud=DEFAULT_BAUDRATE, **limits):
    """A board in virtual time with these fields of its settings."""
    ports = []

    def start(number):
        url = f"haptogram://?clock=virtual&baud={baud}&seed={number}"
        ports[:] = [identity_port(**limits)]
        ports[0].port = url
        ports[0].open()
        return PyserialTransport(ports[0], url)

    return VirtualAccess(
        "haptogram://identity",
        start,
        baudrate=baud,
        virtual=True,
        raise_fault=lambda: ports[0].raise_hardware_fault(),
    )
