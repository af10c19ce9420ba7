"""Consequences of late and lost frames: which focus was held, how long, how it was felt."""
