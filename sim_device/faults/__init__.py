"""Effects of the faults of a plan on line, frames, clock, transducers and reports.

Which faults there are, and how a plan is written, is in :mod:`haptogram.settings.faults`.
"""
