"""Captures of parts of an array, joined: phases that they share, and elements that are missing."""

import dataclasses
import re

import pytest

from haptogram.acoustics import AcousticModel, Medium, Transducer, TransducerArray
from haptogram.evidence.captures.channel_map import ChannelMap
from haptogram.evidence.captures.files import read_capture
from haptogram.evidence.captures.pin_record import pin_record_of_capture
from haptogram.verification import Verdict
from haptogram.verification.pins.joined import verify_captures
from pin_captures import MAP, captured_run

MODEL = AcousticModel(TransducerArray.parse("4x4", pitch_m=0.01), Medium.air(20.0), Transducer())


def part(run, elements, reference="carrier"):
    keys = {**MAP, "reference": reference, "elements": {f"e{n}": n for n in elements}}
    return pin_record_of_capture(read_capture(run.path), ChannelMap.of("map.toml", keys))


def turned(record, periods, begin=0.0, end=float("inf")):
    """Return *record* with the pulses from *begin* to *end* later by a part of a period."""
    pins = {
        element: dataclasses.replace(
            pin,
            rises=pin.rises + periods * ((pin.rises >= begin) & (pin.rises < end)),
            falls=pin.falls + periods * ((pin.rises >= begin) & (pin.rises < end)),
        )
        for element, pin in record.pins.items()
    }
    return dataclasses.replace(record, pins=pins)


def halves(path):
    run = captured_run(path, capture_rate_hz=50e6)
    return run, part(run, range(8)), part(run, range(8, 16))


@pytest.mark.parametrize("degrees", [180.0, 4.0])
def test_captures_that_are_apart_against_one_clock_pass_nothing(degrees, tmp_path):
    run, first, second = halves(tmp_path / "pins.vcd")
    off = turned(second, degrees / 360.0)
    assert verify_captures([off], run.intended, model=MODEL).verdict is Verdict.PASS  # by itself
    found = verify_captures([first, off], run.intended, model=MODEL)
    assert found.verdict is Verdict.INCONCLUSIVE
    assert found.run is None
    told = re.search(r"are ([0-9.]+) degrees apart .* in 12 of 12 frames", found.reasons[0])
    assert float(told[1]) == pytest.approx(degrees, abs=0.3)
    few = part(run, range(8, 12))
    both = [first, turned(few, degrees / 360.0)]
    assert verify_captures(both, run.intended, model=MODEL).verdict is Verdict.INCONCLUSIVE


def test_captures_that_are_apart_in_one_frame_pass_nothing(tmp_path):
    run, first, second = halves(tmp_path / "pins.vcd")
    assert verify_captures([first, second], run.intended, model=MODEL).verdict is Verdict.PASS
    begin = second.latches[4]
    found = verify_captures(
        [first, turned(second, 0.25, begin, second.latches[5])], run.intended, model=MODEL
    )
    assert found.verdict is Verdict.FAIL
    assert "frame 4: all pins are turned by +90.0 degrees against the clock" in found.reasons[0]
    assert "degrees apart against the clock of the carrier in 1 of 12 frames" in found.reasons[1]


def test_an_element_in_both_captures_makes_up_for_a_clock(tmp_path):
    run = captured_run(tmp_path / "pins.vcd", capture_rate_hz=50e6)
    first, both = part(run, range(8)), part(run, [0, *range(8, 16)])
    later = turned(both, 0.3)  # the clock began at another phase, for all elements
    found = verify_captures([first, later], run.intended, model=MODEL)
    assert found.verdict is Verdict.PASS, str(found)
    by_element = [part(run, range(8), "e0"), part(run, [0, *range(8, 16)], "e0")]
    found = verify_captures(by_element, run.intended, model=MODEL)
    assert found.verdict is Verdict.PASS, str(found)
    apart = [part(run, range(8), "e0"), part(run, range(8, 16), "e8")]
    found = verify_captures(apart, run.intended, model=MODEL)
    assert found.verdict is Verdict.INCONCLUSIVE
    assert "share no phase in 12 of 12 frames: capture the clock" in found.reasons[0]


def cut_at(record, end):
    """Return *record* up to *end*, in periods."""
    pins = {
        element: dataclasses.replace(
            pin, rises=pin.rises[pin.falls < end], falls=pin.falls[pin.falls < end]
        )
        for element, pin in record.pins.items()
    }
    latches = record.latches[record.latches < end]
    return dataclasses.replace(record, pins=pins, latches=latches, end=end)


def test_each_element_must_be_seen_in_most_of_the_frames(tmp_path):
    run, first, second = halves(tmp_path / "pins.vcd")
    for parts in ([first, second], [first, part(run, range(8, 11))]):
        short = cut_at(parts[1], parts[1].latches[3])
        found = verify_captures([first, short], run.intended, model=MODEL)
        assert found.verdict is Verdict.INCONCLUSIVE
        names = ", ".join(map(str, short.pins))
        told = f"elements {names}: 3 of 12 frames were judged at the fewest; 90 % must be"
        assert found.reasons[0].startswith(told), found.reasons
        most = verify_captures([first, short], run.intended, model=MODEL, min_verified=0.25)
        assert most.verdict is Verdict.PASS
