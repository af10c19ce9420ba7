"""The report of one verification run: a document, its result as JSON, and lines for a terminal.

Each file is written as a whole or not at all.
"""

from .document import run_document
from .pins import run_result_with_captures
from .result import (
    run_environment,
    run_frame_dict,
    run_result_dict,
    write_run_frame_lines,
    write_run_json,
)
from .wording import run_faults_wording
