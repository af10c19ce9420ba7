"""What pyautd3 38.0.1 sends makes the pulses of autd3's own emulator, period by period."""

import base64
import itertools
import json
import zlib
from pathlib import Path

import numpy as np
import pytest

from haptogram.acoustics import AcousticModel, CircularPiston, Medium, Transducer
from haptogram.acoustics.model.boards.table import LAYOUTS
from haptogram.verification.watch import SeenLatch, Watch
from haptogram_protocol.dialects.autd3.frame import Autd3DeviceState
from haptogram_protocol.dialects.autd3.link import Autd3BoardEnd
from haptogram_protocol.dialects.autd3.messages import Accepted, Autd3States
from sim_device.dialects.autd3.unit import Autd3Unit, Devices

DATA = Path(__file__).parents[3] / "data" / "dialects" / "autd3" / "pyautd3_38.0.1.json"
CASES = json.loads(DATA.read_text())
PERIOD_US, EARLIER = 25, 1000  # periods by which the board is up before the client comes
# error codes as pyautd3 words them
WORDS = {
    "Silencer cannot complete phase/intensity interpolation": 7,
    "Invalid segment transition": 5,
    "Miss transition time": 6,
    "Invalid transition mode": 8,
}
# Phases that do not jump there; EXT goes by the HDL here, which is not the emulator's
WITHOUT_PULSES = {"refusals", "turns"}


def unpacked(text: str) -> bytes:
    return zlib.decompress(base64.b64decode(text))


def played(name):
    """Return latches and replies of a unit that gets what the client sent, when it sent it."""
    sent = CASES[name]["sent"]
    first = sent[0][0] - EARLIER
    unit = Autd3Unit(Devices(system_ns=first * PERIOD_US * 1000, latch_us=PERIOD_US), 0)
    board, replies = Autd3BoardEnd(), []
    for period, packed in sent[:-1]:
        t_us = (period - first) * PERIOD_US - 1
        for operation in board.receive_data(unpacked(packed)):
            replies += unit.take(operation, t_us)
    unit.advance_to((EARLIER + CASES[name]["periods"]) * PERIOD_US)
    assert not board.counters
    return unit, unit.take_latches(), replies, first


def expected(name):
    """Yield period, phases and widths of every period, as the emulator has them."""
    case = CASES[name]
    table = np.frombuffer(unpacked(case["phases"]), np.uint8).reshape(-1, 249)
    changes = {period: (phases, widths) for period, phases, widths in case["changes"]}
    first = min(changes)
    phases, widths = changes[first]
    for period in range(first, first + case["periods"]):
        phases, widths = changes.get(period, (phases, widths))
        yield period, table[phases].astype(int), np.broadcast_to(widths, 249)


@pytest.mark.parametrize("name", sorted(CASES.keys() - WITHOUT_PULSES))
def test_every_period_has_the_pulses_of_the_emulator(name: str) -> None:
    unit, latches, _, first = played(name)
    shown = [((latch.t_latch_us // PERIOD_US) + first, latch.pulses) for latch in latches]
    at = 0
    for period, phases, widths in expected(name):
        while at + 1 < len(shown) and shown[at + 1][0] <= period:
            at += 1
        pulses = shown[at][1]
        assert pulses.widths.tolist() == widths.tolist(), period
        rises = np.where(widths > 0, (2 * phases - widths // 2) % 512, 0)
        assert pulses.rises.tolist() == rises.tolist(), period
    assert not unit.counters


@pytest.mark.parametrize("name", CASES)
def test_every_frame_is_acknowledged_by_its_id(name: str) -> None:
    """What is refused has its error; the recording server had accepted it."""
    _, _, replies, _ = played(name)
    states = [reply.devices[0] for reply in replies if isinstance(reply, Autd3States)]
    assert all(isinstance(reply, Accepted | Autd3States) for reply in replies)
    ids = [state.message_id for state in states]
    assert all(b in (a, (a + 1) % 16) for a, b in itertools.pairwise(ids))
    errors = [int(state.error) for state in states if state.error]
    words = [
        next(code for word, code in WORDS.items() if word in text)
        for text in CASES[name]["refusals"]
    ]
    assert list(dict.fromkeys(errors)) == words
    assert states[0] == Autd3DeviceState(ids[0])


def test_the_errors_of_state_are_all_there() -> None:
    found = {text for name in CASES for text in CASES[name]["refusals"]}
    assert len(found) == len(WORDS)


def test_alternating_segments_take_turns_when_their_own_index_is_0() -> None:
    """By the HDL: a segment goes when its index comes back to 0."""
    _, latches, _, first = played("turns")
    found = [(latch.t_latch_us // PERIOD_US + first, latch.index) for latch in latches]
    expected, period = [], 40_008  # 2 patterns of 4 periods: back at 0 at multiples of 8
    while period < 40_044:
        until = (period // 9 + 1) * 9  # then 3 patterns of 3 periods
        expected += [(at, at // 3 % 3) for at in range(period, until) if at == period or not at % 3]
        period, start = (until // 8 + 1) * 8, until
        expected += [(at, at // 4 % 2) for at in range(start, period) if at == start or not at % 4]
    assert [row for row in found if row[0] >= 40_008] == [
        row for row in expected if row[0] <= found[-1][0]
    ]
    assert found[-1][0] >= 40_036


def test_every_focus_of_a_sequence_is_one_and_in_place_for_watch() -> None:
    """Phases of FociSTM are the FPGA's own: they are judged by the steps of its arithmetic."""
    array, k = LAYOUTS["autd3"].array(), 2.0 * np.pi * 40e3 / 340.0
    model = AcousticModel(array, Medium(340.0, 1.2), Transducer(CircularPiston(4.5e-3)))
    _, latches, _, _ = played("circle")
    shown = [latch for latch in latches if latch.cause in ("foci", "index")]
    watch = Watch(model)
    for latch in shown:
        seen = watch.take(SeenLatch(latch.number, latch.pulses.weights(), latch.phase_steps))
        assert seen.pattern.kind == "one focus"
        assert seen.pattern.outliers == ()
        arrivals = latch.pulses.weights() * np.exp(
            1j * k * np.linalg.norm(array.positions_m - seen.pattern.position_m, axis=1)
        )
        assert abs(arrivals.mean()) > 0.99 * np.abs(arrivals).mean()
    assert len(shown) == 10
