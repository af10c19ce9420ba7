"""A name in the file system that one live process at a time may own."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from haptogram.errors import ConfigurationError, plain_reason
from haptogram.machine.files import make_folder_of
from haptogram.machine.posix import posix_module

INSTEAD_OF_PTY: Final = "a TCP port, or the URL haptogram:// inside the host's process"


class PtyLink:
    """A symbolic link that one live process at a time may own.

    A lock on ``<link>.lock`` says who: the system drops it with the process, however that ends, so
    a link whose lock is free is stale and may be replaced.

    Raises
    ------
    ConfigurationError
        If a live process holds the lock, or the place cannot be written.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._lock_path = path.with_name(path.name + ".lock")
        self._target = ""
        with self._named_errors():
            make_folder_of(path, "the link")
        self._lock = self._take_lock()

    def point_to(self, target: str) -> None:
        """Make the link point to *target*, at once and never half."""
        self._refuse_foreign()
        fresh = self._path.with_name(f"{self._path.name}.{os.getpid()}")
        with self._named_errors():
            os.symlink(target, fresh)
            os.replace(fresh, self._path)
        self._target = target

    def withdraw(self) -> None:
        """Remove the link, if it is still ours; the name stays taken."""
        with contextlib.suppress(OSError):
            if self._target and os.readlink(self._path) == self._target:
                os.unlink(self._path)

    def release(self) -> None:
        """Remove the link, if it is still ours, and then the lock."""
        if self._lock < 0:
            return
        self.withdraw()
        with contextlib.suppress(OSError):
            os.unlink(self._lock_path)
        os.close(self._lock)
        self._lock = -1

    def _take_lock(self) -> int:
        """Lock the lock file of the link and return its descriptor.

        ConfigurationError, with the process id of the owner, if a live board holds it.
        """
        fcntl = posix_module("fcntl", "a pty port", INSTEAD_OF_PTY)
        while True:
            with self._named_errors():
                lock = os.open(self._lock_path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError as error:
                owner = os.read(lock, 32).decode(errors="replace").strip()
                os.close(lock)
                text = f"link {self._path} is held by a live board (process {owner})"
                raise ConfigurationError(text) from error
            if self._is_current(lock):
                self._sign_lock(lock)
                return lock
            os.close(lock)  # its owner removed it between our two calls: try again

    def _sign_lock(self, lock: int) -> None:
        """Write the process id into the lock file."""
        try:
            with self._named_errors():
                os.truncate(lock, 0)
                os.write(lock, f"{os.getpid()}\n".encode())
        except ConfigurationError:  # the disk is full
            with contextlib.suppress(OSError):
                os.unlink(self._lock_path)
            os.close(lock)
            raise

    @contextlib.contextmanager
    def _named_errors(self) -> Iterator[None]:
        """Turn an OSError within the context into a ConfigurationError that names the link."""
        try:
            yield
        except OSError as error:
            reason = plain_reason(error)
            raise ConfigurationError(f"link '{self._path}' cannot be made: {reason}") from error

    def _is_current(self, lock: int) -> bool:
        """Return False if the lock file was removed or replaced after *lock* was opened."""
        try:
            return os.path.samestat(os.fstat(lock), os.stat(self._lock_path))
        except FileNotFoundError:
            return False

    def _refuse_foreign(self) -> None:
        """Raise ConfigurationError if the link's path exists and must not be replaced.

        What may be replaced is a link to a pty, or to nothing.
        """
        if not os.path.lexists(self._path):
            return
        target = os.readlink(self._path) if self._path.is_symlink() else ""
        if target.startswith("/dev/pts/") or (target and not self._path.exists()):
            return
        what = f"a link to {target}" if target else "no link"
        self.release()
        raise ConfigurationError(f"{self._path} exists and is {what}; it is left alone")
