"""Clauses by the drive pins: boards whose words are right, and whose pins may not be."""

import dataclasses
import random
import re
from pathlib import Path

import numpy as np
import pytest
from boards import BAUD, run, virtual

from haptogram.acoustics import AcousticModel, Medium, Transducer, TransducerArray
from haptogram.conformance.case import Depth, case
from haptogram.conformance.client.drive_paths import drive_paths
from haptogram.conformance.client.latching import latch_now
from haptogram.conformance.pins.cases import PIN_CASES
from haptogram.conformance.pins.dialogue import PinDialogue
from haptogram.conformance.pins.judge import (
    captured_share_of_run,
    judge_clauses_by_pins,
    suite_with_clauses_by_pins,
)
from haptogram.conformance.pins.reported_drives import advertised_drive_paths
from haptogram.conformance.run.access import VirtualAccess
from haptogram.conformance.run.runner import SuiteOptions, SuiteRunner
from haptogram.conformance.verdict import Behaviour
from haptogram.driver.driver import Driver
from haptogram.errors import ConfigurationError
from haptogram.evidence.captures.channel_map import ChannelMap
from haptogram.evidence.captures.files import read_capture
from haptogram.evidence.captures.pin_record import pin_record_of_capture
from haptogram.records.frame import Focus
from haptogram.report.conformance.text import suite_text
from haptogram.settings.board import PinCaptureConfig
from haptogram.settings.faults.plan import FaultPlan
from haptogram_protocol.messages import MessageType, Mute, Ping, StateChanged, TraceMode
from haptogram_protocol.state import OutputState
from sim_device.board.timers import BoardTimers
from virtual_ports import BoardPort

pytestmark = pytest.mark.sampled(1)

MAP = {"reference": "carrier", "to_board": "to_board", "to_host": "to_host", "elements": "e{}"}
CASES = ("HG-5.2/6-slots", "HG-6.11/1", "HG-6.11/2-lengths", "HG-6.11/5-timers", "HG-8.3/1")
SEEN = {
    *(
        "HG-5.2/1",
        "HG-5.3/1",
        "HG-5.8/1",
        "HG-5.8/2",
        "HG-5.8/5",
        "HG-6.3/1",
        "HG-6.6/1",
        "HG-6.6/2",
    ),
    *("HG-6.10/1", "HG-6.11/1", "HG-6.11/2", "HG-6.12/2", "HG-8.3/1", "HG-12.2/1"),
}


class OnePort(VirtualAccess):
    """A board that nothing restarts."""

    can_reset = False


def captured_suite(path, faults=(), cases=CASES, depth=Depth.DEFAULT, **pins):
    """Run some cases in virtual time; return their results and the capture."""
    config = PinCaptureConfig(capture=path, capture_ms=600_000.0, capture_elements="0,5,10", **pins)
    grid = TransducerArray.parse("4x4", pitch_m=0.01)
    model = AcousticModel(grid, Medium.air(20.0), Transducer())
    plan = FaultPlan.parse(list(faults)) if faults else None
    port = BoardPort(model=model, faults=plan, capture=config)
    access = OnePort("virtual://pins", lambda _: port, baudrate=BAUD, virtual=True)
    suite = run(access, *cases, depth=depth)
    port.simulation.power_down()
    port.pins.close()
    return suite, pin_record_of_capture(read_capture(path), ChannelMap.of("map.toml", MAP))


def by_clause(results):
    return {result.clause: result for result in results}


@pytest.fixture(scope="module")
def healthy(tmp_path_factory):
    return captured_suite(tmp_path_factory.mktemp("pins") / "pins.vcd")


def test_a_healthy_board_is_seen_to_meet_the_clauses(healthy):
    suite, record = healthy
    results = judge_clauses_by_pins([record])
    assert {r.clause: r.detail for r in results if r.behaviour is Behaviour.FAILED} == {}
    assert {r.clause for r in results if r.behaviour is Behaviour.OK} == SEEN
    assert {str(r.evidence) for r in results} == {"external"}
    assert [r.case for r in results] == [f"{clause}-pins" for clause in PIN_CASES]
    joined = suite_with_clauses_by_pins(suite, results)
    assert len(joined.results) == len(suite.results) + len(results)
    assert {r.case for r in joined.results if r.is_failure} == set()


@case("HG-6.11/6", "a higher ceiling and a longer ramp_ms are set during a ramp")
def raised(board):
    board.configure(hold_ms=60, ramp_ms=240, amplitude_ceiling=100)
    board.arm()
    latch_now(board, board.flat_phases())
    board.wire.idle(150_000)
    board.configure(hold_ms=60, ramp_ms=1000)
    board.wire.idle(200_000)


@case("HG-6.11/6", "a lower ceiling, and then a higher one, are set during a ramp", variant="cut")
def cut(board):
    board.configure(hold_ms=60, ramp_ms=240)
    board.arm()
    latch_now(board, board.flat_phases())
    board.wire.idle(100_000)
    board.configure(hold_ms=60, ramp_ms=240, amplitude_ceiling=90)
    board.wire.idle(60_000)
    board.configure(hold_ms=60, ramp_ms=240)
    board.wire.idle(140_000)


def set_louder(self, now_us, last_latch_us, config, was=BoardTimers.reconfigure):
    was(self, now_us, last_latch_us, config)
    if self.ramp is not None:
        self.ramp.ceiling = config.amplitude_ceiling


@pytest.mark.parametrize(
    ("ramp", "wrong", "failed"),
    [
        (raised, None, set()),
        (raised, set_louder, {1, 2, 6}),
        (cut, None, set()),
        (cut, set_louder, {2, 6}),
    ],
)
def test_a_ramp_keeps_the_ceiling_of_its_beginning(ramp, wrong, failed, tmp_path, monkeypatch):
    if wrong is not None:
        monkeypatch.setattr(BoardTimers, "reconfigure", wrong)
    monkeypatch.setitem(run.__globals__, "all_cases", lambda: (ramp,))
    _, record = captured_suite(tmp_path / "pins.vcd", cases=(ramp.id,))
    found = {r.clause: r.behaviour for r in judge_clauses_by_pins([record])}
    assert {n for n in (1, 2, 6) if found[f"HG-6.11/{n}"] is not Behaviour.OK} == failed


def test_the_sessions_of_a_run_tell_its_capture_from_that_of_another(healthy):
    suite, record = healthy
    opened = sorted(suite.nonces)
    count = len(opened)
    whole = captured_share_of_run(record, opened, "the run")
    assert f"pins.vcd shows {count} of {count} sessions of the run, in " in whole
    captured_share_of_run(record, opened[: count // 2], "the run")  # analysed for longer
    others = set(range(1, 0x10000)) - suite.nonces
    another = [
        *opened[:2],
        *random.Random(1).sample(sorted(others), 200),
    ]  # some are equal by chance
    with pytest.raises(ConfigurationError, match="shows another run than the run: 2 of its"):
        captured_share_of_run(record, another, "the run")
    with pytest.raises(ConfigurationError, match="0 of its"):
        captured_share_of_run(record, [], "the run")


def test_a_capture_of_a_part_of_the_run_says_of_how_much(healthy):
    suite, record = healthy
    line = record.to_board
    half = len(line.values) // 2
    begun = dataclasses.replace(line, values=line.values[:half], times=line.times[:half])
    share = captured_share_of_run(
        dataclasses.replace(record, to_board=begun), suite.nonces, "the run"
    )
    shown = int(share.partition(" shows ")[2].partition(" ")[0])
    assert 0 < shown < len(suite.nonces)
    assert suite_with_clauses_by_pins(suite, [], [share]).settings["captured"] == share
    assert f"captured     {share}" in suite_text(suite_with_clauses_by_pins(suite, [], [share]))


def bent(record, by):
    """Return *record*, whose reference is an element, on the clock of an analyser that drifts."""

    def late(times):
        return times + by * np.sin(np.pi * times / record.end) ** 2

    pins = {
        element: dataclasses.replace(pin, rises=late(pin.rises), falls=late(pin.falls))
        for element, pin in record.pins.items()
    }
    lines = {
        name: dataclasses.replace(line, times=late(line.times))
        for name, line in (("to_board", record.to_board), ("to_host", record.to_host))
    }
    return dataclasses.replace(record, pins=pins, **lines)


def seen(result):
    return int(re.match(r"seen (\d+) times", result.detail)[1])


def with_three_pings(record):
    """Return *record* with the analyser having read no PING but one at each end and one between."""
    line, dialogue = record.to_board, PinDialogue(record)
    arrivals = np.array([frame.arrival for frame, _ in dialogue.sent(Ping)])
    kept = [np.abs(arrivals - share * record.end).argmin() for share in (0.0, 0.5, 1.0)]
    lost = np.delete(arrivals, kept)
    values = line.values.copy()
    values[np.searchsorted(line.times, lost) - 4] ^= 1
    return dataclasses.replace(record, to_board=dataclasses.replace(line, values=values))


@pytest.mark.nightly
@pytest.mark.parametrize("by", [-3.0, 3.0])
def test_crystals_that_drift_apart_are_no_defect_of_the_board(by, healthy):
    """The clock of the pins is bent by 75 us against the device clock."""
    record = of_own_reference(healthy)
    every = by_clause(judge_clauses_by_pins([bent(record, by)]))
    assert {r.detail for r in every.values() if r.behaviour is Behaviour.FAILED} == set()
    assert {clause for clause, r in every.items() if r.behaviour is Behaviour.OK} == SEEN
    few = with_three_pings(bent(record, by))
    results = by_clause(judge_clauses_by_pins([few]))
    assert {r.detail for r in results.values() if r.behaviour is Behaviour.FAILED} == set()
    for clause in ("HG-5.8/1", "HG-8.3/1"):  # where the clock is known well
        assert 0 < seen(results[clause]) < 0.6 * seen(every[clause])


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("faults", "analyser"),
    [
        (["line.flip ber=1e-5"], {}),  # events of latches are lost on the line
        (["clock.ppm ppm=-90"], {"capture_ppm": 150.0, "capture_rate_hz": 12e6}),
    ],
)
def test_noise_on_the_line_and_clocks_that_differ_are_no_defects_of_pins(
    faults, analyser, tmp_path
):
    _, record = captured_suite(tmp_path / "pins.vcd", faults, **analyser)
    results = judge_clauses_by_pins([record])
    assert {r.clause: r.detail for r in results if r.behaviour is Behaviour.FAILED} == {}
    assert sum(r.behaviour is Behaviour.OK for r in results) >= 11


LIES = {
    "capture_lingers=all=2000": {"HG-6.6/1", "HG-6.6/2", "HG-6.10/1", "HG-12.2/1"},
    "capture_lingers=5=60": {"HG-6.6/1"},
    "capture_lingers=5=1e5": {"HG-6.6/1", "HG-6.6/2", "HG-6.10/1", "HG-12.2/1"},
    "capture_late=5=100": {"HG-5.8/2"},
    "capture_late=all=100": {"HG-5.8/1", "HG-8.3/1"},
    "device.dead transducer=5": {"HG-5.2/1", "HG-5.3/1"},
    "device.delayed transducer=5 code=4": {"HG-5.2/1", "HG-5.3/1"},
}


@pytest.mark.slow
@pytest.mark.parametrize("lie", LIES)
def test_pins_that_do_not_do_what_the_board_says_are_found(lie, tmp_path):
    name, _, value = lie.partition("=")
    is_fault = lie.startswith("device.")
    given = {"faults": [lie]} if is_fault else {name: (value,)}
    suite, record = captured_suite(tmp_path / "pins.vcd", **given)
    assert {r.case: r.detail for r in suite.results if r.behaviour is Behaviour.FAILED} == {}
    results = by_clause(judge_clauses_by_pins([record]))
    failed = {clause for clause, r in results.items() if r.behaviour is Behaviour.FAILED}
    assert failed == LIES[lie]


def shifted(record, element, begin, end, periods):
    """Return *record* with more pulses of one pin between two periods."""
    pin = record.pins[element]
    rises = np.arange(begin, end)
    order = np.argsort(np.concatenate([pin.rises, rises]), kind="stable")
    changed = dataclasses.replace(
        pin,
        rises=np.concatenate([pin.rises, rises])[order],
        falls=np.concatenate([pin.falls, rises + periods])[order],
    )
    return dataclasses.replace(record, pins={**record.pins, element: changed})


def of_own_reference(healthy):
    own = MAP | {"reference": "e0", "elements": {"e0": 0, "e5": 5, "e10": 10}}
    return pin_record_of_capture(
        read_capture(Path(healthy[1].name)), ChannelMap.of("map.toml", own)
    )


@pytest.mark.nightly
def test_an_element_that_is_the_reference_may_be_silent(healthy):
    results = judge_clauses_by_pins([of_own_reference(healthy)])
    assert {r.clause: r.detail for r in results if r.behaviour is Behaviour.FAILED} == {}
    assert {r.clause for r in results if r.behaviour is Behaviour.OK} == SEEN


@pytest.mark.nightly
def test_a_phase_that_nothing_is_compared_with_proves_nothing(healthy):
    own = of_own_reference(healthy)
    alone = dataclasses.replace(own, pins={0: own.pins[0]})
    results = by_clause(judge_clauses_by_pins([alone]))
    for clause in ("HG-5.2/1", "HG-5.3/1"):
        assert results[clause].behaviour is Behaviour.NOT_OBSERVED
        assert "beside another sounding pin" in results[clause].detail
    one = dataclasses.replace(healthy[1], pins={5: healthy[1].pins[5]})  # beside the carrier
    assert 0 < latches_seen(one) < latches_seen(healthy[1])  # the first is compared with nothing


def latches_seen(record):
    results = by_clause(judge_clauses_by_pins([record]))
    return sum(seen(results[clause]) for clause in ("HG-5.2/1", "HG-5.3/1"))


def turned_between(record, periods, begin, end):
    """Return *record* with all pulses from *begin* to *end* later by a part of a period."""
    pins = {}
    for element, pin in record.pins.items():
        later = periods * ((pin.rises >= begin) & (pin.rises < end))
        pins[element] = dataclasses.replace(pin, rises=pin.rises + later, falls=pin.falls + later)
    return dataclasses.replace(record, pins=pins)


@pytest.mark.parametrize("elements", [(0, 5, 10), (5,)])
def test_focal_points_that_all_pins_turn_together_in_one_latch_fail(elements, tmp_path):
    """Nothing but focal points, whose codes the host does not know to a step."""
    path = tmp_path / "pins.vcd"
    config = PinCaptureConfig(capture=path, capture_ms=10_000.0)
    model = AcousticModel(
        TransducerArray.parse("4x4", pitch_m=0.01), Medium.air(20.0), Transducer()
    )
    port = BoardPort(model=model, capture=config)
    with Driver(port, seed=1) as driver:
        driver.configure(trace_mode=TraceMode.CRC)
        driver.arm()
        places = [(0.004 * n, 0.0, 0.15) for n in range(6)]
        driver.stream(driver.frames([Focus.at(place) for place in places], mode="points"), 100.0)
    port.simulation.power_down()
    port.pins.close()
    own = MAP | {"latch": "latch", "elements": {f"e{n}": n for n in elements}}
    record = pin_record_of_capture(read_capture(path), ChannelMap.of("map.toml", own))
    result = by_clause(judge_clauses_by_pins([record]))["HG-5.4/1"]
    assert (result.behaviour, seen(result)) == (Behaviour.OK, 6)
    begin, end = record.latches[2:4]
    turned = turned_between(record, 0.05, begin, end)
    result = by_clause(judge_clauses_by_pins([turned]))["HG-5.4/1"]
    assert result.behaviour is Behaviour.FAILED
    assert result.detail.startswith("1 of 6 times: element")


def test_a_fault_of_the_hardware_ends_a_drive_by_right(tmp_path):
    path = tmp_path / "pins.vcd"
    config = PinCaptureConfig(capture=path, capture_ms=10_000.0, capture_elements="0,5")
    model = AcousticModel(
        TransducerArray.parse("4x4", pitch_m=0.01), Medium.air(20.0), Transducer()
    )
    port = BoardPort(model=model, capture=config)
    with Driver(port, seed=1) as driver:
        driver.configure(trace_mode=TraceMode.CRC, hold_ms=1000, host_timeout_ms=1000)
        driver.arm()
        driver.focus((0.0, 0.0, 0.15))
        driver.hold(0.03)
        port.simulation.raise_hardware_fault()
        port.stall(20_000_000)
        assert driver.status().state is OutputState.FAULT
    port.simulation.power_down()
    port.pins.close()
    record = pin_record_of_capture(read_capture(path), ChannelMap.of("map.toml", MAP))
    results = by_clause(judge_clauses_by_pins([record]))
    assert {r.detail for r in results.values() if r.behaviour is Behaviour.FAILED} == set()
    assert results["HG-5.8/5"].behaviour is Behaviour.OK
    assert results["HG-6.6/1"].behaviour is Behaviour.OK
    for pin in record.pins.values():  # the fault came after the hold
        assert pin.falls[-1] - pin.rises[0] == pytest.approx(0.03 * 40_000, abs=40.0)


def test_an_arm_that_the_analyser_read_wrongly_is_known_by_its_reply(healthy):
    _, record = healthy
    line, arms = record.to_board, PinDialogue(record).arms
    kept = np.delete(np.arange(len(line.values)), np.searchsorted(line.times, arms[::2]) - 3)
    damaged = dataclasses.replace(line, values=line.values[kept], times=line.times[kept])
    results = judge_clauses_by_pins([dataclasses.replace(record, to_board=damaged)])
    assert {r.detail for r in results if r.behaviour is Behaviour.FAILED} == set()


def misread(record, name, *arrivals):
    """Return *record* with the analyser having read one bit of some frames wrongly."""
    line = getattr(record, name)
    values = line.values.copy()
    values[np.searchsorted(line.times, arrivals) - 3] ^= 1
    return dataclasses.replace(record, **{name: dataclasses.replace(line, values=values)})


def test_a_first_frame_that_the_analyser_read_wrongly_makes_the_silence_after_arm_unclear(healthy):
    _, record = healthy
    dialogue = PinDialogue(record)
    firsts = {dialogue.next_source(arm) for arm in dialogue.arms}
    results = by_clause(judge_clauses_by_pins([misread(record, "to_board", *sorted(firsts))]))
    assert {r.detail for r in results.values() if r.behaviour is Behaviour.FAILED} == set()
    assert results["HG-6.3/1"].behaviour is Behaviour.INCONCLUSIVE
    assert "on to_board that are no frame" in results["HG-6.3/1"].detail


@pytest.mark.parametrize("name", ["to_board", "to_host"])
def test_no_frame_that_the_analyser_read_wrongly_makes_a_board_fail(name, healthy):
    _, record = healthy
    by_type = {f.header.type: f.arrival for f in getattr(PinDialogue(record), name)}
    results = judge_clauses_by_pins([misread(record, name, *by_type.values())])
    assert {r.detail for r in results if r.behaviour is Behaviour.FAILED} == set()


BY_ONE_LINE = {
    "to_board": {"HG-5.8/2", "HG-6.6/2", "HG-6.10/1", "HG-6.12/2", "HG-8.3/1", "HG-12.2/1"},
    "to_host": {"HG-6.3/1", "HG-6.6/1", "HG-6.6/2"},
}


@pytest.mark.parametrize("missing", BY_ONE_LINE)
def test_one_line_alone_shows_a_part_of_the_clauses(missing, healthy):
    suite, record = healthy
    one = dataclasses.replace(record, **{missing: None})
    results = by_clause(judge_clauses_by_pins([one]))
    assert {r.clause: r.detail for r in results.values() if r.behaviour is Behaviour.FAILED} == {}
    shown = {clause for clause, r in results.items() if r.behaviour is Behaviour.OK}
    assert shown == BY_ONE_LINE[missing]
    assert f" has no line {missing} (name it in the map): what" in results["HG-5.2/1"].detail
    assert f"without {missing} " in results["HG-6.6/2"].detail
    share = captured_share_of_run(one, suite.nonces, "the run")
    assert f"shows {len(suite.nonces)} of {len(suite.nonces)} sessions" in share


def test_a_board_that_takes_longer_than_it_should_to_answer_arm_fails_nothing(tmp_path):
    """HG-4.11/3 is a SHOULD: the pins may sound before the answer, and STATUS says MUTED before."""
    path = tmp_path / "pins.vcd"
    config = PinCaptureConfig(capture=path, capture_ms=10_000.0, capture_elements="0,5")
    model = AcousticModel(
        TransducerArray.parse("4x4", pitch_m=0.01), Medium.air(20.0), Transducer()
    )
    port = BoardPort(model=model, capture=config)
    with Driver(port, seed=1) as driver:
        driver.configure(trace_mode=TraceMode.CRC, status_period_ms=10, host_timeout_ms=1000)
        for _ in range(2):
            driver.arm()
            driver.focus((0.0, 0.0, 0.15))
            driver.hold(0.02)
            driver.mute()
            port.stall(50_000_000)
            driver.status()  # behind its reply alone the ARM can have come
            port.stall(50_000_000)
    port.simulation.power_down()
    port.pins.close()
    record = pin_record_of_capture(read_capture(path), ChannelMap.of("map.toml", MAP))
    dialogue = PinDialogue(record)
    answer = [f.begin for f in dialogue.to_host if f.header.type == MessageType.ARM_REPLY][1]
    line = record.to_board
    arm = dialogue.arms[1]
    waits = (line.times > arm - 20.0) & (line.times <= arm)  # 30 ms, in which STATUS comes thrice
    times = np.where(waits, line.times - 1200.0, line.times)
    slow = shifted(record, 5, answer - 700.0, answer - 690.0, 0.3)
    for one in (
        dataclasses.replace(slow, to_board=dataclasses.replace(line, times=times)),
        dataclasses.replace(slow, to_board=None),
    ):
        results = judge_clauses_by_pins([one])
        broken = {r.clause: r.detail for r in results if r.behaviour is Behaviour.FAILED}
        assert set(broken) <= {"HG-6.3/1"}, broken  # no frame came
    early = shifted(record, 5, answer - 3000.0, answer - 2990.0, 0.3)  # before the ARM of both
    results = judge_clauses_by_pins([dataclasses.replace(early, to_board=None)])
    assert "HG-6.6/2" in {r.clause for r in results if r.behaviour is Behaviour.FAILED}


@pytest.mark.nightly
def test_pins_that_go_on_are_found_by_either_line_alone(tmp_path):
    _, record = captured_suite(tmp_path / "pins.vcd", capture_lingers=("all=1e5",))
    broken = {"to_board": {"HG-6.6/2", "HG-6.10/1", "HG-12.2/1"}, "to_host": {"HG-6.6/1"}}
    for missing, clauses in broken.items():
        one = dataclasses.replace(record, **{missing: None})
        results = judge_clauses_by_pins([one])
        assert {r.clause for r in results if r.behaviour is Behaviour.FAILED} == clauses
    _, late = captured_suite(tmp_path / "late.vcd", capture_late=("all=100",))
    results = judge_clauses_by_pins([dataclasses.replace(late, to_board=None)])
    assert {r.clause for r in results if r.behaviour is Behaviour.FAILED} == {"HG-8.3/1"}


@pytest.mark.nightly
def test_samples_that_are_missing_beside_an_element_as_reference_fail_no_board(healthy):
    record = of_own_reference(healthy)
    missing = record.end / 2.0, record.end / 2.0 + 4000.0  # 100 ms

    def left(times):
        return (times < missing[0]) | (times > missing[1])

    def earlier(times, kept):
        return np.where(times > missing[1], times - 4000.0, times)[kept]

    pins = {}
    for element, pin in record.pins.items():
        count = min(len(pin.rises), len(pin.falls)) - 1
        rises, falls = pin.rises[:count], pin.falls[:count]
        whole = left(rises) & left(falls)  # no pulse is cut in two
        pins[element] = dataclasses.replace(
            pin, rises=earlier(rises, whole), falls=earlier(falls, whole)
        )
    lines = {
        name: dataclasses.replace(
            line,
            values=line.values[left(line.times)],
            times=earlier(line.times, left(line.times)),
        )
        for name, line in (("to_board", record.to_board), ("to_host", record.to_host))
    }
    lossy = dataclasses.replace(record, pins=pins, end=record.end - 4000.0, **lines)
    results = judge_clauses_by_pins([lossy])
    assert {r.clause: r.detail for r in results if r.behaviour is Behaviour.FAILED} == {}
    assert "was cut off: samples are missing behind" in results[0].detail


def test_pins_that_never_sound_prove_nothing(healthy):
    """As where probes are off, or the map names other channels."""
    _, record = healthy
    pins = {
        element: dataclasses.replace(pin, rises=pin.rises[:0], falls=pin.falls[:0])
        for element, pin in record.pins.items()
    }
    results = judge_clauses_by_pins([dataclasses.replace(record, pins=pins)])
    assert {r.clause for r in results if r.behaviour is Behaviour.OK} == set()
    assert {r.clause for r in results if r.behaviour is Behaviour.FAILED} == {
        "HG-5.2/1",
        "HG-5.3/1",
    }


def test_pulses_in_a_silence_are_found_whatever_made_it(healthy):
    _, record = healthy
    dialogue = PinDialogue(record)
    mutes = [f.arrival for f in dialogue.to_board if isinstance(f.message, Mute)]
    mute = next(t for t in mutes if dialogue.next_arm(t) - t > 20.0)
    late = shifted(record, 5, mute + 4.0, mute + 6.0, 0.3)
    results = by_clause(judge_clauses_by_pins([late]))
    assert results["HG-6.6/2"].behaviour is Behaviour.FAILED
    assert "begin to sound 1" in results["HG-6.6/2"].detail
    frame = next(f for f, changed in dialogue.said(StateChanged))
    end = dialogue.capture_time(frame)
    late = shifted(record, 5, end + 60.0, end + 62.0, 0.3)
    failed = {r.clause for r in judge_clauses_by_pins([late]) if r.behaviour is Behaviour.FAILED}
    assert failed == {"HG-6.10/1"}
    arm = next(a for a in dialogue.arms if dialogue.next_source(a) - a > 20.0 and a > mute)
    late = shifted(record, 5, arm + 5.0, arm + 8.0, 0.3)
    results = by_clause(judge_clauses_by_pins([late]))
    assert results["HG-6.3/1"].behaviour is Behaviour.FAILED


def test_a_reset_is_found_by_the_device_clock_and_its_pins_are_judged(healthy):
    _, record = healthy
    (reset,) = PinDialogue(record).resets  # power-up
    late = shifted(record, 5, reset + 4.0, reset + 6.0, 0.3)
    failed = [r for r in judge_clauses_by_pins([late]) if r.behaviour is Behaviour.FAILED]
    assert [r.clause for r in failed] == ["HG-6.12/2"]
    assert "after a reset at" in failed[0].detail


def test_a_capture_without_the_lines_or_of_a_larger_board_is_refused(healthy):
    _, record = healthy
    with pytest.raises(ConfigurationError, match="neither line of the UART; clauses are judged by"):
        judge_clauses_by_pins([dataclasses.replace(record, to_board=None, to_host=None)])
    pins = {99: record.pins[5]}
    with pytest.raises(ConfigurationError, match="the board has the elements 0 to 15"):
        judge_clauses_by_pins([dataclasses.replace(record, pins=pins)])


@pytest.mark.parametrize("missing", [None, "to_board", "to_host"])
def test_lines_that_were_exchanged_are_refused(missing, healthy):
    _, record = healthy
    swapped = {"to_board": record.to_host, "to_host": record.to_board}
    if missing is not None:
        swapped[missing] = None
    with pytest.raises(ConfigurationError, match=r"carries frames of the \w+ alone; exchange"):
        PinDialogue(dataclasses.replace(record, **swapped))


def test_a_capture_that_was_cut_off_passes_nothing(healthy):
    _, record = healthy
    results = judge_clauses_by_pins([dataclasses.replace(record, cut="too short")])
    assert not any(r.behaviour is Behaviour.OK for r in results)


PATHS = {"cases": ("HG-5.2/6-paths", "HG-7.9/1-paths", "HG-7.9/2-paths")}
OF_PATHS = {"HG-5.2/1", "HG-5.3/1", "HG-5.4/1", "HG-7.6/4", "HG-7.9/1", "HG-7.9/2"}


def test_the_drives_of_every_path_are_compared_with_the_pins(tmp_path):
    """Streamed, at once and at its time, computed by the board, stored and played."""
    suite, record = captured_suite(tmp_path / "pins.vcd", **PATHS)
    assert {r.behaviour for r in suite.results} == {Behaviour.OK}
    results = by_clause(judge_clauses_by_pins([record]))
    assert {r.detail for r in results.values() if r.behaviour is Behaviour.FAILED} == set()
    for clause in OF_PATHS:
        assert results[clause].behaviour is Behaviour.OK, clause
        assert "no pin showed" not in results[clause].detail


def test_the_paths_are_those_on_which_the_cases_latch():
    access = virtual(array="4x4")
    with SuiteRunner(access, SuiteOptions()) as runner:
        board = runner.session()
        board.arm()
        latched = set()
        for path in drive_paths(board):
            path.latch()
            name = path.name.replace("while they play", "played")
            latched.add(re.sub(r" \(\d+\)", "", name))  # of focal points
        offered = {path for _, path in advertised_drive_paths(board.identity)}
    assert latched == offered


def test_a_path_that_the_run_left_out_is_named(healthy):
    results = by_clause(judge_clauses_by_pins([healthy[1]]))
    assert results["HG-5.3/1"].detail.endswith("; no pin showed DRIVES, at once")
    assert results["HG-5.4/1"].behaviour is Behaviour.NOT_OBSERVED


@pytest.mark.parametrize("fault", ["device.delayed code=6", "device.dead"])
def test_a_pin_that_is_wrong_fails_on_every_path(fault, tmp_path):
    _, record = captured_suite(tmp_path / "pins.vcd", [f"{fault} transducer=5"], **PATHS)
    results = judge_clauses_by_pins([record])
    assert {r.clause for r in results if r.behaviour is Behaviour.FAILED} == OF_PATHS
