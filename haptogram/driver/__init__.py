"""The driver of a board: from a user's call to frames on the line.

The latches of those frames are evidence, which :mod:`haptogram.verification` judges.
"""
