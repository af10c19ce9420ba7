"""The verdict by captures of drive pins: its checks, sentences, elements, place in the result."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from haptogram.verification import RunVerdict, Verdict
from haptogram.verification.pins.joined import JoinedCaptureVerdict
from haptogram.verification.pins.pin_verdict import PIN_CHECKS

from ..figures.style import BLUE, GREY, VERMILION, embed_picture, new_figure
from ..formats.document import Check, Outcome, PagePicture
from .wording import run_count_wording

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
_ORDER: Final = (Verdict.FAIL, Verdict.INCONCLUSIVE, Verdict.PASS)


def run_result_with_captures(
    result: Mapping[str, Any], captures: JoinedCaptureVerdict, *, is_run_judged: bool
) -> dict[str, Any]:
    """Return the *result* of a run with the verdict of its captures: the worse of both counts.

    Parameters
    ----------
    is_run_judged : bool
        Whether the run has a verdict of its own, beside its captures.
    """
    own = Verdict(result["verdict"]) if is_run_judged else Verdict.PASS
    verdict = next(v for v in _ORDER if v in (own, captures.verdict))
    reasons = [*captures.reasons, *(result["reasons"] if is_run_judged else ())]
    evidence = result["evidence"] if is_run_judged else []
    kinds = {*([evidence] if isinstance(evidence, str) else evidence), "external"}
    return {
        **result,
        "verdict": str(verdict),
        "reasons": list(dict.fromkeys(reasons)),
        "evidence": kinds.pop() if len(kinds) == 1 else sorted(kinds),
        "run_judged": is_run_judged,
        "captures": captures.as_dict() | {"text": str(captures)},
    }


def run_result_sentence(run: RunVerdict, result: Mapping[str, Any]) -> str:
    """Return the verdict and its reason: of a run, and of the captures of its pins."""
    if "captures" not in result:
        return run.sentence
    captured = f"of {len(result['captures']['elements'])} elements every captured pin is right"
    every = f"every focus is on target, and {captured}" if result["run_judged"] else captured
    return f"{result['verdict'].upper()}: {'; '.join(result['reasons']) or every}"


def run_capture_checks(captures: Mapping[str, Any]) -> Iterator[Check]:
    """Yield the checks of the ``captures`` of a result."""
    several = len(captures["captures"]) > 1
    for one in captures["captures"]:
        for name, statement in PIN_CHECKS.items():
            where = f"{one['capture']}: " if several else ""
            yield _run_capture_check(one, name, f"drive pins: {where}{statement}")


def _run_capture_check(one: Mapping[str, Any], name: str, statement: str) -> Check:
    """Return the check *name* of the pins in one capture: its findings, or why not judged.

    *one* is the verdict on the capture as JSON has it, *statement* what is checked.
    """
    found, frames = one["findings"].get(name, ()), one["frames"]
    missing = one["reasons"] if one["verdict"] == str(Verdict.INCONCLUSIVE) else ()
    outcome = Outcome.PASSED
    message = f"none of {run_count_wording(len(one['elements']), 'captured element')}"
    if name in ("phases", "amplitudes") and "pins" in one["findings"]:
        message += ", besides the pins that are dead, stuck or inverted"
    if found:
        outcome = Outcome.FAILED
        message = found[0] if len(found) == 1 else f"{len(found)} findings"
    elif name == "alignment" and missing:
        outcome, message = Outcome.INCONCLUSIVE, "; ".join(missing)
    elif name == "alignment":
        message = f"{frames['judged']} of {run_count_wording(frames['intended'], 'frame')}"
    elif not frames["judged"] or name in one["not_judged"]:
        why = one["not_judged"].get(name) if frames["judged"] else "no frame was judged"
        outcome, message = Outcome.NOT_JUDGED, why
    return Check(f"pins_{name}", statement, outcome, message, found)


def run_capture_figures(captures: Mapping[str, Any]) -> Iterator[tuple[str, str, str]]:
    """Yield the key figures of the captures: what, value, unit."""
    errors = [one["phase_error_deg"] for one in captures["captures"]]
    known = [error for error in errors if error is not None]
    limits = [one["phase_limit_deg"] for one in captures["captures"]]
    if known and not math.isnan(max(known)):
        yield "phase error at the pins that are right, largest", f"{max(known):.2f}", "degrees"
    yield "phase error at a pin that passes", f"{max(limits):.2f}", "degrees"


# --- elements ----------------------------------------------------------------------------------


def run_pin_elements(captures: Mapping[str, Any] | None) -> list[list[str]]:
    """Return a row of the table for each captured element."""
    rows = [] if captures is None else captures["captures"]
    return [
        [_pin_cell(row[name]) for name in PIN_COLUMNS.values()]
        for one in rows
        for row in one["elements_shown"]
    ]


def _pin_cell(value: object) -> str:
    """Return a table cell: a dash for None, a float with 3 digits."""
    if value is None:
        return "–"
    return f"{value:.3f}" if isinstance(value, float) else str(value)


def run_pin_picture(one: Mapping[str, Any]) -> PagePicture:
    """Return the picture of the elements of a capture."""
    return embed_picture(
        draw_pin_elements(one),
        f"The elements at their pins: {one['capture']}.",
        "Mean over the frames that were judged, and standard deviation from frame to frame. "
        "Phases are behind (+) or ahead of (-) the drives that were meant, after the one that all "
        "pins share; amplitudes are over those that were meant.",
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
    """Draw the column *name* of *table*, a value for each element, with the error bars *spread*.

    Values beyond plus or minus *limit* are marked; None: no value is marked.
    """
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
