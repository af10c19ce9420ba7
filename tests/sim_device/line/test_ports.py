"""The line model, and the ports and sinks inside this process."""

import errno
import json
import os
import re
import select
import socket

import pytest
import serial
from hypothesis import given
from hypothesis import strategies as st

from haptogram.errors import ConfigurationError, plain_reason
from haptogram_protocol.framing import end_of_frame
from sim_device.backdoor import sinks as sinks
from sim_device.backdoor.sinks import SocketSink, open_backdoor_sink
from sim_device.board.settings import board_settings
from sim_device.line.port import PortLostError
from sim_device.line.pty_port import PtyPort
from sim_device.line.socket_server import SocketDoorman, UnixListener
from sim_device.line.tcp_port import TcpPort
from sim_device.line.uart import Uart
from sim_device.log import BoardCountLog
from sim_device.simulation import Simulation

BURSTS = st.lists(st.tuples(st.integers(0, 10**7), st.binary(min_size=1, max_size=40)), max_size=8)


def put(line, bursts):
    """Send bursts after each other; return when every byte is there, by hand."""
    t_ns, free_ns, arrivals = 0, 0, []
    for wait_ns, data in bursts:
        t_ns += wait_ns
        line.send(data, t_ns)
        start_ns = max(t_ns, free_ns)
        ends = range(1, len(data) + 1)
        arrivals += [start_ns - (-k * 10 * 10**9 // 115_200) for k in ends]
        free_ns = arrivals[-1]
    return arrivals


@given(BURSTS, st.lists(st.integers(0, 10**8), max_size=10).map(sorted))
def test_every_byte_comes_ten_bit_times_after_the_one_before(bursts, looks):
    line = Uart(115_200)
    arrivals = put(line, bursts)
    sent = b"".join(data for _, data in bursts)
    received = b""
    for t_ns in looks:
        received += line.receive(t_ns)
        assert len(received) == sum(arrival_ns <= t_ns for arrival_ns in arrivals)
    received += line.receive(10**12)
    assert received == sent
    assert line.in_transit == 0


@given(BURSTS)
def test_the_next_event_is_the_next_delimiter_or_the_end_of_a_burst(bursts):
    line = Uart(115_200)
    arrivals = put(line, bursts)
    sent = b"".join(data for _, data in bursts)
    received = b""
    while (next_ns := line.next_event_ns(end_of_frame)) is not None:
        new = line.receive(next_ns)
        assert new
        assert 0 not in new[:-1]
        received += new
        assert next_ns == arrivals[len(received) - 1]
    assert received == sent


def test_without_a_baud_rate_a_line_takes_no_time_and_a_cut_loses_what_is_on_it():
    line = Uart(None)
    line.send(b"abc", 5)
    assert line.receive(4) == b""
    assert line.receive(5) == b"abc"
    line.send(b"def", 6)
    line.cut()
    assert line.receive(9) == b""
    assert line.in_transit == 0


@pytest.mark.pty
def test_a_pty_is_raw_at_both_ends_and_survives_its_clients(tmp_path):
    every_byte = bytes(range(256))
    port = PtyPort(tmp_path / "board")
    try:
        for _ in range(3):
            with serial.Serial(str(tmp_path / "board"), 115_200, timeout=20) as client:
                client.write(every_byte)
                received = b""
                while len(received) < 256:
                    received += port.read(4096)
                assert received == every_byte
                port.write(every_byte)
                assert client.read(256) == every_byte
            assert port.read(100) == b""
    finally:
        port.close()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.pty
def test_a_client_that_does_not_read_leaves_bytes_pending_not_lost(tmp_path):
    port = PtyPort(tmp_path / "board")
    data = os.urandom(300_000)
    try:
        with serial.Serial(str(tmp_path / "board"), 115_200, timeout=20) as client:
            port.write(data)
            assert port.pending > 0
            assert port.writing() == port.reading()
            received = b""
            while len(received) < len(data):
                received += client.read(min(4096, len(data) - len(received)))
                port.write(b"")
            assert received == data
    finally:
        port.close()


@pytest.mark.pty
def test_a_pty_that_is_unplugged_hangs_up_on_its_client_and_is_another_one_afterwards(tmp_path):
    port = PtyPort(tmp_path / "board")
    client = os.open(port.description, os.O_RDWR | os.O_NOCTTY)
    port.write(b"old")
    port.plug(is_there=False)
    port.plug(is_there=False)
    assert not os.path.lexists(port.description)
    assert (port.reading(), port.read(9), port.pending) == ([], b"", 0)
    port.write(b"lost")
    with pytest.raises(OSError, match="Input/output error"):
        os.write(client, b"x")
    os.close(client)
    port.plug(is_there=True)
    client = os.open(port.description, os.O_RDWR | os.O_NOCTTY)
    port.write(b"new")
    assert os.read(client, 9) == b"new"
    os.close(client)
    port.close()
    assert list(tmp_path.iterdir()) == []


def test_a_tcp_port_that_is_unplugged_takes_nobody_in_until_it_is_back():
    port = TcpPort("127.0.0.1", 0)
    address = port.description.removeprefix("socket://").split(":")
    for is_there in (True, False, True):
        port.plug(is_there)
        with socket.create_connection(address, 5) as client:
            select.select(port.reading(), [], [], 5)
            port.read(1)
            port.write(b"x")
            assert client.recv(1) == (b"x" if is_there else b"")
        port.plug(is_there=False)
    port.close()


def test_a_link_to_something_else_is_left_alone(tmp_path):
    (tmp_path / "real").write_text("data")
    (tmp_path / "board").symlink_to(tmp_path / "real")
    with pytest.raises(ConfigurationError, match="it is left alone"):
        PtyPort(tmp_path / "board")
    assert (tmp_path / "board").read_text() == "data"
    assert not (tmp_path / "board.lock").exists()


@pytest.mark.pty
def test_a_link_that_another_took_over_is_not_removed(tmp_path):
    port = PtyPort(tmp_path / "board")
    (tmp_path / "board").unlink()
    (tmp_path / "board").symlink_to("/dev/null")
    port.close()
    assert os.readlink(tmp_path / "board") == "/dev/null"


def test_an_address_in_use_is_one_clear_line():
    first = TcpPort("127.0.0.1", 0)
    number = int(first.description.rpartition(":")[2])
    try:
        with pytest.raises(ConfigurationError, match=f"tcp 127.0.0.1:{number}: cannot listen"):
            TcpPort("127.0.0.1", number)
    finally:
        first.close()


@pytest.mark.skipif(not socket.has_dualstack_ipv6(), reason="no IPv6 on this machine")
def test_an_address_of_ipv6_is_listened_at(caplog):
    port = TcpPort("::1", 0)
    try:
        assert port.description.startswith("socket://[::1]:")
        with serial.serial_for_url(port.description) as client, caplog.at_level("INFO"):
            client.write(b"x")
            heard = b""
            while heard != b"x":
                heard += port.read(10)
        assert "client [::1]:" in caplog.text
    finally:
        port.close()


def test_what_is_said_without_a_client_is_lost_and_a_departure_is_told_once():
    port = TcpPort("127.0.0.1", 0)
    host, _, number = port.description.removeprefix("socket://").rpartition(":")
    try:
        port.write(b"nobody hears this")
        assert port.pending == 0
        with socket.create_connection((host, int(number)), 20) as client:
            while len(port.reading()) == 1:
                port.read(10)
            client.sendall(b"hello")
            heard = b""
            while heard != b"hello":
                heard += port.read(10)
        while not port.take_departure():
            port.read(10)
        assert not port.take_departure()
    finally:
        port.close()


@pytest.fixture
def door(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # a path of a socket has to be short
    return "door"


def connect(path):
    client = socket.socket(socket.AF_UNIX)
    client.settimeout(20)
    client.connect(path)
    return client


def test_each_client_of_a_socket_gets_the_first_line_and_all_from_then_on(door):
    sink = open_backdoor_sink(f"unix:{door}")
    sink.write(b"board\n")
    sink.write(b"before\n")
    with connect(door) as client:
        sink.serve()
        sink.write(b"after\n")
        sink.close()
        assert client.makefile("rb").read() == b"board\nafter\n"
    assert not os.path.exists(door)


def test_a_slow_client_is_dropped_and_told_and_the_others_go_on(door, monkeypatch, caplog):
    monkeypatch.setattr(sinks, "CLIENT_BUFFER", 100_000)
    sink = SocketSink(UnixListener(door))
    sink.write(b"board\n")
    with connect(door) as slow, connect(door) as quick:
        sink.serve()
        received = b""
        quick.setblocking(False)
        for _ in range(100):
            sink.write(b"x" * 9_999 + b"\n")
            while True:
                try:
                    received += quick.recv(1 << 20)
                except BlockingIOError:
                    break
        (told,) = caplog.messages
        assert re.fullmatch(r"a client of the back door is 1\d{5} bytes behind: dropped", told)
        assert len(received) == 6 + 1_000_000
        assert sink.pending == 0
        assert slow.recv(5) == b"board"
    sink.close()


def test_a_stale_socket_is_replaced_and_a_live_one_is_not(door):
    stale = socket.socket(socket.AF_UNIX)
    stale.bind(door)
    stale.close()
    live = UnixListener(door)
    told = "backdoor unix:door: cannot listen there: another program listens at that address"
    with pytest.raises(ConfigurationError, match=f"^{told}$"):
        UnixListener(door)
    live.close()


def test_a_file_is_appended_to(tmp_path):
    path = tmp_path / "door.jsonl"
    for number in range(2):
        sink = open_backdoor_sink(str(path))
        sink.write(json.dumps(number).encode() + b"\n")
        sink.serve()
        assert sink.pending == 0
        sink.close()
    assert path.read_text() == "0\n1\n"


def test_counts_are_logged_when_they_have_moved_and_it_is_time(caplog):
    caplog.set_level("INFO")
    counts = BoardCountLog(1_000)
    counts.update({"latched": 3, "late": 0}, 999)
    counts.update({"latched": 4, "late": 0}, 1_000)
    counts.update({"latched": 4, "late": 0}, 2_000)
    counts.update({"latched": 4, "late": 1}, 2_500)
    counts.update({"latched": 4, "late": 1}, 3_000)
    assert [record.getMessage() for record in caplog.records] == [
        "counts: latched 4",
        "counts: late 1",
    ]


def test_the_time_that_a_process_stalled_counts_for_the_line_and_no_more():
    settings = board_settings(array="4x4", baud=1_000_000)
    arrivals = {}
    for waited_ns in (0, 3_000_000, 10**12):
        simulation = Simulation(settings)
        simulation.host_write(bytes(1000), 50_000_000, waited_ns=waited_ns)
        simulation.advance_to(50_000_000)
        arrivals[waited_ns] = 1000 - simulation.host_unsent
    assert arrivals == {0: 0, 3_000_000: 300, 10**12: 1000}


def test_the_line_still_takes_its_time_after_what_was_credited():
    simulation = Simulation(board_settings(array="4x4", baud=1_000_000))
    simulation.host_write(bytes([1]) * 1000, 50_000_000, waited_ns=3_000_000)
    simulation.advance_to(56_990_000)
    assert simulation.host_unsent > 0
    simulation.advance_to(57_000_000)
    assert simulation.host_unsent == 0


def test_a_server_that_is_gone_is_told_and_not_taken_for_an_idle_one():
    port = TcpPort("127.0.0.1", 0)
    assert port.read(1) == b""
    port.close()
    with pytest.raises(PortLostError, match=r"no client can be taken in: bad file descriptor"):
        port.read(1)


@pytest.mark.parametrize(
    ("code", "is_fatal", "is_short"),
    [(code, False, False) for code in (errno.EAGAIN, errno.ECONNABORTED, errno.EINTR, errno.EPROTO)]
    + [(code, False, True) for code in (errno.EMFILE, errno.ENFILE, errno.ENOBUFS)]
    + [(code, True, False) for code in (errno.EBADF, errno.EINVAL, errno.ENOTSOCK, errno.EPERM)],
)
def test_what_becomes_of_an_error_of_accept(code, is_fatal, is_short):
    error = OSError(code, os.strerror(code))
    why = plain_reason(error)

    class Server:
        def accept(self):
            raise error

    doorman = SocketDoorman(Server(), "port")
    if is_fatal:
        with pytest.raises(PortLostError, match=f"port: .*: {why}"):
            doorman.admit()
    else:
        assert doorman.admit() is None
    assert doorman.refused == is_short
    assert doorman.is_looking is not is_short


def test_the_folder_of_a_link_is_made_as_that_of_any_output(tmp_path, caplog):
    caplog.set_level("INFO")
    port = PtyPort(tmp_path / "new" / "one" / "board")
    assert (tmp_path / "new" / "one" / "board").is_symlink()
    port.close()
    assert f"{tmp_path / 'new' / 'one'}: a new folder, made for the link" in caplog.text
    (tmp_path / "file").write_text("")
    with pytest.raises(ConfigurationError, match="cannot be made"):
        PtyPort(tmp_path / "file" / "board")
