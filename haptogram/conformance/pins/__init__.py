"""Clauses judged by a capture of the drive pins: what the board says, against what its pins do."""
