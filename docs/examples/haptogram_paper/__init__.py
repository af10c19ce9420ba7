"""The simulation of the paper "Haptogram: aerial display of 3D vibrotactile sensation" (2014).

Its equations as printed, with their faults named, and as corrected; its hemisphere; its Table 1
next to what a stated reading of the text predicts; the foci of its figure 4.  What cannot be
reproduced is reported as that.
"""
