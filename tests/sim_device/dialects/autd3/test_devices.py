"""What devices answer: firmware, errors of every operation, clients that ask for other devices."""

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptogram_protocol.dialects.autd3.frame import Autd3DeviceFrame, Autd3DeviceState
from haptogram_protocol.dialects.autd3.messages import (
    Accepted,
    Autd3Refused,
    Autd3States,
    Close,
    Hello,
    Open,
    Pose,
    Read,
    Undecodable,
    Write,
)
from haptogram_protocol.dialects.autd3.operations import (
    CHANNELS,
    Clear,
    ErrorCode,
    FirmwareInfo,
    FociStart,
    FociSTM,
    Gain,
    Modulation,
    ModulationStart,
    Nop,
    Silencer,
    SwapSegment,
    Sync,
    Tag,
    TransitionMode,
    Truncated,
    Unsupported,
)
from sim_device.dialects.autd3.unit import PERIOD_US, Autd3Unit, Devices
from strategies_dialects import device_operations

AT_ORIGIN = Pose((0, 0, 0), (1, 0, 0, 0))
GAIN = Gain(0, True, bytes([7, 255] * CHANNELS))
IMMEDIATE = TransitionMode.IMMEDIATE
FOCI = FociStart(IMMEDIATE, 1, 340 * 64, 40, 0xFFFF, 0)
JUMP = Silencer(True, False, 0xFFFF, 0xFFFF)


def answered(unit: Autd3Unit, *operations, message_id=1, t_us=100) -> Autd3DeviceState:
    unit.take(Write((Autd3DeviceFrame(message_id, operations),)), t_us)
    (states,) = unit.take(Read(), t_us)
    assert isinstance(states, Autd3States)
    return states.devices[0]


# operation, error
ERRORS = [
    (Nop(), 0),
    (Clear(), 0),
    (Sync(), 0),
    (GAIN, 0),
    (Gain(2, True, GAIN.drives), 5),
    (Silencer(False, True, 10, 40), 0),
    (Silencer(False, True, 0xFFFF, 0xFFFF), 0),
    (JUMP, 0),
    (FirmwareInfo(0), 3),
    (FirmwareInfo(7), 3),
    (SwapSegment(Tag.GAIN_SWAP, 1), 0),
    (SwapSegment(Tag.GAIN_SWAP, 2), 5),
    (SwapSegment(Tag.FOCI_STM_SWAP, 1, IMMEDIATE), 5),
    (SwapSegment(Tag.MODULATION_SWAP, 1, IMMEDIATE), 0),
    (SwapSegment(Tag.MODULATION_SWAP, 0, TransitionMode.SYNC_INDEX), 8),
    (SwapSegment(Tag.MODULATION_SWAP, 9, IMMEDIATE), 5),
    (Modulation(0, b"\xff\xff", ModulationStart(IMMEDIATE, 10, 0xFFFF, 0), True, True), 0),
    (Modulation(0, b"\xff\xff", ModulationStart(IMMEDIATE, 9, 0xFFFF, 0), True, True), 7),
    (Modulation(1, b"\xff\xff", ModulationStart(IMMEDIATE, 10, 3, 0), True, True), 8),
    (Modulation(1, b"\xff\xff", ModulationStart(1, 10, 3, 9_000_000), True, True), 6),
    (FociSTM(0, 1, bytes(8), FOCI, True, True), 0),
    (FociSTM(2, 1, bytes(8), FOCI, True, True), 5),
    (FociSTM(0, 1, bytes(8), FociStart(IMMEDIATE, 1, 340 * 64, 39, 0xFFFF, 0), True, True), 7),
    (FociSTM(0, 1, bytes(8), FociStart(0x33, 1, 340 * 64, 40, 0xFFFF, 0), True, True), 8),
    (FociSTM(0, 1, bytes(8), FociStart(IMMEDIATE, 9, 340 * 64, 40, 0xFFFF, 0), True, True), 1),
    (FociSTM(0, 1, bytes(8), FociStart(IMMEDIATE, 1, 0, 40, 0xFFFF, 0), True, True), 1),
    *((Unsupported(tag), 1) for tag in (0x41, 0x43, 0x60, 0x61, 0x72, 0x80, 0x90, 0xF0, 0xF2)),
    (Truncated(0x30), 1),
]


@pytest.mark.parametrize(("operation", "error"), ERRORS)
def test_every_operation_has_its_error(operation, error) -> None:
    unit = Autd3Unit(Devices(), 0)
    assert answered(unit, operation) == Autd3DeviceState(1, error)
    name = f"refused_{ErrorCode(error).name.lower()}"
    assert unit.counters[name] == bool(error)


def test_the_first_error_ends_a_frame() -> None:
    unit = Autd3Unit(Devices(), 0)
    assert answered(unit, Unsupported(0x60), GAIN).error == 1
    unit.advance_to(1000)
    assert [latch.cause for latch in unit.take_latches()] == ["power-up"]


def test_an_id_above_15_is_refused() -> None:
    assert answered(Autd3Unit(Devices(), 0), message_id=16) == Autd3DeviceState(
        16, ErrorCode.INVALID_MESSAGE_ID
    )


def test_a_frame_with_the_id_of_the_last_changes_nothing() -> None:
    unit = Autd3Unit(Devices(), 0)
    answered(unit, GAIN)
    unit.take(Write((Autd3DeviceFrame(1, (), repeated=True),)), 150)
    assert unit.take(Read(), 150) == [Autd3States((Autd3DeviceState(1),))]


def test_firmware_is_v12_1_0() -> None:
    unit = Autd3Unit(Devices(), 0)
    found = [answered(unit, FirmwareInfo(kind), message_id=kind).data for kind in range(1, 6)]
    assert found == [0xA5, 0, 0xA5, 0, 0]


def test_the_link_is_answered() -> None:
    unit = Autd3Unit(Devices(), 0)
    for operation in (Hello(), Open((AT_ORIGIN,)), Close()):
        assert unit.take(operation, 5) == [Accepted()]
    assert unit.take(Undecodable("why"), 6) == [Autd3Refused("why")]


def test_another_number_of_devices_is_refused() -> None:
    unit = Autd3Unit(Devices(), 0)
    (reply,) = unit.take(Open((AT_ORIGIN, AT_ORIGIN)), 1)
    assert reply == Autd3Refused("2 devices are opened, this board has 1")
    (reply,) = unit.take(Write((Autd3DeviceFrame(1, (GAIN,)), Autd3DeviceFrame(1, (GAIN,)))), 2)
    assert isinstance(reply, Autd3Refused)
    assert unit.counters == {"devices_differ": 2}


def test_devices_have_their_own_operations_and_share_a_clock() -> None:
    unit = Autd3Unit(Devices(devices=3), 0)
    frames = tuple(
        Autd3DeviceFrame(1, (Gain(0, True, bytes([number, 255] * CHANNELS)),))
        for number in (1, 2, 3)
    )
    unit.take(Write(frames), 30)
    unit.advance_to(100)
    latch = unit.take_latches()[-1]
    assert (latch.t_latch_us, latch.cause) == (50, "gain")
    rises = latch.pulses.rises.reshape(3, CHANNELS)
    assert [set(row.tolist()) for row in rises] == [{(2 * n - 128) % 512} for n in (1, 2, 3)]


def test_what_changes_by_itself_is_shown_every_250_us_at_the_most() -> None:
    unit = Autd3Unit(Devices(), 0)
    answered(unit, JUMP, GAIN, message_id=1, t_us=10)
    samples = bytes(range(100))
    start = ModulationStart(IMMEDIATE, 1, 0xFFFF, 0)
    answered(unit, Modulation(0, samples, start, True, True), message_id=2, t_us=20)
    unit.advance_to(1_000_000)
    times = [latch.t_latch_us for latch in unit.take_latches() if latch.cause == "modulation"]
    assert 3990 <= len(times) <= 4001
    assert min(b - a for a, b in itertools.pairwise(times)) >= 250


def test_a_modulation_of_4_khz_is_shown_step_by_step() -> None:
    unit = Autd3Unit(Devices(), 0)
    answered(unit, GAIN, message_id=1, t_us=10)
    samples = bytes([10, 60, 110, 160])
    start = ModulationStart(IMMEDIATE, 10, 0xFFFF, 0)
    answered(unit, Modulation(0, samples, start, True, True), message_id=2, t_us=20)
    unit.advance_to(100_000)
    latches = [latch for latch in unit.take_latches() if latch.cause == "modulation"]
    assert len(latches) in (399, 400, 401)
    steady = latches[2:]
    assert {b.t_latch_us - a.t_latch_us for a, b in itertools.pairwise(steady)} == {250}
    assert len({int(latch.pulses.widths[0]) for latch in steady}) == 4


def looked_at(unit: Autd3Unit, until_us: int) -> int:
    """Return how often *unit* looks at its devices by itself."""
    looks = 0
    while (next_us := unit.next_event_us()) is not None and next_us <= until_us:
        unit.advance_to(next_us)
        looks += 1
    return looks


def test_samples_that_change_nothing_cost_two_looks_in_250_us_at_the_most() -> None:
    unit = Autd3Unit(Devices(), 0)
    answered(unit, JUMP, GAIN, message_id=1, t_us=10)
    start = ModulationStart(IMMEDIATE, 1, 0xFFFF, 0)
    answered(unit, Modulation(0, b"\xff\xff", start, True, True), message_id=2, t_us=20)
    assert 4_000 <= looked_at(unit, 1_000_000) <= 8_010


def test_samples_that_change_nothing_make_no_sequence_late() -> None:
    unit = Autd3Unit(Devices(), 0)
    steady = Modulation(0, b"\xff\xff", ModulationStart(IMMEDIATE, 10, 0xFFFF, 0), True, True)
    answered(unit, JUMP, steady, message_id=1, t_us=10)
    foci = bytes([0, 0, 0, 0, 4, 0, 0, 255]) + bytes([200, 1, 0, 0, 4, 0, 0, 255])
    start = FociStart(IMMEDIATE, 1, 340 * 64, 15, 0xFFFF, 0)
    answered(unit, FociSTM(0, 1, foci, start, True, True), message_id=2, t_us=20)
    unit.advance_to(100_000)
    times = [latch.t_latch_us for latch in unit.take_latches() if latch.cause == "index"]
    assert times == list(range(375, 100_001, 375))


@given(data=st.data())
def test_any_operations_are_answered_in_bounded_memory(data: st.DataObject) -> None:
    unit = Autd3Unit(Devices(latch_us=PERIOD_US), 0)
    t_us = 0
    for number in range(data.draw(st.integers(1, 8))):
        operation = data.draw(device_operations(1))
        t_us += data.draw(st.integers(0, 40_000))
        state = answered(unit, JUMP, operation, message_id=number, t_us=t_us)
        assert 0 <= state.error <= 8
        unit.advance_to(t_us)
        assert all(latch.pulses.count == CHANNELS for latch in unit.take_latches())


def test_sequences_longer_than_the_memory_are_cut_and_counted() -> None:
    unit = Autd3Unit(Devices(), 0)
    answered(
        unit,
        Modulation(0, b"\1" * 600, ModulationStart(IMMEDIATE, 10, 0xFFFF, 0), False, False),
        message_id=0,
    )
    for number in range(1, 120):
        part = Modulation(0, b"\1" * 600, None, number == 119, False)
        answered(unit, part, message_id=number % 16)
    assert unit.counters["items_beyond_memory"] == 11
    assert answered(unit, FociSTM(0, 1, bytes(8), None, True, True)).error == 0
    assert unit.counters["parts_without_start"] == 1
