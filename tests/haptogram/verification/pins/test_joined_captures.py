"""Captures of parts of an array, joined: phases that they share, and elements that are missing."""

import dataclasses
import re

import numpy as np
import pytest

from haptogram.acoustics import AcousticModel, Medium, Transducer, TransducerArray
from haptogram.evidence.captures.channel_map import ChannelMap
from haptogram.evidence.captures.files import read_capture
from haptogram.evidence.captures.pin_record import pin_record_of_capture
from haptogram.verification import Verdict
from haptogram.verification.pins.joined import verify_captures
from pin_captures import MAP, captured_run
from pin_oracle import Analyser, Board, edges_of, write_sr, write_vcd

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
    told = []
    every = verify_captures(
        [first, second], run.intended, model=MODEL, progress=lambda *done: told.append(done)
    )
    assert every.verdict is Verdict.PASS
    # The frames of each capture, then those of the field.
    assert told[:3] == [(0, 36), (12, 36), (25, 36)]
    assert told[-1] == (36, 36)
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


def seen_by_analysers(run, path, parts, faults):
    """Return captures of a repeating object by analysers of our own, one for each of *parts*.

    Their clocks are 100 ppm apart; *faults* are those of the board or the analyser in the last.
    """
    turns = np.array([frame.drive.phase_codes for frame in run.intended]) / 256
    board = Board(turns, np.ones(turns.shape), offset_turn=0.3)
    records = []
    for number, pins in enumerate(parts):
        analyser, shown, names = Analyser(50e6, ppm=50.0 - 100.0 * number), board, {}
        if number == len(parts) - 1:
            names = {k: v for k, v in faults.items() if k == "elements"}
            seen = {k: v for k, v in faults.items() if hasattr(analyser, k)}
            done = {k: v for k, v in faults.items() if k not in names | seen}
            analyser = dataclasses.replace(analyser, **seen)
            shown = dataclasses.replace(board, **done)
        file = path / f"{number}.{('vcd', 'sr')[number % 2]}"
        found = edges_of(shown, analyser, pins, np.random.default_rng(number))
        total_s = len(turns) * 1e-3 + (analyser.end_ms - analyser.begin_ms) * 1e-3
        (write_sr if file.suffix == ".sr" else write_vcd)(file, found, analyser, total_s)
        keys = {"reference": "clk", "elements": {f"p{pin}": pin for pin in pins}} | names
        records.append(pin_record_of_capture(read_capture(file), ChannelMap.of("map.toml", keys)))
    return records


EXCHANGED = {f"p{n}": n for n in range(8, 16)} | {"p9": 10, "p10": 9}
PARTS = [tuple(range(8)), tuple(range(8, 16))]
OF_PARTS = {
    "nothing": ({}, PARTS, Verdict.PASS),
    "another rate": ({"rate_hz": 24e6}, PARTS, Verdict.PASS),
    "from the middle on": ({"begin_ms": 6.3}, PARTS, Verdict.INCONCLUSIVE),
    "a gap": ({"lost": ((300_000, 777),)}, PARTS, Verdict.INCONCLUSIVE),
    "another phase of the carrier": ({"offset_turn": 0.4}, PARTS, Verdict.INCONCLUSIVE),
    "an element that is missing": ({}, [PARTS[0], PARTS[1][1:]], Verdict.PASS),
    "an element that is dead": ({"low": (11,)}, PARTS, Verdict.FAIL),
    "a step of 8 bits": ({"shifted": {11: 1 / 256}}, PARTS, Verdict.FAIL),
    "channels exchanged": ({"elements": EXCHANGED}, PARTS, Verdict.FAIL),
    "an overlap that disagrees": (
        {"shifted": {7: 0.02}},
        [PARTS[0], (7, *PARTS[1])],
        Verdict.FAIL,
    ),
    "a torn latch": ({"pin_late_ms": {12: 0.1, 13: 0.1}}, PARTS, Verdict.FAIL),
}


@pytest.mark.sampled(3)
@pytest.mark.parametrize("fault", OF_PARTS)
def test_what_is_wrong_with_one_of_two_captures_decides_their_verdict(fault, tmp_path):
    faults, parts, verdict = OF_PARTS[fault]
    run = captured_run(tmp_path / "pins.vcd", capture_elements="0")
    found = verify_captures(
        seen_by_analysers(run, tmp_path, parts, faults), run.intended, model=MODEL
    )
    assert found.verdict is verdict, str(found)
    assert (found.run is not None) or verdict is not Verdict.PASS or len(found.elements) == 15


def test_a_capture_of_another_object_passes_nothing(tmp_path):
    run = captured_run(tmp_path / "pins.vcd", capture_elements="0")
    other = captured_run(tmp_path / "other.vcd", capture_elements="0", seed=2)
    first = seen_by_analysers(run, tmp_path, PARTS[:1], {})
    second = seen_by_analysers(other, tmp_path, PARTS[1:], {})
    found = verify_captures([*first, *second], run.intended, model=MODEL)
    assert found.verdict is Verdict.INCONCLUSIVE
    assert "does not show this run" in found.reasons[0]
