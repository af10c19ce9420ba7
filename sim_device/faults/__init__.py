"""What each fault of a plan does to line, frames, clock, transducers and reports.

Which faults there are, and how a plan is written, is in :mod:`haptogram.settings.faults`.
"""
