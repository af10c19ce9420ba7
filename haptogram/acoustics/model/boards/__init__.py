"""Geometries of boards that other programs drive: elements in the order of their channels.

Nothing here knows bytes: :mod:`.table` names the dialect that a board speaks.
"""
