"""The report of a soak: text for a terminal, page, summary."""
