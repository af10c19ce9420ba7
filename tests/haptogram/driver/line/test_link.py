import pytest

from haptogram.driver.line.link import Link, open_line_session
from haptogram.driver.upload import upload_by_driver
from haptogram.errors import DeviceError, LinkLostError, NoAnswerError
from haptogram_protocol import HostConnection
from haptogram_protocol.connection import EventReceived
from haptogram_protocol.messages import (
    Arm,
    ArmReply,
    ErrorCode,
    GetStatus,
    MuteReply,
    Ping,
    Play,
    PlayReply,
    Pong,
    Status,
    StatusReply,
    Stop,
    StopReply,
    UploadChunk,
    UploadKind,
)
from virtual_ports import BoardPort, ScriptedPort


def link_to(port, timeout_s=1.0, nonce=9):
    connection = HostConnection(nonce=nonce)
    return Link(port, connection, baudrate=3_000_000, timeout_s=timeout_s, keep=None)


@pytest.fixture
def port():
    return BoardPort()


@pytest.fixture
def link(port):
    link = link_to(port)
    open_line_session(link)
    return link


def test_a_request_has_its_reply(link):
    assert link.request(Arm(), ArmReply).state.name == "ARMED"
    assert link.request(Ping(2**64 - 1), Pong).echo == 2**64 - 1


def test_a_refusal_names_request_and_reason(link):
    play = Play(sequence=5, period_us=1000, loops=1, unattended_ms=2000)
    with pytest.raises(DeviceError, match="PLAY was refused: BAD_STATE, detail 0") as caught:
        link.request(play, PlayReply, immediate=True)
    assert caught.value.code == ErrorCode.BAD_STATE


def test_a_request_waits_for_the_one_before_it(link):
    link.send(Ping(1))
    assert link.request(GetStatus(), StatusReply).queued == 0
    assert link.request(Stop(), StopReply).state.name == "DISARMED"


def test_replies_that_nobody_waits_for_and_events_go_to_the_handler(link, port):
    seen = []
    link.handler = seen.append
    link.send(Ping(7))
    link.run_until(port.now_ns() + 250_000_000)
    pongs = [e.message.echo for e in seen if not isinstance(e, EventReceived)]
    events = [e.message for e in seen if isinstance(e, EventReceived)]
    assert pongs == [7]
    assert len(events) == 2
    assert all(isinstance(event, Status) for event in events)


def test_what_came_with_a_refusal_that_raises_goes_to_the_handler_at_the_next_turn(link, port):
    seen = []
    link.handler = seen.append
    link.send(Play(sequence=5, period_us=1000, loops=1, unattended_ms=2000), immediate=True)
    port.simulation.advance_to(port.now_ns() + 250_000_000)  # refusal and STATUS wait in the port
    with pytest.raises(DeviceError):
        link.turn(port.now_ns())
    assert not seen
    link.turn(port.now_ns())
    assert isinstance(seen[0].message, Status)


def test_a_board_that_fell_silent_is_no_answer_in_bounded_time(link, port):
    port.write_some = len  # bytes vanish
    before_ns = port.now_ns()
    with pytest.raises(NoAnswerError, match=r"virtual://board: .* not answered"):
        link.request(GetStatus(), StatusReply)
    assert port.now_ns() - before_ns <= 1_000_000_000


def test_a_request_in_the_background_that_times_out_is_not_silent(link, port):
    port.write_some = len
    link.send(Ping(1))
    with pytest.raises(NoAnswerError, match="PING was sent 5 times and not answered"):
        link.run_until(port.now_ns() + 60_000_000_000)


def test_a_mute_overtakes_a_request_that_waits(link, port):
    link.request(Arm(), ArmReply)
    link.send(Ping(1))
    assert link.mute(MuteReply, 10**9).state.name == "MUTED"
    assert port.board.output.state.name == "MUTED"


@pytest.fixture
def muting_link(link):
    """A link whose handler mutes the board at every event, as a sink can."""
    link.request(Arm(), ArmReply)
    link.handler = lambda _: link.mute(MuteReply, 10**9)
    return link


def test_a_request_that_a_mute_of_the_handler_overtakes_is_given_up(muting_link, port):
    port.stall(250_000_000)  # STATUS waits in the port
    with pytest.raises(NoAnswerError, match="a request was given up for a MUTE"):
        muting_link.request(GetStatus(), StatusReply)
    assert muting_link.request(GetStatus(), StatusReply).state.name == "MUTED"


def test_a_mute_that_mutes_of_the_handler_overtake_is_confirmed(muting_link, port):
    port.stall(950_000_000)
    assert muting_link.mute(MuteReply, 10**9).state.name == "MUTED"
    assert not muting_link.connection.outstanding


def test_an_upload_that_a_mute_of_the_handler_overtakes_is_given_up(muting_link, port):
    write = port.write_some
    port.write_some = lambda data: len(data) if data[2] == UploadChunk.TYPE else write(data)
    with pytest.raises(NoAnswerError, match="a request was given up for a MUTE"):
        upload_by_driver(muting_link, UploadKind.CORRECTION, 0, bytes(256))
    assert muting_link.request(GetStatus(), StatusReply).state.name == "MUTED"


def test_a_mute_ends_the_rest_of_a_frame_that_was_cut_off(port):
    class Short:
        """A port that takes five bytes at a time."""

        url = "short"
        now_ns, read_available, close = port.now_ns, port.read_available, port.close

        def write_some(self, data):
            return port.write_some(data[:5]) and min(5, len(data))

    link = link_to(Short())
    open_line_session(link)
    link.request(Arm(), ArmReply)
    link.write_frame(b"\x00" + b"\x01\x05" * 60)
    assert link.mute(MuteReply, 10**9).state.name == "MUTED"
    assert link.stalls > 0
    assert port.simulation.dialect.counters["cobs"] == 1


def test_a_port_that_takes_nothing_is_lost_after_the_timeout(link, port):
    port.deaf = True
    before_ns = port.now_ns()
    link.write_frame(bytes(276))
    with pytest.raises(LinkLostError, match="taken no byte for 1 s"):
        link.run_until(before_ns + 10_000_000_000)
    assert port.now_ns() - before_ns < 1_010_000_000


def test_waiting_costs_no_turn_per_nanosecond(link, port):
    """A deadline far away is one wait per event of the line, not a spin."""
    turns, read = [], port.read_available
    port.read_available = lambda deadline_ns: turns.append(deadline_ns) or read(deadline_ns)
    link.run_until(port.now_ns() + 1_000_000_000)
    assert len(turns) < 30


def test_a_mute_is_bounded_before_any_session():
    port = ScriptedPort()
    with pytest.raises(NoAnswerError):
        link_to(port).mute(MuteReply, 500_000_000)
    assert port.now_ns() == 500_000_000
