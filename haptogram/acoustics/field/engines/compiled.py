"""The compiled loops, which numba makes if it is installed.

numba takes a quarter of a second to import, so it is imported by the first who asks.
"""

from __future__ import annotations

import hashlib
import os
import sys
import tempfile
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Final

_KERNELS: Final = "haptogram.acoustics.field.engines.kernels"
_SOURCES: Final = Path(__file__).with_name("kernels")
#: Where numba caches what lies in folders that it cannot write to, on a Mac.
_MAC_CACHE: Final = "~/Library/Caches/numba"
_TOLD: Final = "compiling the field kernels, once on this machine: half a minute or more\n"


def load_kernels() -> ModuleType | None:
    """Return the module of compiled loops; None: numba is not installed.

    Machine code is cached next to the sources; numba itself takes the user's cache folder where
    that is read-only. Where there is no such folder either, the code goes to the temporary folder.
    """
    if _KERNELS in sys.modules:
        return sys.modules[_KERNELS]
    try:
        import numba
    except ImportError:
        return None
    if sys.stderr.isatty() and not _are_cached():
        sys.stderr.write(_TOLD)
    try:
        return import_module(_KERNELS)
    except RuntimeError as error:  # what numba raises if it can write to none of its folders
        if "cannot cache" not in str(error):
            raise
        vars(numba.config)["CACHE_DIR"] = str(_temporary_kernel_cache())
        return import_module(_KERNELS)


def kernel_digest() -> str:
    """Return a name for the state of all sources of the loops."""
    files = sorted(_SOURCES.glob("*.py"))
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()[:12]


def _are_cached() -> bool:
    """Return True if compiled kernels are cached on this machine."""
    own = os.environ.get("NUMBA_CACHE_DIR")
    user = os.path.join(os.environ.get("XDG_CACHE_HOME", "~/.cache"), "numba")
    users = [Path(os.path.expanduser(folder)) for folder in (user, _MAC_CACHE)]
    folders = [Path(own)] if own else [_SOURCES, *users, _temporary_folder()]
    pattern = f"*_kernel-{kernel_digest()}*.nbi"
    return any(next(folder.rglob(pattern), None) for folder in folders)


def _temporary_folder() -> Path:
    return Path(tempfile.gettempdir()) / f"haptogram-numba-{os.getuid()}"


def _temporary_kernel_cache() -> Path:
    """Return a cache folder that only this user can write to."""
    folder = _temporary_folder()
    folder.mkdir(mode=0o700, exist_ok=True)
    status = folder.lstat()
    if status.st_uid == os.getuid() and folder.is_dir() and not status.st_mode & 0o022:
        return folder
    return Path(tempfile.mkdtemp(prefix="haptogram-numba-"))
