"""Patterns that a board of another wire radiates, latch by latch, without an intention.

Every latch has its pattern; a user may add the foci that were expected. A diagnosis is only named
if it explains the data better than every other one by a margin.
"""

from .defect import Defect, Diagnosis
from .expectation import Expectation
from .latch import SeenLatch
from .result import WatchedLatch, WatchResult
from .watch import Watch
