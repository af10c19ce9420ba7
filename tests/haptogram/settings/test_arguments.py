"""What a user can get wrong in the public surface: one line with argument, value and limit."""

import contextlib
import inspect
import math
import re
from pathlib import Path

import numpy as np
import pytest

from haptogram.acoustics import AcousticModel
from haptogram.driver.dialect_driver import DialectDriver
from haptogram.driver.driver import Driver
from haptogram.driver.line.port import PyserialTransport
from haptogram.errors import ConfigurationError
from haptogram.evidence.virtual_board import VirtualBoard
from haptogram.objects.shapes import Circle, Hemisphere, Line, MeshSurface, Point, Sphere
from haptogram.records.frame import Evidence, Focus, FrameKey, Observation
from haptogram.settings.arguments import (
    check_choice,
    check_number,
    check_whole,
    shown_argument,
)
from haptogram.settings.board import BoardConfig
from haptogram.settings.board_url import PortConfig
from haptogram.verification import verify_run
from latched_drives import intend
from sim_device.protocol_haptogram import open_virtual_port
from virtual_ports import BoardPort

NAN, INF = math.nan, math.inf
MODEL = AcousticModel.default(4, 4)
PLACE = (0.0, 0.0, 0.1)

# Values that are wrong for an argument of this kind, whatever its limits are.
NO_NUMBER = ("x", "1", b"1", True, [1.0], (), 1j, object(), np.bool_(True), np.array([1.0, 2.0]))
NUMBER = (*NO_NUMBER, NAN, INF, -INF, -1, -0.5, 1e30, 10**400, np.float64("nan"))
WHOLE = (*NUMBER, 1.5, 2.0, np.float32(3.0))
TEXT = (None, 5, NAN, b"x", ["x"], object())
FLAG = (None, "yes", 0, 1, NAN, [])
CALLABLE = (5, "x", NAN, [])
MODE = (5, NAN, "colours", "", ["phases"], b"phases")
OTHER = (5, NAN, "x", [], object(), np.zeros((2, 2)))  # for an object of a class
TARGETS = (
    None,
    5,
    NAN,
    "x",
    "",
    [],
    [1, 2, 3],
    PLACE,
    [None],
    ["abc"],
    [["1", "2", "3"]],
    [(0, 0)],
    [(0, 0, NAN)],
    [(0, 0, INF)],
    [(0, 0, -0.1)],
    [(0, 0, 1e30)],
    [(0, 0, 1j)],
    [(True, False, True)],
    [[(0, 0, 0.1), (0, 0)]],
    [[]],
    {},
    {1: PLACE},
    np.zeros((2, 2)),
    np.zeros((1, 1, 3)),
    np.array(5.0),
    (place for place in [PLACE]),
    object(),
)
PLACES = (
    None,
    5,
    "x",
    "abc",
    (0, 0),
    (0, 0, NAN),
    (0, 0, INF),
    (0, 0, 1e30),
    (0, 0, 1j),
    (0, 0, "1"),
    ("0", "0", "1"),
    [(0, 0), (0, 0, 0)],
    np.zeros((1, 3)),
    {},
    object(),
)


def optional(values):
    return tuple(value for value in values if value is not None)


DIALECT_PARAMETERS = {"port", "timeout_s", "model", "medium", "calibration", "keep", "sink"}
DRIVER = {
    "port": (None, 5, NAN, "", b"/dev/ttyUSB0", [], {}, object(), Path("/x"), "a\0b", np.zeros(3)),
    "baudrate": (None, *WHOLE, 0),
    "nonce": (*WHOLE, 0, 65_536),
    "seed": WHOLE,
    "timeout_s": (None, *NUMBER, 0),
    "model": OTHER,
    "medium": OTHER,
    "calibration": OTHER,
    "trace": (*OTHER, 1, -1),
    "keep": (*WHOLE, 0),
    "sink": CALLABLE,
}
CHANNELS = (5, NAN, "x", b"x", [], {}, {1, 2}, object(), ["a"], [None], [[1]], [True], [-1])
DIALECT_DRIVER = {
    **{name: values for name, values in DRIVER.items() if name in DIALECT_PARAMETERS},
    "baudrate": (*WHOLE, 0),
    "dialect": (None, 3, True, "sonicsurfaces", b"sonicsurface"),
    "channels": (*CHANNELS, [1.0], [NAN], [10**30], [0, 1], np.zeros((16, 16), int), np.zeros(256)),
}
DIALECT_STREAM = ("targets", "rate_hz", "loops", "spin_us", "realtime", "solver", "progress")
STREAM = {
    "targets": TARGETS,
    "rate_hz": (None, *NUMBER, 0),
    "loops": (None, *WHOLE, 0),
    "lead_us": (*WHOLE, 0),
    "trim": FLAG,
    "miss_share": (None, *NUMBER, 1.5),
    "spin_us": (None, *WHOLE),
    "realtime": FLAG,
    "mode": MODE,
    "solver": MODE,
    "progress": CALLABLE,
}
METHODS = {
    "focus": {
        "target_m": (*PLACES, "", [], [None], [PLACE, PLACE], (1.0, 2.0, 3.0), (0, 0, -0.1)),
        "mode": (None, *MODE),
    },
    "hold": {"seconds": (None, *NUMBER)},
    "frames": {"targets": TARGETS, "mode": (None, *MODE), "solver": (None, *MODE)},
    "stream": STREAM,
    "play": {
        **{name: STREAM[name] for name in ("targets", "rate_hz", "loops", "mode", "solver")},
        "lead_us": (*WHOLE, 0),
        "unattended_ms": (*WHOLE, 0),
        "progress": CALLABLE,
    },
    "correct_phases": {"codes": (None, 5, NAN, "x" * 16, [0] * 16, b"", bytes(15), bytes(17))},
    "read_drive": {"kind": (None, *OTHER)},
}
DIALECT_METHODS = {
    "focus": {"target_m": METHODS["focus"]["target_m"], "solver": (None, *MODE)},
    "phases": {"phases_rad": (None, 5, NAN, "x", [], [0.0], np.full(256, NAN), [1j] * 256)},
    "hold": METHODS["hold"],
    "frames": {name: METHODS["frames"][name] for name in ("targets", "solver")},
    "stream": {name: STREAM[name] for name in DIALECT_STREAM},
}
GIVEN = {
    "focus": {"target_m": PLACE},
    "stream": {"targets": [PLACE], "rate_hz": 20},
    "play": {"targets": [PLACE], "rate_hz": 500},
    "frames": {"targets": [PLACE]},
}
# How an argument is called in a message, where not by its name.
SAID = {
    "targets": "target|frame",
    "target_m": "target|frame",
    "codes": "codes|phase corrections",
    "rate_hz": "rate",
    "array": "array|grid",
}
BOARD = {
    "array": (*TEXT, "", "x", "0x0", "1x-1", "100x100", "/nowhere.csv", "16"),
    "pitch_mm": (None, *NUMBER, 0),
    "temperature_c": (None, *NO_NUMBER, NAN, INF, -INF, 10**400, -21, 50.1, -300.0),
    "seed": (None, *WHOLE),
    "baudrate": (*WHOLE, 0),
    "reconstruct": FLAG,
    "faults": (None, 5, NAN, "line.flip", "", {"line.flip"}, object(), [5], ["line.flip", None]),
    "fault_plan": (5, NAN, [], object()),
    "calibration": OTHER,
    "dialect": (*optional(TEXT), ""),
    "clock": (5, NAN, "", "sundial", object()),
    "dialect_options": (None, 5, NAN, "x=1", [5], {}, object(), np.zeros(3)),
}
INTENDED = (None, 5, NAN, "x", [1], [None], {}, object(), [PLACE])
VERIFY = {
    "intended": INTENDED,
    "model": OTHER,
    "min_verified": (*NUMBER, "all", 1.1),
    "tolerance": (*OTHER, 0.5),
    "uncertainty": (*OTHER, 0.5),
}
OBSERVATIONS = (None, 5, NAN, "x", [5], [None], object(), [intend(MODEL, PLACE)])
RUN = {
    **VERIFY,
    "min_verified": (None, *VERIFY["min_verified"]),
    "model": (None, *OTHER),
    "observations": OBSERVATIONS,
    "cut": OTHER,
    "unseen": (5, NAN, [], object()),
    "silences": (None, 5, NAN, object(), ["x"], [NAN], [None]),
    "losses": (5, NAN, "x", [], {}, object()),
    "progress": CALLABLE,
}
BOARD_METHODS = {
    "verify": VERIFY,
    "wait_idle": {"intended": INTENDED},
    "wait_for": {"latches": (None, *WHOLE), "timeout_s": (None, *NUMBER)},
    "observations": {"session": WHOLE},
    "finish": {"progress": CALLABLE, "skip_fields": FLAG},
}
BOARD_GIVEN = {"verify": {"intended": []}, "wait_for": {"latches": 0}}
LENGTH = (None, *NUMBER, 0)
SHAPES = {
    Point: {"position_m": PLACES},
    Line: {"start_m": PLACES, "end_m": PLACES},
    Circle: {"radius_m": LENGTH, "center_m": PLACES},
    Sphere: {"radius_m": LENGTH, "center_m": PLACES},
    Hemisphere: {"radius_m": LENGTH, "center_m": PLACES, "lower": FLAG},
}
SHAPE_GIVEN = {
    "position_m": PLACE,
    "start_m": PLACE,
    "end_m": (0.1, 0, 0.1),
    "center_m": PLACE,
    "radius_m": 0.05,
}
FOCUS = {
    "position_m": tuple(place for place in PLACES if str(place) != "(0, 0, 1e+30)"),
    "amplitude": (None, *NUMBER, 1.1),
    "phase_rad": (None, *NO_NUMBER, NAN, INF, -INF, 1e30, -1e7, 10**400),
}


def refused(call, name, value):
    """Call with *value* for *name*; assert one clear line."""
    with pytest.raises(ConfigurationError) as caught:
        call(**{name: value})
    text = str(caught.value)
    assert "\n" not in text
    assert re.search(SAID.get(name, name), text), text
    assert len(text) < 250


def covers(call, table, *but):
    """Whether *table* names every parameter of *call*."""
    return set(inspect.signature(call).parameters) - {"self", *but} == set(table)


def each(table):
    return [pytest.param(name, values, id=name) for name, values in table.items()]


def each_in(tables):
    return [(of, name, values) for of, table in tables.items() for name, values in table.items()]


# --- the driver ----------------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "values"), each(DRIVER))
def test_a_driver_refuses_before_it_opens_anything(name, values):
    assert covers(Driver.__init__, DRIVER)
    for value in values:
        port = BoardPort(model=MODEL)
        refused(lambda **given: Driver(**({"port": port} | given)), name, value)  # noqa: B023
        assert port.written == []


@pytest.mark.parametrize(
    ("method", "name", "values"),
    each_in(METHODS),
)
def test_a_driver_refuses_before_the_first_byte(method, name, values):
    assert covers(getattr(Driver, method), METHODS[method])
    port = BoardPort(model=MODEL)
    with Driver(port) as driver:
        driver.arm()
        driver.focus(PLACE)
        before, intended = len(port.written), len(driver.intended)
        for value in values:
            call = getattr(driver, method)
            refused(lambda **given: call(**(GIVEN.get(method, {}) | given)), name, value)  # noqa: B023
            assert (len(port.written), len(driver.intended)) == (before, intended), value


@pytest.mark.parametrize(("name", "values"), each(DIALECT_DRIVER))
def test_a_driver_of_another_wire_refuses_before_it_opens_anything(name, values):
    assert covers(DialectDriver.__init__, DIALECT_DRIVER, "others")
    for value in values:
        port = BoardPort(model=MODEL)
        given = {"port": port, "dialect": "sonicsurface"}
        refused(lambda **wrong: DialectDriver(**(given | wrong)), name, value)  # noqa: B023
        assert port.written == []


@pytest.mark.parametrize(
    ("method", "name", "values"),
    each_in(DIALECT_METHODS),
)
def test_a_driver_of_another_wire_refuses_before_the_first_byte(method, name, values):
    assert covers(getattr(DialectDriver, method), DIALECT_METHODS[method])
    config = PortConfig(board=BoardConfig.of(dialect="sonicsurface"), clock="virtual")
    with (
        contextlib.closing(open_virtual_port(config)) as board,
        DialectDriver(PyserialTransport(board, "board"), dialect="sonicsurface") as driver,
    ):
        before, call = len(board.records), getattr(driver, method)
        for value in values:
            refused(lambda **given: call(**(GIVEN.get(method, {}) | given)), name, value)
            assert (len(board.records), len(driver.intended)) == (before, 0), value


@pytest.mark.parametrize("name", ["hold_ms", "sound_speed_mm_s", "trace_mode"])
@pytest.mark.parametrize("value", [None, *WHOLE], ids=lambda value: type(value).__name__)
def test_a_configuration_is_of_whole_numbers(name, value):
    port = BoardPort(model=MODEL)
    with Driver(port) as driver:
        before = len(port.written)
        refused(driver.configure, name, value)
        assert len(port.written) == before


def test_two_airs_contradict_each_other():
    port, warm = BoardPort(model=MODEL), AcousticModel.default(4, 4, temperature_c=30.0)
    Driver(port, model=MODEL, medium=MODEL.medium)
    with pytest.raises(ConfigurationError, match="the model has its own: leave medium out"):
        Driver(BoardPort(model=MODEL), model=MODEL, medium=warm.medium)


@pytest.mark.parametrize(("name", "values"), each(FOCUS))
def test_a_focus_is_what_can_be_focused_on(name, values):
    for make in (Focus, Focus.at):
        assert covers(make, FOCUS)
        given = {"position_m": PLACE}
        for value in values:
            said = "target" if name == "position_m" else name.split("_")[0]
            with pytest.raises(ConfigurationError, match=said):
                make(**(given | {name: value}))


# --- the virtual board ---------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "values"), each(BOARD))
def test_a_virtual_board_refuses_before_it_starts_a_process(name, values, monkeypatch, tmp_path):
    assert covers(VirtualBoard.__init__, BOARD)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    monkeypatch.setattr("subprocess.Popen", None)
    for value in values:
        refused(VirtualBoard, name, value)
    assert list(tmp_path.iterdir()) == []


@pytest.fixture(scope="module")
def board():
    with VirtualBoard("4x4", reconstruct=False, clock="wall") as board:
        yield board


@pytest.mark.pty
@pytest.mark.parametrize(
    ("method", "name", "values"),
    each_in(BOARD_METHODS),
)
def test_a_virtual_board_refuses_at_once(board, method, name, values):
    call = getattr(board, method)
    assert covers(call, BOARD_METHODS[method])
    for value in values:
        refused(lambda **given: call(**(BOARD_GIVEN.get(method, {}) | given)), name, value)
    assert board.how_it_ended() is None


@pytest.mark.pty
def test_what_was_seen_is_not_what_was_intended(board):
    frame = intend(AcousticModel.default(), PLACE)
    seen = Observation(FrameKey(1, 0, 0, 0), 0, False, Evidence.EXTERNAL)
    with pytest.raises(ConfigurationError, match=r"intended\[1\] is Observation.*, must be an Int"):
        board.verify([frame, seen])


# --- the verdict ---------------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "values"), each(RUN))
def test_a_run_is_refused_before_it_is_judged(name, values):
    assert covers(verify_run, RUN)
    given = {"intended": [intend(MODEL, PLACE)], "observations": [], "model": MODEL}
    for value in values:
        refused(lambda **wrong: verify_run(**(given | wrong)), name, value)


# --- shapes --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("shape", "name", "values"),
    each_in(SHAPES),
)
def test_a_shape_is_one_that_can_be(shape, name, values):
    assert covers(shape, SHAPES[shape])
    given = {part: SHAPE_GIVEN[part] for part in SHAPES[shape] if part in SHAPE_GIVEN}
    for value in values:
        refused(lambda **wrong: shape(**(given | wrong)), name, value)


@pytest.mark.parametrize("shape", SHAPES)
def test_a_resolution_is_a_length(shape):
    given = {part: SHAPE_GIVEN[part] for part in SHAPES[shape] if part in SHAPE_GIVEN}
    for value in LENGTH:
        refused(shape(**given).sample, "resolution_m", value)


def test_a_surface_is_that_of_a_mesh():
    for value in (None, *OTHER, "object.stl", Path("object.stl")):
        refused(MeshSurface, "mesh", value)


@pytest.mark.parametrize(
    ("name", "values"),
    each({"path": TEXT, "unit_m": LENGTH, "center_m": optional(PLACES)}),
)
def test_a_mesh_is_read_from_a_file(name, values):
    for value in values:
        refused(lambda **given: MeshSurface.from_file(**({"path": "x.stl"} | given)), name, value)


# --- the checks themselves -----------------------------------------------------------------------


@pytest.mark.parametrize("value", [1, 1.0, np.float32(1.0), np.int64(1), np.uint8(1)])
def test_any_real_number_will_do(value):
    assert check_number("x", value, 0.0, 1.0) == 1.0
    assert isinstance(check_number("x", value, 0.0, 1.0), float)


@pytest.mark.parametrize("value", [1, np.int64(1), np.uint8(1)])
def test_any_whole_number_will_do(value):
    assert isinstance(check_whole("x", value, 1, 1), int)


def test_a_message_stays_on_one_line():
    assert shown_argument("a\nb" * 50).endswith("...")
    assert "\n" not in shown_argument(np.zeros((9, 9)))


@pytest.mark.parametrize("value", [True, False, 1.0, "1", None])
def test_a_choice_among_numbers_is_a_whole_number(value):
    check_choice("bits", 1, (0, 1))
    with pytest.raises(ConfigurationError, match=r"^bits is .*; known are 0, 1"):
        check_choice("bits", value, (0, 1))
