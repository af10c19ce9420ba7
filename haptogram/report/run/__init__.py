"""The report of one verification run: page, pictures, JUnit XML, JSON, and lines for a terminal.

Each file is written as a whole or not at all.
"""

from .junit import write_run_junit
from .page import write_run_page
from .pins import with_captures
from .result import frame_dict, run_environment, run_result_dict, write_frame_lines, write_run_json
from .summary import run_summary
from .wording import faults_and_troubles_text

__all__ = [
    "faults_and_troubles_text",
    "frame_dict",
    "run_environment",
    "run_result_dict",
    "run_summary",
    "with_captures",
    "write_frame_lines",
    "write_run_json",
    "write_run_junit",
    "write_run_page",
]
