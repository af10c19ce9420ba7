"""Verdicts by the pins of the virtual board: every fault of its output, and no healthy board."""

import dataclasses
import re

import numpy as np
import pytest

from haptogram.acoustics import AcousticModel, Medium, Transducer, TransducerArray
from haptogram.errors import ConfigurationError
from haptogram.evidence.captures.channel_map import ChannelMap
from haptogram.evidence.captures.files import read_capture
from haptogram.evidence.captures.pin_record import pin_record_of_capture
from haptogram.records.pins import LineBytes
from haptogram.settings.faults.kinds import FAULT_KINDS, is_transducer_fault
from haptogram.verification import Verdict
from haptogram.verification.pins.joined import verify_captures
from haptogram_protocol.framing import encode_frame
from haptogram_protocol.messages import Mute, build_body
from pin_captures import MAP, captured_run

pytestmark = pytest.mark.sampled(2)


def model_of(array):
    grid = TransducerArray.parse(array, pitch_m=0.01)
    return AcousticModel(grid, Medium.air(20.0), Transducer())


def some_pins(*elements):
    return {"elements": {f"e{n}": n for n in elements}}


def record_of(run, keys):
    return pin_record_of_capture(read_capture(run.path), ChannelMap.of("map.toml", {**MAP, **keys}))


def judged(run, array="4x4", **keys):
    return judged_record(run, record_of(run, keys), array)


def pins_of(run, array="4x4", **keys):
    return judged_pins(run, record_of(run, keys), array)


def judged_pins(run, record, array="4x4"):
    """The verdict of the pins alone: that of the field takes ten times as long."""
    how = {"model": model_of(array), "incomplete": "the pins are looked at alone"}
    (pins,) = verify_captures([record], run.intended, **how).pins
    return pins


def judged_record(run, record, array="4x4"):
    return verify_captures([record], run.intended, model=model_of(array))


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A healthy board, captured once for all that only look at it."""
    return captured_run(tmp_path_factory.mktemp("healthy") / "pins.vcd")


@pytest.fixture(scope="module")
def record(run):
    return pin_record_of_capture(read_capture(run.path), ChannelMap.of("map.toml", MAP))


@pytest.mark.parametrize("array", ["2x1", "5x3", "8x8"])
@pytest.mark.parametrize("mode", ["phases", "drives", "points"])
@pytest.mark.parametrize("rate_hz", [4e6, 24e6])
def test_no_healthy_board_fails(array, mode, rate_hz, tmp_path):
    run = captured_run(
        tmp_path / "pins.vcd", array=array, mode=mode, capture_rate_hz=rate_hz, capture_ppm=37.0
    )
    for keys in ({}, {"reference": "e0"}, some_pins(0, 1)):
        found = judged(run, array, **keys)
        (pins,) = found.pins
        assert not pins.findings, str(found)
        assert pins.verdict is Verdict.PASS, str(found)
        assert pins.counts["right"] == pins.counts["intended"] == 12
        assert pins.counts["lost"] == pins.counts["late"] == 0
        edges = 1 if "reference" not in keys else 12  # every latch moves a reference that latches
        sample_ppm = edges * 1e6 / (rate_hz * 12e-3)  # of the length of the capture
        assert pins.drift_ppm == pytest.approx(-37.0, abs=1.0 + sample_ppm)
        whole = len(pins.elements) == found.array_count
        assert (found.run is not None) == (whole and rate_hz > 20e6)
        assert bool(found) or (found.run is not None and array == "2x1")  # two tell no focus


NAMES = {
    "device.off": "dead",
    "device.dead": "dead",
    "device.stuck": "stuck at a phase",
    "device.delayed": r"phase off by \+(89\.9|90\.[01]) degrees in every frame",
    "device.intermittent": "silent in",
    "device.garbage": "phase off in",
    "device.wrong": "shows the drive of the frame before",
    "device.slow": "phase off in",
}


@pytest.mark.sampled(1)
@pytest.mark.parametrize("kind", [kind for kind in FAULT_KINDS if is_transducer_fault(kind)])
def test_every_fault_of_the_output_is_named_or_lies_outside_of_the_capture(kind, tmp_path):
    run = captured_run(tmp_path / "pins.vcd", faults=[f"{kind} transducer=3"])
    whole = judged(run)
    part = judged(run, **some_pins(1, 2, 3, 7, 12))
    outside = judged(run, **some_pins(1, 2, 7, 12))
    assert outside.verdict is Verdict.PASS
    assert "4 of 16 elements" in str(outside)
    assert "the other 12 elements are not verified" in str(outside)
    assert "field     not judged: 12 of 16 elements were not captured" in str(outside)
    if kind == "device.ok":
        assert whole.verdict is part.verdict is Verdict.PASS
        return
    for found in (whole, part):
        assert found.verdict is Verdict.FAIL
        ((line,),) = found.pins[0].findings.values()
        assert line.startswith("element 3 (e3): ")
        assert re.search(NAMES[kind], line)
    assert whole.run.verdict is Verdict.FAIL


@pytest.mark.sampled(1)
@pytest.mark.parametrize("late_us", [75.0, 150.0])
def test_a_torn_latch_is_a_failure_of_its_own(late_us, tmp_path):
    late = tuple(f"{pin}={late_us}" for pin in range(8, 16))
    run = captured_run(tmp_path / "pins.vcd", capture_late=late, capture_lingers=late)
    pins = pins_of(run)
    assert pins.verdict is Verdict.FAIL
    assert pins.counts["torn"] == 12
    assert "8 of 16 pins (element 8, 9, 10, 11, ...) latch" in pins.findings["torn"][0]
    assert pins.right.all()  # what they latched is right
    assert set(pins.findings) == {"torn", "mute"}


def test_a_mirrored_map_is_named(tmp_path):
    run = captured_run(tmp_path / "pins.vcd", array="5x3")
    shown = np.arange(15).reshape(5, 3)[::-1].ravel()
    mapped = {"elements": {f"e{pin}": int(element) for element, pin in enumerate(shown)}}
    (line,) = pins_of(run, "5x3", **mapped).findings["phases"]
    assert "show the drives of other elements: x mirrored" in line


@pytest.mark.parametrize("pins", [(0, 1, 5, 10), tuple(range(16))])
def test_a_frame_in_which_all_pins_are_turned_together_fails_against_a_clock(pins, run):
    record = pin_record_of_capture(
        read_capture(run.path), ChannelMap.of("map.toml", MAP | some_pins(*pins))
    )
    begin, end = record.latches[4:6]
    turned = record
    for element, pin in record.pins.items():
        shift = 0.1 * ((pin.rises >= begin) & (pin.rises < end))
        turned = changed(turned, element, rises=pin.rises + shift, falls=pin.falls + shift)
    found = judged_pins(run, turned)
    (line,) = found.findings["phases"]
    assert line.startswith("frame 4: all pins are turned by +3")
    assert found.verdict is Verdict.FAIL
    blind = dataclasses.replace(turned, reference_element=pins[0])
    found = judged_pins(run, blind)
    assert "phases are relative to element 0" in found.notes[-1]


def test_two_wires_that_were_exchanged_are_named(run):
    elements = {f"e{n}": n for n in range(16)} | {"e3": 9, "e9": 3}
    lines = pins_of(run, elements=elements).findings["phases"]
    assert lines == (
        "element 3 (e9): does what element 9 should",
        "element 9 (e3): does what element 3 should",
    )


def changed(record, element, **change):
    pins = {**record.pins, element: dataclasses.replace(record.pins[element], **change)}
    return dataclasses.replace(record, pins=pins)


def test_inverted_pins_and_carriers_that_are_off_are_named(tmp_path):
    run = captured_run(tmp_path / "pins.vcd", mode="drives")
    record = pin_record_of_capture(read_capture(run.path), ChannelMap.of("map.toml", MAP))
    pin = record.pins[4]
    inverted = changed(record, 4, rises=pin.falls[:-1], falls=pin.rises[1:])
    pins = judged_pins(run, inverted)
    assert any("element 4 (e4)" in line for line in pins.findings["pins"])
    fast = dataclasses.replace(record, period_s=record.period_s / 1.002)
    (line,) = judged_pins(run, fast).findings["carrier"]
    assert "+2000 ppm of 40000 Hz" in line
    stated = dataclasses.replace(fast, tolerance_ppm=2500.0)
    assert "carrier" not in judged_pins(run, stated).findings


def test_a_pin_that_goes_on_after_the_mute_is_found(run, record):
    pin = record.pins[4]
    more = np.arange(1.0, 4.0)
    longer = changed(
        record,
        4,
        rises=np.concatenate([pin.rises, pin.rises[-1] + more]),
        falls=np.concatenate([pin.falls, pin.falls[-1] + more]),
    )
    (line,) = judged_pins(run, longer).findings["mute"]
    assert line.startswith("element 4 fall")


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    ("late_us", "frames", "elements"),
    [(400, (1, 19, 23), range(16)), (700, (4, 9), range(40, 56))],
)
def test_a_late_frame_is_judged_from_its_latch_on(late_us, frames, elements, tmp_path):
    """Before it shows the old drive: of that no shared phase is guessed, and nothing of it is
    taken for the new drive of pins whose two drives look alike."""
    run = captured_run(tmp_path / "pins.vcd", array="8x8", frames=24)
    for frame in frames:
        due = run.intended[frame]
        early = dataclasses.replace(due, t_apply_us=due.t_apply_us - late_us)
        late = dataclasses.replace(
            run, intended=[*run.intended[:frame], early, *run.intended[frame + 1 :]]
        )
        pins = pins_of(late, "8x8", **some_pins(*elements))
        assert (pins.findings, pins.counts["late"], pins.counts["right"]) == ({}, 1, 24), frame


@pytest.mark.sampled(1)
@pytest.mark.parametrize("periods", [5.5, 9, 18])
def test_a_last_frame_that_a_mute_cuts_short_is_judged_while_it_sounds(periods, run, record):
    """It lasts 40 periods, of which 20 are judged."""
    muted = record.latches[-1] + periods
    for element, pin in record.pins.items():
        sounding = pin.falls < muted
        keys = {"rises": pin.rises[sounding], "falls": pin.falls[sounding]}
        record = changed(record, element, **keys)
    pins = judged_pins(run, record)
    assert not pins.findings
    assert pins.counts["judged"] == pins.counts["right"] == 12
    wrong = changed(record, 4, rises=record.pins[4].rises + 0.1, falls=record.pins[4].falls + 0.1)
    pins = judged_pins(run, wrong)
    assert pins.right[-1].tolist() == [element != 4 for element in range(16)]


def sounding_again(record, *elements):
    """Return *record* with more pulses of some pins, 20 periods behind their last ones."""
    for element in elements:
        pin = record.pins[element]
        more = pin.rises[-1] + np.arange(20.0, 25.0)
        record = changed(
            record,
            element,
            rises=np.concatenate([pin.rises, more]),
            falls=np.concatenate([pin.falls, more + 0.4]),
        )
    return dataclasses.replace(record, end=record.end + 30.0)


def test_pins_that_sound_again_after_the_end_were_not_muted(run, record):
    last = max(pin.rises[-1] for pin in record.pins.values())
    (line,) = judged_pins(run, sounding_again(record, 4)).findings["mute"]
    assert line == "element 4 sound again 0.5 ms after all fell silent, and the others do not"
    every = judged_pins(run, sounding_again(record, *range(16)))
    assert "the output sounds again 0.5 ms after it fell silent" in every.not_judged["mute"]
    muted = with_mute(sounding_again(record, *range(16)), last)
    (line,) = judged_pins(run, muted).findings["mute"]
    assert "600 µs after MUTE arrived, may be for 25 µs" in line


def with_mute(record, arrival):
    """Return *record* with a line on which a MUTE arrives at this period."""
    data = encode_frame(build_body(Mute(), flags=0, seq=1, time_us=0, session=0))
    times = arrival + 0.133 * np.arange(1 - len(data), 1)
    return dataclasses.replace(record, to_board=LineBytes(np.frombuffer(data, np.uint8), times))


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    ("before", "finding"),
    [(-0.9, None), (0.5, None), (1.5, "still on"), (80.0, "2000 µs after MUTE arrived")],
)
def test_with_the_line_of_the_host_the_pins_are_silent_a_period_after_mute(
    before, finding, tmp_path
):
    run = captured_run(tmp_path / "pins.vcd", capture_lingers=("all=2000",))
    record = pin_record_of_capture(read_capture(run.path), ChannelMap.of("map.toml", MAP))
    last = max(pin.rises[-1] for pin in record.pins.values())
    muted = with_mute(record, last - before)
    pins = judged_pins(run, muted)
    assert pins.after_mute_periods == pytest.approx(before)
    assert ("mute" in pins.findings) is (finding is not None)
    if finding:
        assert finding in pins.findings["mute"][0]
    endless = dataclasses.replace(muted, end=last + 1.5)
    pins = judged_pins(run, endless)
    if before > 1.0:
        assert pins.findings["mute"][0].endswith(", up to the end of the capture")
    else:
        assert pins.not_judged["mute"] == "not verified: the capture ends with MUTE"


def test_a_ramp_to_silence_is_no_torn_mute(run, record):
    fading = record
    for element, pin in record.pins.items():
        more = np.arange(1.0, 30.0 - element)  # where the amplitude is rounded to 0 first
        narrower = 0.25 * more / more[-1]
        fading = changed(
            fading,
            element,
            rises=np.concatenate([pin.rises, pin.rises[-1] + more + narrower]),
            falls=np.concatenate([pin.falls, pin.falls[-1] + more - narrower + 0.001]),
        )
    pins = judged_pins(run, fading)
    assert pins.findings == {}
    assert pins.not_judged == {"mute": "the output fades to silence (a ramp)"}


@pytest.mark.sampled(1)
@pytest.mark.parametrize("fault", ["frame.crc p=0.2", "line.truncate p=0.2", "line.disconnect"])
def test_frames_that_never_latched_are_those_of_the_back_door(fault, tmp_path):
    run = captured_run(tmp_path / "pins.vcd", frames=30, faults=[f"{fault} from=20ms"])
    latched = {latch.key.index for latch in run.latches}
    lost = [frame.number for frame in run.intended if frame.key.index not in latched]
    pins = pins_of(run)
    assert lost
    assert [event.split(":")[0] for event in pins.events] == [str(frame) for frame in lost]
    assert pins.findings == {}


def test_captures_of_parts_of_a_repeating_object_are_joined(tmp_path):
    runs = [captured_run(tmp_path / f"{n}.vcd", seed=5, capture_ppm=20.0 * n) for n in range(4)]
    records = [
        pin_record_of_capture(
            read_capture(run.path),
            ChannelMap.of("map.toml", {**MAP, **some_pins(*range(4 * n, 4 * n + 4))}),
        )
        for n, run in enumerate(runs)
    ]
    found = verify_captures(records, runs[0].intended, model=model_of("4x4"))
    assert found.verdict is Verdict.PASS
    assert found.run.counts["on_target"] == 12
    assert {str(frame.evidence) for frame in found.run.frames} == {"external"}
    three = verify_captures(records[:3], runs[0].intended, model=model_of("4x4"))
    assert three.run is None
    assert three.scope == "12 of 16 elements"


def test_another_run_and_an_element_too_many_are_refused_in_words(run, tmp_path):
    other = captured_run(tmp_path / "other.vcd", seed=2)
    found = judged(dataclasses.replace(run, path=other.path))
    assert found.verdict is Verdict.INCONCLUSIVE
    assert "the capture does not show this run" in found.reasons[0]
    with pytest.raises(ConfigurationError, match="e9 is element 9; the array has the elements 0"):
        judged(run, "3x3")


def test_frames_without_times_are_found_by_their_drives(run, tmp_path):
    timeless = [dataclasses.replace(frame, t_apply_us=None) for frame in run.intended]
    for keys in ({}, {"reference": "e0"}, some_pins(0, 1)):
        found = judged(dataclasses.replace(run, intended=timeless), **keys)
        assert found.verdict is Verdict.PASS, str(found)
        assert found.pins[0].counts["right"] == 12
    other = captured_run(tmp_path / "other.vcd", seed=2)
    found = judged(dataclasses.replace(other, intended=timeless))
    assert found.verdict is Verdict.INCONCLUSIVE


def test_a_capture_that_was_cut_off_passes_nothing(run, tmp_path):
    data, half = run.path.read_bytes(), tmp_path / "half.vcd"
    half.write_bytes(data[: len(data) // 2])
    found = judged(dataclasses.replace(run, path=half))
    assert found.verdict is Verdict.INCONCLUSIVE
    assert 3 < found.pins[0].counts["right"] < 9
    assert any("cut off" in reason for reason in found.reasons)


def test_a_frame_alone_before_missing_samples_fails_nothing(run, record):
    for element in range(9):  # of 16: the others may be right by chance
        pin, late = record.pins[element], 0.03 * (element + 1)
        record = changed(record, element, rises=pin.rises + late, falls=pin.falls + late)
    few = record.between(0.0, float(record.latches[1]) + 1.0, "samples are missing")
    found = judged_record(run, few)
    assert found.verdict is Verdict.INCONCLUSIVE, found.reasons
    # Several frames beside each other are shown for certain.
    most = record.between(0.0, float(record.latches[6]), "samples are missing")
    assert judged_record(run, most).verdict is Verdict.FAIL


def test_a_latch_pin_tells_frames_of_one_drive_apart(tmp_path):
    run = captured_run(tmp_path / "pins.vcd", mode="drives")
    record = pin_record_of_capture(read_capture(run.path), ChannelMap.of("map.toml", MAP))
    same = [dataclasses.replace(frame, drive=run.intended[3].drive) for frame in run.intended]
    begin = record.latches[3]
    pins = {
        element: dataclasses.replace(
            pin,
            rises=np.concatenate(
                [pulses_of(pin.rises, begin) + shift for shift in range(0, 480, 40)]
            ),
            falls=np.concatenate(
                [pulses_of(pin.falls, begin) + shift for shift in range(0, 480, 40)]
            ),
        )
        for element, pin in record.pins.items()
    }
    lacking = np.delete(begin + 40.0 * np.arange(12), [4, 5])
    held = dataclasses.replace(record, pins=pins, latches=lacking, end=begin + 600.0)
    found = verify_captures([held], same, model=model_of("4x4")).pins[0]
    assert found.findings == {}
    assert [event.split(":")[0] for event in found.events] == ["4", "5"]
    blind = dataclasses.replace(held, latches=None)
    assert verify_captures([blind], same, model=model_of("4x4")).pins[0].events == ()


def pulses_of(edges, begin):
    """Return the edges of one frame of 40 periods, well inside of it."""
    return edges[(edges >= begin + 1.0) & (edges < begin + 39.0)]
