"""The timing of a stream: percentiles from the intended time, and the cause of every late frame.

A control loop beside the stream gives the noise floor of the machine.  Nothing here judges a board:
wall-clock figures are reported and gate nothing.  The project's own goals lie in ``ci``.
"""
