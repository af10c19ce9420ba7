"""Latches of emulated boards: of frames, of clients that do not say what they mean, at any port."""
