"""Consequences of late and lost frames: how long which focus was held, and what was felt."""
