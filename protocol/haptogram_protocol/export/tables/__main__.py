"""``python -m haptogram_protocol.export.tables (--spec SPEC.md | --json)``."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from .schema import wire_description
from .spec import update_spec


def tables_export_main(arguments: list[str] | None = None) -> int:
    """Rewrite SPEC.md, or print the description; return the exit status."""
    parser = argparse.ArgumentParser(
        prog="python -m haptogram_protocol.export.tables",
        description="Rewrite the generated parts of SPEC.md, or print the protocol as JSON.",
    )
    action = parser.add_mutually_exclusive_group(required=True)
    action.add_argument("--spec", type=Path, help="rewrite the generated parts of this SPEC.md")
    action.add_argument("--json", action="store_true", help="write the description as JSON")
    options = parser.parse_args(arguments)
    if options.json:
        sys.stdout.write(json.dumps(wire_description(), indent=2) + "\n")
    else:
        options.spec.write_text(update_spec(options.spec.read_text("utf-8")), "utf-8")
    return 0


if __name__ == "__main__":
    raise SystemExit(tables_export_main())
