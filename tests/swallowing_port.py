"""A pseudo-terminal whose far end takes all bytes and says nothing."""

import contextlib
import os
import threading
import tty


class SwallowingPort:
    """Give the path of the port, and keep what came."""

    def __enter__(self):
        self._far, self._near = os.openpty()
        tty.setraw(self._near)
        self.path, self.data = os.ttyname(self._near), b""
        self._thread = threading.Thread(target=self._read)
        self._thread.start()
        return self

    def _read(self):
        with contextlib.suppress(OSError):  # the near end has closed
            while data := os.read(self._far, 4096):
                self.data += data

    def __exit__(self, *_):
        os.close(self._near)
        self._thread.join(60)
        os.close(self._far)
        assert not self._thread.is_alive()
