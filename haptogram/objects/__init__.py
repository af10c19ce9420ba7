"""Objects to be felt: shapes, meshes, modulation, and the pressure that they make in time.

How a focus becomes phases lies in :mod:`haptogram.acoustics.solvers`.
"""
