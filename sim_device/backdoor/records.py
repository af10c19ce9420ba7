"""The records of the back door: what the board really did, as JSON.  See docs/backdoor.md."""

from __future__ import annotations

import base64
import dataclasses
import enum
import json
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Final, TypeAlias

from haptogram.acoustics import Reconstruction
from haptogram.records.model import calibration_record_fields, model_record_fields

from ..board import events
from ..board.settings import BoardSettings

if TYPE_CHECKING:
    from haptogram.acoustics.reconstruct.patterns.found import Pattern

VERSION: Final = 1

Record: TypeAlias = dict[str, Any]

_written: Final = json.JSONEncoder(separators=(",", ":"), allow_nan=False).encode

#: Event of each notice in an ``output`` record, and the fields of the notice that it holds.
_OUTPUT_EVENTS: Final[dict[type[events.Notice], tuple[str, ...]]] = {
    events.SessionOpened: ("session", "session"),
    events.StateChange: ("state", "state", "reason", "requested"),
    events.StreamDropped: ("dropped", "session", "index", "counter"),
    events.RampBegan: ("ramp_began", "reason"),
    events.RampEnded: ("ramp_ended", "restored"),
    events.RadiatedAnew: ("radiated_anew",),
    events.PlaybackEnd: ("playback_ended", "sequence", "loops", "frames"),
    events.PowerDown: ("power_down",),
    events.Remark: ("remark", "about", "text"),
    events.ClientLeft: ("client_left",),
    events.WireCompared: ("wire_compared", "is_own"),
}


def backdoor_board_record(settings: BoardSettings) -> Record:
    """Return the first record: what the board is, enough to compute its field."""
    return {
        "kind": "board",
        "version": VERSION,
        "firmware": settings.firmware,
        **({} if settings.simulator is None else {"simulator": settings.simulator}),
        "seed": settings.seed,
        "boot_id": settings.boot_id,
        "boot_us": settings.boot_us,
        "baud": settings.line.baud,
        "carrier_hz": settings.carrier_hz,
        "queue_depth": settings.queue_depth,
        "transducers": settings.count,
        **({} if settings.wiring is None else dataclasses.asdict(settings.wiring)),
        **model_record_fields(settings.model),
        "calibration": calibration_record_fields(settings.calibration),
    }


def backdoor_latch_record(latch: events.Latch, reconstruction: Reconstruction | None) -> Record:
    """Return the record of one latch, with the field that it made where that was rebuilt."""
    estimate = None if reconstruction is None else reconstruction.as_dict()
    return latch.record().as_record(estimate)


def backdoor_brief_record(latch: events.Latch) -> Record:
    """Return the first fields of the record of one latch, which say nothing of its drive."""
    key = latch.key
    return {
        "kind": "latch",
        "session": latch.session,
        "sequence": key.sequence,
        "loop": key.loop,
        "index": key.index,
        "number": latch.number,
        "t_latch_us": latch.t_latch_us,
        "late": latch.late,
        "t_received_us": latch.t_received_us,
    }


def backdoor_pulse_record(
    latch: events.PulseLatch,
    reconstruction: Reconstruction | None,
    pattern: Pattern | None = None,
    *,
    modulation_changed: bool,
) -> Record:
    """Return the record of one latch of a board of another dialect: kind ``pulses``.

    ``rises`` and ``widths`` hold a little-endian 16-bit number for each channel, in ``steps`` of
    the carrier period; a channel that drives no emitter is among them (``channels`` of the record
    ``board`` says which drive one). ``levels`` holds the level of each step, 0 or 1, of a channel
    that has several pulses in a period. ``cause`` says what made the board latch, ``index`` the
    place in a sequence that it runs along, and ``counted`` what it could not understand since the
    latch before: a latch with anything there may be torn. ``radiated`` holds the weight of each
    emitter, two little-endian 32-bit floats (real and imaginary part, e^{-j w t}), if faults on
    purpose changed it; null: as the pulses say. ``modulation`` is null, ``unchanged``, or the
    samples of the amplitude (0 to 255) with their rate, which repeat from this latch on.
    ``phase_steps`` says to half of which step the board has computed its phases, or is null.
    """
    from haptogram.acoustics.reconstruct.patterns.found import pattern_dict

    pulses, modulation = latch.pulses, latch.modulation
    samples: Record | str | None = "unchanged"
    if modulation is None:
        samples = None
    elif modulation_changed:
        samples = {"rate_hz": modulation.rate_hz, "samples": _backdoor_base64(modulation.samples)}
    faulty = latch.radiated if latch.is_faulty else None
    return {
        "kind": "pulses",
        "number": latch.number,
        "t_latch_us": latch.t_latch_us,
        "cause": latch.cause,
        "index": latch.index,
        "steps": pulses.steps,
        "rises": _backdoor_base64(pulses.rises.astype("<u2").tobytes()),
        "widths": _backdoor_base64(pulses.widths.astype("<u2").tobytes()),
        "levels": {str(channel): levels.hex() for channel, levels in pulses.levels.items()},
        "counted": dict(latch.counted),
        "modulation": samples,
        "phase_steps": latch.phase_steps,
        "radiated": None if faulty is None else _backdoor_base64(faulty.astype("<c8").tobytes()),
        "reconstruction": None if reconstruction is None else reconstruction.as_dict(),
        "pattern": None if pattern is None else pattern_dict(pattern),
    }


def backdoor_output_record(notice: events.Notice) -> Record:
    """Return the record of a change of the output, of a session or of the end of a sequence."""
    event, *names = _OUTPUT_EVENTS[type(notice)]
    told = {name: _backdoor_value(getattr(notice, name)) for name in names}
    return {"kind": "output", "t_us": notice.t_us, "event": event, **told}


def _backdoor_value(value: Any) -> Any:
    """Return a value as JSON can hold it: plain text, and states and reasons by name."""
    if isinstance(value, str):
        return str(value)
    return value.name if isinstance(value, enum.Enum) else value


def backdoor_end_record(
    *,
    latched: int,
    reconstructed: int,
    dropped: int,
    notices_dropped: int,
    clean: bool,
    counted: Mapping[str, events.Counted],
) -> Record:
    """Return the last record: how many latches there were, and how many records are missing."""
    faults, line = counted.get("faults"), counted.get("line")
    return {
        "kind": "end",
        "latched": latched,
        "reconstructed": reconstructed,
        "dropped": dropped,
        "notices_dropped": notices_dropped,
        "clean": clean,
        **({} if faults is None else {"faults": faults.counts, "fault_plan": faults.plan}),
        **({} if line is None else {"line": line.counts}),
    }


def backdoor_record_line(record: Record) -> bytes:
    """Return *record* as one line of JSON."""
    return _written(record).encode() + b"\n"


def backdoor_latch_line(latch: events.Latch, rest: str) -> str:
    """Return the record of a latch as one line; its *rest* tells of the drive."""
    return f"{_written(backdoor_brief_record(latch))[:-1]},{rest}\n"


def backdoor_drive_text(latch: events.Latch, reconstruction: Reconstruction | None) -> str:
    """Return the rest of the record of a latch: the drive, and the field that it made."""
    record = backdoor_latch_record(latch, reconstruction)
    return _written(dict([*record.items()][len(backdoor_brief_record(latch)) :]))[1:]


def _backdoor_base64(data: bytes) -> str:
    """Return bytes as base64 text."""
    return base64.b64encode(data).decode()
