"""The programs of protocol/c, built once with the sanitizers."""

import pytest

from protocol_c.building import compiler, make


@pytest.fixture(scope="session")
def programs(tmp_path_factory):
    """The folder that holds them."""
    name, folder = compiler(), tmp_path_factory.mktemp("c")
    status, output = make(folder, "all", CC=name, SANITIZE=1, CFLAGS="-O1 -g")
    assert (status, output) == (0, ""), output
    return folder
