"""The programs of protocol/c, built once for all processes of a run of the tests."""

import contextlib
import os

import pytest

from protocol_c.building import compiler, make


@contextlib.contextmanager
def shared_folder(tmp_path_factory, name):
    """Yield a folder of all processes of this run to one of them at a time."""
    import fcntl  # where there is a C compiler; not on Windows

    base = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        base = base.parent
    with (base / f"{name}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        (base / name).mkdir(exist_ok=True)
        yield base / name


@pytest.fixture(scope="session")
def programs(tmp_path_factory):
    """The folder that holds them, built with the sanitizers."""
    name = compiler()
    with shared_folder(tmp_path_factory, "c") as folder:
        status, output = make(folder, "all", CC=name, SANITIZE=1, CFLAGS="-O0")
        assert (status, output) == (0, ""), output
        (folder / "sanitized").touch()
    return folder


@pytest.fixture(scope="session")
def plain_programs(tmp_path_factory):
    """The same without sanitizers, which compiles faster: for sources that are spoilt."""
    name = compiler()
    with shared_folder(tmp_path_factory, "plain") as folder:
        targets = [folder / "fuzz", folder / "codec_lines"]
        status, output = make(folder, *targets, CC=name, CFLAGS="-O0")
        assert (status, output) == (0, ""), output
    return folder
