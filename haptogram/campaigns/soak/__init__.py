"""Soak: hours of streaming over a line that damages frames, and an account of every one of them.

Everything runs in virtual time, segment by segment.  Each segment follows from the seed and its
number alone, so they may run in any order, in parallel, and in several sittings.
"""
