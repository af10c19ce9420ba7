"""The formats of a result: page, JUnit XML, table on a terminal, summary of a CI job.

Nothing here knows a run, a case or a benchmark.
"""
