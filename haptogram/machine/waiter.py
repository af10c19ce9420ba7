"""Waiting for file descriptors of any number, with timeouts that are kept to the microsecond."""

from __future__ import annotations

import select
import selectors
import time
from collections.abc import Sequence
from typing import Final, TypeAlias

_Ready: TypeAlias = list[tuple[selectors.SelectorKey, int]]

_SELECT_LIMIT: Final = 1024  # FD_SETSIZE: what select(2) can wait for lies below
_POLL_STEP_S: Final = 1e-3  # resolution of poll(2), which rounds up
_NAP_S: Final = 1e-4


class DescriptorWaiter:
    """Waits for descriptors: in one system call where their numbers allow it."""

    def wait(
        self, reading: Sequence[int], writing: Sequence[int] = (), timeout_s: float | None = None
    ) -> set[int]:
        """Return which descriptors can be read or written, as soon as one can or time is up.

        Parameters
        ----------
        reading, writing : sequence of int
            File descriptors.
        timeout_s : float or None
            How long to wait at most; None: for ever.

        Raises
        ------
        OSError, ValueError
            For a descriptor below 1024 that is closed; a higher one counts as ready.
        """
        # select, where it can: its timeout has microseconds where that of poll has milliseconds.
        if max((*reading, *writing), default=0) < _SELECT_LIMIT:
            readable, writable, _ = select.select(reading, writing, (), timeout_s)
            return {*readable, *writable}
        events = dict.fromkeys(reading, selectors.EVENT_READ)
        for fd in writing:
            events[fd] = events.get(fd, 0) | selectors.EVENT_WRITE
        with selectors.PollSelector() as selector:
            for fd, mask in events.items():
                selector.register(fd, mask)
            return {key.fd for key, _ in _polled_descriptors(selector, timeout_s)}


def _polled_descriptors(selector: selectors.BaseSelector, timeout_s: float | None) -> _Ready:
    """Return descriptors ready within *timeout_s*: poll in whole ms, sleep for the rest.

    None waits until one is ready.
    """
    if timeout_s is None:
        return selector.select()
    left_s, end_s = timeout_s, time.monotonic() + timeout_s
    while not (ready := selector.select(max(0.0, left_s // _POLL_STEP_S * _POLL_STEP_S))):
        if (left_s := end_s - time.monotonic()) <= 0:
            break
        time.sleep(min(left_s, _NAP_S))
    return ready
