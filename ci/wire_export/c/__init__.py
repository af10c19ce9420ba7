"""The C99 headers that firmware includes, made from the messages.

``haptogram.h`` declares constants,
enumerations and layouts. ``haptogram_messages.h`` turns a layout into a struct of numbers and back.
The codec and the board in C are written by hand and do not live here.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Final

from .layouts import c_wire_header
from .values import c_values_header

#: Maker of each header, by the name of its file.
HEADERS: Final[Mapping[str, Callable[[], str]]] = {
    "haptogram.h": c_wire_header,
    "haptogram_messages.h": c_values_header,
}


def write_c_headers(folder: Path) -> list[Path]:
    """Write every header into *folder*, which must exist; return their paths."""
    paths = []
    for name, make in HEADERS.items():
        path = folder / name
        path.write_text(make(), "utf-8")
        paths.append(path)
    return paths


__all__ = ["HEADERS", "write_c_headers"]
