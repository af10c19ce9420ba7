"""Sweep: many runs of one command, over the values of its options.

:mod:`.plan` says which points there are, :mod:`.workers` where they run, :mod:`.campaign` runs them
and keeps what is done, :mod:`.rows` makes a row of each result.
"""
