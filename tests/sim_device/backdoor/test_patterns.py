"""The back door says what a board of another dialect radiated, and nobody what was meant."""

import json
from pathlib import Path

import numpy as np
import pytest

from haptogram.settings.board import BoardConfig
from haptogram.settings.board_url import PortConfig
from sim_device.protocol_haptogram import open_virtual_port

DATA = Path(__file__).parents[2] / "data" / "dialects" / "sonicsurface"


def latches_of(name, *, reconstruct):
    port = open_virtual_port(
        PortConfig(
            board=BoardConfig.of(dialect="sonicsurface", temperature_c=23.21),
            clock="virtual",
            reconstruct=reconstruct,
        )
    )
    port.write((DATA / f"{name}.bin").read_bytes())
    port.flush()
    records = [record for record in port.records if record["kind"] == "pulses"]
    port.close()
    return records


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    ("name", "kind"),
    [("focus_20_150_m15", "one focus"), ("twin_0_150_0_rot45", "twin trap"), ("off", "off")],
)
def test_a_record_has_the_pattern_of_its_latch(name, kind):
    power_up, latch = latches_of(name, reconstruct=True)
    assert power_up["pattern"] == {"kind": "uniform", "active": 256}
    assert latch["pattern"]["kind"] == kind
    assert json.loads(json.dumps(latch["pattern"], allow_nan=False)) == latch["pattern"]
    if kind == "one focus":  # in the axes of the array: +z is the client's +y
        place_mm = 1e3 * np.array(latch["pattern"]["position_m"])
        assert place_mm == pytest.approx([20.0, 15.0, 150.0], abs=0.5)


def test_without_fields_there_is_no_pattern():
    assert [latch["pattern"] for latch in latches_of("on", reconstruct=False)] == [None, None]
