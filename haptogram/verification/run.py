"""A run: intended and latched joined by their keys, every frame accounted for."""

from __future__ import annotations

import dataclasses
import functools
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from types import NoneType
from typing import Final, TypeVar

from haptogram.acoustics import AcousticModel
from haptogram.errors import ConfigurationError
from haptogram.records.frame import (
    STREAM,
    Evidence,
    FrameKey,
    Intended,
    Observation,
    check_intended,
)
from haptogram.records.kept import KeptRecords
from haptogram.records.losses import BoardLosses
from haptogram.settings.arguments import (
    Progress,
    check_argument_kind,
    check_callable,
    check_number,
    check_whole,
)

from .consequences.effect import RunConsequences
from .consequences.held import (
    HeldFocus,
    consequence_of_held_focus,
    due_frames_of_consequences,
    focus_still_held,
)
from .faults import UNNAMED
from .frame.judge import FrameJudge
from .frame.verdict import JUDGED, MISSED, Cut, FrameStatus, FrameVerdict, Verdict
from .losses import LossJudge, lost_frames_reason, unnamed_losses_reason
from .run_verdict import RunVerdict
from .tolerance import Tolerance, Uncertainty

_T = TypeVar("_T")


def verify_run(
    intended: Sequence[Intended],
    observations: Iterable[Observation],
    *,
    model: AcousticModel,
    min_verified: float = 1.0,
    cut: Cut | None = None,
    unseen: str | None = None,
    silences: Iterable[int] = (),
    losses: BoardLosses | None = None,
    tolerance: Tolerance | None = None,
    uncertainty: Uncertainty | None = None,
    progress: Progress | None = None,
) -> RunVerdict:
    """Join intended frames with observed latches, by key, and judge every frame.

    Parameters
    ----------
    intended : sequence of Intended
        One that dropped entries, a :class:`~haptogram.records.kept.KeptRecords`, can fail, but not
        pass; ``counts["not_kept"]`` says how many frames are not judged.
    observations : iterable of Observation
        Where entries of it were dropped, a frame without an observation is not verified.
    model : AcousticModel
        Array and air that the drives were radiated in.
    min_verified : float
        Share of the intended frames that must be verified, 0 to 1.  It is about evidence: a frame
        that the board lost fails the run.
    cut : Cut, optional
        How the run ended before its end: then it can fail, but not pass.
    unseen : str, optional
        Why a frame may have been latched that nobody saw: then one that was not seen is not
        verified, rather than lost.
    silences : iterable of int
        Device times at which the output fell silent, on the clock of *intended*: what was latched
        before is no longer radiated then.
    losses : BoardLosses, optional
        What board and back door say of frames that were not latched; by default the host's own
        record of each frame decides whose loss it is, where the board showed any latch at all.
    tolerance : Tolerance, optional
        Which misses pass on top of those of rounding of the phases; by default none.
    uncertainty : Uncertainty, optional
        How well *model* is known, which the result tells in mm; by default exactly.
    progress : callable, optional
        Called with the number of frames judged and their total.

    Raises
    ------
    ConfigurationError
        An argument that cannot be; two intended frames that have one key; a focus behind the array
        or at one of its elements.

    Examples
    --------
    >>> from haptogram_protocol.messages import TraceMode
    >>> with Driver(url, seed=1, trace=TraceMode.DRIVE) as driver:
    ...     state = driver.arm()
    ...     report = driver.stream([(0.0, 0.0, 0.15), (0.01, 0.0, 0.15)], rate_hz=500)
    ...     verdict = verify_run(driver.intended, driver.observations, model=driver.model)
    >>> bool(verdict)
    True
    """
    check_intended(intended)
    check_run_judgement(model, min_verified, tolerance, uncertainty)
    check_argument_kind("observations", observations, Iterable, "an iterable of Observation")
    check_argument_kind("cut", cut, (Cut, NoneType), "a Cut, or None")
    check_argument_kind("unseen", unseen, (str, NoneType), "a text, or None")
    check_argument_kind("losses", losses, (BoardLosses, NoneType), "a BoardLosses, or None")
    check_argument_kind("silences", silences, Iterable, "an iterable of times in µs")
    check_callable("progress", progress)
    _check_unique_keys(intended)
    if unseen is None and (kept := _kept_for_run_verdict(observations)).dropped:
        unseen = f"the driver keeps the last {len(kept)} latches it is told"
    not_kept = _kept_for_run_verdict(intended).dropped
    seen: dict[FrameKey, list[Observation]] = defaultdict(list)
    latched = _observations_to_verify(observations)
    for observation in _without_earlier(intended, latched) if not_kept else latched:
        seen[observation.key].append(observation)
    for latches in seen.values():
        if len(latches) > 1:
            latches.sort(key=lambda latch: (latch.evidence is Evidence.WIRE, latch.t_latch_us))
    judge = FrameJudge(
        model,
        carrier_us=max(1, round(1e6 / model.frequency_hz)),
        tolerance=tolerance,
        uncertainty=uncertainty,
    )
    frames: list[FrameVerdict] = []
    hold: Callable[[], HeldFocus | None] = _no_drive_yet
    drives = functools.cache(functools.partial(_frames_by_drive, intended))
    every = [seen.pop(frame.key, []) for frame in intended]  # all latches of each frame
    missed = LossJudge(intended, [*every, *seen.values()], losses, unseen, cut)
    quiet_us = sorted(check_whole("silences", t, -(2**63), 2**63, "µs") for t in silences)
    verdicts = judge.judge_all(
        (f, some[0]) for f, some in zip(intended, every, strict=True) if some
    )
    dues = functools.cache(lambda: [*due_frames_of_consequences(intended, every)])
    for number, (wanted, latches) in enumerate(zip(intended, every, strict=True)):
        if latches:
            verdict = next(verdicts)
            if _is_run_frame_unnamed(verdict, latches[0]):
                verdict = _named_by_other_frame(verdict, latches[0], drives())
        else:
            verdict = missed.judge(wanted, dues()[number])
        if verdict.late or verdict.status in MISSED:
            held = focus_still_held(hold(), dues()[number], quiet_us)
            effect = consequence_of_held_focus(model, wanted, held)
            verdict = dataclasses.replace(verdict, consequence=effect)
        seen_by_board = sum(latch.evidence is not Evidence.WIRE for latch in latches)
        if verdict.latches != seen_by_board:
            verdict = dataclasses.replace(verdict, latches=seen_by_board)
        frames.append(verdict)
        if latches:
            hold = functools.partial(HeldFocus.after, wanted, latches[0], verdict)
            missed.latched(latches[0].t_latch_us)
        elif unseen is not None and verdict.status is not FrameStatus.LOST:
            # Who knows whether it was latched?
            hold = functools.partial(HeldFocus, None, verdict.target_m, dues()[number].latest_us)
        if progress is not None:
            progress(number + 1, len(intended))
    run = _conclude_run_verdict(frames, sorted(seen), min_verified, cut, quiet_us, not_kept, losses)
    return dataclasses.replace(
        run, tolerance=judge.tolerance, uncertainty=judge.uncertainty, ways=judge.ways
    )


def _no_drive_yet() -> None:
    """Return None: the drive in force before the first latch is not known."""


def check_run_judgement(
    model: AcousticModel,
    min_verified: float,
    tolerance: Tolerance | None,
    uncertainty: Uncertainty | None,
) -> None:
    """Refuse what a run cannot be judged by, before anybody waits for its latches.

    Raises
    ------
    ConfigurationError
        Naming the argument.
    """
    check_argument_kind("model", model, AcousticModel, "an AcousticModel")
    check_number("min_verified", min_verified, 0.0, 1.0)
    check_argument_kind("tolerance", tolerance, (Tolerance, NoneType), "a Tolerance, or None")
    check_argument_kind(
        "uncertainty", uncertainty, (Uncertainty, NoneType), "an Uncertainty, or None"
    )


def _observations_to_verify(entries: Iterable[Observation]) -> Iterator[Observation]:
    """Yield the observations; raise if an object is none."""
    for number, entry in enumerate(entries):
        if not isinstance(entry, Observation):
            check_argument_kind(
                f"observations[{number}]", entry, Observation, "an Observation, as of the driver"
            )
        yield entry


def _kept_for_run_verdict(entries: Iterable[_T]) -> KeptRecords[_T]:
    """Return *entries* if they are KeptRecords, which count what they drop; else empty ones."""
    return entries if isinstance(entries, KeptRecords) else KeptRecords()


def _without_earlier(
    intended: Sequence[Intended], observations: Iterable[Observation]
) -> Iterator[Observation]:
    """Yield observations of *intended* frames, and of stream frames from the first of these on."""
    wanted = {frame.key for frame in intended}
    streamed = [key.index for key in wanted if key.sequence == STREAM]
    first = min(streamed, default=None)
    return (
        o
        for o in observations
        if o.key in wanted
        or (first is not None and o.key.sequence == STREAM and o.key.index >= first)
    )


def _is_run_frame_unnamed(verdict: FrameVerdict, latch: Observation) -> bool:
    """Return True if a wrong drive or CRC matches no named fault."""
    is_of_crc = latch.drive is None and verdict.status is FrameStatus.CORRUPT
    return is_of_crc or verdict.faults == (UNNAMED,)


def _frames_by_drive(intended: Sequence[Intended]) -> dict[int, list[int]]:
    """Return the numbers of the frames by the CRC of their drive."""
    found: dict[int, list[int]] = defaultdict(list)
    for frame in intended:
        found[frame.drive.digest()].append(frame.number)
    return found


def _named_by_other_frame(
    verdict: FrameVerdict, latch: Observation, drives: Mapping[int, Sequence[int]]
) -> FrameVerdict:
    """Return *verdict* with the nearest frame of the latched drive as fault; as is without one.

    *drives* has the numbers of the frames by the CRC of their drive.
    """
    crc = latch.drive_crc if latch.drive is None else latch.drive.digest()
    numbers = () if crc is None else drives.get(crc, ())
    if not numbers:
        return verdict
    number = min(numbers, key=lambda other: abs(other - verdict.number))
    return dataclasses.replace(verdict, faults=(f"the drive of frame {number}",))


def _check_unique_keys(intended: Sequence[Intended]) -> None:
    """Refuse two intended frames with one key."""
    key, times = next(iter(Counter(frame.key for frame in intended).most_common(1)), (None, 0))
    if times > 1:
        raise ConfigurationError(f"{key} is intended {times} times; a key names one frame")


def _conclude_run_verdict(
    frames: list[FrameVerdict],
    unexpected: list[FrameKey],
    min_verified: float,
    cut: Cut | None,
    quiet_us: Sequence[int],
    not_kept: int,
    losses: BoardLosses | None,
) -> RunVerdict:
    """Return a run's verdict: FAIL if frames are wrong, INCONCLUSIVE if too few are known.

    That is a smaller share than *min_verified*, an interruption (*cut*, None: none), or *not_kept*
    frames. *quiet_us* are the times of silence, *losses* what the board tells of lost frames (None:
    nothing).
    """
    not_sent = 0 if cut is None else cut.not_sent
    counts = _run_verdict_counts(frames, unexpected) | {"not_sent": not_sent, "not_kept": not_kept}
    effect = RunConsequences.of(frames, quiet_us)
    run = RunVerdict(Verdict.PASS, (), frames, unexpected, min_verified, counts, effect)
    lost = (
        lost_frames_reason(frames, run.due, losses),
        None if cut is not None else unnamed_losses_reason(frames, run.due, losses),
    )
    wrong = [reason for reason in lost if reason is not None] + [
        f"{number} {'frame' if number == 1 else 'frames'} {text}"
        for name, text in _FAILURES.items()
        if (number := counts[name])
    ]
    missing = [] if cut is None else [cut.reason]
    if not_kept:
        missing.append(
            f"{not_kept} of {not_kept + len(frames)} frames are not judged: the driver keeps the "
            f"last {len(frames)}; give it a larger keep, or a sink"
        )
    if run.too_few:
        needed = f"{100.0 * min_verified:g} %" if min_verified else "one"
        only = {frame.evidence for frame in frames} == {Evidence.WIRE}
        missing.append(
            f"{counts['verified']} of {run.due} frames were verified; {needed} must be"
            + (f": this machine held up {held_up}" if (held_up := counts["held_up"]) else "")
            + (
                ": what left the host is all that was seen, and nothing of the board"
                if only
                else ""
            )
        )
    verdict = Verdict.FAIL if wrong else Verdict.INCONCLUSIVE if missing else Verdict.PASS
    return dataclasses.replace(run, verdict=verdict, reasons=(*wrong, *missing))


_FAILURES: Final = {
    "off_target": "off target",
    "wrong_drive": "with a wrong drive",
    "corrupt": "damaged, but latched",
    "early": "latched before their time",
    "duplicated": "latched more than once",
    "unexpected": "latched that nobody intended",
}


def _run_verdict_counts(frames: list[FrameVerdict], unexpected: list[FrameKey]) -> dict[str, int]:
    """Return how many frames were sent, latched, verified, late, and of each status."""
    by_status = Counter(frame.status for frame in frames)
    return {
        "sent": len(frames),
        "latched": sum(frame.latches > 0 for frame in frames),
        "verified": sum(frame.status in JUDGED for frame in frames),
        **{status.name.lower(): by_status[status] for status in FrameStatus},
        "late": sum(frame.late for frame in frames),
        "early": sum(frame.early for frame in frames),
        "duplicated": sum(frame.latches > 1 for frame in frames),
        "unexpected": len(unexpected),
    }
