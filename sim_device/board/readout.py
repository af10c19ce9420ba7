"""Replies that only read the board.  SPEC.md chapters 4, 7, 8 and 9."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Final, TypeAlias

import numpy as np

from haptogram.acoustics import Drive
from haptogram_protocol import messages
from haptogram_protocol.framing import HEADER_BYTES, MAX_BODY_BYTES
from haptogram_protocol.rules import READ_CAPABILITIES
from haptogram_protocol.state import MuteReason, OutputState

from .board import Board
from .events import Latch
from .refusal import RefusalError
from .settings import BoardSettings

StatusFields: TypeAlias = tuple[
    OutputState, MuteReason, int, int, int, int, int, int, int, int, messages.Counters
]

_CLOCK_HZ: Final = 1_000_000
_U32: Final = 0xFFFFFFFF
_NO_LATCH: Final = messages.LatchKey(sequence=0, loop=0, index=0)


def board_identity(board: Board) -> messages.HelloReply:
    """Return identity and capabilities of the board for the open session."""
    settings, array = board.settings, board.settings.model.array
    nx, ny = array.grid_shape or (0, 0)
    same_names = ("max_points", "queue_depth", "trace_ring", "max_horizon_us", "rx_window")
    times = ("latch_lead_us", "point_time_us")
    limits = ("max_sequence_frames", "max_upload_bytes", "max_playback_rate_hz")
    uploads = ("max_unattended_ms", "upload_window", "max_chunk", "boot_id", "firmware")
    return messages.HelloReply(
        **{name: getattr(settings, name) for name in same_names + times + limits + uploads},
        major=messages.VERSION_MAJOR,
        minor=messages.VERSION_MINOR,
        nonce=board.session,
        reserved=0,
        features=int(settings.features),
        clock_hz=_CLOCK_HZ,
        clock_ppm=settings.clock_ppm,
        carrier_hz=settings.carrier_hz,
        transducers=settings.count,
        grid_nx=nx,
        grid_ny=ny,
        pitch_um=round((array.pitch_m or 0.0) * 1e6) if array.grid_shape else 0,
        geometry_hash=array.digest(),
        sound_speed_mm_s=board.config.sound_speed_mm_s,
        state=board.state,
        max_frame_rate_hz=settings.carrier_hz,
        config_crc=board.config_crc,
    )


def board_counters(board: Board, link: Mapping[str, int], trace_dropped: int) -> dict[str, int]:
    """Return every counter by its name on the wire, modulo 2^32."""
    fields = dataclasses.fields(board.counters)
    own = {field.name: getattr(board.counters, field.name) for field in fields}
    merged = {**link, **own, "trace_dropped": trace_dropped}
    return {name: merged[name] & _U32 for name in messages.Counters.WIRE}


def board_status(board: Board, counts: Mapping[str, int], *, free_bytes: int) -> StatusFields:
    """Return the fields of a status, in their order; the margins start anew."""
    margins, least_us, mean_us = board.margins.take()
    latched = board.latched
    return (
        board.state,
        board.reason,
        board.queued,
        free_bytes,
        board.last_stream_index & _U32,
        latched.t_latch_us & _U32 if latched else 0,
        min(margins, 0xFFFF),
        _clip_readout_i32(least_us),
        _clip_readout_i32(mean_us),
        board.config_crc,
        messages.Counters(**counts),
    )


def board_geometry(
    settings: BoardSettings, request: messages.GetGeometry
) -> messages.GeometryReply:
    """Return positions and normals of some transducers, as many as fit one frame."""
    first, stop = _readout_span(
        request, settings.count, messages.GeometryReply, messages.Element.LAYOUT.size
    )
    positions_um = settings.model.array.positions_um()[first:stop].tolist()
    normals = np.rint(settings.model.array.normals[first:stop] * 32767).astype(int).tolist()
    rows = zip(positions_um, normals, strict=True)
    elements = tuple(messages.Element(*position, *normal) for position, normal in rows)
    return messages.GeometryReply(total=settings.count, first=first, elements=elements)


def board_drive(board: Board, request: messages.ReadDrive) -> messages.DriveReply:
    """Return the codes of some transducers, latched or radiated, as many as fit one frame."""
    if not READ_CAPABILITIES[request.kind] & board.settings.features:
        text = f"no read-back of the {request.kind.name} drive"
        raise RefusalError(messages.ErrorCode.UNSUPPORTED, int(request.TYPE), text)
    first, stop = _readout_span(request, board.settings.count, messages.DriveReply, 2)
    latch = board.latched
    if request.kind is messages.DriveKind.RADIATED:
        shown = board.radiated(board.now_us)
    else:
        shown = latch.drive if latch else Drive.muted(board.settings.count)
    return messages.DriveReply(
        kind=request.kind,
        key=latch.key if latch else _NO_LATCH,
        t_latch_us=latch.t_latch_us & _U32 if latch else 0,
        first=first,
        data=register_codes(shown, first, stop),
    )


def board_trace(board: Board, request: messages.ReadTrace) -> messages.TraceReply:
    """Return latches of the trace ring, from the number asked for on, as many as fit one frame."""
    ring = board.output.ring
    oldest = ring[0].number if ring else board.output.latches
    room = _room_of_readout(messages.TraceReply) // messages.TraceRecord.LAYOUT.size
    asked = range(request.first, request.first + request.count)
    kept = [latch for latch in ring if latch.number in asked][:room]
    records = tuple(map(_trace_readout_of, kept))
    return messages.TraceReply(
        oldest=oldest & _U32, next=board.output.latches & _U32, records=records
    )


def register_codes(shown: Drive, first: int = 0, stop: int | None = None) -> bytes:
    """Return the phase codes, then the amplitude codes, of transducers *first* to *stop*."""
    phases, amplitudes = shown.phase_codes[first:stop], shown.amplitude_codes[first:stop]
    return phases.tobytes() + amplitudes.tobytes()


def _trace_readout_of(latch: Latch) -> messages.TraceRecord:
    return messages.TraceRecord(
        number=latch.number & _U32,
        key=latch.key,
        t_latch_us=latch.t_latch_us & _U32,
        crc=latch.drive.digest(),
        flags=int(messages.Flag.LATE) if latch.late else 0,
    )


def _room_of_readout(reply: type[messages.Message]) -> int:
    """Return the bytes that one frame leaves for the tail of *reply*."""
    return MAX_BODY_BYTES - HEADER_BYTES - reply.LAYOUT.size


def _readout_span(
    request: messages.GetGeometry | messages.ReadDrive,
    total: int,
    reply: type[messages.Message],
    unit: int,
) -> tuple[int, int]:
    """Return first and last-but-one of the transducers that a reply shows."""
    if request.first >= total:
        raise RefusalError(messages.ErrorCode.NOT_FOUND, total, f"no transducer {request.first}")
    fits = _room_of_readout(reply) // unit
    return request.first, min(total, request.first + min(request.count, fits))


def _clip_readout_i32(value: int) -> int:
    return max(-(2**31), min(2**31 - 1, value))
