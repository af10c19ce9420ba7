"""The simulation of the paper "Haptogram: aerial display of 3D vibrotactile sensation" (2014).

Its equations as printed, with their faults named, and as corrected; its hemisphere; its Table 1
next to what a stated reading of the text predicts; the foci of its figure 4.  What cannot be
reproduced is reported as that.
"""

from haptogram.published.paper.equations import EQUATIONS, PaperConstants, PaperEquation
from haptogram.published.paper.figure4 import FIGURE_4_FOCI_M, figure_4_model, figure_4_section
from haptogram.published.paper.hemisphere import RESOLUTIONS_M, paper_hemisphere
from haptogram.published.paper.table1 import (
    BEST_READING,
    CONFIGURATIONS,
    PRINTED,
    READINGS,
    Table1Cell,
    Table1Reading,
    Table1Reproduction,
    reproduce_table_1,
)

__all__ = [
    "BEST_READING",
    "CONFIGURATIONS",
    "EQUATIONS",
    "FIGURE_4_FOCI_M",
    "PRINTED",
    "READINGS",
    "RESOLUTIONS_M",
    "PaperConstants",
    "PaperEquation",
    "Table1Cell",
    "Table1Reading",
    "Table1Reproduction",
    "figure_4_model",
    "figure_4_section",
    "paper_hemisphere",
    "reproduce_table_1",
]
