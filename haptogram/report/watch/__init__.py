"""Reports of a board that was watched: its document, and words for its latches."""

from .document import WatchReport, watched_defect_texts, watched_status_text
from .words import watched_client_places_mm, watched_pattern_text, watched_place_text
