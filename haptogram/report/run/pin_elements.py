"""The elements as captured pins show them: a table and a picture."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from ..figures.style import BLUE, GREY, VERMILION, embed_picture, new_figure
from ..formats.document import PagePicture

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Columns of the table, and the fields of an element in the result.
PIN_COLUMNS: Final = {
    "element": "element",
    "channel": "channel",
    "phase, degrees": "phase_deg",
    "± degrees": "phase_spread_deg",
    "amplitude": "gain",
    "± amplitude": "gain_spread",
    "duty": "duty",
}


def run_pin_elements(captures: Mapping[str, Any] | None) -> list[list[str]]:
    """Return a row of the table for each captured element."""
    rows = [] if captures is None else captures["captures"]
    return [
        [_pin_cell(row[name]) for name in PIN_COLUMNS.values()]
        for one in rows
        for row in one["elements_shown"]
    ]


def _pin_cell(value: object) -> str:
    if value is None:
        return "–"
    return f"{value:+.3f}" if isinstance(value, float) and value < 0 else _plain_pin_cell(value)


def _plain_pin_cell(value: object) -> str:
    return f"{value:.3f}" if isinstance(value, float) else str(value)


def run_pin_pictures(captures: Mapping[str, Any] | None) -> Iterator[PagePicture]:
    """Yield a picture of the elements of each capture that shows some."""
    for one in () if captures is None else captures["captures"]:
        if one["elements_shown"]:
            yield embed_picture(
                draw_pin_elements(one),
                f"The elements at their pins: {one['capture']}.",
                "Mean over the frames that were judged, and standard deviation from frame to "
                "frame. Phases are behind (+) or ahead of (-) the drives that were meant, after "
                "the one that all pins share; amplitudes are over those that were meant.",
            )


def draw_pin_elements(one: Mapping[str, Any]) -> Figure:
    """Draw phase and amplitude of each element of a capture; its level in time if it has one."""
    rows, levels = one["elements_shown"], one["levels"]
    table = {
        name: np.array([np.nan if row[name] is None else row[name] for row in rows])
        for name in ("element", "phase_deg", "phase_spread_deg", "gain", "gain_spread")
    }
    limit = one["phase_limit_deg"]
    with new_figure(8.0, 3.0 if levels is None else 4.4) as figure:
        panels = figure.subplots(2 if levels is None else 3, 1)
        panels[0].axhspan(-limit, limit, color=GREY, alpha=0.3, linewidth=0)
        _draw_pin_values(panels[0], table, "phase_deg", "phase_spread_deg", limit)
        panels[0].set_ylabel("phase (degrees)")
        _draw_pin_values(panels[1], table, "gain", "gain_spread", None)
        panels[1].set_ylim(0.0, 1.1 * max(1.0, float(np.nanmax(table["gain"], initial=1.0))))
        panels[1].set_ylabel("amplitude")
        panels[1].set_xlabel("element")
        if levels is not None:
            values = [np.nan if level is None else level for level in levels["level_db"]]
            panels[2].plot(levels["t_ms"], values, color=VERMILION, linewidth=1.0)
            panels[2].set_ylabel("level (dB)")
            panels[2].set_xlabel("time from the begin of the capture (ms)")
    return figure


def _draw_pin_values(
    axes: Any, table: Mapping[str, Any], name: str, spread: str, limit: float | None
) -> None:
    """Draw one value of the elements with its spread; those beyond the *limit* stand out."""
    values = table[name]
    off = np.zeros(len(values), np.bool_) if limit is None else np.abs(values) > limit
    for colour, chosen in ((BLUE, ~off), (VERMILION, off)):
        if chosen.any():
            axes.errorbar(
                table["element"][chosen],
                values[chosen],
                yerr=table[spread][chosen],
                fmt="o",
                color=colour,
                markersize=2.5,
                linewidth=0.8,
            )
