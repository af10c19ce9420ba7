"""The report of the reproduced paper: page, pictures, text for a terminal."""
