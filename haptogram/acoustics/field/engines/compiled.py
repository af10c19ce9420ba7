"""The compiled loops, which numba makes if it is installed.

numba takes a quarter of a second to import, so it is imported by the first who asks.
"""

from __future__ import annotations

import os
import sys
import tempfile
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Final

_KERNELS: Final = "haptogram.acoustics.field.engines.kernels"


def load_kernels() -> ModuleType | None:
    """Return the module of compiled loops, or None where numba is not installed.

    Machine code is cached next to the sources; numba itself takes the user's cache folder where
    that is read-only. Where there is no such folder either, the code goes to the temporary folder.
    """
    if _KERNELS in sys.modules:
        return sys.modules[_KERNELS]
    try:
        import numba
    except ImportError:
        return None
    try:
        return import_module(_KERNELS)
    except RuntimeError as error:  # what numba raises if it can write to none of its folders
        if "cannot cache" not in str(error):
            raise
        vars(numba.config)["CACHE_DIR"] = str(_temporary_kernel_cache())
        return import_module(_KERNELS)


def _temporary_kernel_cache() -> Path:
    """Return a folder that only this user can write to: what lies in it will be executed."""
    folder = Path(tempfile.gettempdir()) / f"haptogram-numba-{os.getuid()}"
    folder.mkdir(mode=0o700, exist_ok=True)
    status = folder.lstat()
    if status.st_uid == os.getuid() and folder.is_dir() and not status.st_mode & 0o022:
        return folder
    return Path(tempfile.mkdtemp(prefix="haptogram-numba-"))
