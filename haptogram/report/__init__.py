"""The result of a run for machines and for people: JSON, JUnit XML and an HTML page with pictures.

Each file is written as a whole or not at all.  Given a run in virtual time, nothing here adds a
date, a host name or a duration: the same run gives the same bytes.
"""

from .junit import write_junit
from .page import write_html
from .result import environment, result_dict, write_frames, write_json
from .wording import faults_and_troubles

__all__ = [
    "environment",
    "faults_and_troubles",
    "result_dict",
    "write_frames",
    "write_html",
    "write_json",
    "write_junit",
]
