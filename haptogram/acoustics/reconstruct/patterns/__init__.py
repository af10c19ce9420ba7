"""The pattern that a drive radiates: a focus, several, a twin trap, a vortex, or none of these.

No target enters here.
"""
