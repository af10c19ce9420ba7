"""From foci to a drive: the phases of one focus, and solvers for several.

The way back lies in :mod:`haptogram.acoustics.reconstruct`.
"""
