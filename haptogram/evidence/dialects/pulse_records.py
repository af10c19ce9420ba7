"""Latches of boards of other dialects, read from the ``pulses`` records of a back door."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from haptogram.acoustics import Reconstruction
from haptogram.acoustics.arrays import ComplexArray
from haptogram.acoustics.model.pulses import PulseDrive
from haptogram.errors import ConfigurationError
from haptogram.evidence.backdoor import observed_reconstruction_of


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
    try:
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
    except (KeyError, TypeError, ValueError, IndexError) as error:
        raise ConfigurationError(f"not a pulses record of a back door: {error!r}") from error


def _pulse_numbers(text: str, kind: str) -> np.ndarray[Any, Any]:
    return np.frombuffer(base64.b64decode(text), dtype=kind)
