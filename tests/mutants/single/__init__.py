"""Boards that are wrong for one type, at one moment, or for one timer alone; no others."""
