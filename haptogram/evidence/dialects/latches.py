"""Latches of boards of any wire, from the records of a back door.

Those of other dialects carry no number. Latches in which every channel is off are the host's own
before the first and after the last that sounds, and are left out there; between its frames a board
that goes dark is a latch without an intended frame.
"""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from haptogram.acoustics import Drive, Reconstruction
from haptogram.acoustics.arrays import ComplexArray
from haptogram.acoustics.model.drive import saturated_weights
from haptogram.acoustics.model.pulses import PulseDrive
from haptogram.errors import reads_as, refusals_of
from haptogram.evidence.backdoor import (
    observations_of_backdoor,
    observations_on_clock_of,
    observed_reconstruction_of,
)
from haptogram.records.frame import Evidence, Intended, Observation
from haptogram.settings.frozen import dataclass
from haptogram.verification.unnumbered import UnnumberedLatch, observations_of_unnumbered
from haptogram_protocol.dialects.looks_like import HAPTOGRAM

_PULSES: Final = "pulses"
_LEAST_LOSS: Final = 0.01


def dialect_run_observations(
    intended: Sequence[Intended], records: Sequence[Mapping[str, Any]], session: int | None
) -> list[Observation]:
    """Return the latches in the records of a back door, of any board, with the keys of frames."""
    if not are_records_of_another_dialect(records):
        return observations_on_clock_of(intended, observations_of_backdoor(records, session))
    return observations_of_unnumbered(intended, _dialect_latches_of_run(records))


def are_records_of_another_dialect(records: Sequence[Mapping[str, Any]]) -> bool:
    """Return True if the records of a back door are those of another board than Haptogram's."""
    return bool(records) and records[0].get("dialect", HAPTOGRAM) != HAPTOGRAM


def evidence_of_records(records: Sequence[Mapping[str, Any]]) -> Evidence:
    """Return the witness of the latches in the records of a back door."""
    is_simulated = bool(records) and records[0].get("simulator") is not None
    return Evidence.SIMULATED if is_simulated else Evidence.EXTERNAL


def has_dialect_latched_all(
    intended: Sequence[Intended], records: Sequence[Mapping[str, Any]]
) -> bool:
    """Return True if the records of another board hold a latch for each frame."""
    return len(_dialect_latches_of_run(records)) >= len(intended)


def upload_loss_text(records: Sequence[Mapping[str, Any]]) -> str | None:
    """Return the loss of a board while bytes arrive; None: there is none, or it was not observed.

    Frames are judged as they are latched, between the bytes.
    """
    from haptogram.verification.watch.latch import UPLOAD

    channels = [int(channel) for channel in records[0].get("channels", ())] if records else []
    pulses = [record for record in records if record["kind"] == _PULSES]
    if not any(record["cause"] == UPLOAD for record in pulses):
        return None
    times_us = np.array([record["t_latch_us"] for record in pulses])
    levels = []
    for record in pulses:
        seen = pulse_observation_of(record, channels)
        full = np.abs(seen.pulses.weights()[channels]).max(initial=0.0)
        levels.append(np.abs(seen.weights).max(initial=0.0) / full if full else 1.0)
    usual, sounding = max(levels), [level for level in levels if level > 0.0]
    least = min(sounding, default=0.0) / (usual or 1.0)
    if not 0.0 < least < 1.0 - _LEAST_LOSS:
        return None
    low = np.array(levels[:-1]) < (1.0 - _LEAST_LOSS) * usual
    share = np.diff(times_us)[low].sum() / max(times_us[-1] - times_us[0], 1)
    return (
        f"while bytes arrive: {20.0 * np.log10(least):.1f} dB ({least:.2f} of every pressure), for "
        f"{100.0 * share:.0f} % of the time; frames are judged as they are latched"
    )


def _dialect_latches_of_run(records: Sequence[Mapping[str, Any]]) -> list[UnnumberedLatch]:
    """Return the client's latches from the first to the last that sounds; [] if none does.

    Latches of the board's own doing are left out.
    """
    from haptogram.verification.watch.latch import OWN_CAUSES

    channels = [int(channel) for channel in records[0]["channels"]] if records else []
    evidence = evidence_of_records(records)
    found: list[UnnumberedLatch] = []
    sounding: list[int] = []
    for record in records:
        if record["kind"] == _PULSES and record["cause"] not in OWN_CAUSES:
            seen = pulse_observation_of(record, channels)
            latched = saturated_weights(seen.pulses.weights()[channels])
            if latched.any():
                sounding.append(len(found))
            radiated = saturated_weights(seen.weights)
            drives = Drive.from_weights(latched), Drive.from_weights(radiated)
            found.append(UnnumberedLatch(seen.number, seen.t_latch_us, *drives, evidence))
    return found[sounding[0] : sounding[-1] + 1] if sounding else []


@dataclass(frozen=True, slots=True, eq=False)
class PulseObservation:
    """One observed latch of a board whose channels are switched by pulses.

    Attributes
    ----------
    number : int
        Number of the latch.
    t_latch_us : int
        Device time of the latch, microseconds.
    cause : str
        Cause of the latch.
    pulses : PulseDrive
        Pulses of every channel, those that drive no emitter among them.
    weights : (N,) numpy.ndarray of complex128
        Radiated weights of the emitters, faults on purpose included.
    phase_steps : int or None
        Steps to half of which the board has computed these phases, if they are coarser than others.
    counted : mapping of str to int
        Counts of bytes since the latch before that the board could not understand.
    reconstruction : Reconstruction or None
        Focus and field rebuilt from the weights.
    """

    number: int
    t_latch_us: int
    cause: str
    pulses: PulseDrive
    weights: ComplexArray
    phase_steps: int | None
    counted: Mapping[str, int]
    reconstruction: Reconstruction | None


def pulse_observation_of(record: Mapping[str, Any], channels: Sequence[int]) -> PulseObservation:
    """Return the observation in a ``pulses`` record.

    Parameters
    ----------
    channels : sequence of int
        Channel of each emitter: ``channels`` of the ``board`` record.

    Raises
    ------
    ConfigurationError
        If it is no such record.
    """
    with reads_as("a pulses record"), refusals_of("not a pulses record of a back door:"):
        levels = {int(channel): bytes.fromhex(text) for channel, text in record["levels"].items()}
        pulses = PulseDrive(
            _pulse_numbers(record["rises"], "<u2"),
            _pulse_numbers(record["widths"], "<u2"),
            record["steps"],
            levels,
        )
        radiated = record["radiated"]
        return PulseObservation(
            number=record["number"],
            t_latch_us=record["t_latch_us"],
            cause=record["cause"],
            pulses=pulses,
            weights=pulses.weights()[list(channels)]
            if radiated is None
            else _pulse_numbers(radiated, "<c8").astype(np.complex128),
            phase_steps=record.get("phase_steps"),
            counted=record["counted"],
            reconstruction=observed_reconstruction_of(record["reconstruction"]),
        )


def _pulse_numbers(text: str, kind: str) -> np.ndarray[Any, Any]:
    """Return the array that a record has as base64 text of the numpy type *kind*."""
    return np.frombuffer(base64.b64decode(text), dtype=kind)
