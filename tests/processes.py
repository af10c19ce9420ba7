"""Tests in several processes that share one collection: `--processes N`.

To import and collect the tests takes as long as forty files of them, so one process does it, and
those that run them are its copies. Each takes whole files from one queue, with their fixtures.
"""

import contextlib
import os
import signal
from itertools import groupby
from multiprocessing import Pipe
from multiprocessing.connection import wait

import pytest

NUMBER_BYTES = 2


def pytest_addoption(parser):
    parser.addoption(
        "--processes", type=int, default=1, metavar="N", help="run the tests in N processes"
    )


@pytest.hookimpl(tryfirst=True)
def pytest_runtestloop(session):
    """Report in this process, with its plugins, what the others run."""
    option = session.config.option
    if option.processes < 2 or option.collectonly or session.testsfailed:
        return None
    with contextlib.ExitStack() as ends:
        running = dict.fromkeys(_start(session, option.processes, ends), "its beginning")
        while running:
            for results in wait([*running]):
                _report(session, results, running)
                if session.shouldfail:
                    raise session.Failed(session.shouldfail)
                if session.shouldstop:
                    raise session.Interrupted(session.shouldstop)
    return True


def _start(session, count, ends):
    """Return what the processes send their results to; *ends* ends them."""
    files = [list(items) for _, items in groupby(session.items, key=lambda item: item.path)]
    queue, numbers = os.pipe()
    os.write(numbers, b"".join(n.to_bytes(NUMBER_BYTES, "big") for n in range(len(files))))
    os.close(numbers)
    folder = session.config._tmp_path_factory.getbasetemp()  # noqa: SLF001 - each has one in it
    receivers = []
    for number in range(count):
        results, sender = Pipe(duplex=False)
        pid = os.fork()
        if pid == 0:
            try:
                session.config._tmp_path_factory._basetemp = folder / f"process{number}"  # noqa: SLF001
                (folder / f"process{number}").mkdir(mode=0o700)
                _run(session, _taken(queue, files), sender)
            finally:
                os._exit(0)
        sender.close()
        ends.callback(_end, pid)
        receivers.append(results)
    return receivers


def _end(pid):
    os.kill(pid, signal.SIGTERM)  # one that has ended is there until it is waited for
    os.waitpid(pid, 0)


def _taken(queue, files):
    while number := os.read(queue, NUMBER_BYTES):
        yield from files[int.from_bytes(number, "big")]


class _Sender:
    """Sends each report to the process that reports."""

    def __init__(self, config, results):
        self._config, self._results = config, results

    def pytest_runtest_logstart(self, nodeid):
        self._results.send(nodeid)

    def pytest_runtest_logreport(self, report):
        self._results.send(
            self._config.hook.pytest_report_to_serializable(config=self._config, report=report)
        )


def _run(session, items, results):
    config = session.config
    capture = config.pluginmanager.getplugin("capturemanager")
    capture.stop_global_capturing()  # its files are shared with the other processes
    capture.start_global_capturing()
    capture.suspend_global_capture()
    config.pluginmanager.unregister(name="terminalreporter")
    config.pluginmanager.register(_Sender(config, results))
    item = next(items, None)
    while item is not None:
        following = next(items, None)
        config.hook.pytest_runtest_protocol(item=item, nextitem=following)
        item = following
    results.send(None)


def _report(session, results, running):
    """Report what a process sends: which test begins, a report, or None at its end."""
    hook = session.config.hook
    try:
        told = results.recv()
    except EOFError:
        raise session.Interrupted(f"a process died in {running[results]}") from None
    if told is None:
        del running[results]
    elif isinstance(told, str):
        running[results] = told
    else:
        report = hook.pytest_report_from_serializable(config=session.config, data=told)
        hook.pytest_runtest_logreport(report=report)
        if report.when == "teardown":
            hook.pytest_runtest_logfinish(nodeid=report.nodeid, location=report.location)
