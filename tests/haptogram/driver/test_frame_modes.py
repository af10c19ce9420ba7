"""Whatever way a frame goes to the board, what is latched is what its record says."""

import itertools

import numpy as np
import pytest

from haptogram.acoustics import AcousticModel, Medium, TransducerArray
from haptogram.driver.driver import Driver
from haptogram.errors import ConfigurationError, NoAnswerError
from haptogram.records.frame import Focus
from haptogram_protocol.messages import Feature, MessageType
from sim_device.board.settings import ALL_FEATURES
from virtual_ports import BoardPort

MODEL = AcousticModel.default(4, 4)  # the board's own air
WARM = Medium.air(35.0)
HOT = Medium.air(45.0)
PLACES = [(0.01, 0.0, 0.1), (0.0, 0.02, 0.12), (-0.01, -0.01, 0.09)]
HALF = [Focus(place, 0.5) for place in PLACES]
PAIRS = [[Focus(a), Focus(b, 0.3, 1.0)] for a, b in itertools.pairwise([*PLACES, PLACES[0]])]
FULL = [Focus(place) for place in PLACES]

WAYS = {
    "stream": lambda driver, foci, mode: driver.stream(foci, 500, mode=mode),
    "stream, ready": lambda driver, foci, mode: driver.stream(driver.frames(foci, mode=mode), 500),
    "stream, ready, round": lambda driver, foci, mode: driver.stream(
        driver.frames(foci, mode=mode), 500, mode=mode, loops=2
    ),
    "play": lambda driver, foci, mode: driver.play(foci, 500, mode=mode),
    "play, ready": lambda driver, foci, mode: driver.play(driver.frames(foci, mode=mode), 500),
    "focus": lambda driver, foci, mode: driver.focus(foci[0], mode=mode),
    "hold": lambda driver, foci, mode: (driver.focus(foci[0], mode=mode), driver.hold(0.3)),
}
FOCI = {
    "phases": {"full": FULL, "pairs": PAIRS},
    "drives": {"full": FULL, "half": HALF, "pairs": PAIRS},
    "points": {"full": FULL, "half": HALF, "pairs": PAIRS},
}
CASES = [
    (way, mode, name)
    for way, mode in itertools.product(WAYS, FOCI)
    for name in FOCI[mode]
    if not (way.startswith("play") and mode == "drives")
    and not (way in ("focus", "hold") and name == "pairs")
]


def turned(model, medium):
    return AcousticModel(model.array, medium, model.transducer)


def assert_latched_as_intended(port, driver):
    port.stall(2_000_000)  # the last frame may still be on the line
    latches = {(k.sequence, k.loop, k.index): x.drive for x in port.latches for k in [x.key]}
    assert len(latches) == len(driver.intended)
    for intended in driver.intended:
        key = intended.key
        latched = latches[key.sequence, key.loop, key.index]
        allowed = 1 if intended.board_computed else 0  # HG-5.4: the nearest code, or its neighbour
        apart = latched.phase_codes.astype(int) - intended.drive.phase_codes
        assert np.abs((apart + 128) % 256 - 128).max() <= allowed
        levels = latched.amplitude_codes.astype(int) - intended.drive.amplitude_codes
        assert np.abs(levels).max() <= allowed


@pytest.fixture
def port():
    return BoardPort(model=MODEL)


@pytest.fixture
def driver(port):
    with Driver(port, seed=1, medium=WARM) as driver:
        driver.arm()
        yield driver


@pytest.mark.parametrize(("way", "mode", "foci"), CASES)
def test_what_is_latched_is_what_was_intended(port, way, mode, foci):
    with Driver(port, seed=1, medium=WARM) as driver:
        driver.arm()
        WAYS[way](driver, FOCI[mode][foci], mode)
        assert_latched_as_intended(port, driver)
    assert {i.board_computed for i in driver.intended} == {mode == "points"}
    if foci == "half":
        assert driver.intended[0].drive.amplitude_codes.max() == 128


def test_modes_may_follow_each_other_within_a_stream(driver, port):
    frames = [f for mode in ("points", "phases", "drives") for f in driver.frames(FULL, mode=mode)]
    assert [frame.mode for frame in frames[::3]] == ["points", "phases", "drives"]
    driver.stream(frames, 500)
    assert_latched_as_intended(port, driver)


# --- the speed of sound --------------------------------------------------------------------------

OUTPUTS = {
    "stream": lambda driver, frames: driver.stream(frames, 500),
    "play": lambda driver, frames: driver.play(frames, 500),
}
BETWEEN = {
    "nothing": lambda _: None,
    "configure": lambda driver: driver.configure(sound_speed_mm_s=300_000),
    "another model": lambda driver: setattr(driver, "model", turned(driver.model, HOT)),
    "frames of another model": lambda driver: (
        setattr(driver, "model", turned(driver.model, HOT)),
        driver.focus(PLACES[0], mode="points"),
    ),
    "frames of phases": lambda driver: driver.focus(PLACES[0]),
}


@pytest.mark.parametrize("between", BETWEEN)
@pytest.mark.parametrize("output", OUTPUTS)
def test_a_ready_frame_takes_its_speed_of_sound_along(driver, port, output, between):
    frames = driver.frames(FULL, mode="points")
    assert {frame.sound_speed_mm_s for frame in frames} == {round(1000 * WARM.sound_speed_m_s)}
    OUTPUTS[output](driver, frames)
    BETWEEN[between](driver)
    OUTPUTS[output](driver, frames[::-1])
    assert port.board.output.config.sound_speed_mm_s == frames[0].sound_speed_mm_s
    driver.intended.clear()
    port.latches.clear()
    OUTPUTS[output](driver, frames) if output == "stream" else driver.play(frames, 250)
    assert_latched_as_intended(port, driver)


@pytest.mark.parametrize("between", BETWEEN)
def test_a_held_focus_takes_its_speed_of_sound_along(driver, port, between):
    held = driver.focus(PLACES[1], mode="points")
    if between.startswith("frames"):
        between = "another model"
    BETWEEN[between](driver)
    driver.hold(0.2)
    assert_latched_as_intended(port, driver)
    assert {latch.drive for latch in port.latches} == {held.drive}


def test_the_next_session_agrees_anew(port):
    with Driver(port, seed=1, medium=WARM) as first:
        first.arm()
        frames = first.frames(FULL, mode="points")
        first.configure(sound_speed_mm_s=377_000)
    port.closed = False
    port.latches.clear()
    with Driver(port, seed=2, medium=HOT) as second:
        second.arm()
        second.stream(frames, 500)  # as they are: for the air of the first
        second.stream(FULL, 500, mode="points")
        assert_latched_as_intended(port, second)
    assert port.board.output.config.sound_speed_mm_s == round(1000 * HOT.sound_speed_m_s)


def test_a_configuration_whose_answer_was_lost_is_asked_for(driver, port):
    read, deaf = port.read_available, []

    def hear(deadline_ns):
        data = read(deadline_ns)
        return b"" if deaf else data

    port.read_available = hear
    deaf.append(True)
    with pytest.raises(NoAnswerError):
        driver.configure(sound_speed_mm_s=round(1000 * HOT.sound_speed_m_s))
    deaf.clear()
    driver.model = turned(driver.model, MODEL.medium)  # what the board was set to before
    driver.arm()
    driver.focus(PLACES[0], mode="points")
    assert_latched_as_intended(port, driver)


def test_a_board_that_cannot_be_told_is_refused_before_the_first_byte():
    port = BoardPort(model=MODEL, features=ALL_FEATURES ^ Feature.CONFIG)
    with Driver(port, medium=WARM) as driver:
        driver.arm()
        before = len(port.written)
        for output in (
            lambda: driver.focus(PLACES[0], mode="points"),
            lambda: driver.play(FULL, 500, mode="points"),
        ):
            with pytest.raises(
                ConfigurationError, match=r"353\.5\d* m/s; the board assumes 343\.987"
            ):
                output()
        assert len(port.written) == before


def test_an_air_that_no_board_takes_is_refused(port):
    with Driver(port, medium=Medium(1500.0, 1000.0)) as driver:
        with pytest.raises(ConfigurationError, match="model is 1500 m/s; a board takes 300 to 380"):
            driver.frames(FULL, mode="points")
        assert len(driver.frames(FULL)) == 3


def test_a_board_without_amplitudes_is_expected_to_drive_in_full():
    port = BoardPort(model=MODEL, features=ALL_FEATURES ^ Feature.AMPLITUDE)
    with Driver(port, seed=1) as driver:
        driver.arm()
        driver.stream(PAIRS, 500, mode="points")
        assert_latched_as_intended(port, driver)
        with pytest.raises(ConfigurationError, match="drives every transducer at full amplitude"):
            driver.frames(HALF, mode="points")


# --- what does not fit ---------------------------------------------------------------------------


def other(mode="phases", targets=FULL, model=MODEL, medium=None, **settings):
    """Frames that another driver made."""
    port = BoardPort(model=model, **settings)
    with Driver(port, medium=medium) as driver:
        return driver.frames(targets, mode=mode)


BOWL = AcousticModel(
    TransducerArray.from_positions(MODEL.array.positions_m * (1.0, 1.0, 0.0) + (0.001, 0.0, 0.0)),
    MODEL.medium,
    MODEL.transducer,
)
LARGE = AcousticModel.default(5, 5)
MIXED = [*other(), *other("drives")]
TWO_AIRS = [*other("points"), *other("points", medium=HOT)]
MISFITS = [
    ("both", {"targets": []}, "0 targets"),
    ("both", {"targets": [*other(), (0.0, 0.0, 0.1)]}, "3 of 4 targets are frames"),
    ("both", {"targets": other(model=LARGE)}, "frame 0 was made for another board"),
    ("both", {"targets": other("points", model=LARGE)}, "frame 0 was made for another board"),
    ("both", {"targets": other(model=BOWL)}, "frame 0 was made for another board"),
    ("both", {"targets": other("points", model=BOWL)}, "frame 0 was made for another board"),
    ("both", {"targets": other("points"), "mode": "phases"}, "mode is 'phases'; the frames were"),
    ("both", {"targets": other(), "mode": "points"}, "made with phases: leave mode out"),
    ("both", {"targets": other(), "solver": "wgs"}, "made with naive: leave solver out"),
    (
        "both",
        {"targets": other("points", [[Focus(PLACES[0])] * 9], max_points=9)},
        "frame 0 was made for another board",
    ),
    ("both", {"targets": TWO_AIRS}, "a board has one"),
    ("play", {"targets": other("drives")}, "hold phases or points, not drives"),
    ("play", {"targets": MIXED}, "frames of the mode drives, phases; sequences"),
    ("play", {"targets": [*other(), *other("points")]}, "sequences hold phases or points"),
    *(
        ("both", {"loops": loops}, text)
        for loops, text in [
            (2.5, "loops is 2.5, must be a whole number"),
            (2.0, "loops is 2.0, must be a whole number"),
            (True, "loops is True, must be a whole number"),
            ("2", "loops is '2', must be a whole number"),
            (None, "loops is None, must be a whole number"),
            (0, "loops is 0, must be 1"),
            (-1, "loops is -1, must be 1"),
            (2**40, "must be 1 to 1"),
        ]
    ),
    ("stream", {"loops": 4_000_000}, "all loops of them is 12000000, must be 1 to 10000000"),
    ("play", {"loops": 40_000_000}, "all loops of them is 120000000, must be 1 to 100000000"),
]


@pytest.mark.parametrize(
    ("output", "arguments", "text"),
    [
        (output, arguments, text)
        for output, (which, arguments, text) in itertools.product(("stream", "play"), MISFITS)
        if which in (output, "both")
    ],
)
def test_what_does_not_fit_is_refused_before_the_first_byte(port, output, arguments, text):
    with Driver(port) as driver:
        driver.arm()
        before = len(port.written)
        given = {"targets": FULL} | arguments
        with pytest.raises(ConfigurationError, match=text):
            getattr(driver, output)(given.pop("targets"), 500, **given)
        assert len(port.written) == before
        assert driver.intended == []


@pytest.mark.parametrize(("mode", "lacks"), [("drives", "AMPLITUDE"), ("points", "POINTS")])
def test_frames_that_the_board_does_not_take_are_refused(mode, lacks):
    port = BoardPort(model=MODEL, features=ALL_FEATURES ^ Feature[lacks])
    with Driver(port) as driver, pytest.raises(ConfigurationError, match="made for another board"):
        driver.stream(other(mode), 500)


def test_frames_with_amplitudes_are_not_for_a_board_without():
    port = BoardPort(model=MODEL, features=ALL_FEATURES ^ Feature.AMPLITUDE)
    with Driver(port) as driver, pytest.raises(ConfigurationError, match="made for another board"):
        driver.stream(other("points", HALF), 500)


def test_a_model_of_another_size_makes_no_frames(driver):
    driver.model = LARGE
    with pytest.raises(ConfigurationError, match="25 transducers, the board 16"):
        driver.focus(PLACES[0])


def test_equal_targets_share_one_frame(driver):
    frames = driver.frames(np.tile(PLACES, (100, 1)))
    assert len({id(frame) for frame in frames}) == 3
    assert [frame.foci[0].position_m for frame in frames] == PLACES * 100
    assert MessageType.PHASES == frames[0].message.TYPE
