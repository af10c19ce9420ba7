"""Frames of a driver: from targets to expected drive and message; no line, no time."""
