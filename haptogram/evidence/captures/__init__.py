"""Captures of drive pins by a logic analyser: files -> edges -> phases, duties and latches."""
