"""Campaigns: many runs, and the numbers that they give together.

One run lies in :mod:`haptogram.evidence.run_record`, text and pages in :mod:`haptogram.report`.
"""
