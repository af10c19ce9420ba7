"""The worker behind the back door: it never stops the board, and nothing is lost uncounted."""

import dataclasses
import json
import os
import pickle
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from haptogram.acoustics import AcousticModel, Drive, superpose_foci
from haptogram.errors import ConfigurationError
from haptogram.evidence.backdoor import observations_of_backdoor
from haptogram.evidence.board_process import ENDS_WITHIN_S
from haptogram_protocol.messages import LatchKey
from sim_device.backdoor import recorder as recorder_module
from sim_device.backdoor import worker as reconstruction
from sim_device.backdoor.recorder import BackdoorEstimator, InlineReconstructionWorker
from sim_device.backdoor.worker import (
    ReconstructionWorker,
    packed_worker_batch,
    unpacked_worker_batches,
)
from sim_device.backdoor.worker_process import _SEARCHES
from sim_device.board.events import Latch, SessionOpened
from sim_device.board.settings import BoardSettings

MODEL = AcousticModel.default(4, 4)
SETTINGS = BoardSettings(model=MODEL)


def a_latch(index, bits=8):
    weights = superpose_foci(MODEL, [(0.001 * (index % 7), 0.002, 0.05)], [1.0], [0.0])
    coarse = Drive.from_weights(weights, bits)
    drive = Drive(coarse.phase_codes << (8 - bits), coarse.amplitude_codes)
    key = LatchKey(sequence=0, loop=0, index=index)
    return Latch(key, 1, index, 1000 * index, False, drive, bits, drive, False)


def records(path):
    return [json.loads(line) for line in path.read_text().splitlines()]


def test_worker_and_inline_write_the_same(tmp_path):
    worker = ReconstructionWorker(SETTINGS, str(tmp_path / "door"))
    kept = []
    inline = InlineReconstructionWorker(SETTINGS, kept.append)
    for recorder in (worker, inline):
        recorder.notice(SessionOpened(5, 1))
        for index in range(12):
            recorder.latch(a_latch(index))
    worker.close()
    inline.finish()
    assert records(tmp_path / "door") == kept
    assert kept[-1]["reconstructed"] == 12


@pytest.mark.parametrize("at_once", [1, 5, 100])
def test_fields_that_come_later_are_the_same_and_observations_are_the_records(monkeypatch, at_once):
    monkeypatch.setattr(recorder_module, "_AT_ONCE", at_once)
    kept, later, told = [], [], []
    inline = InlineReconstructionWorker(SETTINGS, kept.append)
    lazy = InlineReconstructionWorker(SETTINGS, later.append, told=told)
    for recorder in (inline, lazy):
        recorder.notice(SessionOpened(5, 1))
        for index in (*range(9), 3):
            recorder.latch(dataclasses.replace(a_latch(index % 7), number=index))
        recorder.latch(dataclasses.replace(a_latch(2), ramping=True, late=True, t_received_us=7))
        dead = Drive(a_latch(4).drive.phase_codes, np.full(16, 200, np.uint8))
        recorder.latch(dataclasses.replace(a_latch(4), radiated=dead))
    assert [list(record.items())[:7] for record in later[2:]] == [
        list(record.items())[:7] for record in kept[2:]
    ]
    lazy.complete()
    assert [list(record.items()) for record in later] == [list(r.items()) for r in kept]
    assert told == observations_of_backdoor(kept)
    ramps = [record["reconstruction"] for record in kept if record.get("ramping")]
    assert ramps == [{"kind": "no_focus", "reason": "ramping"}]
    for recorder in (inline, lazy):
        recorder.finish()
    assert later == kept


def test_an_interrupt_tells_no_latch_twice(monkeypatch):
    told, moments = [], iter(range(100))
    lazy = InlineReconstructionWorker(SETTINGS, lambda _: None, told=told)
    for index in range(5):
        lazy.latch(a_latch(index))
    observation = recorder_module._latch_observation  # noqa: SLF001

    def interrupted(*latch):
        if next(moments) == 2:
            raise KeyboardInterrupt
        return observation(*latch)

    monkeypatch.setattr(recorder_module, "_latch_observation", interrupted)
    with pytest.raises(KeyboardInterrupt):
        lazy.settle()
    lazy.settle()
    assert [seen.t_latch_us for seen in told] == [1000 * index for index in range(5)]


def test_records_are_handed_over_many_at_a_time(tmp_path):
    worker = ReconstructionWorker(SETTINGS, str(tmp_path / "door"), reconstruct=False)
    for index in range(reconstruction.BATCH - 1):
        worker.latch(a_latch(index))
    assert worker.pending == reconstruction.BATCH - 1
    worker.notice(SessionOpened(5, 1))
    assert worker.pending == 0
    worker.latch(a_latch(reconstruction.BATCH))
    worker.pump()
    assert worker.pending == 0
    worker.close()
    assert records(tmp_path / "door")[-1]["latched"] == reconstruction.BATCH


def test_a_full_queue_drops_counts_and_never_blocks(tmp_path, monkeypatch):
    monkeypatch.setattr(reconstruction, "QUEUE_LATCHES", 50)
    worker = ReconstructionWorker(SETTINGS, str(tmp_path / "door"), reconstruct=False)
    os.kill(worker._process.pid, signal.SIGSTOP)  # noqa: SLF001  the worker hangs
    for index in range(4000):
        worker.latch(a_latch(index))
    assert worker.pending == 50
    dropped = worker.dropped
    assert dropped > 0
    os.kill(worker._process.pid, signal.SIGCONT)  # noqa: SLF001  and goes on
    worker.close()
    found = records(tmp_path / "door")
    latches = [record["index"] for record in found if record["kind"] == "latch"]
    assert latches == sorted(latches)
    assert len(latches) == 4000 - dropped
    assert (found[-1]["latched"], found[-1]["dropped"]) == (4000, dropped)


def test_a_worker_that_died_costs_records_not_the_board(tmp_path):
    worker = ReconstructionWorker(SETTINGS, str(tmp_path / "door"), reconstruct=False)
    os.kill(worker._process.pid, signal.SIGKILL)  # noqa: SLF001  it dies
    worker._process.wait()  # noqa: SLF001
    for index in range(10):
        worker.latch(a_latch(index))
    worker.pump()
    assert worker.dropped == 10
    assert worker.pending == 0
    worker.close()


def test_out_of_time_every_latch_is_written_down_without_its_field(tmp_path, monkeypatch):
    monkeypatch.setattr(reconstruction, "SKIP_FIELDS_AFTER_S", 0.0)
    monkeypatch.setattr(reconstruction, "_PIPE_BYTES", 4096)
    worker = ReconstructionWorker(SETTINGS, str(tmp_path / "door"))
    os.kill(worker._process.pid, signal.SIGSTOP)  # noqa: SLF001  so that records pile up
    for index in range(4000):
        worker.latch(a_latch(index))
    assert worker.pending > 100
    os.kill(worker._process.pid, signal.SIGCONT)  # noqa: SLF001
    worker.close()
    found = records(tmp_path / "door")
    assert found[-1]["latched"] == 4000
    assert found[-1]["dropped"] == 0
    assert found[-1]["reconstructed"] < 4000
    without = [r["reconstruction"] is None for r in found if r["kind"] == "latch"]
    assert without == sorted(without)  # first with, then without


def test_what_was_handed_over_is_written_without_its_field_too_once_time_is_up(
    tmp_path, monkeypatch
):
    monkeypatch.setattr(reconstruction, "SKIP_FIELDS_AFTER_S", 0.0)
    worker = ReconstructionWorker(SETTINGS, str(tmp_path / "door"))
    os.kill(worker._process.pid, signal.SIGSTOP)  # noqa: SLF001  it gets no processor
    for index in range(100):
        worker.latch(a_latch(index))
    worker.pump()
    assert worker.pending == 0
    going_on = threading.Timer(0.5, os.kill, (worker._process.pid, signal.SIGCONT))  # noqa: SLF001
    going_on.start()
    worker.close()
    going_on.join()
    end = records(tmp_path / "door")[-1]
    assert (end["latched"], end["reconstructed"], end["dropped"]) == (100, 0, 0)


def test_a_worker_that_gets_no_processor_is_ended_and_the_log_says_so(tmp_path, caplog):
    worker = ReconstructionWorker(SETTINGS, str(tmp_path / "door"))
    os.kill(worker._process.pid, signal.SIGSTOP)  # noqa: SLF001
    worker.latch(a_latch(0))
    worker.close(0.2)
    assert "lacks its last records" in caplog.text
    assert ENDS_WITHIN_S > reconstruction.DRAIN_TIMEOUT_S  # a host waits until the board has ended


def test_drives_without_a_focus_are_searched_for_only_as_long_as_no_record_waits(
    tmp_path, monkeypatch
):
    """A stream of them at 1 kHz would else be told half a minute later for each second."""
    monkeypatch.setattr(reconstruction, "SKIP_FIELDS_AFTER_S", 500.0)  # however busy the machine is
    worker = ReconstructionWorker(SETTINGS, str(tmp_path / "door"))
    os.kill(worker._process.pid, signal.SIGSTOP)  # noqa: SLF001  so that all of them wait
    codes = np.random.default_rng(1).integers(0, 256, (200, 16), dtype=np.uint8)
    for index, phases in enumerate(codes):
        nowhere = Drive(phases, np.full(16, 255, np.uint8))
        latch = dataclasses.replace(a_latch(index), drive=nowhere, radiated=nowhere)
        worker.latch(latch)
        worker.latch(a_latch(index))  # its field is found at once
    worker.pump()
    assert worker.pending == 0
    os.kill(worker._process.pid, signal.SIGCONT)  # noqa: SLF001
    worker.close(500.0)
    *latches, end = records(tmp_path / "door")[1:]
    kinds = [r["reconstruction"] and r["reconstruction"]["kind"] for r in latches]
    assert kinds[1::2] == ["single_focus"] * 200
    assert kinds[::2] == ["not_single"] * _SEARCHES + [None] * (200 - _SEARCHES)
    assert (end["latched"], end["reconstructed"]) == (400, 200 + _SEARCHES)


def test_a_place_that_cannot_be_written_is_an_error_at_once(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(ConfigurationError, match="cannot be written"):
        ReconstructionWorker(SETTINGS, str(tmp_path / "file" / "door"))


def test_a_file_that_takes_no_more_is_told_at_the_end(tmp_path):
    os.mkfifo(tmp_path / "door")
    reader = os.open(tmp_path / "door", os.O_RDONLY | os.O_NONBLOCK)
    worker = ReconstructionWorker(SETTINGS, str(tmp_path / "door"), reconstruct=False)
    os.close(reader)
    worker.latch(a_latch(0))
    assert worker.close() == f"backdoor '{tmp_path / 'door'}' cannot be written: broken pipe"


@pytest.mark.parametrize("bits", [8, 6, 5])
def test_coarser_phases_are_judged_by_their_own_rounding(bits):
    found = BackdoorEstimator(MODEL).estimate(a_latch(3, bits))
    assert found.as_dict()["kind"] == "single_focus"
    offset = np.abs(np.array(found.position_m) - (0.003, 0.002, 0.05))
    assert (offset <= found.bound_m).all()


def test_what_was_seen_lately_is_remembered_within_bounds(monkeypatch):
    monkeypatch.setattr("sim_device.backdoor.recorder.MEMORY_DRIVES", 3)
    estimator = BackdoorEstimator(MODEL)
    first = estimator.estimate(a_latch(0))
    assert estimator.estimate(a_latch(7)) is first  # the same drive
    for index in range(1, 5):
        estimator.estimate(a_latch(index))
    assert len(estimator._seen) == 3  # noqa: SLF001  its bound is the point


def test_settings_and_latches_survive_the_way_to_the_worker():
    latches = [a_latch(index) for index in range(3)]
    latches.append(dataclasses.replace(latches[0], number=3))
    packed = bytearray(b"".join(map(packed_worker_batch, (latches[:2], latches[2:]))))
    first, second = unpacked_worker_batches(packed)
    assert [first, second] == [latches[:2], latches[2:]]
    assert second[-1].drive is first[0].drive  # made once, though it came twice
    assert not packed
    settings = pickle.loads(pickle.dumps(SETTINGS))
    assert settings.model.array.digest() == MODEL.array.digest()
    assert settings.boot_id == SETTINGS.boot_id


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs FIFOs")
def test_a_worker_whose_fifo_nobody_reads_ends_with_its_board(tmp_path):
    fifo = tmp_path / "records"
    os.mkfifo(fifo)
    code = f"""
import os, signal, threading
from sim_device.backdoor import worker
from sim_device.board.settings import BoardSettings
from haptogram.acoustics import AcousticModel
start = worker._start_worker_process
def told():
    process = start()
    print(process.pid, flush=True)
    threading.Timer(2.0, os.kill, (os.getpid(), signal.SIGKILL)).start()
    return process
worker._start_worker_process = told
worker.ReconstructionWorker(BoardSettings(model=AcousticModel.default(4, 4)), {str(fifo)!r})
"""
    board = subprocess.run([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    worker = int(board.stdout)
    end_s = time.monotonic() + 60.0
    while Path(f"/proc/{worker}/cmdline").exists() and time.monotonic() < end_s:
        time.sleep(0.02)
    assert not Path(f"/proc/{worker}/cmdline").exists()


def test_a_board_that_is_told_to_end_at_its_start_waits_for_its_worker(tmp_path, monkeypatch):
    """One that went on by itself made its output anew after the board had removed the folder."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(reconstruction, "STOP_TIMEOUT_S", 60.0)
    started = []

    def start(start_process=reconstruction._start_worker_process):  # noqa: SLF001
        started.append(start_process())
        return started[0]

    def leave(*_):
        raise SystemExit(0)

    monkeypatch.setattr(reconstruction, "_start_worker_process", start)
    monkeypatch.setattr(ReconstructionWorker, "_await_ready", leave)
    with pytest.raises(SystemExit):
        ReconstructionWorker(SETTINGS, "unix:door", reconstruct=False)
    assert started[0].returncode == 0
    assert list(tmp_path.iterdir()) == []
