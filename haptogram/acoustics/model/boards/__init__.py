"""Geometries of boards that other programs drive: elements in the order of their channels.

Nothing here knows bytes; which dialect of a wire a board speaks is written in :mod:`.table` by name only.
"""
