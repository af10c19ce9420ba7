"""The report of one verification run: page, pictures, JUnit XML, JSON, and lines for a terminal.

Each file is written as a whole or not at all.
"""

from .junit import write_run_junit
from .page import write_run_page
from .result import environment, result_dict, write_frames, write_json
from .wording import faults_and_troubles

__all__ = [
    "environment",
    "faults_and_troubles",
    "result_dict",
    "write_frames",
    "write_json",
    "write_run_junit",
    "write_run_page",
]
