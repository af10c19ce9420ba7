"""``python -m haptogram_protocol.export.vectors [FOLDER]``."""

from __future__ import annotations

from ..folder import rewrite_export_folder
from . import write_vectors


def vectors_export_main(arguments: list[str] | None = None) -> int:
    """Rewrite the vectors; return the exit status."""
    text = "Rewrite the test vectors of the protocol."
    return rewrite_export_folder("vectors", text, write_vectors, arguments)


if __name__ == "__main__":
    raise SystemExit(vectors_export_main())
