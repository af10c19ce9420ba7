"""What is set before a run, checked at the door: for host and simulator alike.

No numpy, no port, no clock.
"""
