"""Uploads that replace each other: what was replaced is gone, at the host and at the board."""

import gc
import sys
from collections import deque

from haptogram.acoustics import AcousticModel
from haptogram.driver.driver import Driver
from virtual_ports import BoardPort

UPLOADS = 400
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
