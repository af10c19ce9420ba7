"""Verdicts on captures of our own analyser: drives, disturbances and faults that were put there."""

import numpy as np
import pytest

from haptogram.acoustics import AcousticModel, Drive, Medium, Transducer, TransducerArray
from haptogram.errors import ConfigurationError
from haptogram.evidence.captures.channel_map import ChannelMap
from haptogram.evidence.captures.files import read_capture
from haptogram.evidence.captures.pin_record import pin_record_of_capture
from haptogram.records.frame import Focus, FrameKey, Intended
from haptogram.verification import Verdict
from haptogram.verification.pins.judge import verify_captured_pins
from pin_oracle import Analyser, Board, edges_of, write_sr, write_vcd

pytestmark = pytest.mark.sampled(1)

MODEL = AcousticModel(TransducerArray.grid(4, 4, pitch_m=0.01), Medium.air(20.0), Transducer())


def judged(board, analyser, path, random, pins=range(16), reference="clk", **keys):
    """Capture the pins of *board* and judge them against what it was told."""
    count = len(board.turns)
    found = edges_of(board, analyser, list(pins), random)
    total_s = count * board.period_ms * 1e-3 + (analyser.end_ms - analyser.begin_ms) * 1e-3
    write = write_sr if path.suffix == ".sr" else write_vcd
    write(path, found, analyser, total_s)
    return judged_file(board, path, pins, reference, **keys)


def judged_file(board, path, pins=range(16), reference="clk", **more):
    count = len(board.turns)
    phases = np.rint(board.turns * 256).astype(np.uint8)
    amplitudes = np.rint(board.amplitudes * 255).astype(np.uint8)
    keys = {"reference": reference, "elements": {f"p{pin}": pin for pin in pins}} | more
    record = pin_record_of_capture(read_capture(path), ChannelMap.of("map.toml", keys))
    intended = [
        Intended(
            number,
            FrameKey.of_stream(1, 65_520 + number),
            4_285_000_000 + round(number * board.period_ms * 1e3),
            (Focus((0.0, 0.0, 0.1)),),
            Drive(phases[number], amplitudes[number]),
            8,
        )
        for number in range(count)
    ]
    return verify_captured_pins(record, intended, model=MODEL)


def drawn(seed, frames=10):
    random = np.random.default_rng(seed)
    codes = random.integers(0, 256, (frames, 16))
    if seed % 2:  # an object with small steps
        codes = (codes[0] + np.cumsum(random.integers(-6, 7, (frames, 16)), axis=0)) % 256
    amplitudes = random.integers(20, 256, (frames, 16))
    amplitudes[:, 5] = 0  # an element that never sounds
    amplitudes[frames // 2] = 0  # and a silent frame
    board = Board(codes / 256, amplitudes / 255, offset_turn=random.random())
    return random, board


@pytest.mark.parametrize("reference", ["clk", "p0"])
@pytest.mark.parametrize("seed", range(4))
def test_disturbances_of_the_analyser_are_no_faults_of_the_board(seed, reference, tmp_path):
    random, board = drawn(seed)
    analyser = Analyser(
        rate_hz=[8e6, 24e6, 50e6, 12.5e6][seed],
        ppm=[-100.0, 0.0, 100.0, 37.0][seed],
        jitter_ns=[0.0, 20.0, 5.0, 5.0][seed],
        glitches=seed,
        begin_ms=[-0.5, 1.3, -3.0, 1.3][seed],
        end_ms=[0.5, -1.3, 3.0, 0.5][seed],
    )
    path = tmp_path / ("pins.vcd" if (seed % 2 == 0) is (reference == "clk") else "pins.sr")
    pins = judged(board, analyser, path, random, reference=reference)
    assert pins.findings == {}
    assert pins.verdict is Verdict.PASS
    outside = 2 * (analyser.begin_ms > 0.0) + 2 * (analyser.end_ms < 0.0)  # frames, or a part
    assert pins.counts["right"] == 10 - outside
    assert pins.counts["lost"] == pins.counts["late"] == 0


FAULTS = {
    "dead": ({"low": (3,)}, "element 3 (p3): dead"),
    "stuck high": ({"high": (3,)}, "element 3 (p3): stuck high"),
    "inverted": ({"inverted": (3,)}, "element 3 (p3): "),
    "shifted": ({"shifted": {3: 0.25}}, "element 3 (p3): phase off by +"),
    "one step": ({"shifted": {3: 1 / 256}}, "element 3 (p3): phase off by +1."),
    "stuck": ({"stuck": {3: 0.4}}, "element 3 (p3): "),
    "silent": ({"drop": {3: 0.6}}, "element 3 (p3): silent in"),
    "torn": ({"pin_late_ms": dict.fromkeys(range(6), 0.1)}, "pins (element "),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_every_fault_is_found_in_spite_of_disturbances(fault, tmp_path):
    wrong, told = FAULTS[fault]
    random, board = drawn(len(fault))
    for name, value in wrong.items():
        setattr(board, name, value)
    analyser = Analyser(ppm=-60.0, jitter_ns=5.0, glitches=2)
    pins = judged(board, analyser, tmp_path / "pins.vcd", random)
    assert pins.verdict is Verdict.FAIL
    assert any(told in line for lines in pins.findings.values() for line in lines), pins.findings


@pytest.mark.parametrize("map_says_low", [False, True])
def test_pins_that_are_driven_while_they_are_silent_fail_though_they_all_are(
    map_says_low, tmp_path
):
    """Half a period that all pins share is no error of a phase; DC at the elements is one."""
    random, board = drawn(0)
    board.amplitudes = np.ones_like(board.amplitudes)
    if not map_says_low:
        board.inverted = tuple(range(16))
    pins = judged(board, Analyser(), tmp_path / "pins.vcd", random, active_low=map_says_low)
    level = "low" if map_says_low else "high"
    (line,) = pins.findings["pins"]
    assert f" and 8 more: {level} for 20 periods on end: inverted polarity, or stuck" in line
    random, board = drawn(0)
    board.inverted = tuple(range(16))
    right = judged(board, Analyser(), tmp_path / "low.vcd", random, active_low=True)
    assert right.verdict is Verdict.PASS


def test_phases_of_the_opposite_sign_at_all_pins_are_named(tmp_path):
    random, board = drawn(0)
    path = tmp_path / "pins.vcd"
    judged(Board(-board.turns, board.amplitudes, offset_turn=0.3), Analyser(), path, random)
    pins = judged_file(board, path)
    assert pins.verdict is Verdict.FAIL
    assert pins.findings["phases"] == ("every captured pin has the opposite sign of the phase",)


def test_the_shortest_frames_are_judged_and_shorter_ones_refused(tmp_path):
    random, board = drawn(0)
    board.amplitudes = np.ones_like(board.amplitudes)
    board.period_ms = 0.125  # five periods
    pins = judged(board, Analyser(), tmp_path / "pins.vcd", random)
    assert pins.findings == {}
    assert pins.counts["right"] > 0
    board.period_ms = 0.1
    with pytest.raises(ConfigurationError, match="must be 125 µs at least: 8000 frames/s"):
        judged(board, Analyser(), tmp_path / "pins.vcd", random)


@pytest.mark.parametrize("count", [17, 100, 333, 1000, 24_100])
@pytest.mark.parametrize("form", ["vcd", "sr"])
def test_what_comes_behind_lost_samples_is_not_judged(count, form, tmp_path):
    random, board = drawn(0)
    analyser = Analyser(ppm=60.0, lost=((120_000, count),))
    pins = judged(board, analyser, tmp_path / f"pins.{form}", random)
    assert pins.findings == {}
    assert pins.verdict is Verdict.INCONCLUSIVE
    assert any("cut off: samples are missing at 4.9" in reason for reason in pins.reasons)
    assert pins.counts["right"] == 4
    board.shifted = {3: 0.25}
    pins = judged(board, analyser, tmp_path / f"pins.{form}", random)
    assert pins.verdict is Verdict.FAIL


@pytest.mark.parametrize("reference", ["clk", "p0"])
@pytest.mark.parametrize("first_ms", [0.3, 8.2])
def test_samples_lost_in_the_first_or_last_frames_fail_no_board(first_ms, reference, tmp_path):
    """Those of a whole number of periods, which the clock of the carrier does not show either.

    A first frame that is shorter by them looks late, which fails no board either.
    """
    random = np.random.default_rng(8)
    board = Board(random.integers(0, 256, (10, 16)) / 256, np.ones((10, 16)))
    analyser = Analyser(lost=((round((first_ms + 0.5) * 24_000), 27 * 600),))
    path = tmp_path / "pins.vcd"
    pins = judged(board, analyser, path, random, reference=reference)
    assert pins.findings == {}
    board.shifted = {3: 0.25}
    assert judged(board, analyser, path, random, reference=reference).verdict is Verdict.FAIL


@pytest.mark.parametrize("lost", [(225_923, 1_063), (78_087, 21), (155_389, 1_971)])
@pytest.mark.parametrize("step", [3, 128])
def test_samples_lost_beside_an_element_fail_no_board(lost, step, tmp_path):
    random = np.random.default_rng(21)
    moves = np.cumsum(random.integers(-step, step + 1, (10, 16)), axis=0)
    turns = (random.integers(0, 256, 16) + moves) % 256 / 256
    board = Board(turns, np.ones((10, 16)), offset_turn=random.random())
    pins = judged(board, Analyser(lost=(lost,)), tmp_path / "pins.sr", random, reference="p0")
    assert pins.findings == {}


@pytest.mark.parametrize(("rate_hz", "jitter_ns"), [(24e6, 60), (100e6, 20), (500e6, 5)])
@pytest.mark.parametrize("fault", [{"shifted": {3: 0.25}}, {"drop": {3: 0.6}}, {}])
def test_jitter_of_an_element_that_is_the_reference_hides_no_fault(
    fault, rate_hz, jitter_ns, tmp_path
):
    random, board = drawn(1)
    board.amplitudes = np.ones_like(board.amplitudes)
    for name, value in fault.items():
        setattr(board, name, value)
    analyser = Analyser(rate_hz, jitter_ns=jitter_ns)
    pins = judged(board, analyser, tmp_path / "pins.vcd", random, reference="p0")
    assert pins.verdict is (Verdict.FAIL if fault else Verdict.PASS)


@pytest.mark.parametrize("reference", ["clk", "p0"])
def test_a_latch_that_comes_early_is_wrong(reference, tmp_path):
    random = np.random.default_rng(9)
    board = Board(random.integers(0, 256, (12, 16)) / 256, np.ones((12, 16)), late_ms={5: -0.4})
    path = tmp_path / "pins.vcd"
    pins = judged(board, Analyser(), path, random, reference=reference)
    if reference == "clk":
        assert pins.verdict is Verdict.FAIL
        assert any("frame 4: " in line for line in pins.findings["frames"])
    else:  # beside an element, missing samples look the same
        assert pins.verdict is Verdict.INCONCLUSIVE
        assert "frames 4: pins show another drive" in pins.reasons[0]


def test_pins_that_each_end_at_their_own_period_fall_silent_together(tmp_path):
    random = np.random.default_rng(3)
    board = Board(np.tile(random.integers(0, 256, (6, 1)) / 256, 16), np.ones((6, 16)))
    board.pin_late_ms = {pin: 0.0249 * (pin % 2) for pin in range(16)}
    pins = judged(board, Analyser(), tmp_path / "pins.vcd", random)
    assert pins.findings == {}
    assert pins.mute_periods is not None
    assert pins.mute_periods <= 1.0


def test_a_still_object_that_is_cut_off_begins_with_the_sound(tmp_path):
    random = np.random.default_rng(4)
    board = Board(np.tile(random.integers(0, 256, 16) / 256, (12, 1)), np.ones((12, 16)))
    analyser = Analyser(begin_ms=-1.5, end_ms=-5.5)
    pins = judged(board, analyser, tmp_path / "pins.vcd", random)
    assert pins.findings == {}
    assert pins.counts["judged"] == pins.counts["right"] == 6


def test_two_pins_with_another_sound_show_no_run(tmp_path):
    """One of both agrees with any run: the phase that they share is not known."""
    random = np.random.default_rng(5)
    told = Board(np.tile(random.integers(0, 256, 16) / 256, (8, 1)), np.ones((8, 16)))
    other = Board(np.tile(random.integers(0, 256, 16) / 256, (8, 1)), np.ones((8, 16)))
    judged(other, Analyser(), tmp_path / "pins.vcd", random, range(2))
    pins = judged_file(told, tmp_path / "pins.vcd", range(2))
    assert pins.verdict is Verdict.INCONCLUSIVE
    assert "does not show this run for certain" in pins.reasons[0]


def test_a_frame_of_which_a_pin_is_wrong_is_no_loss_of_samples(tmp_path):
    """Nor is one that all pins take late, nor one that they never take."""
    random, board = drawn(0)
    board.kept, board.late_ms, board.lost = {3: (4,)}, {6: 0.4}, (8,)
    pins = judged(board, Analyser(ppm=60.0), tmp_path / "pins.vcd", random, reference="p0")
    assert pins.verdict is Verdict.FAIL
    assert not any("cut off" in reason for reason in pins.reasons)


@pytest.mark.parametrize("reference", ["clk", "p0"])
@pytest.mark.parametrize("seed", [0, 1])
def test_lost_and_late_frames_are_named(seed, reference, tmp_path):
    random, board = drawn(seed)
    board.lost, board.late_ms = (3,), {7: 0.4}
    pins = judged(board, Analyser(ppm=50.0), tmp_path / "pins.vcd", random, reference=reference)
    assert pins.findings == {}
    assert pins.events[0] == "3: not latched; the pins kept the drive they had"
    assert pins.late_us == {7: pytest.approx(400.0, abs=30.0)}


@pytest.mark.parametrize("late_ms", [0.1, 0.5, 0.85, 0.98])
def test_a_frame_that_all_pins_latch_late_is_no_wrong_drive(late_ms, tmp_path):
    random, board = drawn(2)
    board.late_ms = {7: late_ms}
    pins = judged(board, Analyser(), tmp_path / "pins.vcd", random)
    assert pins.findings == {}
    assert pins.counts["lost"] + pins.counts["late"] == 1


def test_a_late_frame_beside_an_element_as_reference_is_no_wrong_drive(tmp_path):
    random = np.random.default_rng(6)
    board = Board(random.integers(0, 256, (12, 8)) / 256, np.ones((12, 8)), late_ms={6: 0.7})
    pins = judged(board, Analyser(), tmp_path / "pins.vcd", random, range(8), "p0")
    assert pins.findings == {}
    assert pins.late_us == {6: pytest.approx(700.0, abs=30.0)}


@pytest.mark.parametrize(("rate_hz", "step"), [(4e6, 4), (8e6, 2), (8e6, 3), (24e6, 1)])
def test_a_lost_frame_of_an_object_that_hardly_moves_is_no_wrong_drive(rate_hz, step, tmp_path):
    random = np.random.default_rng(7)
    moves = step * np.arange(12)[:, None] * np.where(np.arange(16) % 2, 1, -1)
    turns = (random.integers(0, 256, 16) + moves) % 256 / 256
    board = Board(turns, np.ones(turns.shape), lost=(8,))
    pins = judged(board, Analyser(rate_hz=rate_hz), tmp_path / "pins.vcd", random)
    assert pins.findings == {}
    assert pins.verdict is Verdict.PASS
    assert pins.events == ("8: not latched; the pins kept the drive they had",)


@pytest.mark.parametrize("kept", [1, 2, 5, 6])
def test_a_frame_that_only_some_pins_latch_is_wrong_and_not_lost(kept, tmp_path):
    random, board = drawn(4)
    board.kept = dict.fromkeys((0, 1, 2, 3, 4, 6, 7)[:kept], (3,))
    pins = judged(board, Analyser(), tmp_path / "pins.vcd", random, pins=range(8))
    assert pins.verdict is Verdict.FAIL
    assert pins.counts["lost"] == 0


def test_a_frame_is_lost_in_spite_of_a_dead_pin(tmp_path):
    random, board = drawn(2)
    board.lost, board.low = (3,), (4,)
    pins = judged(board, Analyser(), tmp_path / "pins.vcd", random)
    assert pins.findings == {"pins": ("element 4 (p4): dead: low all the time",)}
    assert pins.events == ("3: not latched; the pins kept the drive they had",)


@pytest.mark.parametrize("rate_hz", [4e6, 8e6, 24e6])
@pytest.mark.parametrize("code", [1, 2, 4, 6, 10, 12, 14, 20])
def test_pulses_of_a_sample_or_two_are_no_disturbance(code, rate_hz, tmp_path):
    random = np.random.default_rng(code)
    amplitudes = np.ones((8, 16))
    amplitudes[4] = code / 255
    amplitudes[:, 3] = 0.0  # a silent pin, for the disturbances
    board = Board(random.integers(0, 256, (8, 16)) / 256, amplitudes)
    pins = judged(board, Analyser(rate_hz, glitches=5), tmp_path / "pins.vcd", random)
    assert pins.findings == {}
    assert pins.counts["right"] == 8


@pytest.mark.parametrize(("begins_ms", "right"), [(0.1, 10), (1.4, 9), (2.4, 8)])
def test_pins_are_not_judged_while_a_simulation_knows_no_level(begins_ms, right, tmp_path):
    random, board = drawn(0)
    path = tmp_path / "pins.vcd"
    judged(board, Analyser(), path, random)
    lines = path.read_text().splitlines()
    name = next(line.split()[3] for line in lines if line.endswith("p5 $end"))  # a silent pin
    lines[lines.index(f"0{name}")] = f"x{name}"
    stamps = ((n, int(line[1:])) for n, line in enumerate(lines) if line[1:].isdigit())
    later = next(n for n, ns in stamps if lines[n][0] == "#" and ns >= begins_ms * 1e6)
    lines.insert(later + 1, f"0{name}")
    path.write_text("\n".join(lines) + "\n")
    pins = judged_file(board, path)
    assert pins.verdict is Verdict.PASS
    assert pins.counts["right"] == right


@pytest.mark.parametrize(
    ("end_ms", "told"),
    [
        (20.0, "the output sounds up to the end of the capture, 20.0 ms after the run; "),
        (-1.5, "the capture ends before the run"),
    ],
)
def test_a_mute_that_was_not_seen_is_told_as_not_verified(end_ms, told, tmp_path):
    random, board = drawn(0)
    board.mute = False
    pins = judged(board, Analyser(end_ms=end_ms), tmp_path / "pins.vcd", random)
    assert pins.mute_periods is None
    assert pins.not_judged["mute"].startswith(f"not verified: {told}")


@pytest.mark.parametrize(
    ("rate_hz", "pins", "seed", "reference"),
    [(24e6, 8, 0, "clk"), (24e6, 6, 1, "p0"), (50e6, 8, 1, "clk"), (50e6, 6, 0, "p0")],
)
def test_a_step_of_many_pins_fails_where_the_sampling_rate_shows_it(
    rate_hz, pins, seed, reference, tmp_path
):
    random, board = drawn(seed)
    board.amplitudes[:] = 1.0
    board.shifted = dict.fromkeys(range(pins), 1 / 256)
    found = judged(board, Analyser(rate_hz), tmp_path / "pins.vcd", random, reference=reference)
    assert found.verdict is Verdict.FAIL, found.reasons
    assert "phases" in found.findings


@pytest.mark.parametrize("reference", ["clk", "p0"])
@pytest.mark.parametrize(("rate_hz", "samples"), [(8e6, 2), (50e6, 4)])
def test_spikes_and_gaps_of_two_samples_or_a_tenth_of_a_microsecond_are_disturbances(
    rate_hz, samples, reference, tmp_path
):
    for seed in range(2):
        random, board = drawn(seed)
        analyser = Analyser(rate_hz, glitches=8, glitch_samples=samples)
        pins = judged(board, analyser, tmp_path / "pins.vcd", random, reference=reference)
        assert pins.findings == {}
        assert pins.counts["right"] == 10


def test_a_run_that_other_sound_precedes_has_no_torn_first_frame(tmp_path):
    """As of an object that repeats: the capture shows the end of the pass before."""
    random, board = drawn(2)
    board.turns = np.tile(board.turns[:6], (2, 1))
    board.amplitudes = np.ones((12, 16))
    pins = judged(board, Analyser(), tmp_path / "pins.vcd", random)
    assert pins.findings == {}
    told = Board(board.turns[6:], board.amplitudes[6:])
    shown = Board(np.roll(told.turns, 1, axis=0), told.amplitudes, offset_turn=0.3)
    judged(shown, Analyser(), tmp_path / "pins.vcd", random)
    pins = judged_file(told, tmp_path / "pins.vcd")
    assert pins.findings == {}
    assert pins.counts["right"] == 5


def told_without_the_first(board, first):
    """Return *board* as one that was told its later frames: what comes before is another sound."""
    return Board(board.turns[first:], board.amplitudes[first:], board.period_ms)


@pytest.mark.parametrize("pins", [2, 5])
def test_a_still_object_behind_another_sound_is_not_turned_in_its_first_frame(pins, tmp_path):
    random = np.random.default_rng(10)
    turns = np.tile(random.integers(0, 256, 16) / 256, (16, 1))
    turns[0] = random.integers(0, 256, 16) / 256
    board = Board(turns, np.ones((16, 16)))
    path = tmp_path / "pins.vcd"
    judged(board, Analyser(), path, random, range(pins))
    assert judged_file(told_without_the_first(board, 1), path, range(pins)).findings == {}


@pytest.mark.parametrize("reference", ["clk", "p0"])
@pytest.mark.parametrize("begin_ms", [-0.5, 3.95])
@pytest.mark.parametrize("fault", ["late", "lost", "wrong"])
def test_another_sound_reaches_into_a_first_frame_that_comes_late(
    fault, begin_ms, reference, tmp_path
):
    random = np.random.default_rng(11)
    board = Board(random.integers(0, 256, (14, 16)) / 256, np.ones((14, 16)))
    told = told_without_the_first(board, 4)
    if fault == "late":
        board.late_ms = {4: 0.4}
    elif fault == "lost":
        board.lost = (4,)
    else:
        board.turns = board.turns.copy()
        board.turns[4] = random.integers(0, 256, 16) / 256
    path = tmp_path / "pins.vcd"
    judged(board, Analyser(begin_ms=begin_ms), path, random, reference=reference)
    pins = judged_file(told, path, reference=reference)
    # What came before is not known; beside an element, missing samples look like a wrong frame.
    if (fault != "late" and begin_ms > 0.0) or (fault == "wrong" and reference == "p0"):
        assert pins.verdict is Verdict.INCONCLUSIVE
    elif fault == "wrong":
        assert pins.findings["frames"] == ("frame 0: 16 of 16 pins show another drive",)
    else:
        assert pins.findings == {}
        assert pins.verdict is Verdict.PASS
        assert pins.events[0].startswith("0: latched 39" if fault == "late" else "0: not latched")


def test_a_pin_that_is_too_faint_for_the_samples_is_not_dead(tmp_path):
    random = np.random.default_rng(12)
    board = Board(random.integers(0, 256, (8, 16)) / 256, np.ones((8, 16)), low=(3,))
    board.amplitudes[:, 3] = 2 / 255
    path = tmp_path / "pins.vcd"
    assert judged(board, Analyser(4e6), path, random).verdict is Verdict.PASS
    board.amplitudes[4, 3] = 40 / 255
    assert "dead" in judged(board, Analyser(4e6), path, random).findings["pins"][0]


def test_faint_pulses_of_the_last_frame_tell_no_end(tmp_path):
    """Disturbances are as long: of those pulses some are left out."""
    random = np.random.default_rng(13)
    board = Board(random.integers(0, 256, (8, 3)) / 256, np.ones((8, 3)), mute=False)
    board.amplitudes[-1] = [1.0, 2 / 255, 2 / 255]
    analyser = Analyser(50e6, jitter_ns=25.0, end_ms=3.0)
    board.turns, board.amplitudes = (
        np.tile(board.turns, 6)[:, :16],
        np.tile(board.amplitudes, 6)[:, :16],
    )
    assert judged(board, analyser, tmp_path / "pins.vcd", random).findings == {}


def test_the_carrier_of_a_few_periods_is_not_judged(tmp_path):
    random, board = drawn(0)
    analyser = Analyser(lost=((1_700, 7_464),))
    pins = judged(board, analyser, tmp_path / "pins.sr", random)
    assert pins.findings == {}
    assert pins.verdict is Verdict.INCONCLUSIVE


@pytest.mark.parametrize("reference", ["clk", "p0"])
@pytest.mark.parametrize("late_ms", [0.9, 0.92, 0.94])
def test_the_latch_behind_one_that_came_at_the_last_moment_is_not_torn(
    late_ms, reference, tmp_path
):
    random = np.random.default_rng(14)
    codes = random.integers(0, 256, 16) + np.cumsum(random.integers(-20, 21, (12, 16)), axis=0)
    board = Board(codes % 256 / 256, np.ones((12, 16)), late_ms={6: late_ms})
    path = tmp_path / "pins.vcd"
    pins = judged(board, Analyser(12e6), path, random, reference=reference)
    assert pins.findings == {}
    board.pin_late_ms = dict.fromkeys(range(1, 6), 0.1)
    assert "torn" in judged(board, Analyser(12e6), path, random, reference=reference).findings


def test_drives_that_samples_do_not_tell_apart_show_no_run(tmp_path):
    random = np.random.default_rng(16)
    moves = np.cumsum(random.integers(-1, 2, (6, 16)), axis=0)
    told = Board((random.integers(0, 256, 16) + moves) % 256 / 256, np.ones((6, 16)))
    other = Board(np.tile(random.integers(0, 256, 16) / 256, (6, 1)), np.ones((6, 16)))
    judged(other, Analyser(8e6), tmp_path / "pins.vcd", random, range(2))
    pins = judged_file(told, tmp_path / "pins.vcd", range(2))
    assert pins.findings == {}
    assert "does not show this run for certain" in pins.reasons[0]
