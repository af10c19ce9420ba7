"""Test vectors that are typed by hand: frames, and the few dialogues without a case.

The schema of every file is ``protocol/vectors/schema.json``. The meaning of a frame is taken from
the message that it was made of, or typed, and never from the decoder. Recorded dialogues do not
live here: ``ci/record-dialogues`` writes them.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from haptogram_protocol.messages import VERSION_MAJOR, VERSION_MINOR

from .acceptable import acceptable_frame_vectors
from .dialogues import dialogue_vectors
from .invalid import invalid_frame_vectors
from .valid import valid_frame_vectors

_Vectors = list[dict[str, Any]]
_VERSION: Final = f"{VERSION_MAJOR}.{VERSION_MINOR}"

#: Maker of each file, by its name, and the subject of the file.
FILES: Final[Mapping[str, tuple[Callable[[], _Vectors], str]]] = {
    "frames-valid.json": (valid_frame_vectors, "Frames as a sender of this version emits them."),
    "frames-acceptable.json": (
        acceptable_frame_vectors,
        "Bytes that no sender of this version emits, and every receiver must take as stated.",
    ),
    "frames-invalid.json": (
        invalid_frame_vectors,
        "Bytes that a receiver must drop, each with the counter that counts them.",
    ),
    "dialogues-typed.json": (
        dialogue_vectors,
        "Dialogues of host and board, by the board's clock, about clauses that no case judges.",
    ),
}


def vector_file_text(name: str) -> str:
    """Return the text of one of :data:`FILES`."""
    make, about = FILES[name]
    return vector_document_text(about, make())


def vector_document_text(about: str, vectors: Sequence[Mapping[str, Any]]) -> str:
    """Return the text of a file of *vectors*: one vector a line, so that a change is readable."""
    contents = {"$schema": "schema.json", "protocol": _VERSION, "about": about}
    head = json.dumps(contents, ensure_ascii=False, indent=1)[:-2]
    lines = [json.dumps(vector, ensure_ascii=False) for vector in vectors]
    return head + ',\n "vectors": [\n' + ",\n".join(lines) + "\n]}\n"


def write_vectors(folder: Path) -> list[Path]:
    """Write every file of :data:`FILES` into *folder*, which must exist; return their paths."""
    paths = []
    for name in FILES:
        path = folder / name
        path.write_text(vector_file_text(name), "utf-8")
        paths.append(path)
    return paths


__all__ = ["FILES", "vector_document_text", "vector_file_text", "write_vectors"]
