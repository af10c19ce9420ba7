"""Latches of boards of other dialects: of frames, and of clients that do not say what they mean."""
