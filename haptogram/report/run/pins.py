"""The verdict by captures of drive pins: its checks, sentences, elements, place in the result."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any, Final

from haptogram.verification import RunVerdict, Verdict
from haptogram.verification.pins.joined import JoinedCaptureVerdict
from haptogram.verification.pins.pin_verdict import PIN_CHECKS

from ..formats.document import Check, Outcome
from .wording import run_count_wording

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
    shown = [one["levels"]["level_db"] for one in captures["captures"] if one["levels"]]
    levels = [level for some in shown for level in some if level is not None]
    if levels:
        yield "level of the pins in time, lowest", f"{min(levels):.1f}", "dB"
        yield "level of the pins in time, highest", f"{max(levels):.1f}", "dB"


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
    if value is None:
        return "–"
    return f"{value:.3f}" if isinstance(value, float) else str(value)
