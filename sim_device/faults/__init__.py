"""Faults on purpose: their plan, and what each does to line, frames, transducers and reports."""
