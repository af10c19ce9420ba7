"""Levels derived from the field: force, spot, lobes, exposure, and how they change in time."""
