"""Latches that a capture of the drive pins shows, without knowledge of the intended foci."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from haptogram.errors import ConfigurationError
from haptogram.records.remark import About
from haptogram.verification.pins.held.drives import HeldDrives
from haptogram.verification.pins.pin_verdict import captured_elements_text

#: Kind of the records of latches that pins show.
PINS: Final = "pins"


def records_of_held_drives(held: HeldDrives, board: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return records of a capture, as those of a back door: the *board*, its latches, the end.

    Raises
    ------
    ConfigurationError
        An element that the board lacks.
    """
    record, count = held.record, len(board["positions_m"])
    if held.elements[-1] >= count:
        element = held.elements[-1]
        raise ConfigurationError(
            f"channel {record.pins[element].channel} is element {element}; the board has the "
            f"elements 0 to {count - 1}"
        )
    records = [dict(board)]
    records += [_client_remark_record(text) for text in _limits_of_capture(held, count)]
    begins = np.array([held.begins[0], *(latch.end for latch in held.latches)])
    times_us = np.rint(record.seconds(begins) * 1e6).astype(np.int64).tolist()
    for number, t_us in enumerate(times_us):
        weights = np.zeros(count, np.complex128)
        weights[list(held.elements)] = held.weights[number]
        records.append({"kind": PINS, "number": number, "t_latch_us": t_us, "weights": weights})
    end = {"kind": "end", "clean": True, "dropped": 0, "cut": record.cut}
    return [*records, end]


def _client_remark_record(text: str) -> dict[str, Any]:
    """Return the record of a remark about the client, as the board makes it."""
    return {"kind": "event", "event": "remark", "about": About.CLIENT, "text": text}


def _limits_of_capture(held: HeldDrives, count: int) -> list[str]:
    """Return notes: how many elements were captured, defects of pins, those of the capture."""
    record = held.record
    found = [f"pins of {captured_elements_text(len(held.elements), count)} were captured"]
    found += [
        f"element {element} ({pin.channel}): {text}"
        for element, pin in record.pins.items()
        for text in pin.defects
    ]
    return [*found, *record.notes]
