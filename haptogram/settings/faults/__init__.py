"""Fault plans: which faults there are, their parameters and limits, and the only parser of them.

What a fault does to bytes, clock and transducers is in :mod:`sim_device.faults`.
"""
