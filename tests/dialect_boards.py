"""Boards of other dialects in virtual time, and what unmodified clients sent to them."""

import base64
import functools
import json
import zlib
from pathlib import Path

from haptogram.settings.board import BoardConfig
from sim_device.blueprint import blueprint_of
from sim_device.simulation import Simulation

DATA = Path(__file__).parent / "data" / "dialects"
EXPECTED = json.loads((DATA / "expected.json").read_text())
# For each device of Ultraino the dialect and its options.
DEVICES = {
    "SimpleFPGA": ("ultraino-fpga", ()),
    "SimpleFPGA_128": ("ultraino-fpga-128", ()),
    "ChainedFPGA": ("ultraino-fpga-chained", ()),
    "MEGA": ("ultraino-mega64", ()),
    "MEGA_Anim": ("ultraino-mega64", ("firmware=animation",)),
}


def capture(name):
    return (DATA / f"{name}.bin").read_bytes()


def dialect_of(name):
    """Return the dialect in which a capture was sent, and options."""
    device = EXPECTED[name].get("device")
    return DEVICES[device] if device else (name.split("/")[0], ())


def pyautd3(name):
    """Return what pyautd3 38.0.1 sent, without its end."""
    cases = json.loads((DATA / "autd3" / "pyautd3_38.0.1.json").read_text())
    return b"".join(
        zlib.decompress(base64.b64decode(packed)) for _, packed in cases[name]["sent"][:-1]
    )


def nibbles(count):
    """Return data for the first Arduino: a high nibble of payload, 1 as the low one."""
    return bytes(number % 16 << 4 | 1 for number in range(count))


# Captures of clients; where there are none, bytes by the tables of the wire
SENT = {
    "sonicsurface": capture("sonicsurface/focus_20_150_m15"),
    "sonicsurface-tactile": b"\xa7\xfe" + bytes(number % 33 for number in range(256)) + b"\xfd",
    "ultraino-fpga": capture("ultraino/simplefpga_ss_focus_0_120_0"),
    "ultraino-fpga-128": capture("ultraino/simplefpga128_ss_focus_0_120_0"),
    "ultraino-fpga-chained": capture("ultraino/chainedfpga_512_ramp"),
    "ultraino-mega64": capture("ultraino/mega_flat8x8_focus"),
    "ultraino-nano8": nibbles(48) + b"\x00",
    "ultraino-nano16": nibbles(64) + b"\x00",
    "interactlab": capture("interactlab/levitate_focus_0_0_100"),
    "autd3": pyautd3("focus"),
}


@functools.cache
def _blueprint(values):
    return blueprint_of(BoardConfig.of(**dict(values)))


def blueprint_of_options(dialect, options, array=None):
    """Return the blueprint of a board; the same one for the same options."""
    words = tuple(f"{name}={value}" for name, value in options.items())
    given = {} if array is None else {"array": array}
    return _blueprint(tuple({"dialect": dialect, "dialect_option": words, **given}.items()))


class DialectBoard:
    """A board in virtual time, whose latches and notices are kept."""

    def __init__(self, dialect, *options, **values):
        values = {"dialect": dialect, "dialect_option": options, **values}
        blueprint = _blueprint(tuple(values.items()))
        self.settings = blueprint.settings
        self.latches, self.notices, self.records = [], [], []
        self.simulation = Simulation(
            self.settings, self, parts=blueprint.parts, faults=blueprint.faults
        )

    def latch(self, latch):
        self.latches.append(latch)

    def notice(self, notice):
        self.notices.append(notice)

    @property
    def remarks(self):
        return [notice.text for notice in self.notices if hasattr(notice, "text")]

    def send(self, data, pieces=None):
        """Let the line carry *data*, in writes of these sizes, and wait until it has."""
        for size in pieces or [len(data)]:
            piece, data = data[:size], data[size:]
            while piece:
                piece = piece[self.simulation.host_write(piece, self.simulation.now_ns) :]
                self._drain()
        self._drain()

    def pass_us(self, span_us):
        self.simulation.advance_to(self.simulation.now_ns + 1000 * span_us)

    def _drain(self):
        while self.simulation.host_unsent:
            self.simulation.advance_to(self.simulation.next_event_ns())
