"""Files of captures; the first bytes show the format."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from haptogram.errors import ConfigurationError, reading_file

from .capture import Capture
from .sigrok import read_sigrok
from .vcd import read_vcd

_ZIP: Final = b"PK"


def read_capture(path: Path) -> Capture:
    """Return the capture in a VCD or in a session file of sigrok.

    Raises
    ------
    ConfigurationError
        A file that cannot be read, is neither, or has no edge.
    """
    with reading_file(path, "capture"), path.open("rb") as file:
        begin = file.read(len(_ZIP))
    if not begin:
        raise ConfigurationError(f"{path}: the file is empty; end the capture before it is read")
    capture = read_sigrok(path) if begin == _ZIP else read_vcd(path)
    if not capture.edges:
        after = f" (cut off: {capture.cut})" if capture.cut else ""
        raise ConfigurationError(
            f"{path}: no edge on any of {len(capture.channels)} channels in "
            f"{capture.duration_s:g} s{after}; check the probes, and that the board is armed"
        )
    return capture
