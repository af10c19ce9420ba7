"""Workers of a sweep: processes of this machine, as a soak has, or those of a Dask cluster."""

from __future__ import annotations

import contextlib
import logging
import multiprocessing
import os
import signal
import threading
import warnings
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from dataclasses import dataclass
from typing import Any, Final

from haptogram.errors import ConfigurationError, missing_extra, plain_reason

LOCAL: Final = "local"
_TIMEOUT_S: Final = 10
_QUIET: Final = "distributed.nanny.pre-spawn-environ.DASK_LOGGING__DISTRIBUTED"
#: Packages with the same version at both ends: for their messages, and for equal rows.
_WIRE: Final[tuple[str, ...]] = ("distributed", "cloudpickle", "msgpack")
_ROWS: Final[tuple[str, ...]] = ("haptogram", "numpy", "scipy", "numba", "pyserial")


@dataclass(frozen=True, slots=True)
class Workers:
    """Workers that take points.

    Attributes
    ----------
    executor : Executor
    count : int
        Points that they run at a time.
    """

    executor: Executor
    count: int


@contextlib.contextmanager
def process_workers(jobs: int) -> Iterator[Workers]:
    """Give *jobs* processes of this machine; an error in the block ends what they are at.

    They end with this process, however it ends.
    """
    others = set(multiprocessing.active_children())
    # Spawned, not forked: no process inherits threads or memory of this one.
    context = multiprocessing.get_context("spawn")
    try:
        executor = ProcessPoolExecutor(jobs, context, _begin_worker)
    except OSError as error:  # the file system of the pool's semaphores is full
        raise ConfigurationError(f"no workers can be started: {plain_reason(error)}") from error
    try:
        yield Workers(executor, jobs)
    except BaseException:
        for process in set(multiprocessing.active_children()) - others:
            process.terminate()
        raise
    finally:
        executor.shutdown(cancel_futures=True)


def _begin_worker() -> None:
    """Ignore Ctrl-C in a worker, and exit with the parent."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, lambda *_: os._exit(1))  # while it has no point
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """Wait until the parent process ends, then end this worker."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os.kill(os.getpid(), signal.SIGTERM)


@contextlib.contextmanager
def dask_workers(address: str, jobs: int) -> Iterator[Workers]:
    """Give the workers of the Dask scheduler at *address*, or of one that is started here.

    Raises
    ------
    ConfigurationError
        If there is no scheduler or worker, or one of them has other versions than this machine.
    """
    try:
        from dask import config
        from distributed import Client, LocalCluster
    except ImportError as error:
        raise missing_extra("--scheduler needs distributed", "sweep") from error
    with contextlib.ExitStack() as stack:
        logging.disable()  # our own errors report lost workers and schedulers
        stack.callback(logging.disable, logging.NOTSET)
        stack.enter_context(warnings.catch_warnings())
        warnings.simplefilter("ignore")  # of other versions, which are refused below
        place: Any = address
        if address == LOCAL:
            stack.enter_context(config.set({_QUIET: "critical"}))
            # Deaf to Ctrl-C, as the processes that it starts: this one ends them.
            before = signal.signal(signal.SIGINT, signal.SIG_IGN)
            try:
                cluster = LocalCluster(n_workers=jobs, threads_per_worker=1, dashboard_address=None)
                place = stack.enter_context(cluster)
            finally:
                signal.signal(signal.SIGINT, before)
        try:
            client = stack.enter_context(Client(place, timeout=_TIMEOUT_S, set_as_default=False))
            count = _checked_dask_workers(client.get_versions(packages=_ROWS))
        except ConfigurationError as error:
            raise ConfigurationError(f"--scheduler {address}: {error}") from error
        except Exception as error:  # of the network, or of another version of Dask
            raise ConfigurationError(f"--scheduler {address}: {plain_reason(error)}") from error
        yield Workers(client.get_executor(pure=False), count)


def _checked_dask_workers(found: dict[str, Any]) -> int:
    """Return the number of workers; refuse none, or other versions of packages than here.

    *found*: versions of the packages of client, scheduler and workers, as Dask gathers them; they
    must equal those on this machine.
    """
    own = found["client"]["packages"]
    parts = [("the scheduler", found["scheduler"], _WIRE)]
    parts += [(f"worker {name}", one, _WIRE + _ROWS) for name, one in found["workers"].items()]
    for name, versions, packages in parts:
        for package in packages:
            theirs = versions["packages"].get(package)
            if theirs != own.get(package):
                raise ConfigurationError(
                    f"{name} has {_version_text(package, theirs)}, this machine has "
                    f"{_version_text(package, own.get(package))}: they must be the same"
                )
    if not found["workers"]:
        raise ConfigurationError("the scheduler has no worker: start one with dask worker")
    return len(found["workers"])


def _version_text(package: str, version: str | None) -> str:
    """Return package and version or, if that is None, that the package is missing."""
    return f"no {package}" if version is None else f"{package} {version}"
