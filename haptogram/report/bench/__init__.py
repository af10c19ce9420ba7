"""The report of one benchmark of the loop: page, pictures, text for a terminal."""
