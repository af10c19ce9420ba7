"""Reports of a board that was watched: words for its latches, JUnit XML, a page, a summary."""

from .document import watch_document
from .page import WatchPage
from .words import watched_client_places_mm, watched_pattern_text, watched_place_text

__all__ = [
    "WatchPage",
    "watch_document",
    "watched_client_places_mm",
    "watched_pattern_text",
    "watched_place_text",
]
