"""Boards with a clock of their own: any operations, told at any time, and never an error."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptogram_protocol.dialects.codec import Operation
from sim_device.board.events import PulseLatch
from sim_device.dialects.table import EMULATIONS
from strategies_dialects import WIRES, Wire

BOOT_US = 2**32 - 10_000_000  # as the device clock of the virtual board begins
LAST_US = BOOT_US + 4_000_000

TIMED = {"interactlab", "autd3"}
every_unit = pytest.mark.parametrize(
    "wire", [wire for wire in WIRES if wire.dialect in TIMED], ids=str
)


def powered_up(wire: Wire, devices: int = 1):
    emulation = EMULATIONS[wire.dialect]
    names = {"devices"} & set(emulation.options.__dataclass_fields__)
    options = emulation.options.of(**dict.fromkeys(names, devices))
    return emulation.unit(options, BOOT_US), emulation.dialect.channels * emulation.boards(options)


def told(latches: list[PulseLatch]) -> list[tuple[object, ...]]:
    return [
        (latch.t_latch_us, latch.cause, latch.index, latch.modulation, latch.pulses)
        for latch in latches
    ]


def driven(wire: Wire, timed, stops, devices=1):
    """Run a unit over operations at their times, stopping where *stops* says."""
    unit, channels = powered_up(wire, devices)
    latches, replies = unit.take_latches(), []
    times = sorted([(t_us, None) for t_us in stops] + timed, key=lambda row: row[0])
    for t_us, operation in times:
        replies += unit.advance_to(t_us)
        if operation is not None:
            replies += unit.take(operation, t_us)
        latches += unit.take_latches()
    replies += unit.advance_to(LAST_US)
    return latches + unit.take_latches(), replies, unit.counters, channels


def with_times(draw, operations):
    gaps = [0, 1, 24, 25, 26, 250, 20_480, 990_000, 1_000_001]
    t_us, timed = BOOT_US + draw(st.integers(0, 60)), []
    for operation in operations[:40]:
        t_us = min(t_us + draw(st.sampled_from(gaps)), LAST_US)
        timed.append((t_us, operation))
    return timed


@pytest.mark.sampled(1)
@every_unit
@given(data=st.data())
def test_any_partition_of_time_gives_the_same_latches(wire: Wire, data: st.DataObject) -> None:
    operations = [
        operation for _ in range(3) for operation in data.draw(wire.operations)
    ]  # of several sessions, one after the other
    timed = with_times(data.draw, operations)
    devices = max((len(getattr(op, "devices", ())) for op in operations), default=1) or 1
    whole = driven(wire, timed, [], devices)
    stops = data.draw(st.lists(st.integers(BOOT_US, LAST_US), max_size=30))
    parted = driven(wire, timed, stops, devices)
    assert told(parted[0]) == told(whole[0])
    assert parted[1:] == whole[1:]


@every_unit
@given(data=st.data())
def test_latches_are_whole_and_in_order(wire: Wire, data: st.DataObject) -> None:
    timed = with_times(data.draw, data.draw(wire.operations))
    latches, _, _, channels = driven(wire, timed, [])
    assert latches[0].cause == "power-up"
    assert latches[0].t_latch_us == BOOT_US
    times = [latch.t_latch_us for latch in latches]
    assert times == sorted(times)
    assert {latch.pulses.count for latch in latches} == {channels}
    assert all(np.isfinite(latch.pulses.weights()).all() for latch in latches)


class Unknown(Operation):
    """What no board knows."""


@every_unit
def test_an_operation_that_no_board_knows_changes_nothing(wire: Wire) -> None:
    unit, _ = powered_up(wire)
    unit.take_latches()
    assert unit.take(Unknown(), BOOT_US) == []
    unit.advance_to(BOOT_US + 1000)
    assert unit.take_latches() == []
