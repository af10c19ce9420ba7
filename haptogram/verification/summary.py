"""What a run came to, in a few lines that fit a screen."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final

from .tolerance import tolerance_text
from .verdict import NOTHING_WRONG, WRONG, Consequence, FrameStatus, FrameVerdict

if TYPE_CHECKING:
    from .run import RunVerdict

_NAMED_FRAMES: Final = 8  # the JSON names all


def summary(run: RunVerdict) -> Iterator[str]:
    """Yield the lines."""
    result, counts = run.as_dict(), run.counts
    yield f"{str(run.verdict).upper()}: " + ("; ".join(run.reasons) or "every focus is on target")
    yield (
        f"  frames    {counts['sent']} sent, {counts['latched']} latched, "
        f"{counts['verified']} verified, {counts['lost']} lost, {counts['late']} late"
        f"{cut_text(counts)}"
    )
    if result["lateral_error_mm"]["max"] is not None:
        yield _error_line(result)
    yield from _known_lines(run)
    if result["balance"]["min"] is not None:
        yield _several_line(result)
    if run.effect is not None:
        yield f"  effect    {run.effect}"
    if result["pressure_rms_pa"]["mean"] is not None and result["force_mn"]["mean"] is not None:
        yield _field_line(result)
    yield f"  evidence  {result['evidence'] or 'none: no latch was seen'}"
    odd = [f for f in run.frames if f.status not in NOTHING_WRONG or _untimely(f)]
    yield from (f"  {line}" for line in _named(odd))


def cut_text(counts: Mapping[str, int]) -> str:
    """Return what became of the frames that a run did not come to; nothing if there are none."""
    parts = {"cancelled": "cancelled by its MUTE", "not_sent": "not sent"}
    said = (f", {counts[name]} {text}" for name, text in parts.items() if counts[name])
    return "".join(said)


def consequence_text(effect: Consequence) -> str:
    """Return what it did in space that a frame was not latched in time."""
    wanted = f"instead of {effect.intended_pressure_rms_pa:.0f} Pa"
    if effect.focus_error_mm is None:
        return f"silence {wanted}"
    away = f"the focus stayed {effect.focus_error_mm:.1f} mm away"
    return f"{away}: {effect.pressure_rms_pa:.0f} Pa {wanted}"


def pressure_text(frame: FrameVerdict) -> str | None:
    """Return what a wrong drive makes of the pressure at the target; None: nobody knows."""
    if frame.status not in WRONG or frame.target_pressure_rms_pa is None:
        return None
    wanted = f"instead of {frame.intended_pressure_rms_pa:.0f} Pa"
    return f"{frame.target_pressure_rms_pa:.0f} Pa at the target {wanted}"


def _untimely(frame: FrameVerdict) -> bool:
    return frame.late or frame.early or frame.latches > 1


def _error_line(result: dict[str, Any]) -> str:
    lateral, axial = result["lateral_error_mm"], result["axial_error_mm"]
    along = "along the beam: not observable"
    if axial["max"] is not None:
        along = f"{axial['p50']:.3f} / {axial['max']:.3f} mm along the beam"
    smallest_mm = result["smallest_miss_mm"]
    shows = (
        "a miss that cannot be observed does not show"
        if smallest_mm is None
        else f"the smallest miss that shows is {smallest_mm:.2f} mm"
    )
    return (
        f"  focus     off by {lateral['p50']:.3f} / {lateral['max']:.3f} mm across, "
        f"{along} (median / largest); {shows}"
    )


def _known_lines(run: RunVerdict) -> Iterator[str]:
    """Yield what is tolerated, and how well the place of a focus is known."""
    if not run.tolerance.is_strict:
        yield f"  tolerance {tolerance_text(run.tolerance)}, on top of what rounding makes"
    place = run.place_uncertainty
    if place is None or not place.total:
        return
    known = run.uncertainty
    yield (
        f"  known to  {place.total:.2f} mm, the place of a focus: {place.air:.2f} mm from the air "
        f"(±{known.temperature_c:g} °C, ±{known.humidity_percent:g} %), {place.positions:.2f} mm "
        f"from the positions (±{known.position_mm:g} mm) and {place.phases:.2f} mm from the phases "
        f"(±{known.phase_rad:g} rad) of the elements"
    )


def _field_line(result: dict[str, Any]) -> str:
    pressure, force = result["pressure_rms_pa"], result["force_mn"]
    return (
        f"  field     {pressure['mean']:.0f} Pa RMS on average, force {force['mean']:.2f} ± "
        f"{force['std']:.2f} mN, coherence {result['coherence']['min']:.5f} or more"
    )


def _several_line(result: dict[str, Any]) -> str:
    return (
        f"  foci      several in a frame: the weakest has {result['balance']['min']:.2f} of their "
        f"mean or more, efficiency {result['efficiency']['min']:.2f} or more (1: they share the "
        f"output without loss), {result['pressure_rms_pa']['mean']:.0f} Pa RMS at the first on "
        "average"
    )


# --- Frames ------------------------------------------------------------------------------------


def _named(odd: Sequence[FrameVerdict]) -> Iterator[str]:
    """Yield a line for each frame; if there are many, one for all with the same thing wrong."""
    if len(odd) <= _NAMED_FRAMES:
        yield from map(_frame_line, odd)
        return
    groups: dict[tuple[str, ...], list[FrameVerdict]] = defaultdict(list)
    for frame in odd:
        groups[_what_is_wrong(frame)].append(frame)
    ordered = sorted(groups.items(), key=lambda group: -len(group[1]))
    for what, frames in ordered[:_NAMED_FRAMES]:
        yield _group_line(what, frames) if len(frames) > 1 else _frame_line(frames[0])
    if left := sum(len(frames) for _, frames in ordered[_NAMED_FRAMES:]):
        yield f"... and {left} frames more, in the JSON file"


def _what_is_wrong(frame: FrameVerdict) -> tuple[str, ...]:
    times = {"late": frame.late, "early": frame.early, "latched more than once": frame.latches > 1}
    note = frame.note if frame.status is FrameStatus.NOT_VERIFIED else ""
    words = [str(frame.status), *(word for word, is_so in times.items() if is_so)]
    return tuple(filter(None, [*words, *frame.faults, note]))


def _group_line(what: tuple[str, ...], frames: list[FrameVerdict]) -> str:
    """Return what frames have in common, and the worst that it did."""
    numbers = ", ".join(str(frame.number) for frame in frames[:_NAMED_FRAMES])
    more = ", ..." if len(frames) > _NAMED_FRAMES else ""
    measures = "; ".join(_measures(max(frames, key=_damage)))
    at_worst = [f"at the worst {measures}"] if measures else []
    return f"{len(frames)} frames ({numbers}{more}): {'; '.join([*what, *at_worst])}"


def _damage(frame: FrameVerdict) -> tuple[float, float]:
    """Return by what the worst frame of a group is found: distance, then what is missing."""
    effect = frame.consequence
    away_mm = (effect.focus_error_mm if effect else None) or frame.error_mm or 0.0
    return away_mm, -(frame.target_pressure_rms_pa or 0.0)


def _frame_line(frame: FrameVerdict) -> str:
    parts = [f"frame {frame.number}: {frame.status}"]
    if (frame.late or frame.early) and frame.lateness_us is not None:
        parts.append(f"{abs(frame.lateness_us)} us {'late' if frame.late else 'early'}")
    if frame.latches > 1:
        parts.append(f"latched {frame.latches} times")
    parts += [*frame.faults, *_measures(frame)]
    if frame.note and (frame.status is FrameStatus.NOT_VERIFIED or not frame.faults):
        parts += [frame.note] if frame.status in (FrameStatus.NOT_VERIFIED, *WRONG) else []
    return "; ".join(parts)


def frame_text(frame: FrameVerdict) -> str:
    """Return what became of one frame, what that rests on, and which miss would have shown."""
    parts = [_frame_line(frame)]
    if frame.status not in WRONG and (place := _place(frame)) is not None:
        parts.append(place)
    if frame.criteria and not frame.is_silence:
        smallest_mm = frame.smallest_miss_mm
        parts.append(
            "a miss that cannot be observed does not show"
            if smallest_mm is None
            else f"smallest miss that shows {smallest_mm:.3f} mm"
        )
    failed = "failed" if frame.status in WRONG else "warns"
    judged = [name if passed else f"{name} {failed}" for name, passed in frame.criteria.items()]
    parts += [", ".join(judged)] if judged else []
    parts += [] if frame.evidence is None else [f"{frame.evidence} evidence"]
    return "; ".join(parts)


def _place(frame: FrameVerdict) -> str | None:
    """Return how far from its place the focus is, as far as that can be observed."""
    parts = [
        None if frame.lateral_error_mm is None else f"{frame.lateral_error_mm:.3f} mm across",
        None if frame.axial_error_mm is None else f"{frame.axial_error_mm:+.3f} mm along",
    ]
    return ", ".join(filter(None, parts)) or None


def _measures(frame: FrameVerdict) -> Iterator[str]:
    """Yield the millimetres and pascals of what went wrong."""
    if frame.status in WRONG and (place := _place(frame)) is not None:
        yield place
    if (pressure := pressure_text(frame)) is not None:
        yield pressure
    if frame.consequence is not None:
        yield consequence_text(frame.consequence)
