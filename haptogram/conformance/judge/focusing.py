"""Frames for foci, and the verdict on the focus of a latched drive; needs numpy only."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from haptogram.acoustics import AcousticModel, Drive, superpose_foci
from haptogram.driver.frames.builder import FrameBuilder
from haptogram.driver.frames.frame import Frame, Mode
from haptogram.driver.frames.targets import as_frame_foci
from haptogram.records.frame import Evidence, FrameKey, Observation
from haptogram.verification import FrameJudge, FrameStatus
from haptogram_protocol import messages as m

from ..client import latching
from ..client.board_client import BoardClient
from ..outcome import check, fail

_STEPS = 256
_LATCHED_US = 0
_WORST_STEPS = 1.5 + 1e-6  # one step beyond the rounding, which is half of one


def judged_host_frames(
    model: AcousticModel,
    identity: m.HelloReply,
    targets_m: Sequence[tuple[float, float, float]],
    mode: Mode = "phases",
) -> list[Frame]:
    """Return a frame per target, as a host computes it."""
    return FrameBuilder(model, identity).build(as_frame_foci(list(targets_m)), mode)


def judge_of_model(model: AcousticModel) -> FrameJudge:
    """Return the judge of drives of one array, which remembers the position of the last focus."""
    return FrameJudge(model, carrier_us=round(1e6 / model.frequency_hz))


def judge_focus(judge: FrameJudge, frame: Frame, shown: latching.ClientDrive) -> None:
    """FAILED, with the name of the fault, unless the focus of the shown drive is on target."""
    key = FrameKey(session=0, sequence=0, loop=0, index=0)
    latched = Drive(
        np.frombuffer(shown.phases, np.uint8), np.frombuffer(shown.amplitudes, np.uint8)
    )
    observation = Observation(key, _LATCHED_US, False, Evidence.SELF_REPORTED, latched)
    verdict = judge.judge(frame.intended(0, key, None), observation)
    if verdict.status in (FrameStatus.ON_TARGET, FrameStatus.NOT_VERIFIED) and not verdict.faults:
        return
    where = ", ".join(f"{1e3 * value:.1f}" for value in frame.foci[0].position_m)
    found = "no focus"
    if verdict.measured_m is not None:
        place = ("?" if value is None else f"{1e3 * value:.1f}" for value in verdict.measured_m)
        found = "(" + ", ".join(place) + ") mm"
    named = "; ".join(verdict.faults) or verdict.status.value
    fail(f"{named}: focus commanded to ({where}) mm, found {found}")


def weights_of_points(
    model: AcousticModel, points: tuple[m.FocalPoint, ...]
) -> NDArray[np.complex128]:
    """Return the (N,) drive of focal points before it is rounded to codes (HG-5.4)."""
    positions = np.array([(p.x_um, p.y_um, p.z_um) for p in points]) * 1e-6
    levels = np.array([p.amplitude for p in points]) / 65_535
    lags = np.array([p.phase for p in points]) * (2 * np.pi / 65_536)
    return superpose_foci(model, positions, levels, lags)


def judged_phase_errors(
    model: AcousticModel, found: Sequence[tuple[tuple[m.FocalPoint, ...], latching.ClientDrive]]
) -> NDArray[np.float64]:
    """Return latched phase codes less the exact phases, in steps, of every transducer.

    Where the weight all but vanishes its phase means nothing: below 1/16 it is free (HG-5.4/3).
    """
    errors = []
    for points, shown in found:
        weights = weights_of_points(model, points)
        exact = np.angle(weights) / (2 * np.pi) * _STEPS
        codes = np.frombuffer(shown.phases, np.uint8).astype(np.float64)
        difference = (codes - exact + _STEPS / 2) % _STEPS - _STEPS / 2
        errors.append(difference[np.abs(weights) >= 1 / 16])
    return np.concatenate(errors)


def judged_amplitude_errors(
    model: AcousticModel,
    found: Sequence[tuple[tuple[m.FocalPoint, ...], latching.ClientDrive]],
    *,
    graded: bool = True,
) -> NDArray[np.float64]:
    """Return latched amplitude codes less the exact ones, of every transducer.

    Unless the amplitudes are *graded* each is 255.
    """
    errors = []
    for points, shown in found:
        weights = np.abs(weights_of_points(model, points))
        exact = 255 * np.minimum(1.0, weights if graded else 1.0)
        errors.append(np.frombuffer(shown.amplitudes, np.uint8) - exact)
    return np.concatenate(errors)


def judge_drive_of_points(
    board: BoardClient,
    model: AcousticModel,
    points: tuple[m.FocalPoint, ...],
    shown: latching.ClientDrive,
    name: str,
) -> None:
    """FAILED if a phase or an amplitude of *shown* is off by more than one step."""
    found, key, last = [(points, shown)], shown.reply.key, board.link.stream_next - 1
    if not key.sequence and key.index != last:
        name += f": frame {last} was sent, and DRIVE_REPLY shows frame {key.index}"
    errors = np.zeros(len(shown.phases))
    errors[np.abs(weights_of_points(model, points)) >= 1 / 16] = judged_phase_errors(model, found)
    _check_codes(shown.phases, errors, f"{name}: phase")
    if board.has(m.Feature.AMPLITUDE):
        _check_codes(shown.amplitudes, judged_amplitude_errors(model, found), f"{name}: amplitude")


def _check_codes(codes: bytes, errors: NDArray[np.float64], what: str) -> None:
    """FAILED if one of *codes* (phase or amplitude: *what*) is off by over 1.5 steps.

    *errors* says by how many; half a step is rounding. The worst one is named.
    """
    n = int(np.abs(errors).argmax())
    due = (codes[n] - errors[n]) % _STEPS
    check(abs(errors[n]) <= _WORST_STEPS, f"{what} {n} is {codes[n]}, due is {due:.2f}")
