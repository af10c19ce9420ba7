"""Published arrays and the paper's equations, with the figures that they give.

Text, pictures and pages of them lie in :mod:`haptogram.report`.
"""
