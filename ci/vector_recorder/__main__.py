"""``ci/record-dialogues``: record protocol/vectors/dialogues.json anew."""

from __future__ import annotations

import argparse
import subprocess
import tempfile
from pathlib import Path

from haptogram.conformance.cases import all_cases

from .boards import CBoard
from .recorder import dialogues, text

_PROTOCOL = Path(__file__).resolve().parents[2] / "protocol"


def main(arguments: list[str] | None = None) -> int:
    """Build the C board, record every case, write the file; return the exit status."""
    parser = argparse.ArgumentParser(prog="ci/record-dialogues", description=__doc__)
    parser.add_argument(
        "file", nargs="?", type=Path, default=_PROTOCOL / "vectors" / "dialogues.json"
    )
    path: Path = parser.parse_args(arguments).file
    with tempfile.TemporaryDirectory() as folder:
        build = [
            "make",
            "-s",
            "-C",
            str(_PROTOCOL / "c"),
            f"BUILD={folder}",
            f"{folder}/board_steps",
        ]
        subprocess.run(build, check=True)
        with CBoard(Path(folder)) as board:
            found = dialogues(all_cases(), board)
    path.write_text(text(found), "utf-8")
    print(f"{path}: {len(found)} dialogues")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
