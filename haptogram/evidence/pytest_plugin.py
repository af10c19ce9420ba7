"""A virtual board for the tests of a driver, in any repository: the fixture ``verified_board``.

::

    def test_my_driver(verified_board):
        with MyDriver(verified_board.port) as driver:
            driver.show([(0, 0, 0.15), (0.01, 0, 0.15)])
        verified_board.expect([(0, 0, 0.15), (0.01, 0, 0.15)])

The test fails if a focus is not where it was expected, a frame is late or lost, or the board is not
muted at the end.

The board is in virtual time, whatever the load of the machine: time passes while the driver reads
its port or calls ``time.sleep``.  A driver that opens a path, has threads or a clock of its own
takes the wall clock: ``@pytest.mark.haptogram_board(clock="wall")``.  The plugin imports nothing
but pytest before the fixture is used.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Generator, Iterator
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from haptogram.evidence.verified_board import VerifiedBoard

_FIXTURE = "verified_board"
_MARKER = "haptogram_board"


def pytest_configure(config: pytest.Config) -> None:
    """Register the marker with the options of the board."""
    config.addinivalue_line(
        "markers",
        f"{_MARKER}(**options): options of the board of {_FIXTURE}, as of haptogram.VirtualBoard",
    )


@pytest.fixture
def verified_board(request: pytest.FixtureRequest) -> Iterator[VerifiedBoard]:
    """Give a virtual board that judges at the end of the test what a driver sent to it."""
    from haptogram.evidence.verified_board import VerifiedBoard

    marker = request.node.get_closest_marker(_MARKER)
    options = {} if marker is None else marker.kwargs
    with VerifiedBoard(**options) as board, pytest.MonkeyPatch.context() as patch:
        if board.is_virtual:
            patch.setattr(time, "sleep", _sleep_on_board(board))
        yield board
        has_failed = request.node.stash.get(_FAILED, False)
        if _is_board_held_by_fixture(request.node) and not has_failed:
            _check_verified_board(board)


def _sleep_on_board(board: VerifiedBoard) -> Callable[[float], None]:
    """Return a :func:`time.sleep` that advances the board's time; in other threads it sleeps."""
    asleep = time.sleep

    def sleep(seconds: float) -> None:
        is_own = threading.current_thread() is threading.main_thread()
        (board.sleep if is_own else asleep)(seconds)

    return sleep


@pytest.hookimpl(wrapper=True)
def pytest_pyfunc_call(pyfuncitem: pytest.Function) -> Generator[None, object, object]:
    """Judge after the last line of the test, so that a wrong drive is a failure of the test."""
    try:
        result = yield
    except BaseException:
        pyfuncitem.stash[_FAILED] = True
        raise
    board: Any = pyfuncitem.funcargs.get(_FIXTURE)
    if board is not None and not _is_board_held_by_fixture(pyfuncitem):
        _check_verified_board(board)
    return result


_FAILED = pytest.StashKey[bool]()


def _is_board_held_by_fixture(item: Any) -> bool:
    """Return True if, for the pytest *item*, another fixture uses the board.

    That fixture then ends its driver after the test.
    """
    closure = item._fixtureinfo.name2fixturedefs  # noqa: SLF001  pytest shows it to nobody else
    return any(_FIXTURE in definition.argnames for (*_, definition) in closure.values())


def _check_verified_board(board: VerifiedBoard) -> None:
    """Fail the test if the verdict on its board is not pass."""
    from haptogram.errors import HaptogramError

    problem = ""
    try:
        board.check()
    except HaptogramError as error:
        problem = str(error)
    if problem:  # not in the handler: pytest would show the error a second time
        pytest.fail(problem, pytrace=False)
