"""The report of one verification run: page, pictures, JUnit XML, JSON, and lines for a terminal.

Each file is written as a whole or not at all.
"""

from .junit import write_run_junit
from .page import write_run_page
from .pins import run_result_with_captures
from .result import (
    run_environment,
    run_frame_dict,
    run_result_dict,
    write_run_frame_lines,
    write_run_json,
)
from .summary import run_summary
from .wording import run_faults_wording

__all__ = [
    "run_environment",
    "run_faults_wording",
    "run_frame_dict",
    "run_result_dict",
    "run_result_with_captures",
    "run_summary",
    "write_run_frame_lines",
    "write_run_json",
    "write_run_junit",
    "write_run_page",
]
