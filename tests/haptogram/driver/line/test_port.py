import contextlib
import fcntl
import os
import socket
import subprocess
import sys
import tty

import pytest
import serial

from haptogram.driver.line.port import FdTransport, PyserialTransport, open_transport
from haptogram.errors import (
    ConfigurationError,
    LinkError,
    LinkLostError,
    PortBusyError,
    PortNotFoundError,
)

SOON_NS = 5_000_000_000


@pytest.fixture
def pty_pair():
    """A master descriptor and the path of its slave."""
    master, slave = os.openpty()
    tty.setraw(master)
    path = os.ttyname(slave)
    yield master, path
    for descriptor in (master, slave):
        with contextlib.suppress(OSError):  # the test closed it
            os.close(descriptor)


@pytest.fixture
def listener():
    with socket.create_server(("127.0.0.1", 0)) as server:
        yield server


@pytest.mark.parametrize(
    "url",
    [
        *("socket://", "socket://host", "socket://host:x", "socket://:1", "rfc2217://h:99999"),
        *("socket://[", "SOCKET://[::1:7000", "socket://\N{ACCOUNT OF}:1"),
    ],
)
def test_an_address_without_host_and_port_is_refused_with_its_form(url):
    with pytest.raises(ConfigurationError, match=r"^port '.*', must be \w+://HOST:PORT$"):
        open_transport(url)


@pytest.mark.pty
def test_bytes_pass_both_ways(pty_pair):
    master, path = pty_pair
    port = open_transport(path)
    assert isinstance(port, FdTransport)
    assert port.write_some(b"\x00\x11\x13\xff") == 4
    assert os.read(master, 100) == b"\x00\x11\x13\xff"
    os.write(master, b"answer\x00")
    assert port.read_available(port.now_ns() + SOON_NS) == b"answer\x00"
    port.close()


@pytest.mark.pty
def test_a_port_that_writes_the_bytes_down_is_given_them_all(pty_pair, capsys):
    master, path = pty_pair
    port = open_transport(f"spy://{path}")
    os.write(master, b"answer")
    assert port.write_some(b"request") == 7
    assert os.read(master, 100) == b"request"
    assert port.read_available(port.now_ns() + SOON_NS) == b"answer"
    port.close()
    told = capsys.readouterr().err
    assert "TX   0000  72 65 71 75" in told
    assert "RX   0000  61 6E 73 77" in told


@pytest.mark.pty
def test_a_silent_port_gives_nothing_at_the_deadline_and_not_before(pty_pair):
    port = open_transport(pty_pair[1])
    deadline_ns = port.now_ns() + 2_000_000
    assert port.read_available(deadline_ns) == b""
    assert port.now_ns() >= deadline_ns
    assert port.read_available(port.now_ns() - 1) == b""
    port.close()


@pytest.mark.pty
def test_a_port_that_takes_no_more_says_how_much_it_took(pty_pair):
    port = open_transport(pty_pair[1])
    taken = [port.write_some(bytes(65_536)) for _ in range(64)]
    assert taken[-1] == 0
    assert sum(taken) > 0
    port.close()


@pytest.mark.pty
def test_the_death_of_the_other_end_is_reported(pty_pair):
    master, path = pty_pair
    port = open_transport(path)
    os.close(master)
    with pytest.raises(LinkLostError, match=path):
        port.read_available(port.now_ns() + SOON_NS)
    with pytest.raises(LinkLostError, match=path):
        port.write_some(b"lost")
    port.close()
    port.close()


@pytest.mark.pty
def test_a_closed_port_is_lost_and_not_somebody_elses(pty_pair):
    port = open_transport(pty_pair[1])
    port.close()
    with pytest.raises(LinkLostError):
        port.read_available(0)
    with pytest.raises(LinkLostError):
        port.write_some(b"x")


@pytest.mark.pty
def test_a_port_that_was_closed_can_be_opened_again(pty_pair):
    for _ in range(3):
        open_transport(pty_pair[1]).close()


@pytest.mark.pty
def test_a_port_that_another_program_holds_is_busy(pty_pair):
    path = pty_pair[1]
    holder = subprocess.Popen(
        [
            sys.executable,
            "-c",
            "import serial, sys; port = serial.Serial(sys.argv[1], exclusive=True); "
            "print('held', flush=True); sys.stdin.read()",
            path,
        ],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
    )
    try:
        assert holder.stdout.readline() == b"held\n"
        with pytest.raises(PortBusyError, match=f"{path}: another program"):
            open_transport(path)
    finally:
        holder.communicate()
    open_transport(path).close()


@pytest.mark.pty
def test_an_open_port_is_locked_for_others(pty_pair):
    port = open_transport(pty_pair[1])
    other = os.open(pty_pair[1], os.O_RDWR | os.O_NOCTTY)
    with pytest.raises(BlockingIOError):
        fcntl.flock(other, fcntl.LOCK_EX | fcntl.LOCK_NB)
    os.close(other)
    port.close()


def test_no_such_port(tmp_path):
    with pytest.raises(PortNotFoundError, match="no such port"):
        open_transport(str(tmp_path / "ttyX"))


def test_a_refused_connection_is_not_called_an_absent_port():
    with socket.create_server(("127.0.0.1", 0)) as server:
        url = f"socket://127.0.0.1:{server.getsockname()[1]}"
    with pytest.raises(PortNotFoundError, match="nothing listens there"):
        open_transport(url)


def test_a_link_to_a_board_that_is_gone(tmp_path):
    (tmp_path / "board").symlink_to("/dev/pts/999999")
    with pytest.raises(PortNotFoundError, match="board: there is no such port"):
        open_transport(str(tmp_path / "board"))


def test_a_file_is_no_port(tmp_path):
    path = tmp_path / "file"
    path.write_text("not a port")
    with pytest.raises(LinkError, match="it is no serial port") as caught:
        open_transport(str(path))
    assert "\n" not in str(caught.value)
    assert path.read_text() == "not a port"


def test_a_folder_is_no_port(tmp_path):
    with pytest.raises(LinkError, match="it is a folder; name a port"):
        open_transport(str(tmp_path))


def test_nobody_listens(listener):
    port = listener.getsockname()[1]
    listener.close()
    with pytest.raises(PortNotFoundError, match=f"socket://127.0.0.1:{port}"):
        open_transport(f"socket://127.0.0.1:{port}")


@pytest.mark.parametrize(
    ("url", "baudrate"),
    [("nosuch://x", 9600), ("loop://", 0), ("loop://", -1), ("loop://[", 9600), ("spy://[", 9600)],
)
def test_arguments_that_make_no_sense(url, baudrate):
    with pytest.raises(ConfigurationError):
        open_transport(url, baudrate=baudrate)


def test_tcp(listener):
    port = open_transport(f"socket://127.0.0.1:{listener.getsockname()[1]}")
    client, _ = listener.accept()
    with client:
        assert port.write_some(b"hello") == 5
        assert client.recv(10) == b"hello"
        client.sendall(b"reply")
        assert port.read_available(port.now_ns() + SOON_NS) == b"reply"
    with pytest.raises(LinkLostError, match="closed"):
        port.read_available(port.now_ns() + SOON_NS)
    port.close()


def test_tcp_sends_small_writes_at_once(listener, monkeypatch):
    opened, open_serial = [], serial.serial_for_url

    def note_opened(*arguments, **options):
        opened.append(open_serial(*arguments, **options))
        return opened[-1]

    monkeypatch.setattr(serial, "serial_for_url", note_opened)
    port = open_transport(f"socket://127.0.0.1:{listener.getsockname()[1]}")
    with socket.socket(fileno=os.dup(opened[0].fileno())) as line:
        assert line.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)
    port.close()


def test_a_port_without_a_descriptor_waits_and_fails_alike():
    port = open_transport("loop://")
    assert isinstance(port, PyserialTransport)
    assert port.read_available(port.now_ns() - 1) == b""
    deadline_ns = port.now_ns() + 1_000_000
    assert port.read_available(deadline_ns) == b""
    assert port.now_ns() >= deadline_ns
    port.close()
    for use in (lambda: port.read_available(0), lambda: port.write_some(b"x")):
        with pytest.raises(LinkLostError, match="loop://"):
            use()


class VirtualPort(serial.SerialBase):
    """A port whose time passes only in its blocking reads; its answer takes 7 µs."""

    t_ns = 0
    answer = b""

    def open(self):
        self.is_open = True

    def _reconfigure_port(self):
        pass

    def now_ns(self):
        return self.t_ns

    @property
    def in_waiting(self):
        return len(self.answer) if self.t_ns >= 7_000 else 0

    def write(self, data):
        self.answer = data[:10]
        return len(self.answer)

    def read(self, size=1):
        until_ns = self.t_ns + round(self.timeout * 1e9)
        self.t_ns = max(self.t_ns, min(7_000, until_ns) if self.answer else until_ns)
        size = min(size, self.in_waiting)
        found, self.answer = self.answer[:size], self.answer[size:]
        return found


def test_a_port_that_cannot_but_wait_for_a_write_is_refused_and_closed(monkeypatch):
    """As that of rfc2217:// is."""

    def refuse(*_):
        raise NotImplementedError("write_timeout is currently not supported")

    port = serial.serial_for_url("loop://")
    monkeypatch.setattr(type(port), "write_timeout", property(fset=refuse))
    monkeypatch.setattr(serial, "serial_for_url", lambda *_, **__: port)
    with pytest.raises(ConfigurationError, match=r"rfc2217://h:1.*not supported.*take socket://"):
        open_transport("rfc2217://h:1")
    assert not port.is_open


def test_the_ports_own_clock_is_used_where_it_has_one():
    port = PyserialTransport(VirtualPort(), "virtual")
    assert port.read_available(5_000) == b""
    assert port.now_ns() == 5_000
    assert port.write_some(b"0123456789 more") == 10
    assert port.read_available(20_000) == b"0123456789"
    assert port.now_ns() == 7_000
    assert port.read_available(20_001) == b""
    assert port.now_ns() == 20_001
