"""The report of one verification run: a document, its result as JSON, and lines for a terminal.

Each file is written as a whole or not at all.
"""

from typing import Any

from .result import (
    run_environment,
    run_frame_dict,
    run_result_dict,
    write_run_frame_lines,
    write_run_json,
)
from .wording import run_faults_wording


def __getattr__(name: str) -> Any:
    """Import what few runs need when it is asked for."""
    if name == "run_document":
        from .document import run_document as found
    elif name == "run_result_with_captures":
        from .pins import run_result_with_captures as found
    else:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return found
