"""Reports of a board that was watched: words for its latches, JUnit XML, a page, a summary."""

from .junit import write_watch_junit
from .page import WatchPage
from .summary import watch_summary
from .words import client_places_mm, pattern_text, place_text

__all__ = [
    "WatchPage",
    "client_places_mm",
    "pattern_text",
    "place_text",
    "watch_summary",
    "write_watch_junit",
]
