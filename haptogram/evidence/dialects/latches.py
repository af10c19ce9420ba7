"""Latches of a run on boards of any wire, from the records of a back door.

Those of other dialects carry no number. Latches in which every channel is off are the host's own
before the first and after the last that sounds, and are left out there; between its frames a board
that goes dark is a latch without an intended frame.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from haptogram.acoustics import Drive
from haptogram.acoustics.model.drive import saturated_weights
from haptogram.evidence.backdoor import observations_of_backdoor, observations_on_clock_of
from haptogram.evidence.dialects.pulse_records import pulse_observation_of
from haptogram.records.frame import Evidence, Intended, Observation
from haptogram.verification.unnumbered import UnnumberedLatch, observations_of_unnumbered
from haptogram.verification.watch.latch import OWN_CAUSES, UPLOAD
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
