"""The report of one benchmark of the loop: page, text for a terminal, summary."""
