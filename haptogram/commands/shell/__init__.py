"""Shared by commands: exit status, interrupts, array options, files, positions, standard streams.

Nothing of a single command lives here.
"""
