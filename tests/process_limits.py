"""Limits of the system that a test sets: descriptors that have high numbers, a full disk."""

import contextlib
import functools
import os
import resource
import subprocess
import sys

import pytest

HIGH = 1500  # a descriptor beyond FD_SETSIZE


@contextlib.contextmanager
def room_for_high_descriptors():
    """As many descriptors may be open as high numbers take."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if hard != resource.RLIM_INFINITY and hard < HIGH + 100:
        pytest.skip(f"no more than {hard} descriptors may be open here")
    resource.setrlimit(resource.RLIMIT_NOFILE, (max(soft, HIGH + 100), hard))
    yield
    resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


@contextlib.contextmanager
def only_high_descriptors():
    """Every number below the high ones is taken: what opens next has a high one."""
    with room_for_high_descriptors():
        taken = [os.open(os.devnull, os.O_RDONLY)]
        while taken[-1] < HIGH:
            taken.append(os.dup(taken[0]))
        yield
        for fd in taken:
            os.close(fd)


def run_with_full_disk(words, room_bytes=0, cwd=None):
    """Run haptogram with *words* where no file can have more than *room_bytes*; return its end."""
    limit = (room_bytes, room_bytes)
    return subprocess.run(
        [sys.executable, "-m", "haptogram", *words],
        cwd=cwd,
        capture_output=True,
        text=True,
        preexec_fn=functools.partial(resource.setrlimit, resource.RLIMIT_FSIZE, limit),
        env=os.environ | {"PYTHONDONTWRITEBYTECODE": "1"},
        check=False,
    )
