"""Reports of a board that was watched: words for its latches, JUnit XML, a page."""

from .junit import write_watch_junit
from .page import WatchPage
from .words import client_places_mm, pattern_text, place_text

__all__ = ["WatchPage", "client_places_mm", "pattern_text", "place_text", "write_watch_junit"]
