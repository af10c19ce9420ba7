"""The compiled loops, which numba makes if it is installed.

numba takes a quarter of a second to import, so it is imported where a loop is not stored yet.
"""

from __future__ import annotations

import atexit
import contextlib
import functools
import hashlib
import logging
import os
import sys
import tempfile
from collections.abc import Callable
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import Any, Final, TypeAlias

from haptogram.acoustics.field.engines.stored import (
    StoredKernels,
    read_stored,
    store_kernels,
    stored_name,
)

_KERNELS: Final = "haptogram.acoustics.field.engines.kernels"
_SOURCES: Final = Path(__file__).with_name("kernels")
#: Folder of numba's cache on a Mac, for modules in folders that it cannot write to.
_MAC_CACHE: Final = "~/Library/Caches/numba"
_HARMLESS: Final = {"NUMBA_CACHE_DIR", "NUMBA_NUM_THREADS"}
_TOLD: Final = "compiling the field kernels, once on this machine: half a minute or more\n"


_log = logging.getLogger(__name__)
Kernels: TypeAlias = ModuleType | StoredKernels


def load_kernels() -> Kernels | None:
    """Return the compiled loops; None: numba is not installed, or not for this numpy.

    Where their machine code is stored on this machine, numba itself is not imported.
    """
    if _KERNELS in sys.modules:
        return sys.modules[_KERNELS]
    if find_spec("numba") is None:
        return None
    try:
        return _stored_kernels() or compiled_kernels()
    except ImportError:  # numba does not know this numpy or Python yet
        return None


def compiled_kernels() -> ModuleType:
    """Return the package of loops, which numba compiles.

    Machine code is cached next to the sources; numba itself takes the user's cache folder where
    that is read-only. Where there is no such folder either, the code goes to the temporary folder.
    """
    if _KERNELS in sys.modules:
        return sys.modules[_KERNELS]
    import numba

    if sys.stderr.isatty() and not _are_cached():
        sys.stderr.write(_TOLD)
    try:
        kernels = import_module(_KERNELS)
    except RuntimeError as error:  # what numba raises if it can write to none of its folders
        if "cannot cache" not in str(error):
            raise
        vars(numba.config)["CACHE_DIR"] = str(_temporary_kernel_cache())
        kernels = import_module(_KERNELS)
    for loop in vars(kernels).values():
        if (cache := getattr(loop, "_cache", None)) is not None:
            cache.save_overload = _saved_if_possible(cache.save_overload)
    if _is_code_stored():
        atexit.register(_store_machine_code, kernels)
    return kernels


def _saved_if_possible(save: Callable[..., None]) -> Callable[..., None]:
    """Return *save* of numba's cache without its errors: a loop runs on a full disk as well."""

    def save_if_possible(*of_loop: Any) -> None:
        try:
            save(*of_loop)
        except OSError as error:
            _log.info("a loop cannot be stored: %s", error)

    return save_if_possible


@functools.cache
def _stored_kernels() -> StoredKernels | None:
    """Return the kernels linked from stored machine code; None if none can be used."""
    if not _is_code_stored():
        return None
    try:
        name = stored_name(kernel_digest())
        for folder in _cache_folders():
            for path in folder.glob(f"**/{name}"):
                if (stored := read_stored(path)) is not None:
                    return StoredKernels(stored, compiled_kernels)
    except Exception as error:  # another llvmlite: numba itself serves
        _log.info("the stored loops cannot be linked: %s", error)
    return None


def _is_code_stored() -> bool:
    """Return True if machine code is stored: on Linux, with the default options of numba."""
    set_otherwise = any(name.startswith("NUMBA_") for name in os.environ.keys() - _HARMLESS)
    return sys.platform == "linux" and not set_otherwise


def _store_machine_code(kernels: ModuleType) -> None:
    """Write the machine code of all compiled kernels beside numba's cache; log if that fails."""
    folder = Path(kernels.fit_phases_kernel.stats.cache_path)
    try:
        store_kernels(kernels, folder / stored_name(kernel_digest()))
    except Exception as error:  # a full disk, or a numba that keeps code elsewhere
        _log.info("the loops cannot be stored: %s", error)


def kernel_digest() -> str:
    """Return a name for the state of all sources of the loops."""
    files = sorted(_SOURCES.glob("*.py"))
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()[:12]


def _are_cached() -> bool:
    """Return True if numba's cache on this machine has compiled kernels of this version."""
    pattern = f"*_kernel-{kernel_digest()}*.nbi"
    return any(next(folder.rglob(pattern), None) for folder in _cache_folders())


def _cache_folders() -> list[Path]:
    """Return the folders in which numba may keep code; a temporary one only if private.

    Private is a folder that this user owns and nobody else can write to.
    """
    if own := os.environ.get("NUMBA_CACHE_DIR"):
        return [Path(own)]
    user = os.path.join(os.environ.get("XDG_CACHE_HOME", "~/.cache"), "numba")
    users = [Path(os.path.expanduser(folder)) for folder in (user, _MAC_CACHE)]
    folders = [_SOURCES, *users]
    with contextlib.suppress(FileNotFoundError):  # no folder takes a temporary file: a full disk
        folders += filter(_is_own_folder, [_temporary_folder()])
    return folders


def _is_own_folder(folder: Path) -> bool:
    """Return True if *folder* exists and only this user can write to it."""
    if not folder.is_dir():
        return False
    status = folder.lstat()
    return status.st_uid == os.getuid() and not status.st_mode & 0o022


def _temporary_folder() -> Path:
    """Return this user's cache folder in the folder for temporary files."""
    return Path(tempfile.gettempdir()) / f"haptogram-numba-{os.getuid()}"


def _temporary_kernel_cache() -> Path:
    """Return this user's temporary cache folder; a new one if others can write to that."""
    folder = _temporary_folder()
    folder.mkdir(mode=0o700, exist_ok=True)
    if _is_own_folder(folder):
        return folder
    return Path(tempfile.mkdtemp(prefix="haptogram-numba-"))
