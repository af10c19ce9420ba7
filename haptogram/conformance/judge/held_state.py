"""State of a board as far as a host can read it: before and after a refusal, or an event."""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from typing import Final

from haptogram_protocol import messages as m
from haptogram_protocol.rules import UPLOADS
from haptogram_protocol.state import OutputState

from ..client import latching
from ..client.board_client import BoardClient
from ..client.capabilities import drive_kinds
from ..outcome import check, check_equal, record_differences

_RECORDS: Final = 8
#: Counters that reading, refusals and frames that are dropped on purpose move: they only grow.
_GROWING: Final = (
    "frames",
    "requests",
    "stale_session",
    "bad_length",
    "bad_value",
    "unsupported",
    "dropped_order",
    "dropped_state",
)
_WRAP: Final = 1 << 32

#: State that a board holds, by names.
Held = Mapping[str, object]
#: Expected value that matches anything.
ANYTHING: Final = object()


def judged_held_state(board: BoardClient, since: int) -> Held:
    """Return output, queue, margins, configuration, drives, ring and upload by their names.

    Events since piece *since* that tell of a change of output or playback count as well.  FAILED if
    two of the readings contradict each other.
    """
    status = board.status()
    config = board.link.call(m.GetConfig(), m.ConfigReply)
    held: dict[str, object] = {
        "the output state": (status.state, status.reason),
        "the queue": status.queued,
        # A STATUS that the board sends by itself resets them (HG-9.3/1).
        "the arrival margins": None if board.config.status_period_ms else status.margins,
        "the last latch": (status.last_seq, status.last_latch_us),
        "config_crc": status.config_crc,
        "the configuration": config,
    }
    held |= {f"the counter {name}": getattr(status.counters, name) for name in m.Counters.WIRE}
    drives: dict[m.DriveKind, m.DriveReply] = {}
    for kind in drive_kinds(board):
        drives[kind] = latching.read_drive(board, kind, 0, board.identity.transducers)
        held[f"the {kind.name.lower()} drive"] = drives[kind]
    if board.has(m.Feature.TRACE_RING):
        ring = latching.read_ring(board, 0, _RECORDS)
        held["the trace ring"] = ring
        _check_held_ring(status, config, drives, ring)
    if board.identity.features & UPLOADS:
        held["the upload"] = _upload_progress(board)
    last = board.identity.transducers - 1
    held["the geometry"] = board.link.call(m.GetGeometry(last, 2), m.GeometryReply)
    events = [*board.link.events(m.StateChanged, since), *board.link.events(m.PlaybackEnded, since)]
    held["events"] = [event for _, event in events]
    _check_held_status(board, status, config)
    _check_held_drives(board, status, config, drives)
    return held


def _upload_progress(board: BoardClient) -> object:
    """Return the reply to an empty UPLOAD_CHUNK, which tells how far the upload has come.

    If the board refuses it: ("refused", error code).
    """
    answer = board.link.ask(m.UploadChunk(0, b"")).message
    return ("refused", answer.code) if isinstance(answer, m.Error) else answer


# --- Contradictions ----------------------------------------------------------------------------


def _check_held_status(board: BoardClient, status: m.StatusReply, config: m.ConfigReply) -> None:
    """FAILED unless config_crc in STATUS matches the configuration and the correction."""
    crc, told = status.config_crc, config.config_crc
    check_equal(
        crc, told, f"config_crc is {crc:#010x} in STATUS_REPLY, {told:#010x} in CONFIG_REPLY"
    )
    if board.correction is not None:
        due = zlib.crc32(config.config.pack() + board.correction)
        check(crc == due, f"config_crc is {crc:#010x}; configuration and correction: {due:#010x}")


def _check_held_drives(
    board: BoardClient,
    status: m.StatusReply,
    config: m.ConfigReply,
    drives: Mapping[m.DriveKind, m.DriveReply],
) -> None:
    """FAILED unless the drives that are read back are of the last latch in STATUS.

    The radiated one must be silent unless the state is ARMED.
    """
    for kind, reply in drives.items():
        name = f"READ_DRIVE({kind.name})"
        told, due = reply.t_latch_us, status.last_latch_us
        check(told == due, f"{name} names a latch at {told} µs, STATUS_REPLY one at {due} µs")
        if reply.key.sequence == 0:
            seq = status.last_seq
            check_equal(
                reply.key.index, seq, f"{name} names frame {reply.key.index}, last_seq is {seq}"
            )
    if len(drives) < len(m.DriveKind):
        return
    latched, radiated = drives[m.DriveKind.LATCHED], drives[m.DriveKind.RADIATED]
    check_equal(radiated.key, latched.key, "READ_DRIVE(RADIATED) names another latch than LATCHED")
    loud = any(latching.client_drive_of_reply(radiated).amplitudes)
    if status.state is not OutputState.ARMED:
        check(not loud, f"{status.state.name}, and transducers are driven")
    elif loud and board.correction is not None and board.has(m.Feature.AMPLITUDE):
        _check_held_radiated(latched, radiated, board.correction, config.config.amplitude_ceiling)


def _check_held_radiated(
    latched: m.DriveReply, radiated: m.DriveReply, correction: bytes, ceiling: int
) -> None:
    """FAILED unless radiated phases are latched ones plus *correction*, modulo 256.

    Nor may an amplitude be above the latched one or *ceiling*; a ramp may have lowered it.
    """
    before, after = (
        latching.client_drive_of_reply(latched),
        latching.client_drive_of_reply(radiated),
    )
    phases = bytes((a + b) % 256 for a, b in zip(before.phases, correction, strict=True))
    check_equal(after.phases, phases, "radiated phases are not the latched ones and the correction")
    louder = [
        n
        for n, (a, b) in enumerate(zip(before.amplitudes, after.amplitudes, strict=True))
        if b > min(a, ceiling)
    ]
    check(not louder, f"transducers {louder[:4]} are louder than latched under a ceiling {ceiling}")


def _check_held_ring(
    status: m.StatusReply,
    config: m.ConfigReply,
    drives: Mapping[m.DriveKind, m.DriveReply],
    ring: m.TraceReply,
) -> None:
    """FAILED unless the newest record of the trace ring is of the last latch.

    Not checked if the ring is empty or was not read to its end, or the trace mode is not RING.
    """
    last = ring.records[-1] if ring.records else None
    if last is None or last.number + 1 != ring.next or config.config.trace_mode != m.TraceMode.RING:
        return
    told, due = last.t_latch_us, status.last_latch_us
    check(told == due, f"the ring ends with a latch at {told} µs, the last one was at {due} µs")
    if m.DriveKind.LATCHED in drives:
        latched = drives[m.DriveKind.LATCHED]
        read = latched.key, zlib.crc32(latched.data)
        check_equal((last.key, last.crc), read, "(key, CRC-32) of the ring's last record")


# --- Changes -----------------------------------------------------------------------------------


def held_state_changes(before: Held, after: Held, due: Held | None = None) -> str:
    """Return the differences in words; empty if there is none but those of *due*.

    *due* holds the values that have to be there afterwards where these are not those from before.
    """
    due = due or {}
    wanted = {**before, **due}
    return "; ".join(
        f"{name}: {record_differences(value, wanted[name], 'due is' if name in due else 'was')}"
        for name, value in after.items()
        if _is_held_state_change(name, wanted[name], value)
    )


def _is_held_state_change(name: str, due: object, value: object) -> bool:
    """Return True if *value* of the state *name* is not *due*.

    Counters that always grow may be larger; ANYTHING as *due* is never a change.
    """
    if due is ANYTHING:
        return False
    if name.removeprefix("the counter ") in _GROWING:
        assert isinstance(due, int)  # a counter
        assert isinstance(value, int)
        return (value - due) % _WRAP >= _WRAP // 2
    return value != due
