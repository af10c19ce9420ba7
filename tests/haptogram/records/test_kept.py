"""What a driver records stays bounded, and what it does not keep any more is visible."""

import contextlib
import dataclasses
import gc

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptogram.acoustics import AcousticModel
from haptogram.driver.driver import Driver
from haptogram.evidence.boards import PortBoardUnderTest
from haptogram.evidence.virtual_board import VirtualBoard
from haptogram.records.frame import FrameKey, Intended, Observation
from haptogram.records.kept import MOST_KEPT, KeptRecords, only_kept_records
from haptogram.verification import FrameStatus, verify_run
from haptogram_protocol.connection import EventReceived
from haptogram_protocol.messages import LatchKey, TraceDrive, TraceMode
from link_pair import wire
from virtual_ports import BoardPort

MODEL = AcousticModel.default(4, 4)
ANGLE = np.linspace(0.0, 6.0, 40)
CIRCLE = np.column_stack((0.03 * np.cos(ANGLE), 0.03 * np.sin(ANGLE), np.full(40, 0.12)))


@given(st.one_of(st.none(), st.integers(1, 9)), st.lists(st.integers(), max_size=30), st.data())
def test_it_reads_like_the_end_of_a_list(most, entries, data):
    seen = []
    kept = KeptRecords(most, seen.append)
    kept.extend(entries)
    end = entries if most is None else entries[-most:]
    assert kept == end == list(kept)
    assert (len(kept), kept.total, kept.dropped) == (
        len(end),
        len(entries),
        len(entries) - len(end),
    )
    assert seen == entries
    number = data.draw(st.integers(0, len(entries)))
    assert list(kept.since(number)) == end[max(0, number - kept.dropped) :]
    assert kept[1:-1] == end[1:-1]
    for place in range(-len(end), len(end)):
        assert kept[place] == end[place]
    kept.clear()
    assert (kept == [], kept.dropped) == (True, len(entries))


def test_the_default_has_a_limit():
    with Driver(BoardPort(model=MODEL)) as driver:
        for record in (driver.intended, driver.observations, driver.events):
            record.extend([None] * (MOST_KEPT + 5))
            assert len(record) == MOST_KEPT


# --- a driver ------------------------------------------------------------------------------------

KEEP = 60


@pytest.fixture
def living():
    """Count the objects of each kind that were made in this test."""

    def count(*kinds):
        gc.collect()
        return [sum(isinstance(o, kind) for o in gc.get_objects()) for kind in kinds]

    gc.collect()
    gc.freeze()  # what ran in this process before is neither looked through nor counted
    return count


@pytest.mark.parametrize(
    ("way", "trace"),
    [
        ("stream", TraceMode.DRIVE),
        ("stream", TraceMode.RING),
        ("play", TraceMode.CRC),
        ("focus", TraceMode.CRC),
    ],
)
def test_a_long_run_takes_no_more_memory_than_a_short_one(way, trace, living):
    port, seen = BoardPort(model=MODEL), []
    port.latch = port.notice = lambda _: None
    outputs = {
        "stream": lambda: driver.stream(CIRCLE, 1000, loops=2),
        "play": lambda: driver.play(CIRCLE, 1000, loops=2),
        "focus": lambda: [driver.focus(place) for place in CIRCLE for _ in range(2)],
    }
    with Driver(
        port, seed=1, trace=trace, keep=KEEP, sink=lambda r: seen.append(type(r))
    ) as driver:
        driver.arm()
        counts = []
        for _ in range(4):
            outputs[way]()
            driver.mute()
            driver.arm()  # two events
            port.written.clear()
            counts.append(living(Intended, Observation, EventReceived))
        assert counts[-1][:2] == counts[0][:2]
        assert max(counts[-1]) <= KEEP
        driver.status()
        driver.collect_ring()
    assert len(driver.intended) == KEEP
    assert driver.intended.total == seen.count(Intended) == 4 * 80
    assert [i.number for i in driver.intended] == list(range(260, 320))
    assert driver.observations.total == seen.count(Observation) == 4 * 80


def test_numbers_go_on_where_the_record_does_not():
    port = BoardPort(model=MODEL)

    def stall(done, _):
        if done == 20:
            port.stall(40_000_000)

    with Driver(port, keep=10) as driver:
        driver.arm()
        driver.stream(CIRCLE, 1000)
        report = driver.stream(CIRCLE, 400, lead_us=10_000, progress=stall)
    assert 60 <= report.skipped[0] <= report.skipped[-1] < 80
    assert [i.number for i in driver.intended] == list(range(70, 80))


def test_the_end_of_a_playback_is_heard_among_any_number_of_events():
    with Driver(BoardPort(model=MODEL), keep=1) as driver:
        driver.arm()
        for _ in range(3):
            assert driver.play(CIRCLE, 1000).latched == 40
        assert driver.events.dropped > 0


@pytest.mark.parametrize("keep", [7, 50, None])
def test_a_playback_that_is_cut_short_intends_what_was_due(keep):
    port = BoardPort(model=MODEL)

    def interrupt(done, _):
        if done >= 100:
            raise KeyboardInterrupt

    with contextlib.suppress(KeyboardInterrupt), Driver(port, keep=keep) as driver:
        driver.arm()
        driver.play(CIRCLE, 100, loops=1_000_000, progress=interrupt)
    assert driver.intended.total == len(port.latches)
    assert 100 <= driver.intended.total < 150
    assert driver.intended[-1].key.loop == (driver.intended.total - 1) // 40


def test_a_sink_that_fails_ends_the_stream_and_leaves_the_board_mute():
    def full(entry):
        if entry.number == 30:
            raise OSError(28, "No space left on device")

    port = BoardPort(model=MODEL)
    driver = Driver(port, sink=full)
    driver.arm()
    with pytest.raises(OSError, match="No space"), driver:
        driver.stream(CIRCLE, 1000)
    assert driver.intended.total == 31
    assert port.board.output.state.name == "MUTED"


class Lying(BoardPort):
    """A board that tells, with every byte that it sends, of a drive that cannot be."""

    told = session = 0

    def read_available(self, deadline_ns):
        data = super().read_available(deadline_ns)
        if not (data and self.session):
            return data
        self.told += 1
        drive = TraceDrive(LatchKey(0, 0, 0), bytes(2 * (17 + self.told % 300)))
        return data + wire(drive, seq=self.told, session=self.session)


def test_warnings_do_not_pile_up():
    port = Lying(model=MODEL)
    with Driver(port) as driver:
        port.session = driver.session
        for _ in range(700):
            driver.status()
        assert port.told >= 700
        assert len(driver.warnings) == len(set(driver.warnings)) == 100
        assert "a drive of 18 transducers; the board has 16" in driver.warnings


# --- a verdict -----------------------------------------------------------------------------------


def test_a_board_at_a_port_says_that_its_word_was_not_kept():
    transport = BoardPort(model=MODEL)
    board = PortBoardUnderTest("x", baudrate=3_000_000, rate_hz=1000.0, board_computes=False)
    with Driver(transport, keep=30) as driver:
        board.prepare(driver)
        driver.arm()
        driver.stream(CIRCLE, 1000)
        board.finish(driver)
    observations = board.observations(driver)
    assert (board.unseen, len(observations)) == (None, 30)
    asked = [
        driver.intended[-1],
        dataclasses.replace(driver.intended[-1], key=FrameKey(0, 0, 0, 1)),
    ]
    for seen in (observations, only_kept_records(observations, lambda _: True)):
        run = verify_run(asked, seen, model=driver.model, min_verified=0.0)
        assert run.frames[1].status is FrameStatus.NOT_VERIFIED
        assert run.frames[1].note == "the driver keeps the last 30 latches it is told"
    run = verify_run(asked, list(observations), model=driver.model, min_verified=0.0)
    assert run.frames[1].status is FrameStatus.LOST


def test_a_run_whose_first_frames_were_dropped_is_judged_without_them():
    with Driver(BoardPort(model=MODEL), keep=30, trace=TraceMode.DRIVE) as driver:
        driver.arm()
        driver.stream(CIRCLE, 1000)
    assert driver.intended.dropped
    run = verify_run(driver.intended, driver.observations, model=driver.model)
    assert run.verdict.value == "inconclusive"
    assert run.counts["not_kept"] == driver.intended.dropped
    assert run.unexpected == []


@pytest.mark.pty
def test_what_is_not_kept_never_passes():
    with VirtualBoard("8x8", reconstruct=False) as board:
        with Driver(board.url, keep=50) as driver:
            driver.arm()
            driver.stream(CIRCLE, 200)
            assert board.verify(driver.intended, min_verified=0.0).counts["not_kept"] == 0
            driver.play(CIRCLE, 500)
            driver.focus(CIRCLE[0])
            driver.stream(CIRCLE, 200)
        run = board.verify(driver.intended, min_verified=0.0)
    assert (run.verdict.value, run.exit_status) == ("inconclusive", 3)
    assert run.counts["not_kept"] == driver.intended.dropped == 71
    assert run.counts["sent"] == 50
    assert run.unexpected == []
    assert "71 of 121 frames are not judged: the driver keeps the last 50" in str(run)
