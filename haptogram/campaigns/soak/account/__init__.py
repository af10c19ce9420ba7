"""Counts of a soak: of every fault, of everything that was done, and their course over time."""
