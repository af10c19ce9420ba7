"""The process of a live view, beside the program whose board it shows."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
from pathlib import Path
from typing import Final

import haptogram
import haptogram_protocol

_STOP_S: Final = 5.0


class ViewProcess:
    """Runs ``haptogram view`` on a back door; the address appears on standard error.

    Parameters
    ----------
    source : str
        Back door: a file, or ``unix:PATH``.
    """

    def __init__(self, source: str) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-m", "haptogram", "view", source, "--until-eof"],
            stdin=subprocess.PIPE,  # the view ends with us, whatever ends us
            stdout=2,
            env=child_process_environment(),
            start_new_session=True,  # Ctrl-C is for the host; the view is ended when it is done
        )

    def wait(self) -> None:
        """Wait until the view ends, or Ctrl-C."""
        with contextlib.suppress(KeyboardInterrupt):
            self._process.wait()

    def close(self) -> None:
        """End the view."""
        if self._process.stdin is not None:
            self._process.stdin.close()
        try:
            self._process.wait(_STOP_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()


def child_process_environment() -> dict[str, str]:
    """Return an environment in which a child finds the packages that are running here."""
    packages = (haptogram, haptogram_protocol)
    places = {str(Path(str(package.__file__)).parent.parent): None for package in packages}
    inherited = os.environ.get("PYTHONPATH", "")
    paths = [*places, *inherited.split(os.pathsep)]
    return os.environ | {"PYTHONPATH": os.pathsep.join(path for path in paths if path)}
