"""Verdicts by the pins of boards of other makers, with defects that real ones were found with."""

import re

import numpy as np
import pytest

from board_pins import CapturedBoard, frames_of, model_of
from haptogram.errors import ConfigurationError
from haptogram.evidence.captures.channel_map import ChannelMap
from haptogram.evidence.captures.files import read_capture
from haptogram.evidence.captures.pin_record import pin_record_of_capture
from haptogram.verification import Verdict
from haptogram.verification.pins.joined import verify_captures
from pin_captures import captured_dialect_run

MEGA_HZ = 16e6 / 396
EVERY = {"reference": "sync", "elements": "p{}"}
MEGA = EVERY | {"carrier_hz": MEGA_HZ}


def judged(board, path, keys, incomplete="", **how):
    record = pin_record_of_capture(
        read_capture(board.capture(path, **how)), ChannelMap.of("map.toml", keys)
    )
    model = model_of(board.dialect)
    return verify_captures([record], board.intended, model=model, incomplete=incomplete)


def judged_pins(*arguments):
    """The verdict of the pins alone, without that of the field."""
    return judged(*arguments, "the pins are looked at alone").pins[0]


def mega(gap_s=3e-3, **defects):
    frames = frames_of("ultraino-mega64", 4)
    return CapturedBoard("ultraino-mega64", frames, carrier_hz=MEGA_HZ, gap_s=gap_s, **defects)


@pytest.mark.parametrize("name", ["pins.sr", "pins.vcd"])
@pytest.mark.parametrize(
    ("dialect", "some"),
    [("sonicsurface", range(40)), ("ultraino-mega64", range(64)), ("ultraino-nano16", range(12))],
)
def test_a_healthy_board_passes(dialect, some, name, tmp_path):
    board = CapturedBoard(dialect, frames_of(dialect, 4), gap_s=6e-3)
    keys = EVERY | {"sample_rate_hz": 24e6}  # edges of ten steps of a period do not show it
    found = judged(board, tmp_path / name, keys, channels=some)
    (pins,) = found.pins
    assert found.verdict is Verdict.PASS, str(found)
    assert pins.counts["right"] == pins.counts["captured"] == 4
    assert (found.run is not None) == (len(some) == found.array_count)
    assert "a delay does not show" in pins.notes[0]


def test_late_channels_are_one_line_and_lose_no_focus(tmp_path):
    late = tuple(range(3, 256, 8))
    board = CapturedBoard("sonicsurface", frames_of("sonicsurface", 3), gap_s=6e-3, late_step=late)
    found = judged(board, tmp_path / "pins.sr", EVERY)
    assert found.pins[0].findings["phases"] == (
        "elements n mod 8 = 3 (32 of 256 pins): one step of 32 late, +11.2 degrees",
    )
    offsets = found.pins[0].offsets
    assert np.degrees(offsets.phase_rad[3::8]) == pytest.approx(11.25, abs=0.3)
    assert np.degrees(np.delete(offsets.phase_rad, late)) == pytest.approx(0.0, abs=0.3)
    assert "wrong drive; elements n mod 8 = 3 (32 of 256): one step of 32 late" in str(found)


@pytest.mark.parametrize("named", [False, True])
def test_ports_that_are_written_one_after_another_lag_behind_the_first(named, tmp_path):
    board = mega(late_us={n: 0.27 * (n // 8) for n in range(64)})
    elements = {f"p{n}": n for n in range(64)}
    path = board.capture(tmp_path / "pins.vcd")
    if named:
        elements = {f"P{'ABCDEFGH'[n // 8]}{n % 8}": n for n in range(64)}
        text = path.read_text()
        for channel, element in elements.items():
            text = text.replace(f" p{element} $end", f" {channel} $end")
        path.write_text(text)
    keys = MEGA | {"elements": elements}
    record = pin_record_of_capture(read_capture(path), ChannelMap.of("map.toml", keys))
    found = verify_captures([record], board.intended, model=model_of(board.dialect))
    lines = found.pins[0].findings["phases"]
    where = "port PH (8 of 64 pins)" if named else "elements 56 to 63 (8 of 64 pins)"
    base = "port PA" if named else "elements 0 to 7"
    assert len(lines) == 7
    lag = re.fullmatch(rf"{re.escape(where)}: ([0-9.]+) degrees behind {base}", lines[-1])
    assert float(lag[1]) == pytest.approx(7 * 0.27e-6 * MEGA_HZ * 360, abs=0.5)


def test_a_carrier_passes_within_the_tolerance_that_is_stated(tmp_path):
    board = mega()
    off = judged(board, tmp_path / "pins.sr", EVERY)
    ((line,),) = off.pins[0].findings.values()
    assert line.endswith("Hz on the analyser's clock, +10101 ppm of 40000 Hz; 1000 pass")
    stated = judged(board, tmp_path / "pins.sr", EVERY | {"carrier_tolerance_ppm": 2e4})
    assert stated.verdict is Verdict.PASS


@pytest.mark.parametrize("clock", [True, False])
def test_a_carrier_of_half_the_frequency_is_said(clock, tmp_path):
    board = mega(every=2)
    found = judged(board, tmp_path / "pins.sr", MEGA, clock=True)
    assert found.verdict is Verdict.FAIL
    (line,) = found.pins[0].findings["carrier"]
    assert line.startswith("20202 Hz: 64 of 64 pins pulse in one of 2 periods of the carrier")
    if clock:  # that of the timer alone is right
        found = judged(mega(), tmp_path / "right.sr", MEGA)
        assert found.verdict is Verdict.PASS


@pytest.mark.parametrize("reference", ["sync", "p0"])
def test_a_carrier_that_is_not_steady_is_no_latch(reference, tmp_path):
    board = mega(busy_s=6e-3, gap_s=12e-3)
    pins = judged_pins(board, tmp_path / "pins.sr", MEGA | {"reference": reference})
    assert pins.counts["right"] == 4, str(pins)
    assert set(pins.findings) == {"amplitudes"}
    (line,) = pins.findings["amplitudes"]
    assert re.fullmatch(r"for \d\d % of the time: -\d+\.\d dB; capture to_board to know why", line)
    assert not pins.carrier.is_steady
    line = MEGA | {"reference": reference, "to_board": "rx", "baud": 115_200}
    pins = judged_pins(board, tmp_path / "pins.sr", line)
    assert re.fullmatch(r"while bytes arrive: -\d+\.\d dB", pins.findings["amplitudes"][0])
    assert pins.not_judged["torn"] == "the carrier is not steady while pins change"


PINS = {  # findings, and the frames of 3 that are right; port H is 18.2 degrees behind port A
    "": ({}, 3),
    "upload=drawn-out": ({"amplitudes": r"while bytes arrive: -[56]\.\d dB"}, 3),
    "carrier=20kHz": ({"carrier": r"20000 Hz: 6 of 6 pins pulse in one of 2 periods"}, 0),
    "ports=staggered": (
        {"phases": r"element 63 \(e63\): phase off by -18\.[12] degrees in every"},
        0,
    ),
}


@pytest.mark.sampled(2)
@pytest.mark.parametrize("option", PINS)
def test_the_emulated_board_shows_at_its_pins_what_was_found(option, tmp_path):
    options = dict([option.split("=")]) if option else {}
    path, name = tmp_path / "pins.vcd", "ultraino-mega64"
    intended = captured_dialect_run(path, name, frames_of(name, 3), **options)
    line = {"reference": "carrier", "elements": "e{}", "to_board": "to_board", "baud": 115_200}
    record = pin_record_of_capture(read_capture(path), ChannelMap.of("map.toml", line))
    (pins,) = verify_captures([record], intended, model=model_of(name)).pins
    found, right = PINS[option]
    assert pins.counts["right"] == right, str(pins)
    assert set(pins.findings) == set(found)
    for check, told in found.items():
        assert re.search(told, "\n".join(pins.findings[check]))


def test_a_frame_that_never_came_is_lost_and_a_few_pins_say_what_they_cover(tmp_path):
    board = mega(left_out=(1,))
    for elements in ("p{}", {"p0": 0, "p9": 9, "p33": 33}):
        found = judged(board, tmp_path / "pins.sr", MEGA | {"elements": elements}, "unasked")
        (pins,) = found.pins
        assert pins.events == ("1: not latched; the pins kept the drive they had",)
        assert pins.counts["right"] == 3
    assert "3 of 64 elements" in str(found)


def test_a_capture_of_a_part_of_the_run_judges_that_part(tmp_path):
    """Nor is a frame that was lost at its end one that the board fell silent in."""
    frames = frames_of("ultraino-mega64", 12)
    board = CapturedBoard("ultraino-mega64", frames[:4], gap_s=6e-3, carrier_hz=MEGA_HZ)
    board.intended = [frame.intended(number) for number, frame in enumerate(frames)]
    pins = judged_pins(board, tmp_path / "pins.sr", MEGA)
    assert pins.counts["right"] == 4
    assert pins.findings == {}
    pins = judged_pins(mega(left_out=(3,)), tmp_path / "pins.sr", MEGA)
    assert pins.events == ("3: not latched; the pins kept the drive they had",)
    assert pins.counts["right"] == 3


def test_exchanged_pins_and_other_frames_are_named(tmp_path):
    board = CapturedBoard("sonicsurface", frames_of("sonicsurface", 5), gap_s=6e-3)
    elements = {f"p{n}": n for n in range(16)} | {"p3": 9, "p9": 3}
    some = range(16)
    found = judged(board, tmp_path / "pins.sr", EVERY | {"elements": elements}, channels=some)
    assert "element 3 (p9): does what element 9 should" in found.pins[0].findings["phases"]
    board.intended = [f.intended(n) for n, f in enumerate(frames_of("sonicsurface", 5, seed=2))]
    found = judged(board, tmp_path / "pins.sr", EVERY, channels=some)
    assert found.verdict is Verdict.INCONCLUSIVE
    assert "does not show this run" in found.reasons[0]


# --- shift registers -----------------------------------------------------------------------------

CHAINS = [[8 * chain + output for output in range(7, -1, -1)] for chain in range(32)]
LATE = [[8 * chain + output for output in (7, 6, 5, 4, 2, 1, 0, 3)] for chain in range(32)]


def shift_map(chains, **keys):
    data = {f"DATA{number}": elements for number, elements in enumerate(chains)}
    return {"shift": {"clock": "SHIFT", "latch": "LATCH", "steps": 32, "data": data} | keys}


@pytest.fixture(scope="module")
def surface():
    return CapturedBoard("sonicsurface", frames_of("sonicsurface", 3), gap_s=1e-3)


def judged_shift(board, path, keys):
    record = pin_record_of_capture(read_capture(path), ChannelMap.of("map.toml", keys))
    return verify_captures([record], board.intended, model=model_of(board.dialect))


@pytest.mark.sampled(1)
@pytest.mark.parametrize("name", ["pins.sr", "pins.vcd"])
def test_data_shift_and_latch_show_all_outputs(name, surface, tmp_path):
    path = surface.capture_shift(tmp_path / name, CHAINS)
    found = judged_shift(surface, path, shift_map(CHAINS))
    assert found.verdict is Verdict.PASS, str(found)
    assert found.scope == "all 256 elements"
    path = surface.capture_shift(tmp_path / name, LATE, late_bit=True)
    found = judged_shift(surface, path, shift_map(LATE))
    assert found.pins[0].findings["phases"] == (
        "elements n mod 8 = 3 (32 of 256 pins): one step of 32 late, +11.2 degrees",
    )


def test_a_pattern_names_chains_and_the_order_may_be_the_other(tmp_path):
    surface = CapturedBoard("sonicsurface", frames_of("sonicsurface", 8), gap_s=1e-3)
    ascending = [list(range(8 * chain, 8 * chain + 8)) for chain in range(4)]
    path = surface.capture_shift(tmp_path / "pins.sr", [list(reversed(c)) for c in ascending])
    keys = {"shift": {"clock": "SHIFT", "latch": "LATCH", "steps": 32, "data": "DATA{}"}}
    first = judged_shift(surface, path, {"shift": keys["shift"] | {"order": "first"}})
    assert first.verdict is Verdict.PASS, str(first)
    assert first.scope == "32 of 256 elements"
    other = judged_shift(surface, path, keys)
    assert other.verdict is Verdict.FAIL
    (line,) = other.pins[0].findings["phases"]
    assert "each chain of 8 the other way round" in line


REFUSED = {
    "even": ({"data": {"DATA0": [0, 1, 2]}}, "must come out even"),
    "latch": ({"latch": "L"}, "no channel 'L'"),
    "no latch": ({"latch": None}, "[shift] has no latch"),
    "twice": ({"data": {"DATA0": [*range(8)], "DATA1": [7, *range(9, 16)]}}, "are both element 7"),
    "order": ({"order": "up"}, "order"),
    "list": ({"data": {"DATA0": "e0"}}, "must be a list of 1 to 256 elements"),
    "data": ({"data": "D"}, "data of [shift] is 'D'"),
    "clock": ({"clock": "quiet"}, "quiet"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_makes_no_sense_is_one_line(case, surface, tmp_path):
    change, told = REFUSED[case]
    path = surface.capture_shift(tmp_path / "pins.vcd", CHAINS[:2], until_s=1e-3)
    keys = shift_map(CHAINS[:2])
    keys["shift"] = {k: v for k, v in (keys["shift"] | change).items() if v is not None}
    with pytest.raises(ConfigurationError) as refusal:
        judged_shift(surface, path, keys)
    assert told in str(refusal.value)
    assert "\n" not in str(refusal.value)


def test_a_capture_that_ends_in_a_shift_or_lacks_edges_says_so(surface, tmp_path):
    path = surface.capture_shift(tmp_path / "pins.vcd", CHAINS[:2])
    whole = path.read_text()
    lines = whole.splitlines()
    path.write_text("\n".join(lines[:-20]) + "\n")
    (pins,) = judged_shift(surface, path, shift_map(CHAINS[:2])).pins
    assert re.match(r"the capture ends in a shift, \d of 8 bits behind", pins.notes[0])
    name = next(line.split()[3] for line in lines if line.endswith("SHIFT $end"))
    edges = [n for n, line in enumerate(lines) if line in (f"0{name}", f"1{name}")]
    lacking = [line for n, line in enumerate(lines) if n not in edges[15_001:15_003]]
    path.write_text("\n".join(lacking) + "\n")
    found = judged_shift(surface, path, shift_map(CHAINS[:2]))
    assert found.verdict is Verdict.INCONCLUSIVE
    assert "shifts between two edges of LATCH, not 8: edges are missing" in found.reasons[-1]
