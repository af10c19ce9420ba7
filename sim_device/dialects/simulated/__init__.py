"""Boards that another process simulates (Simulated...): its lines, pins, and the unit of it."""
