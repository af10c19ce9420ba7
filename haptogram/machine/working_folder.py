"""A temporary folder that is removed with its owner, however the owner ends."""

from __future__ import annotations

import contextlib
import os
import shutil
import tempfile
from pathlib import Path
from typing import Final

from haptogram.errors import ConfigurationError
from haptogram.machine.posix import posix_module

_OWNER: Final = "haptogram-owner.lock"
_TRIES: Final = 3


class WorkingFolder:
    """A folder of this process; folders of owners that were killed are removed on the way.

    A lock in the folder says that its owner lives: the system drops the lock with the process.

    Parameters
    ----------
    prefix : str
        Start of the name, of this folder and of those of other owners.

    Attributes
    ----------
    path : Path

    Raises
    ------
    ConfigurationError
        If files cannot be locked in the folder of temporary files, or not on this system.
    """

    def __init__(self, prefix: str) -> None:
        self._fcntl = posix_module(
            "fcntl", "a virtual board in a process of its own", "the port haptogram://"
        )
        try:
            place = Path(tempfile.gettempdir())
        except FileNotFoundError as error:  # none of its folders takes a file
            text = "no folder of temporary files takes one: the disk is full, or set TMPDIR"
            raise ConfigurationError(text) from error
        for lock_file in place.glob(f"{prefix}*/{_OWNER}"):
            self._remove_unowned(lock_file.parent)
        for _ in range(_TRIES):  # somebody else may have seen the new one before it had an owner
            self.path = Path(tempfile.mkdtemp(prefix=prefix))
            if (lock := self._own(self.path)) is not None:
                self._lock: int | None = lock
                return
        raise ConfigurationError(f"{place}: files cannot be locked there; set TMPDIR")

    def remove(self) -> None:
        """Remove the folder and its content; twice does no harm."""
        if self._lock is not None:
            shutil.rmtree(self.path, ignore_errors=True)
            os.close(self._lock)
            self._lock = None

    def _remove_unowned(self, folder: Path) -> None:
        """Remove *folder* if no living process owns it."""
        if (lock := self._own(folder)) is not None:
            shutil.rmtree(folder, ignore_errors=True)
            os.close(lock)

    def _own(self, folder: Path) -> int | None:
        """Lock *folder* and return the lock; None if another process owns or removed it."""
        fcntl = self._fcntl
        with contextlib.suppress(OSError):
            lock = os.open(folder / _OWNER, os.O_RDWR | os.O_CREAT, 0o600)
            with contextlib.suppress(OSError):
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                if os.fstat(lock).st_nlink:
                    return lock
            os.close(lock)
        return None
