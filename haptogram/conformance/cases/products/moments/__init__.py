"""Requests at every moment of a board: refused ones, those that end the output, new settings."""
