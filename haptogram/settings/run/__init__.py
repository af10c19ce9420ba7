"""Settings of a run: frames, link, limits, captures, outputs; those of verify, which has all."""
