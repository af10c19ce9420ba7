"""Campaigns: many runs, and what they say together.

One run lies in :mod:`haptogram.evidence.run_record`.
"""
