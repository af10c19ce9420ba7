"""The report of one verification run: a document, its result as JSON, and lines for a terminal.

Each file is written as a whole or not at all.
"""

from importlib import import_module
from typing import Any, Final

from .result import (
    run_environment,
    run_frame_dict,
    run_result_dict,
    write_run_frame_lines,
    write_run_json,
)
from .wording import run_faults_wording

_SELDOM: Final = {"run_document": "document", "run_result_with_captures": "pins"}


def __getattr__(name: str) -> Any:
    """Import what few runs need when it is asked for."""
    if name not in _SELDOM:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f".{_SELDOM[name]}", __name__), name)
