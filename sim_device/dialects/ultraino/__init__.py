"""Ultraino's boards: FPGAs (:mod:`.fpga`) and Arduinos (:mod:`.arduino`)."""
