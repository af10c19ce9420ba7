"""From a drive back to its focus: search, fit, and its uncertainty.

No target enters here.
"""
