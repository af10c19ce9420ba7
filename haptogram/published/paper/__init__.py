"""The simulation of the paper "Haptogram: aerial display of 3D vibrotactile sensation" (2014).

Its equations as printed, with their faults named, and as corrected; its hemisphere; its Table 1
next to what a stated reading of the text predicts; the foci of its figure 4.  What cannot be
reproduced is reported as that.
"""

from haptogram.published.paper.equations import EQUATIONS, Constants, Equation
from haptogram.published.paper.figure4 import FIGURE_4_FOCI_M, concave_section, figure_4_model
from haptogram.published.paper.hemisphere import RESOLUTIONS_M, hemisphere
from haptogram.published.paper.table1 import (
    BEST_READING,
    CONFIGURATIONS,
    PRINTED,
    READINGS,
    Cell,
    Reading,
    Reproduction,
    reproduce,
)

__all__ = [
    "BEST_READING",
    "CONFIGURATIONS",
    "EQUATIONS",
    "FIGURE_4_FOCI_M",
    "PRINTED",
    "READINGS",
    "RESOLUTIONS_M",
    "Cell",
    "Constants",
    "Equation",
    "Reading",
    "Reproduction",
    "concave_section",
    "figure_4_model",
    "hemisphere",
    "reproduce",
]
