"""The acoustic model: array, medium, transducers, drive, calibration.

No field is computed here.
"""
