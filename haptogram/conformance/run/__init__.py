"""Runs of the suite: ways to a board, the runner that never hangs, expected failures."""
