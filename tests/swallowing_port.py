"""A pseudo-terminal whose far end takes all bytes and says nothing."""

import contextlib
import os
import select
import threading
import tty


class SwallowingPort:
    """Give the path of the port, and keep what came."""

    def __enter__(self):
        self._far, self._near = os.openpty()
        self._stopped, self._stop = os.pipe()
        tty.setraw(self._near)
        self.path, self.data = os.ttyname(self._near), b""
        self._thread = threading.Thread(target=self._read)
        self._thread.start()
        return self

    def _read(self):
        ends = [self._far, self._stopped]
        with contextlib.suppress(OSError):  # the near end has closed
            while self._far in select.select(ends, [], [])[0]:
                self.data += os.read(self._far, 4096)

    def __exit__(self, *_):
        os.close(self._near)
        os.close(self._stop)  # a process forked meanwhile may hold the near end open
        self._thread.join(60)
        os.close(self._far)
        os.close(self._stopped)
        assert not self._thread.is_alive()
