"""The page of one verification run."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

from haptogram.acoustics import AcousticModel
from haptogram.machine.provenance import UNSTATED, Provenance
from haptogram.records.frame import Observation
from haptogram.verification import (
    RunVerdict,
    Verdict,
)

from ..figures.embedded import embed_picture
from ..formats.document import PagePicture
from ..formats.html import check_html_page, html_setting_rows, write_html_page
from ..viewer.run_scene import viewer_scene_of_run
from . import pictures, prose
from .check import CheckOutcome
from .checks import run_checks_of_result
from .fieldmap import RunFieldPicture, frame_field_picture, run_finite_amplitude
from .frame_rows import run_frame_place_text, run_frame_table
from .pins import (
    PIN_COLUMNS,
    run_capture_figures,
    run_pin_elements,
    run_pin_pictures,
    run_result_sentence,
)
from .wording import NOTHING, run_figure_wording

_BITS: Final = 8
_TONES: Final = {Verdict.PASS: "good", Verdict.FAIL: "bad", Verdict.INCONCLUSIVE: "doubt"}
_CHECK_TONES: Final = {
    CheckOutcome.PASSED: "good",
    CheckOutcome.FAILED: "bad",
    CheckOutcome.INCONCLUSIVE: "doubt",
    CheckOutcome.NOT_JUDGED: "plain",
    CheckOutcome.NOTED: "note",
}


def write_run_page(
    path: Path,
    run: RunVerdict,
    result: Mapping[str, Any],
    model: AcousticModel,
    *,
    observations: Mapping[int, Observation] | None = None,
    provenance: Provenance = UNSTATED,
) -> None:
    """Write the result as a page with pictures.

    Parameters
    ----------
    run : RunVerdict
        The judged run.
    result : mapping
        The same as :func:`result_dict` returns it.
    model : AcousticModel
        Array and air that the drives were radiated in.
    observations : mapping of int to Observation, optional
        Latches whose drive was observed, by frame number, for the view and the picture of the
        field.
    provenance : Provenance, optional
        Origin of the result.

    Raises
    ------
    ConfigurationError
        If the extra ``report`` is not installed, or *path* cannot be written.
    """
    check_html_page()
    effect = [] if run.effect is None else [f"The focus was {run.effect}."]
    seen, captures = observations or {}, result.get("captures")
    drives = {number: one.output for number, one in seen.items() if one.output is not None}
    shown = frame_field_picture(run, model, drives, _BITS)
    write_html_page(
        path,
        "run.html",
        provenance,
        title=f"Haptogram: {result['verdict']}, {result['frames']['sent']} frames",
        heading=run_result_sentence(run, result),
        tone=_TONES[Verdict(result["verdict"])],
        lead=[*prose.run_summary_sentences(result), *effect],
        tested=list(prose.run_tested_rows(result, model)),
        key_figures=_run_key_figures(result),
        faults=_run_fault_rows(result["faults"]) if "faults" in result else None,
        troubles=_run_trouble_rows(result["troubles"]),
        scene=viewer_scene_of_run(run, model, seen).embedded() if run.frames else None,
        checks=run_checks_of_result(run, result),
        tones=_CHECK_TONES,
        focus=list(_run_focus_pictures(shown, model, result["board"].get("phase_steps"))),
        pictures=[*run_pin_pictures(captures), *_run_page_pictures(run, model)],
        pins={"head": tuple(PIN_COLUMNS), "rows": run_pin_elements(captures)},
        frames=run_frame_table(run),
        judged=any(frame.criteria for frame in run.frames),
        criteria=prose.CRITERIA,
        evidence=list(prose.run_evidence_sentences(result)),
        limits=[*prose.run_limits_sentences(result), *run_finite_amplitude(run, model)],
        warnings=result["warnings"],
        circumstances=_run_circumstances(result),
    )


# --- Tables ------------------------------------------------------------------------------------


def _run_key_figures(result: Mapping[str, Any]) -> list[tuple[str, str, str]]:
    lateral, axial = result["lateral_error_mm"], result["axial_error_mm"]
    late, pressure, force = result["lateness_us"], result["pressure_rms_pa"], result["force_mn"]
    captures = result.get("captures")
    rows = [
        *(() if captures is None else run_capture_figures(captures)),
        ("error across the beam, median", run_figure_wording(lateral["p50"], 4), "mm"),
        ("error across the beam, 99th percentile", run_figure_wording(lateral["p99"], 4), "mm"),
        ("error across the beam, largest", run_figure_wording(lateral["max"], 4), "mm"),
        ("error along the beam, median", run_figure_wording(axial["p50"], 4), "mm"),
        ("error along the beam, 99th percentile", run_figure_wording(axial["p99"], 4), "mm"),
        ("error along the beam, largest", run_figure_wording(axial["max"], 4), "mm"),
        ("every miss shows from", run_figure_wording(result["smallest_miss_mm"]), "mm"),
        (
            "uncertainty of the place, from air and elements",
            run_figure_wording(_run_total_row(result)),
            "mm",
        ),
        ("coherence at the target, lowest", run_figure_wording(result["coherence"]["min"], 5), ""),
        (
            "weakest of several foci, of their mean, lowest",
            run_figure_wording(result["balance"]["min"], 2),
            "",
        ),
        (
            "efficiency of several foci, lowest",
            run_figure_wording(result["efficiency"]["min"], 2),
            "",
        ),
        ("pressure at the focus, mean", run_figure_wording(pressure["mean"], 0), "Pa RMS"),
        (
            "pressure at the focus, standard deviation",
            run_figure_wording(pressure["std"], 0),
            "Pa RMS",
        ),
        ("force on a disc of 10 mm radius, mean", run_figure_wording(force["mean"], 2), "mN"),
        ("force, standard deviation", run_figure_wording(force["std"], 2), "mN"),
        ("latched after its time, median", run_figure_wording(late["p50"], 0), "µs"),
        ("latched after its time, 99.9th percentile", run_figure_wording(late["p99.9"], 0), "µs"),
        ("latched after its time, largest", run_figure_wording(late["max"], 0), "µs"),
    ]
    return [row for row in rows if row[1] != NOTHING]


def _run_total_row(result: Mapping[str, Any]) -> float | None:
    return None if result["uncertainty_mm"] is None else result["uncertainty_mm"]["total"]


def _run_fault_rows(faults: Mapping[str, Any]) -> dict[str, Any]:
    """Return the planned faults, and how often those of each name fired."""
    fired = faults["fired"] or {}
    rows = [(plan, fired.get(plan.split()[0], NOTHING)) for plan in faults["plan"]]
    return {"rows": rows, "seed": faults["seed"], "counted": faults["fired"] is not None}


def _run_trouble_rows(troubles: Mapping[str, Mapping[str, int]]) -> list[tuple[str, int, int]]:
    """Return the counters of frames that were damaged, lost or out of time, on each side."""
    board, host = troubles.get("board", {}), troubles.get("host", {})
    return [(name, board.get(name, 0), host.get(name, 0)) for name in sorted({*board, *host})]


def _run_circumstances(result: Mapping[str, Any]) -> dict[str, list[tuple[str, str]]]:
    parts = {
        "Configuration": {**result["configuration"], "seed": result["seed"]},
        "Board": result["board"],
        "Host": result.get("host") or {},
        "Environment": result.get("environment") or {},
    }
    return {title: html_setting_rows(values) for title, values in parts.items()}


# --- Pictures ----------------------------------------------------------------------------------


def _run_focus_pictures(
    shown: RunFieldPicture | None, model: AcousticModel, steps: int | None
) -> Iterator[PagePicture]:
    """Yield the field of one frame, and its close-up; nothing if no frame was sent."""
    if shown is None:
        return
    yield embed_picture(
        pictures.draw_run_field(shown, model, close=False),
        "Pressure around one focus.",
        f"Frame {shown.frame.number}, target {run_frame_place_text(shown.frame)} mm: level and "
        "vertical plane through the target.",
    )
    yield embed_picture(
        pictures.draw_run_field(shown, model, close=True),
        "Close-ups of the white frames.",
        _run_field_caption(shown, steps),
    )


def _run_page_pictures(run: RunVerdict, model: AcousticModel) -> Iterator[PagePicture]:
    yield embed_picture(
        pictures.draw_run_foci(run, model),
        "Intended and measured foci over the array.",
        "The colour is the error of a focus over the largest one that the rounding of the phases "
        "can make, on the axis where that is worst; beyond 1 it is off target.",
    )
    measured = any(frame.lateral_error_mm is not None for frame in run.frames)
    if measured:
        yield from _pictures_of_errors(run, model)
    if any(frame.pressure_rms_pa is not None for frame in run.frames):
        yield embed_picture(
            pictures.draw_run_along_object(run),
            "Pressure and force along the object.",
            "Left in the order of display, right as seen from above the array.",
        )
    if len(run.values("lateness_us")):
        yield embed_picture(
            pictures.draw_run_lateness(run, model),
            "How long after its time each frame was latched.",
            "On the board's clock. A frame latches at the first carrier period after its time; "
            "from one whole period on it is late.",
        )


def _pictures_of_errors(run: RunVerdict, model: AcousticModel) -> Iterator[PagePicture]:
    yield embed_picture(
        pictures.draw_run_misses(run, model),
        "The misses over time and over the object.",
        "Left, on the board's clock from the first frame on: the distance of each focus from its "
        "target, and the largest one that the rounding of the phases can make. Right: as seen from "
        "above the array.",
    )
    yield embed_picture(
        pictures.draw_run_errors(run, model),
        "How the errors are distributed.",
        "Grey: from the smallest to the largest error that the rounding of the phases can make, "
        "which differs from target to target. Smaller errors than 10 nm are drawn as 10 nm.",
    )


def _run_field_caption(shown: RunFieldPicture, steps: int | None) -> str:
    """Return the origin of a field; *steps* are those of boards whose steps are no bits."""
    of_board = f"{steps} steps a period" if steps else f"{shown.phase_bits} bits"
    source = (
        "the drive that was latched, or seen to be radiated in its place, with phases of "
        f"{of_board}"
        if shown.latched
        else f"the ideal drive of its target, at full amplitude with phases of {shown.phase_bits} "
        "bits, and not what was latched"
    )
    return (
        f"Calculated from {source}. Diffraction shifts the peak off the focus, mostly towards the "
        "array."
    )
