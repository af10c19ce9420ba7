"""The driver of a board: from a user's call to frames on the line.

What the board made of them is evidence, and judged elsewhere.
"""
