"""Playback: sizes and times of every width, and the store of sequences."""
