"""The suite inside pytest, in any firmware repository.

::

    pip install './haptogram[pytest]'
    pytest --pyargs haptogram.conformance --haptogram-port=/dev/ttyACM0

Two fixtures serve the repository's own cases.  The plugin imports nothing but pytest before one of
them is used.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from haptogram.conformance.client.request_client import RequestClient
    from haptogram.conformance.run.access import Access
    from haptogram.conformance.run.runner import SuiteRunner


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the options of the board under test."""
    group = parser.getgroup("haptogram", "board under test")
    add = group.addoption
    add("--haptogram-port", metavar="URL", help="any pyserial URL [a virtual board on a pty]")
    add("--haptogram-spawn", metavar="CMD", help="start this program, which prints its port")
    add(
        "--haptogram-port-regex", metavar="REGEX", help="finds the port in the text of that program"
    )
    add("--haptogram-reset-cmd", metavar="CMD", help="shell command that restarts the board")
    add(
        "--haptogram-fault-cmd",
        metavar="CMD",
        help="shell command that lets the board's hardware fail for 1 s at most "
        "($BOARD_PID: --haptogram-spawn)",
    )
    add(
        "--haptogram-boot-timeout",
        type=float,
        default=60.0,
        metavar="S",
        help="longest wait for the port after a restart [60]",
    )
    add("--haptogram-baud", type=int, default=3_000_000, metavar="BAUD", help="line rate")
    add(
        "--haptogram-timeout",
        type=float,
        default=1.0,
        metavar="S",
        help="longest wait for an answer [1]",
    )
    add("--haptogram-seed", type=int, metavar="N", help="seed of nonces and contents [random]")
    add("--haptogram-strict", action="store_true", help="a SHOULD that is not met is a failure")


@pytest.fixture(scope="session")
def haptogram_board(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[SuiteRunner]:
    """Give the board under test: ``result(case)`` judges it, ``session()`` opens a board."""
    import os

    from haptogram.conformance.run.runner import SuiteOptions, SuiteRunner

    option = request.config.getoption
    seed = option("--haptogram-seed")
    options = SuiteOptions(
        timeout_s=option("--haptogram-timeout"),
        seed=int.from_bytes(os.urandom(4)) if seed is None else seed,
        strict=option("--haptogram-strict"),
    )
    with SuiteRunner(_access_from_options(option, tmp_path_factory), options) as runner:
        yield runner


@pytest.fixture
def haptogram_link(haptogram_board: SuiteRunner) -> RequestClient:
    """Give an open session: raw frames in and out, on a board that is DISARMED and quiet."""
    return haptogram_board.session().link


def _access_from_options(option: Any, folders: pytest.TempPathFactory) -> Access:
    """Return the way to the board that pytest's options name; a virtual board if they name none."""
    from haptogram.conformance.run.access import PortAccess
    from haptogram.conformance.run.spawning import DEFAULT_PORT_REGEX, SpawnAccess

    baudrate = option("--haptogram-baud")
    port, command = option("--haptogram-port"), option("--haptogram-spawn")
    fault_command = option("--haptogram-fault-cmd")
    if fault_command is not None and port is None and command is None:
        raise pytest.UsageError(
            "--haptogram-fault-cmd is about a board at --haptogram-port or --haptogram-spawn; "
            "there is none"
        )
    if port is not None:
        return PortAccess(
            port,
            baudrate=baudrate,
            reset_command=option("--haptogram-reset-cmd"),
            boot_timeout_s=option("--haptogram-boot-timeout"),
            fault_command=fault_command,
        )
    regex = option("--haptogram-port-regex") or DEFAULT_PORT_REGEX
    return SpawnAccess(
        command or _virtual_board_command(folders),
        port_regex=regex,
        boot_timeout_s=option("--haptogram-boot-timeout"),
        baudrate=baudrate,
        fault_command=fault_command,
    )


def _virtual_board_command(folders: pytest.TempPathFactory) -> str:
    """Return the command line of a virtual board, which runs as a process like a firmware build."""
    import shlex
    import sys

    link = folders.mktemp("haptogram") / "board"
    words = [sys.executable, "-m", "sim_device", "--link", str(link)]
    return shlex.join(words)
