"""Test vectors that firmware in any language can read: frames, packings, dialogues.

``python -m haptogram_protocol.export.vectors`` rewrites them; ``protocol/vectors/schema.json`` says
what a file of them holds. What a frame means is taken from the message that it was made of, or
said by hand, and never from the decoder.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

from .acceptable import acceptable_frames
from .dialogues import dialogues
from .invalid import invalid_frames
from .packing import packings
from .valid import valid_frames

_Vectors = list[dict[str, Any]]

#: What makes each file, by its name, and what the file is about.
FILES: Final[Mapping[str, tuple[Callable[[], _Vectors], str]]] = {
    "frames-valid.json": (valid_frames, "Frames as a sender of this version emits them."),
    "frames-acceptable.json": (
        acceptable_frames,
        "Bytes that no sender of this version emits, and every receiver must take as stated.",
    ),
    "frames-invalid.json": (
        invalid_frames,
        "Bytes that a receiver must drop, each with the counter that counts them.",
    ),
    "packing.json": (packings, "Phase codes of 8, 6 and 5 bits, packed and unpacked."),
    "dialogues.json": (
        dialogues,
        "What a host sends and what a board answers, by the board's clock from power-up on.",
    ),
}


def document(name: str) -> dict[str, Any]:
    """Return the contents of one of :data:`FILES`."""
    make, about = FILES[name]
    return {"$schema": "schema.json", "protocol": "1.0", "about": about, "vectors": make()}


def text(name: str) -> str:
    """Return the text of one of :data:`FILES`: a vector a line, so that a change is readable."""
    contents = document(name)
    vectors = [json.dumps(vector, ensure_ascii=False) for vector in contents.pop("vectors")]
    head = json.dumps(contents, ensure_ascii=False, indent=1)[:-2]
    return head + ',\n "vectors": [\n' + ",\n".join(vectors) + "\n]}\n"


def write_vectors(folder: Path) -> list[Path]:
    """Write every file into *folder*, which must exist; return their paths."""
    paths = []
    for name in FILES:
        path = folder / name
        path.write_text(text(name), "utf-8")
        paths.append(path)
    return paths


__all__ = ["FILES", "document", "text", "write_vectors"]
