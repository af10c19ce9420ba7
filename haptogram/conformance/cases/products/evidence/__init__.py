"""Traces, ring, read-backs and the last latch in a status: every span, size and moment."""
