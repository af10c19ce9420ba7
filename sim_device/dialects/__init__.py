"""Dialects: what a board does with the messages of one wire protocol."""
