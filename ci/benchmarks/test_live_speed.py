"""A board on a terminal with its client, and its worker: processor time of both ends together."""

import contextlib

import pytest
from test_verdict_speed import jittered_frames

from haptogram import Driver
from haptogram.driver.line.port import FdTransport, open_transport
from haptogram.evidence.virtual_board import VirtualBoard
from haptogram_protocol.messages import LatchKey
from sim_device.backdoor.recorder import InlineReconstructionWorker
from sim_device.backdoor.worker import packed_worker_batch, unpacked_worker_batches
from sim_device.board.events import Latch
from sim_device.board.settings import BoardSettings
from sim_device.line.pty_port import PtyPort
from sim_device.simulation import Simulation
from sim_device.wallclock import Heartbeat
from timing_goals import exchange

AT_A_TIME = 20  # latches that a worker is handed at 1 kHz
TRIPS = 50
PIPELINED = 1000


class InTurns(FdTransport):
    """A terminal whose board does its part when its client waits: both are timed in one thread."""

    def __init__(self, port, url, heartbeat):
        super().__init__(port, url)
        self.heartbeat = heartbeat

    def read_available(self, deadline_ns):
        while not (data := super().read_available(0)) and self.now_ns() < deadline_ns:
            self.heartbeat._wait()  # noqa: SLF001  in turns
            self.heartbeat._turn()  # noqa: SLF001
        return data


class Sink:
    """Forgets what the board did."""

    def latch(self, latch):
        pass

    notice = latch


@contextlib.contextmanager
def exchanger_in_turns(folder, monkeypatch):
    port = PtyPort(folder / "board")
    heartbeat = Heartbeat(Simulation(BoardSettings(), Sink(), paced=False), port)

    def opened(url):
        transport = open_transport(url)
        return InTurns(transport._port, url, heartbeat)  # noqa: SLF001

    monkeypatch.setattr(exchange, "open_transport", opened)
    try:
        with exchange.exchanger(str(folder / "board")) as session:
            yield session
    finally:
        port.close()


@pytest.mark.row("ping over a pty, both ends")
def test_ping_over_a_pty(measure, tmp_path, monkeypatch):
    with exchanger_in_turns(tmp_path, monkeypatch) as session:
        measure(lambda: session.round_trips_us(TRIPS), repeats=1)


@pytest.mark.row("1000 frames pipelined over a pty, both ends")
def test_pipelined_over_a_pty(measure, tmp_path, monkeypatch):
    with exchanger_in_turns(tmp_path, monkeypatch) as session:
        assert session.closed_loop(20).verified == 20
        measure(lambda: session.pipelined(PIPELINED, 64), repeats=1)


@pytest.mark.row("256 latches at the worker, drives {drives}")
@pytest.mark.parametrize("drives", ["never seen", "seen before"])
def test_worker(drives, measure, board):
    """From the pipe to the lines of the back door, fields included."""
    latches = [
        Latch(
            LatchKey(0, 0, f.number), 1, f.number, f.t_apply_us, False, f.drive, 8, f.drive, False
        )
        for f in jittered_frames(board)
    ]
    groups = [latches[at : at + AT_A_TIME] for at in range(0, len(latches), AT_A_TIME)]
    piped = b"".join(map(packed_worker_batch, groups))
    recorder = InlineReconstructionWorker(BoardSettings(), lambda _: None)
    recorder.warm_up()

    def record():
        if drives == "never seen":
            recorder._texts.clear()  # noqa: SLF001  as of new drives
            recorder._estimator._seen.clear()  # noqa: SLF001
        return b"".join(map(recorder.lines_of_latches, unpacked_worker_batches(bytearray(piped))))

    assert record().count(b"single_focus") == len(latches)
    measure(record, repeats=1)


@pytest.mark.row("playback in virtual time, 4000 latches")
def test_playback(measure):
    """Upload of 40 frames, then a hundred loops of them: each latch and its record."""
    foci = [(0.001 * n - 0.02, 0.0, 0.15) for n in range(40)]
    with VirtualBoard(reconstruct=False) as board, Driver(board.url) as driver:
        driver.arm()
        measure(lambda: driver.play(foci, rate_hz=10_000, loops=100), repeats=1)
