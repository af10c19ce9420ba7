"""Runs to report: judged for real, from drives that are right, wrong, late and lost."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Collection, Sequence
from typing import Any

import numpy as np

from haptogram.acoustics import AcousticModel, Drive, focus_phases
from haptogram.records.frame import Evidence, Focus, FrameKey, Intended, Observation
from haptogram.report.run import result as report
from haptogram.verification import Cut, RunVerdict, verify_run

SESSION = 0xC0FFEE
Change = Callable[[Observation], Observation | None]


def targets(count: int) -> np.ndarray:
    """Points on a tilted circle, off the symmetry planes of the array."""
    turns = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
    x, y = 0.021 * np.cos(turns) + 0.004, 0.021 * np.sin(turns) - 0.003
    return np.stack([x, y, 0.12 + 0.3 * x], axis=1)


def make_run(
    model: AcousticModel,
    points: Sequence[Sequence[float]] | np.ndarray,
    change: dict[int, Change] | None = None,
    *,
    min_verified: float = 0.0,
    cut: Cut | None = None,
    held_up: Collection[int] = (),
) -> RunVerdict:
    """Judge a board that latches what it should, but for *change* by frame number.

    Frames in *held_up* were not sent.
    """
    intended, seen = [], []
    for number, point in enumerate(points):
        wanted = Intended(
            number,
            FrameKey.of_stream(SESSION, number),
            1000 * number,
            (Focus.at(point),),
            Drive.from_weights(np.exp(1j * focus_phases(model, np.array(point)))),
            8,
            t_latest_us=1000 * number if number in held_up else None,
        )
        intended.append(wanted)
        if number in held_up:
            continue
        latch = Observation(wanted.key, 1000 * number, False, Evidence.EXTERNAL, wanted.drive)
        changed = (change or {}).get(number, lambda same: same)(latch)
        if changed is not None:
            seen.append(changed)
    return verify_run(intended, seen, model=model, min_verified=min_verified, cut=cut)


def make_result(run: RunVerdict, **changes: Any) -> dict[str, Any]:
    """Return the result of a run in virtual time."""
    arguments: dict[str, Any] = {
        "configuration": {"object": "circle", "center_mm": (0.0, 0.0, 100.0)},
        "seed": 7,
        "board": {"label": "virtual board", "firmware": "1.0"},
        "warnings": [],
        "cut_short": None,
        "host": None,
        "environment": None,
    }
    return report.run_result_dict(run, **(arguments | changes))


def aim(model: AcousticModel, point: np.ndarray) -> Change:
    """Make a board that focuses on *point*, whatever it was told."""
    drive = Drive.from_weights(np.exp(1j * focus_phases(model, point)))
    return lambda latch: dataclasses.replace(latch, drive=drive)


def lose(latch: Observation) -> None:
    """Nobody sees the frame latched."""


def delay(latch: Observation) -> Observation:
    """The board latches the frame 400 µs after its time."""
    return dataclasses.replace(latch, t_latch_us=latch.t_latch_us + 400, late=True)


def hurry(latch: Observation) -> Observation:
    """The board latches the frame 50 µs before its time."""
    return dataclasses.replace(latch, t_latch_us=latch.t_latch_us - 50)


def damage(latch: Observation) -> Observation:
    """Three elements of the latched drive are dead."""
    assert latch.drive is not None
    amplitudes = latch.drive.amplitude_codes.copy()
    amplitudes[3:6] = 0
    return dataclasses.replace(latch, drive=Drive(latch.drive.phase_codes, amplitudes))


def hide(latch: Observation) -> Observation:
    """The latch is seen, and nothing of its drive."""
    return dataclasses.replace(latch, drive=None)
