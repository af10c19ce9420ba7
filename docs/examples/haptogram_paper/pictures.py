"""The pictures of the reproduction: hemispheres, Table 1, figure 4."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from haptogram.acoustics import NumpyEngine, focus_phases
from haptogram.acoustics.levels.shift import find_pressure_peak
from haptogram.report.figures import PicturePlane, draw_plane_figure, sample_picture_plane
from haptogram.report.figures.style import BLACK, BLUE, GREEN, ORANGE, VERMILION, new_figure

from .figure4 import BENDS, FIGURE_4_FOCI_M, figure_4_model
from .hemisphere import RESOLUTIONS_M, paper_hemisphere
from .table1 import CONFIGURATIONS, Table1Reproduction

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_COLOURS: Final = (BLUE, ORANGE, GREEN, VERMILION)
_MARKERS: Final = ("o", "s", "^", "D")
_STEP_M: Final = 0.75e-3
_HEIGHTS_M: Final = (0.040, 0.140)  # from a wavelength above the edge of the section


def draw_paper_hemispheres() -> Figure:
    """Return the hemisphere at the four resolutions."""
    with new_figure(7.2, 4.4) as figure:
        figure.set_layout_engine("none")
        for index, resolution in enumerate(RESOLUTIONS_M):
            points = paper_hemisphere(resolution) * 1e3
            place = (0.01 + 0.49 * (index % 2), 0.46 - 0.50 * (index // 2), 0.45, 0.60)
            axes: Any = figure.add_axes(place, projection="3d", facecolor="none")
            axes.scatter(*points.T, color=BLUE, s=max(2.0, 16.0 - 4.5 * index), linewidths=0)
            axes.set_title(f"{resolution * 1e3:g} mm: {len(points)} points", fontsize=9, y=0.88)
            axes.set_box_aspect((2, 2, 1))
            axes.view_init(elev=16, azim=-60)
            axes.tick_params(labelsize=6, pad=-2)
            axes.set_xticks([-50, 0, 50])
            axes.set_yticks([-50, 0, 50])
            axes.set_zticks([50, 75, 100])
            axes.set_xlabel("x (mm)", fontsize=7, labelpad=-5)
            axes.set_ylabel("y (mm)", fontsize=7, labelpad=-5)
            axes.set_zlabel("z (mm)", fontsize=7, labelpad=-5)
    return figure


def draw_paper_table_1(result: Table1Reproduction) -> Figure:
    """Return the sixteen averages and standard deviations, printed and predicted."""
    with new_figure(8.4, 3.6) as figure:
        places = np.arange(len(RESOLUTIONS_M))
        left, right = figure.subplots(1, 2)
        for row, shape in enumerate(CONFIGURATIONS):
            cells = result.cells[row * len(places) : (row + 1) * len(places)]
            style = {"color": _COLOURS[row], "marker": _MARKERS[row]}
            name = f"{shape[0]} × {shape[1]}"
            for axes, printed, ours in (
                (
                    left,
                    [cell.printed_average_mn for cell in cells],
                    [cell.average_mn for cell in cells],
                ),
                (
                    right,
                    [cell.printed_deviation_mn for cell in cells],
                    [cell.deviation_mn for cell in cells],
                ),
            ):
                axes.plot(places, printed, "-", label=name, markersize=6, **style)
                axes.plot(places, ours, ":", markersize=6, fillstyle="none", **style)
        left.set_title("average: reproduced within 7 %")
        right.set_title("standard deviation: not reproduced")
        for axes in (left, right):
            axes.set_xticks(places, [f"{value * 1e3:g}" for value in RESOLUTIONS_M])
            axes.set_xlabel("resolution (mm)")
            axes.set_ylabel("force (mN)")
        left.set_ylim(2.8, 4.6)
        right.set_ylim(0.0, 2.3)
        left.plot([], [], "-", color=BLACK, label="printed")
        left.plot([], [], ":", color=BLACK, label="predicted")
        handles, labels = left.get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=6)
    return figure


def draw_paper_figure_4() -> dict[str, Figure]:
    """Return planes through both foci of figure 4, for both ways to bend the section."""
    figures = {}
    for bend, (index, focus) in itertools.product(BENDS, enumerate(FIGURE_4_FOCI_M, start=1)):
        model = figure_4_model(bend)
        engine = NumpyEngine(model)
        weights = np.exp(1j * focus_phases(model, focus))
        for plane in (
            PicturePlane("xz", focus, (-0.05, 0.05), _HEIGHTS_M, _STEP_M),
            PicturePlane("yz", focus, (-0.10, 0.10), _HEIGHTS_M, _STEP_M),
        ):
            field = sample_picture_plane(engine, weights, plane)
            # Along the beam, the edge of the section bent along y is louder than its focus.
            along = bend == "y" and plane.orientation == "yz"
            peak = find_pressure_peak(engine, weights, focus) if along else None
            figures[f"figure4_{index}_bent_{bend}_{plane.orientation}"] = draw_plane_figure(
                field,
                targets_m=[focus],
                peak_m=peak,
                title=f"64 × 1 section bent along {bend}, focus at "
                f"({', '.join(f'{value * 1e3:g}' for value in focus)}) mm",
            )
    return figures
