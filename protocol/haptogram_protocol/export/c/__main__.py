"""``python -m haptogram_protocol.export.c [FOLDER]``."""

from __future__ import annotations

from ..folder import rewrite_export_folder
from . import write_c_headers


def c_export_main(arguments: list[str] | None = None) -> int:
    """Rewrite the headers; return the exit status."""
    text = "Rewrite the C99 headers of the protocol."
    return rewrite_export_folder("c", text, write_c_headers, arguments)


if __name__ == "__main__":
    raise SystemExit(c_export_main())
