"""Settings of a run, checked at the door: for host and simulator alike.

No numpy, no port, no clock.
"""
