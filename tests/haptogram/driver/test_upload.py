"""Uploads that replace each other: what was replaced is gone, at the host and at the board."""

import gc
import sys
from collections import deque

from haptogram.acoustics import AcousticModel
from haptogram.driver.driver import Driver
from haptogram_protocol.messages import UploadChunk
from virtual_ports import BoardPort

UPLOADS = 300
PLACES = [(0.0, 0.0, 0.15), (0.01, 0.0, 0.15)]


def blocks_after(count, driver, port):
    """Return the blocks of memory in use after so many corrections and sequences."""
    for number in range(count):
        driver.correct_phases(bytes([number % 256]) * 16)
        driver.play(PLACES, 1000)
        port.latches.clear()
        port.notices.clear()
    gc.collect()
    return sys.getallocatedblocks()


def test_uploads_that_replace_each_other_keep_no_memory():
    port = BoardPort(model=AcousticModel.default(4, 4))
    port.written = deque(maxlen=1)
    with Driver(port, seed=1, keep=10) as driver:
        driver.arm()
        before = blocks_after(UPLOADS // 4, driver, port)
        grown = blocks_after(UPLOADS, driver, port) - before
    assert grown < UPLOADS, f"{grown} blocks more after {UPLOADS} uploads of each kind"


def test_an_upload_over_a_line_that_loses_chunks_is_whole():
    """Chunks behind a lost one are refused, and the host goes back to what the board has."""
    lost = []

    def lose(data):
        if data[2] != UploadChunk.TYPE:
            return data
        lost.append(len(lost) % 3 == 1)
        return b"" if lost[-1] else data

    port = BoardPort(model=AcousticModel.default(4, 4), tamper=lose, max_chunk=64)
    with Driver(port, seed=1) as driver:
        driver.arm()
        driver.play([(0.001 * number, 0.0, 0.15) for number in range(40)], 1000)
        assert [latch.drive for latch in port.latches] == [one.drive for one in driver.intended]
    assert sum(lost) > 3
