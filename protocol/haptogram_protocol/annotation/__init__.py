"""Bytes of a line in words: every frame, every operation, and what is neither, with its offset.

:mod:`.words` describes one frame of Haptogram's wire; :mod:`.frames` cuts a stream of them,
:mod:`.operations` one of another board's wire. Nothing here reads a file or prints.
"""
