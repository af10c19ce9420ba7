"""Timers: their lengths, what starts them anew, new settings meanwhile, the wrap of the clock."""
