"""Every dialect over a real pseudo-terminal or socket: the bytes of clients, and bad clients."""

import os
import re
import socket
import struct
import threading
import time
from contextlib import contextmanager

import pytest

from dialect_boards import SENT, DialectBoard
from haptogram_protocol.dialects.table import DIALECTS
from sim_device.dialects.table import EMULATIONS
from sim_device.line.pty_port import PtyPort
from sim_device.line.tcp_port import TcpPort
from sim_device.wallclock import Heartbeat

pytestmark = pytest.mark.pty
PATIENCE_S = 60
HELLO = bytes.fromhex("10 0100") + b"AUTD3REMOTE"
OPEN = b"\x01" + struct.pack("<I7f", 1, 0, 0, 0, 1, 0, 0, 0)


@contextmanager
def at_port(board: DialectBoard, port):
    """Run *board* on the wall clock behind *port*, in a thread."""
    heartbeat = Heartbeat(board.simulation, port)
    thread = threading.Thread(target=heartbeat.run)
    thread.start()
    try:
        yield
    finally:
        heartbeat.stop()
        thread.join(PATIENCE_S)
        port.close()
    assert not thread.is_alive()


def waited_for(condition) -> bool:
    deadline = time.monotonic() + PATIENCE_S
    while not condition() and time.monotonic() < deadline:
        time.sleep(0.005)
    return condition()


def address_of(port: TcpPort) -> tuple[str, int]:
    found = re.fullmatch(r"socket://(.*):(\d+)", port.description)
    assert found is not None
    return found[1], int(found[2])


def test_there_are_bytes_for_every_dialect() -> None:
    assert set(SENT) == set(EMULATIONS)


@pytest.mark.parametrize("name", SENT)
def test_a_client_s_bytes_make_the_same_pulses_as_in_virtual_time(name, tmp_path) -> None:
    expected = DialectBoard(name)
    expected.send(SENT[name])
    expected.pass_us(1_500_000)
    answer = expected.simulation.host_read()
    board, received = DialectBoard(name), b""
    if DIALECTS[name].bauds:
        with at_port(board, PtyPort(tmp_path / "board")):
            client = os.open(tmp_path / "board", os.O_RDWR | os.O_NOCTTY)
            os.write(client, SENT[name])
            assert waited_for(lambda: board.latches[-1:] and same_drive(board, expected))
            while len(received) < len(answer):
                received += os.read(client, 4096)
            os.close(client)
    else:
        port = TcpPort("127.0.0.1", 0)
        with at_port(board, port), socket.create_connection(address_of(port)) as client:
            client.settimeout(PATIENCE_S)
            client.sendall(SENT[name])
            while len(received) < len(answer):
                received += client.recv(4096)
            assert waited_for(lambda: board.latches[-1:] and same_drive(board, expected))
    assert received == answer
    assert board.simulation.dialect.counters == expected.simulation.dialect.counters


def same_drive(board: DialectBoard, expected: DialectBoard) -> bool:
    return board.latches[-1].pulses == expected.latches[-1].pulses


# first bytes of a client, what the link answers, what is told of it
STRANGERS = [
    (b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n", "gRPC over HTTP/2, as autd3 36", "HTTP/2 (gRPC"),
    (b"ARMT\x03" + bytes(40), "autd3-sdk", "autd3-sdk"),
    (b"GET / HTTP/1.1\r\n\r\n", "message 47h before the handshake", "text"),
    (HELLO[:1] + b"\x02\x00" + HELLO[3:], "version 2 of the link; served is 1", None),
    (HELLO + b"\x01" + struct.pack("<I", 2) + 2 * OPEN[5:], "this board has 1", None),
]


def test_clients_that_do_not_fit_are_told_why_and_the_next_one_is_served() -> None:
    board, port = DialectBoard("autd3"), TcpPort("127.0.0.1", 0)
    with at_port(board, port):
        for line, says, remark in STRANGERS:
            with socket.create_connection(address_of(port)) as client:
                client.settimeout(PATIENCE_S)
                client.sendall(line)
                told = b""
                while says.encode() not in told:
                    told += (more := client.recv(4096))
                    assert more, told
            if remark:
                assert waited_for(lambda remark=remark: any(remark in r for r in board.remarks))
        with socket.create_connection(address_of(port)) as client:
            client.settimeout(PATIENCE_S)
            client.sendall(
                HELLO + OPEN + b"\x03" + bytes(100)
            )  # and leaves in the middle of a frame
        assert waited_for(lambda: any("stops in its middle" in r for r in board.remarks))
        with socket.create_connection(address_of(port)) as first:
            first.settimeout(PATIENCE_S)
            first.sendall(HELLO)
            assert first.recv(1) == b"\0"
            with socket.create_connection(address_of(port)) as second:  # one at a time
                second.settimeout(PATIENCE_S)
                assert second.recv(1) == b""
            first.sendall(OPEN + b"\x04")
            answer = first.recv(1)
            while len(answer) < 4:
                answer += first.recv(4)
            assert answer[:2] == b"\0\0"
    counters = board.simulation.dialect.counters
    assert counters["links_undecodable"] == len(STRANGERS) - 1
    assert counters["devices_differ"] == 1
    assert counters["other_wires"] == sum(remark is not None for _, _, remark in STRANGERS)
    assert counters["frames_unfinished"] == 1
    assert all("\n" not in remark for remark in board.remarks)
