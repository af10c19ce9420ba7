"""Frames of a host at every type: bytes on the line, header, length, order of the checks."""
