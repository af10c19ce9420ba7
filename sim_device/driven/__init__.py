"""Boards without a port, driven step by step: of a soak, of a replay, of a model."""
