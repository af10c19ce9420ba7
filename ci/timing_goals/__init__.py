"""The project's own goals for control loop and round trip, measured beside the same work in C.

What a user measures of a loop, a line or a board lies in :mod:`haptogram.campaigns.bench`.
"""
