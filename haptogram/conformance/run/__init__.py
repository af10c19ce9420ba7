"""Runs of the suite: ways to a board, its connection, the runner, expected failures.

Reports of a run lie in :mod:`haptogram.report.conformance`.
"""
