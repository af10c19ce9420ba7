"""``haptogram watch``: options, lines of latches, the foci that are expected, the run."""
