"""``python -m haptogram_protocol.export.c [FOLDER]``."""

from __future__ import annotations

import argparse
from pathlib import Path

from . import write_c_headers

_FOLDER = Path(__file__).resolve().parents[3] / "c"


def c_export_main(arguments: list[str] | None = None) -> int:
    """Rewrite the headers; return the exit status."""
    parser = argparse.ArgumentParser(
        prog="python -m haptogram_protocol.export.c",
        description="Rewrite the C99 headers of the protocol.",
    )
    parser.add_argument("folder", nargs="?", type=Path, default=_FOLDER)
    folder: Path = parser.parse_args(arguments).folder
    if not folder.is_dir():
        parser.error(f"{folder} is no folder")
    for path in write_c_headers(folder):
        print(path)
    return 0


if __name__ == "__main__":
    raise SystemExit(c_export_main())
