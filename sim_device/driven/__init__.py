"""Boards without a port, which a program drives step by step: of a soak, of a replay, of a model."""
