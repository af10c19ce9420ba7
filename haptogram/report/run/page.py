"""The result as one HTML file that needs nothing else: no script, no font, no picture beside it."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

from haptogram.acoustics import AcousticModel, Drive
from haptogram.machine.files import write_atomically
from haptogram.verification import FrameStatus, FrameVerdict, RunVerdict, consequence_text

from ..markup import Html, element, listing, picture, section, table, text
from ..style import CSS
from . import pictures, prose
from .checks import NAMED_FRAMES, Check, Outcome, checks
from .fieldmap import FieldPicture, picture_field
from .series import relative_error, worst
from .wording import NOTHING, figure, timeliness

HOW_TO_GET_PICTURES: Final = "pip install 'haptogram[report]'"

_WORST: Final = 10
_BITS: Final = 8
_DECISIVE: Final = (Outcome.FAILED, Outcome.INCONCLUSIVE)


def write_html(
    path: Path,
    run: RunVerdict,
    result: Mapping[str, Any],
    model: AcousticModel,
    *,
    drives: Mapping[int, Drive] | None = None,
) -> None:
    """Write the result as a page for people, with pictures where matplotlib is installed.

    Parameters
    ----------
    run : RunVerdict
        What was found.
    result : mapping
        What :func:`result_dict` made of it.
    model : AcousticModel
        Array and air that the drives were radiated in.
    drives : mapping of int to Drive, optional
        Drives that were latched, or radiated in their place, by frame number, for the picture of
        the field.

    Raises
    ------
    ConfigurationError
        If *path* cannot be written.
    """
    page = "".join(_document(run, result, model, drives))
    # A port may be named by bytes that are no text; they become question marks.
    write_atomically(path, page.encode("utf-8", errors="replace"))


def _document(
    run: RunVerdict,
    result: Mapping[str, Any],
    model: AcousticModel,
    drives: Mapping[int, Drive] | None,
) -> Iterator[str]:
    title = f"Haptogram: {run.verdict}, {result['frames']['sent']} frames"
    yield '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
    yield '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
    yield f"<title>{text(title)}</title>\n<style>{CSS}</style>\n</head>\n<body>\n"
    yield _banner(run, result)
    yield section("Key figures", _key_figures(result))
    if "faults" in result:
        yield section("Faults on purpose", *_faults(result["faults"]))
    if result["troubles"]:
        yield section("Damage on the line", *_troubles(result["troubles"]))
    yield section("Checks", *_checks(checks(run, result["cut_short"])))
    yield section("Pictures", *_pictures(run, result, model, drives))
    yield section("Frames with the largest errors", *_worst_frames(run))
    yield section("Lost and late frames", _missing_frames(run))
    yield section("Evidence", listing(prose.evidence(result)))
    yield section("What this does not show", listing(prose.limits(result)))
    if result["warnings"]:
        yield section("Warnings", listing(result["warnings"]))
    yield from _circumstances(result)
    yield "</body>\n</html>\n"


def _banner(run: RunVerdict, result: Mapping[str, Any]) -> Html:
    effect = [] if run.effect is None else [f"The focus was {run.effect}."]
    lines = (element("p", line) for line in [*prose.summary(result), *effect])
    headline = element("h1", prose.HEADLINES[run.verdict])
    return Html(element("header", headline, *lines, class_=f"verdict {run.verdict}") + "\n")


# --- Tables ------------------------------------------------------------------------------------


def _key_figures(result: Mapping[str, Any]) -> Html:
    lateral, axial = result["lateral_error_mm"], result["axial_error_mm"]
    late, pressure, force = result["lateness_us"], result["pressure_rms_pa"], result["force_mn"]
    rows = [
        ("error across the beam, median", figure(lateral["p50"], 4), "mm"),
        ("error across the beam, 99th percentile", figure(lateral["p99"], 4), "mm"),
        ("error across the beam, largest", figure(lateral["max"], 4), "mm"),
        ("error along the beam, median", figure(axial["p50"], 4), "mm"),
        ("error along the beam, 99th percentile", figure(axial["p99"], 4), "mm"),
        ("error along the beam, largest", figure(axial["max"], 4), "mm"),
        ("smallest miss that shows", figure(result["smallest_miss_mm"]), "mm"),
        ("uncertainty of the place, from air and elements", figure(_total(result)), "mm"),
        ("coherence at the target, lowest", figure(result["coherence"]["min"], 5), ""),
        ("weakest of several foci, of their mean, lowest", figure(result["balance"]["min"], 2), ""),
        ("efficiency of several foci, lowest", figure(result["efficiency"]["min"], 2), ""),
        ("pressure at the focus, mean", figure(pressure["mean"], 0), "Pa RMS"),
        ("pressure at the focus, standard deviation", figure(pressure["std"], 0), "Pa RMS"),
        ("force on a disc of 10 mm radius, mean", figure(force["mean"], 2), "mN"),
        ("force, standard deviation", figure(force["std"], 2), "mN"),
        ("latched after its time, median", figure(late["p50"], 0), "µs"),
        ("latched after its time, 99.9th percentile", figure(late["p99.9"], 0), "µs"),
        ("latched after its time, largest", figure(late["max"], 0), "µs"),
    ]
    return table(("figure", "value", "unit"), rows, numbers=1)


def _total(result: Mapping[str, Any]) -> float | None:
    return None if result["uncertainty_mm"] is None else result["uncertainty_mm"]["total"]


def _faults(faults: Mapping[str, Any]) -> Iterator[Html]:
    """Yield what was to go wrong, and how often it did."""
    fired = faults["fired"] or {}
    rows = [(element("code", told), fired.get(told.split()[0], NOTHING)) for told in faults["plan"]]
    yield table(("fault", "fired"), rows, numbers=1)
    yield element(
        "p",
        f"With the seed {faults['seed']}. Counted is what docs/faults.md says, for all faults of a "
        "name together; a dash: the board did not tell.",
    )


def _troubles(troubles: Mapping[str, Mapping[str, int]]) -> Iterator[Html]:
    """Yield what each side counted of frames that were damaged, lost or out of time."""
    names = sorted(set().union(*troubles.values()))
    sides = ("board", "host")
    rows = [(name, *(troubles.get(side, {}).get(name, 0) for side in sides)) for name in names]
    yield table(("counter (SPEC.md 9.2)", *sides), rows, numbers=2)


def _checks(answers: list[Check]) -> Iterator[Html]:
    """Yield every check, and the frames that those concern which decided the verdict."""
    rows = [
        (
            check.statement,
            element("b", check.outcome) if check.outcome in _DECISIVE else check.outcome,
            check.message,
        )
        for check in answers
    ]
    yield table(("check", "outcome", "found"), rows)
    for check in answers:
        if check.outcome in _DECISIVE and check.details:
            yield element("h3", f"{check.statement}: {check.outcome}")
            yield listing(check.details)


def _worst_frames(run: RunVerdict) -> Iterator[Html]:
    frames = worst(run, _WORST)
    if not frames:
        yield element("p", "No frame could be judged.")
        return
    head = ("frame", "target x, y, z (mm)", "across (mm)", "along (mm)", "error / bound")
    rows = [
        (
            frame.number,
            _place(frame),
            figure(frame.lateral_error_mm, 4),
            figure(frame.axial_error_mm, 4),
            figure(relative_error(frame)),
            str(frame.status),
            "; ".join([*frame.faults, *_failed(frame)]) or NOTHING,
        )
        for frame in frames
    ]
    yield table((*head, "status", "what is wrong"), rows, numbers=4)
    yield element("p", "A frame is on target if it meets all of these, as far as they apply:")
    yield listing(prose.CRITERIA)


def _failed(frame: FrameVerdict) -> list[str]:
    failed = [name for name, passed in frame.criteria.items() if not passed]
    return [f"{', '.join(failed)} failed"] if failed else []


def _missing_frames(run: RunVerdict) -> Html:
    odd = [frame for frame in run.frames if frame.status is FrameStatus.LOST or frame.late]
    if not odd:
        return element("p", "None.")
    rows = [
        (
            frame.number,
            _place(frame),
            NOTHING if frame.t_apply_us is None else frame.t_apply_us,
            timeliness(frame) if frame.late else str(frame.status),
            NOTHING if frame.consequence is None else consequence_text(frame.consequence),
        )
        for frame in odd[: 5 * NAMED_FRAMES]
    ]
    head = ("frame", "target x, y, z (mm)", "due (µs, board's clock)", "", "consequence")
    more = len(odd) - len(rows)
    tail = element("p", f"... and {more} more, in the JSON file.") if more else Html()
    return Html(table(head, rows, numbers=2) + tail)


def _place(frame: FrameVerdict) -> str:
    return ", ".join(f"{1e3 * value:.1f}" for value in frame.target_m)


def _circumstances(result: Mapping[str, Any]) -> Iterator[Html]:
    parts = {
        "Configuration": {**result["configuration"], "seed": result["seed"]},
        "Board": result["board"],
        "Host": result.get("host"),
        "Environment": result.get("environment"),
    }
    for title, values in parts.items():
        if values:
            rows = [(name, element("code", _setting(value))) for name, value in values.items()]
            yield section(title, table((), rows))


def _setting(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)


# --- Pictures ----------------------------------------------------------------------------------


def _pictures(
    run: RunVerdict,
    result: Mapping[str, Any],
    model: AcousticModel,
    drives: Mapping[int, Drive] | None,
) -> list[Html]:
    bits = result["configuration"].get("phase_bits", _BITS)
    try:
        return list(_drawn(run, model, picture_field(run, model, drives, bits)))
    except ImportError as error:
        reason = f"No pictures, because they could not be drawn ({error}). To get them: "
        return [element("p", reason, element("code", HOW_TO_GET_PICTURES))]


def _drawn(run: RunVerdict, model: AcousticModel, shown: FieldPicture | None) -> Iterator[Html]:
    yield picture(
        pictures.foci(run, model),
        "Intended and measured foci over the array.",
        "The colour is the error of a focus over the largest one that the rounding of the phases "
        "can make, on the axis where that is worst; beyond 1 it is off target.",
    )
    yield picture(
        pictures.errors(run, model),
        "How the errors are distributed.",
        "Grey: from the smallest to the largest error that the rounding of the phases can make, "
        "which differs from target to target. Smaller errors than 10 nm are drawn as 10 nm.",
    )
    yield picture(pictures.field(shown, model), "Pressure around one focus.", _field_caption(shown))
    yield picture(
        pictures.along_object(run),
        "Pressure and force along the object.",
        "Left in the order of display, right as seen from above the array.",
    )
    yield picture(
        pictures.lateness(run, model),
        "How long after its time each frame was latched.",
        "On the board's clock. A frame latches at the first carrier period after its time; from "
        "one whole period on it is late.",
    )


def _field_caption(shown: FieldPicture | None) -> str:
    if shown is None:
        return "There is none: no frame was sent."
    source = (
        "the drive that was latched, or seen to be radiated in its place, with phases of "
        f"{shown.phase_bits} bits"
        if shown.latched
        else f"the ideal drive of its target, at full amplitude with phases of {shown.phase_bits} "
        "bits, and not what was latched"
    )
    return (
        f"Frame {shown.frame.number}, target {_place(shown.frame)} mm. Above: the plane z = target "
        "and the vertical plane through the target; below: close-ups of the white frames. "
        f"Calculated from {source}. The peak need not sit on the focus: diffraction shifts it, "
        "mostly towards the array."
    )
