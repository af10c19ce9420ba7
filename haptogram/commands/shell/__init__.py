"""Shared by all commands: exit status, interrupts, output files, positions, standard streams.

Nothing of a single command lives here.
"""
