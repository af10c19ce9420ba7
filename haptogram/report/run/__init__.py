"""The report of one verification run: page, pictures, JUnit, JSON."""
