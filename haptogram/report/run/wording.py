"""A run in words and figures, for people: its frames, its outcome, its evidence and limits."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping
from typing import Any, Final

import numpy as np

from haptogram import verification
from haptogram.acoustics import AcousticModel, NumpyEngine, focus_phases
from haptogram.acoustics.levels.harmonic import finite_amplitude_text
from haptogram.acoustics.model.lattice import find_lattice
from haptogram.verification.frame.criteria import CRITERIA as FRAME_CRITERIA

NOTHING = "–"


def run_figure_wording(value: float | None, digits: int = 3) -> str:
    """Return *value* with *digits* decimals; a dash if there is none."""
    return NOTHING if value is None else f"{value:.{digits}f}"


def run_count_wording(number: int, noun: str) -> str:
    """Return "1 frame", "2 frames"."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def run_frame_wording(frame: verification.FrameVerdict) -> str:
    """Return the verdict on a frame with its number on the wire and its time, in one line."""
    place = f"sequence {frame.key.sequence}, loop {frame.key.loop}, index {frame.key.index}"
    if frame.key.sequence == 0:
        place = f"stream index {frame.key.index}"
    due = "as soon as complete" if frame.t_apply_us is None else f"due at {frame.t_apply_us} µs"
    return f"{frame} ({place}, {due})"


def run_faults_wording(result: Mapping[str, Any]) -> Iterator[str]:
    """Yield the planned faults that fired, the host's own delay, and the damage on the line."""
    if "faults" in result:
        yield f"faults on purpose: {_run_fired_faults_wording(result['faults'])}"
    if (delay := run_host_delay_text(result)) is not None:
        yield f"host: {delay}"
    if (remedy := run_remedy_text(result)) is not None:
        yield f"to do: {remedy}"
    sides = [
        f"the {side} counted " + ", ".join(f"{name} {number}" for name, number in counts.items())
        for side, counts in result["troubles"].items()
    ]
    if sides:
        yield f"line: {'; '.join(sides)} (SPEC.md 9.2)"


def run_host_delay_text(result: Mapping[str, Any]) -> str | None:
    """Return the number of frames that host and machine held up, by cause; None: none."""
    held_up = [
        f for f in result["not_on_target"] if f["status"] == verification.FrameStatus.HELD_UP
    ]
    if not held_up:
        return None
    known = Counter(frame["faults"][0] for frame in held_up)
    causes = "; ".join(f"{run_count_wording(n, 'frame')}: {why}" for why, n in known.items())
    host = result.get("host")
    loop = f", its loop by up to {host['tick_lateness_us_max'] / 1e3:.0f} ms" if host else ""
    return f"this machine, not the board, was held up{loop} ({causes})"


def run_remedy_text(result: Mapping[str, Any]) -> str | None:
    """Return the remedy for a run that a busy machine left inconclusive, or None."""
    if result["verdict"] != str(verification.Verdict.INCONCLUSIVE) or "faults" in result:
        return None
    is_virtual = result["configuration"].get("port", "") is None
    if run_host_delay_text(result) is None or "host" not in result:
        return None
    text = (
        "run it again while this machine has less to do, with a longer --lead-ms or at a lower "
        "--rate-hz"
    )
    return f"{text}; with --virtual-time its load does not count" if is_virtual else text


def _run_fired_faults_wording(faults: Mapping[str, Any]) -> str:
    """Return how often each injected fault fired, as text; or that the board did not tell."""
    if faults["fired"] is None:
        return f"{', '.join(faults['plan'])}; the board did not report how often each fired"
    times = (
        f"{name} {run_count_wording(number, 'time')}" for name, number in faults["fired"].items()
    )
    return f"{', '.join(times)}; seed {faults['seed']}"


CRITERIA: Final = (
    *(f"{name}: {of_one}." for name, (of_one, _) in FRAME_CRITERIA.items()),
    "Several foci in a frame: each against what the ideal drive for these foci makes of it. "
    + "; ".join(f"{name}: {each}" for name, (_, each) in FRAME_CRITERIA.items() if each)
    + ".",
)

_SIZED: Final = ("hemisphere", "sphere", "circle", "line")  # shapes that have a radius


def run_tested_rows(result: Mapping[str, Any], model: AcousticModel) -> Iterator[tuple[str, str]]:
    """Yield name and text of what was tested: object, rate, array, mode, link and evidence."""
    asked, frames = result["configuration"], result["frames"]["sent"]
    is_live = asked.get("from_recording") is None  # else these are not the options of the run
    if is_live and "object" in asked:
        yield "object", _run_object_text(asked)
        rate = f" at {asked['rate_hz']:g} Hz" if "rate_hz" in asked else ""
        yield "frames", f"{frames}{rate}, {asked.get('mode')}"
    yield "array", _run_array_text(model, asked.get("array"))
    if "is" in result["board"]:
        line = f", {asked['baud']} Bd" if is_live and "baud" in asked else ""
        yield "link", f"{result['board']['is']}{line}"
    kinds = result["evidence"]
    yield "evidence", (kinds if isinstance(kinds, str) else ", ".join(kinds)) or "none"


def _run_object_text(asked: Mapping[str, Any]) -> str:
    """Return shape, size, place (mm) and modulation of the object that a run displayed."""
    name, center = asked["object"], ", ".join(f"{value:g}" for value in asked["center_mm"])
    size = f" of {asked['radius_mm']:g} mm" if name in _SIZED and "radius_mm" in asked else ""
    text = f"{name}{size} at {center} mm"
    if asked.get("modulation"):
        text += f", {asked['modulation']} at {asked['modulation_hz']:g} Hz"
    return text + (f", {asked['foci']} foci a frame" if asked.get("foci", 1) > 1 else "")


def _run_array_text(model: AcousticModel, file: str | None) -> str:
    """Return the number of transducers, rows and columns of a grid, and the *file* if any."""
    count, lattice = model.array.count, find_lattice(model.array)
    text = f"{count} transducers"
    if lattice is not None and lattice.elements.size == count:
        text += ", " + " × ".join(map(str, lattice.elements.shape))
    return text + (f", {file}" if file and "." in file else "")


def run_summary_sentences(result: Mapping[str, Any]) -> Iterator[str]:
    """Yield the outcome of the run, sentence by sentence, without full stops."""
    frames = result["frames"]
    if "captures" in result:
        yield from run_capture_sentences(result["captures"])
    if not result.get("run_judged", True):
        return
    yield (
        f"{run_count_wording(frames['sent'], 'frame')} sent, {frames['latched']} latched, "
        f"{frames['verified']} verified, {frames['on_target']} of them on target"
        f"{verification.cut_run_verdict_text(frames)}"
    )
    lateral, axial = result["lateral_error_mm"]["max"], result["axial_error_mm"]["max"]
    if lateral is not None:
        along = "" if axial is None else f" and {axial:.3f} mm along the beam"
        yield f"the largest distance from a target was {lateral:.3f} mm across{along}"
    if result["smallest_miss_mm"] is not None:
        yield (
            f"every miss from {result['smallest_miss_mm']:.2f} mm on shows; rounding of the phases"
            f"{_run_tolerance_sentence_end(result)} can make a shorter one"
        )
    yield from filter(None, (run_host_delay_text(result), run_remedy_text(result)))
    if frames["lost"] or frames["held_up"] or frames["late"]:
        yield (
            f"{frames['lost']} lost by the board, {frames['held_up']} held up by this machine and "
            f"{frames['late']} late; each is named below"
        )


def _run_tolerance_sentence_end(result: Mapping[str, Any]) -> str:
    """Return " and a tolerance of ..." to end a sentence; '' without one."""
    stated = verification.tolerance_text(verification.Tolerance(**result["tolerance"]))
    return "" if stated == "none" else f" and a tolerance of {stated}"


def run_capture_sentences(captures: Mapping[str, Any]) -> Iterator[str]:
    """Yield the verdict of the captures, sentence by sentence."""
    from haptogram.verification.pins.pin_verdict import captured_elements_text

    seen, count = len(captures["elements"]), captures["elements_of_array"]
    yield (
        f"the drive pins of {captured_elements_text(seen, count)} were captured"
        + (f"; nothing is known of the other {count - seen}" if seen < count else "")
    )
    for one in captures["captures"]:
        frames = one["frames"]
        yield (
            f"by {one['capture']}, {frames['judged']} of "
            f"{run_count_wording(frames['intended'], 'frame')} "
            f"were judged; {one['sample_rate_hz'] / 1e6:g} Msamples/s show no phase error below "
            f"{one['smallest_phase_error_deg']:.2f} degrees; carrier {one['carrier_hz']:.2f} Hz "
            f"({one['carrier_drift_ppm']:+z.1f} ppm on the analyser's clock)"
        )
    if captures["no_field"]:
        yield f"by the pins alone there is no field and no focus: {captures['no_field']}"


def run_limits_sentences(result: Mapping[str, Any]) -> Iterator[str]:
    """Yield the limits of this run; the template of the page has those of every run."""
    frames = result["frames"]
    due = frames["sent"] - frames["cancelled"]
    unseen = due - frames["verified"]
    if unseen:
        yield f"{run_count_wording(unseen, 'frame')} of {due} could not be verified at all."
    if result["cut_short"] is not None:
        yield f"What would have come later: the run was {result['cut_short']}."
    if result["smallest_miss_mm"] is not None:
        yield (
            f"By its place alone, a miss below {result['smallest_miss_mm']:.2f} mm cannot be "
            "told from what rounding of the phases makes; phases that are off by more fail."
        )
    if result["axial_error_mm"]["max"] is None and result["lateral_error_mm"]["max"] is not None:
        yield "The error along the beam: this array cannot observe it."


def run_finite_amplitude(run: verification.RunVerdict, model: AcousticModel) -> Iterator[str]:
    """Yield the limits of the linear field, at the focus that strains it most."""
    heard = [frame for frame in run.frames if frame.pressure_rms_pa is not None]
    if not heard:
        return

    def reach(frame: verification.FrameVerdict) -> float:
        return (frame.pressure_rms_pa or 0.0) * math.dist(frame.target_m, model.array.centre_m)

    frame, engine = max(heard, key=reach), NumpyEngine(model)
    ideal = np.exp(1j * focus_phases(model, frame.target_m))
    full_pa = float(np.abs(engine.pressure(ideal, [frame.target_m])[0])) / math.sqrt(2.0)
    weights = ideal * (frame.pressure_rms_pa or 0.0) / full_pa
    text = finite_amplitude_text(engine, weights, frame.target_m)
    if text is not None:
        yield f"Frame {frame.number}, {text}."
