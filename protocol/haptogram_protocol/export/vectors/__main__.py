"""``python -m haptogram_protocol.export.vectors [FOLDER]``."""

from __future__ import annotations

import argparse
from pathlib import Path

from . import write_vectors

_FOLDER = Path(__file__).resolve().parents[3] / "vectors"


def vectors_export_main(arguments: list[str] | None = None) -> int:
    """Rewrite the vectors; return the exit status."""
    parser = argparse.ArgumentParser(
        prog="python -m haptogram_protocol.export.vectors",
        description="Rewrite the test vectors of the protocol.",
    )
    parser.add_argument("folder", nargs="?", type=Path, default=_FOLDER)
    folder: Path = parser.parse_args(arguments).folder
    if not folder.is_dir():
        parser.error(f"{folder} is no folder")
    for path in write_vectors(folder):
        print(path)
    return 0


if __name__ == "__main__":
    raise SystemExit(vectors_export_main())
