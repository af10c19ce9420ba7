"""``ci/export-wire [FOLDER]``: SPEC.md's tables, the C headers and the test vectors.

Rewrites what is made from the messages in FOLDER, which has a SPEC.md and the folders c and
vectors, and prints the files.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from .c import write_c_headers
from .tables import wire_description
from .tables.spec import update_spec
from .vectors import write_vectors

PROTOCOL = Path(__file__).resolve().parents[2] / "protocol"


def export_wire(arguments: list[str] | None = None) -> int:
    """Rewrite the files, or print the description of the wire; return the exit status."""
    parser = argparse.ArgumentParser(
        prog="ci/export-wire",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("folder", nargs="?", type=Path, metavar="FOLDER", default=PROTOCOL)
    parser.add_argument(
        "--json", action="store_true", help="print the description of the wire and write nothing"
    )
    options = parser.parse_args(arguments)
    if options.json:
        sys.stdout.write(json.dumps(wire_description(), indent=2) + "\n")
        return 0
    spec: Path = options.folder / "SPEC.md"
    headers, vectors = (options.folder / name for name in ("c", "vectors"))
    if not (spec.is_file() and headers.is_dir() and vectors.is_dir()):
        parser.error(f"{options.folder} must have a SPEC.md and the folders c and vectors")
    spec.write_text(update_spec(spec.read_text("utf-8")), "utf-8")
    for path in (spec, *write_c_headers(headers), *write_vectors(vectors)):
        sys.stdout.write(f"{path}\n")
    return 0


if __name__ == "__main__":
    raise SystemExit(export_wire())
