"""The result of a sweep: where it breaks, as text, page and pictures."""
