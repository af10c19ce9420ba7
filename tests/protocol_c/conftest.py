"""The programs of protocol/c, built once with the sanitizers."""

import pytest

from protocol_c.building import compiler, make


@pytest.fixture(scope="session")
def programs(tmp_path_factory):
    """The folder that holds them."""
    name, folder = compiler(), tmp_path_factory.mktemp("c")
    status, output = make(folder, "all", CC=name, SANITIZE=1, CFLAGS="-O0")
    assert (status, output) == (0, ""), output
    (folder / "sanitized").touch()
    return folder


@pytest.fixture(scope="session")
def plain_programs(tmp_path_factory):
    """The same without sanitizers, which compiles faster: for sources that are spoilt."""
    name, folder = compiler(), tmp_path_factory.mktemp("plain")
    targets = [folder / "fuzz", folder / "codec_lines"]
    status, output = make(folder, *targets, CC=name, CFLAGS="-O0")
    assert (status, output) == (0, ""), output
    return folder
