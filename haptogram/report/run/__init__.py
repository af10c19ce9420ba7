"""The report of one verification run: a document, its result as JSON, and lines for a terminal.

Each file is written as a whole or not at all.
"""
