"""The result of a run for machines and for people: JSON, JUnit XML and an HTML page with pictures.

Each file is written as a whole or not at all.  Given a run in virtual time, nothing here adds a
date, a host name or a duration: the same run gives the same bytes.
"""

from .run.junit import write_junit
from .run.page import write_html
from .run.result import environment, result_dict, write_frames, write_json
from .run.wording import faults_and_troubles

__all__ = [
    "environment",
    "faults_and_troubles",
    "result_dict",
    "write_frames",
    "write_html",
    "write_json",
    "write_junit",
]
