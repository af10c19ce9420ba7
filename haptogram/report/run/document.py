"""One run of verification as a document: checks, key figures, and what its page shows."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import Any, Final

from haptogram.acoustics import AcousticModel
from haptogram.records.frame import Observation
from haptogram.settings.text_file import flat_document
from haptogram.verification import RunVerdict

from ..formats import document
from ..formats.html import html_setting_rows
from ..viewer.frames import judged_viewer_frame
from ..viewer.scene import ViewerScene
from . import pins, wording
from .checks import run_checks_of_result
from .frame_rows import run_frame_table
from .wording import NOTHING, run_figure_wording

_LEVELS: Final = {
    document.Outcome.FAILED: document.Level.ERROR,
    document.Outcome.INCONCLUSIVE: document.Level.ERROR,
    document.Outcome.NOTED: document.Level.WARNING,
}
#: Text, quantity and figure in the result, decimals, unit.
_KEY_FIGURES: Final = (
    ("error across the beam, median", "lateral_error_mm", "p50", 4, "mm"),
    ("error across the beam, 99th percentile", "lateral_error_mm", "p99", 4, "mm"),
    ("error across the beam, largest", "lateral_error_mm", "max", 4, "mm"),
    ("error along the beam, median", "axial_error_mm", "p50", 4, "mm"),
    ("error along the beam, 99th percentile", "axial_error_mm", "p99", 4, "mm"),
    ("error along the beam, largest", "axial_error_mm", "max", 4, "mm"),
    ("every miss shows from", "smallest_miss_mm", None, 3, "mm"),
    ("uncertainty of the place, from air and elements", "uncertainty_mm", "total", 3, "mm"),
    ("coherence at the target, lowest", "coherence", "min", 5, ""),
    ("weakest of several foci, of their mean, lowest", "balance", "min", 2, ""),
    ("efficiency of several foci, lowest", "efficiency", "min", 2, ""),
    ("pressure at the focus, mean", "pressure_rms_pa", "mean", 0, "Pa RMS"),
    ("pressure at the focus, standard deviation", "pressure_rms_pa", "std", 0, "Pa RMS"),
    ("force on a disc of 10 mm radius, mean", "force_mn", "mean", 2, "mN"),
    ("force, standard deviation", "force_mn", "std", 2, "mN"),
    ("latched after its time, median", "lateness_us", "p50", 0, "µs"),
    ("latched after its time, 99.9th percentile", "lateness_us", "p99.9", 0, "µs"),
    ("latched after its time, largest", "lateness_us", "max", 0, "µs"),
)


def run_document(
    run: RunVerdict,
    result: Mapping[str, Any],
    model: AcousticModel,
    *,
    observations: Mapping[int, Observation] | None = None,
    seconds: float | None = None,
) -> document.Document:
    """Return the judged *run* as a document.

    Parameters
    ----------
    result : mapping
        The same as :func:`run_result_dict` returns it.
    model : AcousticModel
        Array and air that the drives were radiated in.
    observations : mapping of int to Observation, optional
        Latches whose drive was observed, by frame number, for the view.
    seconds : float or None
        How long the run took: the time of the check that it came to its end.
    """
    checks = run_checks_of_result(run, result, seconds)
    effect = [] if run.effect is None else [f"the focus was {run.effect}"]
    return document.Document(
        command="verify",
        heading=pins.run_result_sentence(run, result),
        title=f"{result['verdict']}, {result['frames']['sent']} frames",
        tone=document.TONES[result["verdict"]],
        findings=list(_run_findings(checks)),
        lead=[*wording.run_summary_sentences(result), *effect],
        sections=list(_run_sections(result)),
        checks=checks,
        properties=_run_properties(result),
        seconds=seconds,
        template="run.html",
        content=lambda: _run_page_content(run, result, model, observations or {}),
    )


def _run_findings(checks: Sequence[document.Check]) -> Iterator[document.Finding]:
    """Yield a finding for each check that failed, is inconclusive or noted; decisive ones first."""
    for check in sorted(checks, key=lambda check: not check.decisive):
        if (level := _LEVELS.get(check.outcome)) is not None:
            found = "; ".join([check.message, *check.details[:1]])
            yield document.Finding(level, f"{check.name}: {check.outcome}", found)


def _run_sections(result: Mapping[str, Any]) -> Iterator[document.Section]:
    """Yield the sections of a run: key figures; if any, faults, damage, pins and warnings."""
    head = ("figure", "value", "unit")
    yield document.Section(
        "Key figures", [document.Table(head, list(_run_key_figures(result)), (1,))], folds=True
    )
    if "faults" in result:
        faults, counts = result["faults"], result["faults"]["fired"]
        named = [(plan, plan.split()[0]) for plan in faults["plan"]]
        rows = [(plan, str((counts or {}).get(name, NOTHING))) for plan, name in named]
        note = (
            f"The seed is {faults['seed']}. The number counts all faults of a name together, as "
            f"docs/faults.md says{'; the board did not report it' if counts is None else ''}."
        )
        table = document.Table(("fault", "fired"), rows, (1,))
        yield document.Section("Faults on purpose", [table, document.Listing([note])], folds=True)
    if sides := result["troubles"]:
        names = sorted({name for counts in sides.values() for name in counts})
        counted = [
            (name, *(str(sides.get(side, {}).get(name, 0)) for side in ("board", "host")))
            for name in names
        ]
        table = document.Table(("counter (SPEC.md 9.2)", "board", "host"), counted, (1, 2))
        yield document.Section("Damage on the line", [table], folds=True)
    if elements := pins.run_pin_elements(result.get("captures")):
        table = document.Table(tuple(pins.PIN_COLUMNS), elements, (0, 2, 3, 4, 5, 6))
        drawn = [one for one in result["captures"]["captures"] if one["elements_shown"]]
        pictures = [document.Picture(partial(pins.run_pin_picture, one)) for one in drawn]
        yield document.Section("Elements at their pins", [table, *pictures], folds=True)
    if result["warnings"]:
        yield document.Section("Warnings", [document.Listing(result["warnings"])])


def _run_key_figures(result: Mapping[str, Any]) -> Iterator[tuple[str, str, str]]:
    """Yield text, value and unit of each key figure that is known."""
    if "captures" in result:
        yield from pins.run_capture_figures(result["captures"])
    for text, name, figure, digits, unit in _KEY_FIGURES:
        value = result[name] if figure is None or result[name] is None else result[name][figure]
        if value is not None:
            yield text, run_figure_wording(value, digits), unit


def _run_properties(result: Mapping[str, Any]) -> dict[str, str]:
    """Return verdict, seed, settings, board and environment of the run as texts, by dotted names.

    Values that are None or [] are left out.
    """
    names = ("verdict", "evidence", "seed", "frames", "faults", "configuration", "board")
    named = {name: result[name] for name in names if name in result}
    return {
        name: value if isinstance(value, str) else json.dumps(value)
        for name, value in flat_document(named | {"environment": result.get("environment", {})})
        if value is not None and value != []
    }


def _run_page_content(
    run: RunVerdict,
    result: Mapping[str, Any],
    model: AcousticModel,
    seen: Mapping[int, Observation],
) -> dict[str, Any]:
    """Return what a run's HTML page shows and its other forms do not: view, frames, settings."""
    circumstances = {
        "Configuration": {**result["configuration"], "seed": result["seed"]},
        "Board": result["board"],
        "Host": result.get("host") or {},
        "Environment": result.get("environment") or {},
    }
    kinds = result["evidence"]
    return {
        "tested": list(wording.run_tested_rows(result, model)),
        "scene": run_viewer_scene(run, model, seen).embedded() if run.frames else None,
        "frames": run_frame_table(run),
        "judged": any(frame.criteria for frame in run.frames),
        "criteria": wording.CRITERIA,
        "evidence": [kinds] if isinstance(kinds, str) else kinds,
        "limits": list(wording.run_limits_sentences(result)),
        "strained": list(wording.run_finite_amplitude(run, model)),
        "circumstances": {n: html_setting_rows(values) for n, values in circumstances.items()},
    }


def run_viewer_scene(
    run: RunVerdict, model: AcousticModel, seen: Mapping[int, Observation]
) -> ViewerScene:
    """Return the scene of *run*, with the drives that were *seen*, by frame number."""
    frames = [
        judged_viewer_frame(partial(getattr, frame), str(frame)).observed(seen.get(frame.number))
        for frame in run.frames
    ]
    counters = {name.replace("_", " "): count for name, count in run.counts.items() if count}
    return ViewerScene.of(model, frames, counters=counters)
