"""Boards of other dialects: their latches as observations, and one run on them."""
