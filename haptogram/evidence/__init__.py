"""Evidence of a run: where observations come from, and the boards that give them.

What follows from an observation is decided in :mod:`haptogram.verification`.
"""
