"""Reports of a board that was watched: words for its latches, JUnit XML, a page, a summary."""

from .junit import write_watch_junit
from .page import WatchPage
from .summary import watch_summary
from .words import watched_client_places_mm, watched_pattern_text, watched_place_text

__all__ = [
    "WatchPage",
    "watch_summary",
    "watched_client_places_mm",
    "watched_pattern_text",
    "watched_place_text",
    "write_watch_junit",
]
