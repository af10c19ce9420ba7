"""Phases of a host as operations of every wire, and back."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptogram_protocol.dialects.autd3.frame import Autd3DeviceState
from haptogram_protocol.dialects.autd3.link import Autd3HostEnd
from haptogram_protocol.dialects.autd3.messages import Accepted, Autd3Refused, Autd3States, Hello
from haptogram_protocol.dialects.autd3.operations import ErrorCode
from haptogram_protocol.dialects.codec import Display, OneWayHostEnd
from haptogram_protocol.dialects.sonicsurface import TACTILE_CORRECTION, TACTILE_STEPS
from haptogram_protocol.dialects.table import DIALECTS
from haptogram_protocol.errors import LocalProtocolError

pytestmark = pytest.mark.sampled(8)

ASKS_BYTES = {"autd3": 1}  # of the question behind a frame


def displays() -> list[tuple[str, int]]:
    """Return each dialect with each number of boards, up to four, that its wire takes."""
    found = []
    for name, dialect in DIALECTS.items():
        assert dialect.display is not None
        for boards in range(1, 5):
            try:
                display = dialect.display(boards)
            except LocalProtocolError:
                continue
            if display.channels == boards * dialect.channels:
                found.append((name, boards))
    return found


every_display = pytest.mark.parametrize(("name", "boards"), displays())


def test_every_dialect_shows_phases_on_one_board() -> None:
    assert {name for name, boards in displays() if boards == 1} == set(DIALECTS)


@every_display
@given(data=st.data())
def test_codes_come_back_from_the_bytes(name: str, boards: int, data: st.DataObject) -> None:
    dialect = DIALECTS[name]
    display: Display = dialect.display(boards)
    host, board = dialect.host(**display.options), dialect.board(**display.options)
    board.receive_data(b"".join(map(host.send, display.opening())))
    few = st.lists(st.none() | st.integers(0, display.steps - 1), min_size=1, max_size=5)
    for _ in range(3):
        some = data.draw(few)
        codes = (some * display.channels)[: display.channels]
        line = b"".join(map(host.send, display.frame(codes)))
        assert len(line) == dialect.frame_bytes(boards) + ASKS_BYTES.get(name, 0)
        assert display.read(board.receive_data(line)) == codes
    assert not board.counters
    assert display.read(board.receive_data(b"".join(map(host.send, display.off())))) == [
        None
    ] * len(codes)


@every_display
def test_half_a_frame_shows_nothing(name: str, boards: int) -> None:
    display = DIALECTS[name].display(boards)
    assert display.read([]) is None
    assert display.read(display.frame([1] * display.channels)[:-2]) is None


def test_the_tactile_correction_brings_each_code_onto_its_step() -> None:
    """The board adds its table and drops the lowest bit."""
    display = DIALECTS["sonicsurface-tactile"].display(1)
    for step in range(TACTILE_STEPS):
        (_, phases, _) = display.frame([step] * 256)
        shown = [(c + a) % 32 >> 1 for c, a in zip(phases.codes, TACTILE_CORRECTION, strict=True)]
        assert shown == [step] * 256
    assert display.level == pytest.approx(math.sin(math.pi * 7 / 16))


def test_four_outputs_of_nano16_are_not_connected() -> None:
    assert DIALECTS["ultraino-nano16"].display(1).unconnected == {6, 7, 8, 9}
    assert DIALECTS["ultraino-nano16"].display(2).unconnected == {6, 7, 8, 9, 22, 23, 24, 25}
    assert not DIALECTS["ultraino-nano8"].display(1).unconnected


def test_a_wire_that_cannot_select_so_many_boards_says_so() -> None:
    with pytest.raises(LocalProtocolError, match="sonicsurface cannot select 3 boards"):
        DIALECTS["sonicsurface"].display(3)


def test_a_device_that_has_not_acknowledged_is_asked_again() -> None:
    display = DIALECTS["autd3"].display(2)
    (written, asked) = display.frame([None] * display.channels)
    (frame, _) = written.frames
    behind = Autd3States(
        (Autd3DeviceState(frame.message_id), Autd3DeviceState(frame.message_id - 1))
    )
    done = Autd3States((Autd3DeviceState(frame.message_id),) * 2)
    assert display.unfinished([Accepted(), behind]) == [asked]
    assert display.unfinished([behind, done]) == []
    assert display.unfinished([]) == []


def test_replies_say_why_they_refuse() -> None:
    assert Accepted().refusal is None
    assert Autd3Refused("no such device").refusal == "no such device"
    error = ErrorCode.INVALID_SEGMENT_TRANSITION
    states = Autd3States((Autd3DeviceState(1), Autd3DeviceState(1, error)))
    assert states.refusal == "device 1 answers error 5, INVALID_SEGMENT_TRANSITION"
    assert Autd3States((Autd3DeviceState(1, 15),)).refusal == "device 0 answers error 15"


def test_answers_are_due_where_boards_answer() -> None:
    host = Autd3HostEnd()
    assert host.due == 0
    host.send(Hello())
    assert host.due == 1
    host.receive_data(b"\0")
    assert host.due == OneWayHostEnd().due == 0
