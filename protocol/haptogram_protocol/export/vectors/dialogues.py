"""Every dialogue, by the chapter of SPEC.md that it is about."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from . import evidence_dialogues, output_dialogues, session_dialogues, stream_dialogues
from . import upload_dialogues as uploads
from .script import Script

_PARTS: Final[tuple[Callable[[], list[Script]], ...]] = (
    session_dialogues.scripts,
    stream_dialogues.scripts,
    output_dialogues.scripts,
    uploads.scripts,
    evidence_dialogues.scripts,
)


def dialogues() -> list[dict[str, Any]]:
    """Return every vector of ``dialogues.json``."""
    return [script.finish() for part in _PARTS for script in part()]
