"""What a user can do wrong with drivers and boards in the course of a session: one clear error."""

import contextlib

import numpy as np
import pytest

from haptogram.acoustics import AcousticModel
from haptogram.driver.dialect_driver import DialectDriver
from haptogram.driver.driver import Driver
from haptogram.driver.line.link import Link
from haptogram.driver.line.port import PyserialTransport
from haptogram.errors import ConfigurationError, DeviceError, LinkLostError
from haptogram.evidence.virtual_board import VirtualBoard
from haptogram.records.frame import FrameKey
from haptogram.settings.board import BoardConfig
from haptogram.settings.board_url import PortConfig
from haptogram_protocol.messages import Play
from latched_drives import intend
from sim_device.protocol_haptogram import open_virtual_port
from virtual_ports import BoardPort

MODEL = AcousticModel.default(4, 4)
PLACE = (0.0, 0.0, 0.15)
CLOSED = "this driver was closed; open another one"
USES = {
    "arm": lambda driver: driver.arm(),
    "mute": lambda driver: driver.mute(),
    "focus": lambda driver: driver.focus(PLACE),
    "hold": lambda driver: driver.hold(0.1),
    "stream": lambda driver: driver.stream([PLACE], 100),
    "play": lambda driver: driver.play([PLACE], 100),
    "status": lambda driver: driver.status(),
    "ping": lambda driver: driver.ping(),
    "config": lambda driver: driver.config(),
    "correct_phases": lambda driver: driver.correct_phases(bytes(16)),
    "geometry": lambda driver: driver.geometry(),
    "read_drive": lambda driver: driver.read_drive(),
}
DIALECT_USES = {
    "focus": USES["focus"],
    "phases": lambda driver: driver.phases(np.zeros(256)),
    "mute": USES["mute"],
    "hold": USES["hold"],
    "stream": lambda driver: driver.stream([PLACE], 20),
}


@contextlib.contextmanager
def boards_of(dialect):
    config = PortConfig(board=BoardConfig.of(dialect=dialect), clock="virtual")
    with contextlib.closing(open_virtual_port(config)) as port:
        yield PyserialTransport(port, dialect)


# --- Whole numbers of numpy ----------------------------------------------------------------------


def short(number):
    """Return *number* in the fewest bits of numpy, which most products overflow."""
    return np.min_scalar_type(number).type(number)


@pytest.mark.filterwarnings("error")
def test_whole_numbers_of_numpy_are_those_of_python():
    baudrate, keep = short(3_000_000), short(2000)
    with Driver(BoardPort(model=MODEL), seed=short(1), baudrate=baudrate, keep=keep) as driver:
        driver.arm()
        lead_us, spin_us = short(50_000), short(200)
        sent = driver.stream([PLACE] * 200, 1000, loops=short(3), lead_us=lead_us, spin_us=spin_us)
        lead_us, least_ms = short(100_000), short(3000)
        played = driver.play(
            [PLACE] * 200, 1000, loops=short(3), lead_us=lead_us, unattended_ms=least_ms
        )
    assert sent.sent == sent.status.counters.latched == played.latched == 600


@pytest.mark.filterwarnings("error")
def test_whole_numbers_of_numpy_are_those_of_python_on_another_wire():
    options = {"dialect": "sonicsurface", "baudrate": short(230_400), "keep": short(200)}
    with boards_of("sonicsurface") as port, DialectDriver(port, **options) as driver:
        report = driver.stream([PLACE] * 100, 40, loops=short(3), spin_us=short(200))
    assert report.frames == driver.observations.total == 300


# --- A driver that was closed --------------------------------------------------------------------


@pytest.mark.parametrize("use", USES)
def test_a_closed_driver_says_so(use):
    with Driver(BoardPort(model=MODEL), seed=1) as driver:
        driver.arm()
        driver.focus(PLACE)
    for _ in range(2):
        with pytest.raises(LinkLostError, match=CLOSED):
            USES[use](driver)
    driver.close()


def test_a_driver_that_an_inner_with_closed_says_so():
    with Driver(BoardPort(model=MODEL), seed=1) as driver:
        with driver:
            driver.arm()
        with pytest.raises(LinkLostError, match=CLOSED):
            driver.focus(PLACE)


@pytest.mark.parametrize("use", DIALECT_USES)
def test_a_closed_driver_of_another_wire_says_so(use):
    with boards_of("sonicsurface") as port:
        with DialectDriver(port, dialect="sonicsurface") as driver:
            driver.focus(PLACE)
        with pytest.raises(LinkLostError, match=CLOSED):
            DIALECT_USES[use](driver)


# --- A session that is not alone -----------------------------------------------------------------


def test_a_host_whose_session_another_host_took_is_told_of_it():
    port = BoardPort(model=MODEL)
    first = Driver(port, seed=1)
    Driver(port, seed=2)
    with pytest.raises(DeviceError, match=r"STALE_SESSION.*; another host has opened a session"):
        first.status()


def test_a_host_whose_board_was_started_anew_is_told_of_it():
    port, anew = BoardPort(model=MODEL), BoardPort(model=MODEL)
    driver = Driver(port, seed=1)
    anew.stall(port.now_ns())
    port.simulation = anew.simulation
    with pytest.raises(DeviceError, match="STALE_SESSION, detail 0; the board has been started"):
        driver.focus(PLACE)


def test_a_host_that_takes_the_nonce_of_the_last_session_is_told_of_it():
    port = BoardPort(model=MODEL)
    Driver(port, seed=1).close()
    port.closed = False
    with pytest.raises(DeviceError, match="SEQUENCE_REUSED, detail 1; the last session had this"):
        Driver(port, seed=1)


@pytest.mark.pty
def test_frames_of_two_sessions_are_not_one_run():
    with VirtualBoard("4x4", reconstruct=False) as board:
        frames = [intend(MODEL, PLACE, key=FrameKey(session, 0, 0, 65_520)) for session in (7, 9)]
        with pytest.raises(ConfigurationError, match="sessions 7 and 9; verify one session at a"):
            board.verify(frames)


# --- A playback that was cut short ---------------------------------------------------------------


@pytest.mark.parametrize(
    "then",
    [
        lambda driver: driver.play([PLACE] * 5, 1000).frames == 5,
        lambda driver: driver.stream([PLACE] * 5, 1000).status.counters.dropped_state == 0,
        lambda driver: driver.focus(PLACE),
    ],
    ids=["play", "stream", "focus"],
)
def test_a_driver_goes_on_after_a_playback_that_was_cut_short(then):
    def fail(*_):
        raise ZeroDivisionError

    with Driver(BoardPort(model=MODEL), seed=1) as driver:
        driver.arm()
        with pytest.raises(ZeroDivisionError):
            driver.play([PLACE] * 100, 100, progress=fail)
        assert then(driver)


def test_a_playback_whose_reply_nobody_waited_for_is_ended_before_the_next_frame(monkeypatch):
    real = Link.request

    def interrupted(link, message, *rest, **options):
        reply = real(link, message, *rest, **options)
        if isinstance(message, Play):
            raise KeyboardInterrupt
        return reply

    with Driver(BoardPort(model=MODEL), seed=1) as driver:
        driver.arm()
        monkeypatch.setattr(Link, "request", interrupted)
        with pytest.raises(KeyboardInterrupt):
            driver.play([PLACE] * 100, 100)
        monkeypatch.undo()
        assert driver.stream([PLACE] * 5, 1000).status.counters.dropped_state == 0


# --- Things of another driver, or of none --------------------------------------------------------


@pytest.mark.parametrize(
    ("model", "said"), [(None, "model is None, must be an"), (AcousticModel.default(), "256")]
)
def test_a_model_that_does_not_fit_is_refused_before_the_next_frame(model, said):
    with Driver(BoardPort(model=MODEL), seed=1) as driver:
        driver.model = model
        with pytest.raises(ConfigurationError, match=said):
            driver.focus(PLACE)
    with boards_of("sonicsurface") as port, DialectDriver(port, dialect="sonicsurface") as driver:
        driver.model = None
        with pytest.raises(ConfigurationError, match="model is None, must be an AcousticModel"):
            driver.focus(PLACE)


def test_frames_of_other_boards_are_refused_before_the_first_byte():
    with boards_of("autd3") as port, DialectDriver(port, dialect="autd3") as driver:
        others = driver.frames([PLACE])
    with boards_of("sonicsurface") as port, DialectDriver(port, dialect="sonicsurface") as driver:
        with pytest.raises(ConfigurationError, match="frame 0 was made for other boards"):
            driver.stream(others, 20)
        with pytest.raises(ConfigurationError, match="1 of 2 targets are frames; all must be"):
            driver.stream([*driver.frames([PLACE]), PLACE], 20)
        ours, count = driver.frames([PLACE]), driver.model.array.count
        assert driver.intended.total == 0
    turned = range(count)[::-1]
    with (
        boards_of("sonicsurface") as port,
        DialectDriver(port, dialect="sonicsurface", channels=turned) as driver,
        pytest.raises(ConfigurationError, match="frame 0 was made for other boards or channels"),
    ):
        driver.stream(ours, 20)


@pytest.mark.parametrize(
    ("targets", "said"),
    [
        (PLACE, r"targets are one point, \(0.0, 0.0, 0.15\); they must be a sequence of points"),
        (np.array(PLACE), "targets are one point, .*; they must be a sequence of points"),
        (iter([PLACE]), "targets are <list_iterator .*; they must be a sequence of points or foci"),
        ([], "0 targets; there must be 1 or more"),
    ],
    ids=["point", "array", "iterator", "none"],
)
def test_targets_that_are_no_row_of_points_say_what_they_are(targets, said):
    with Driver(BoardPort(model=MODEL), seed=1) as driver:
        driver.arm()
        with pytest.raises(ConfigurationError, match=said):
            driver.stream(targets, 100)
    with (
        boards_of("sonicsurface") as port,
        DialectDriver(port, dialect="sonicsurface") as driver,
        pytest.raises(ConfigurationError, match=said),
    ):
        driver.stream(targets, 20)


def test_an_event_is_one_of_the_board():
    said = r"event is 5, must be an event, as in Driver\.events"
    with Driver(BoardPort(model=MODEL)) as driver, pytest.raises(ConfigurationError, match=said):
        driver.time_of_event_us(5)


def test_a_board_in_this_program_wants_its_url_handler(monkeypatch):
    monkeypatch.setattr("serial.protocol_handler_packages", ["serial.urlhandler"])
    with pytest.raises(ConfigurationError, match=r"sim_device.register_url_handler\(\) makes it"):
        Driver("haptogram://?clock=virtual")
