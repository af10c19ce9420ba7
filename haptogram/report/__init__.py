"""Results for people and for CI: pages, pictures, text for a terminal, JUnit XML and JSON.

Nothing is computed here that a verdict rests on, and no file holds a date, a host name or a
duration: the same result gives the same bytes.
"""
