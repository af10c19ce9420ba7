"""How good the loop is on this machine, whose fault each late frame was, and what it did.

Time is measured from the intended moment, for every frame, and set against a noise floor that ran
beside it.  Nothing here judges a board; wall-clock figures are reported and gate nothing.
"""
