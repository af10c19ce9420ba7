"""Answers of the board to requests.  SPEC.md chapters 4 to 9.

:data:`ANSWERS` has those that need nothing but the board; the dialect has the others, which need
the line, the moment of the request or the timers of the dialect.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any, Final, TypeAlias

import numpy as np

from haptogram.acoustics import Drive
from haptogram_protocol import messages as m
from haptogram_protocol.framing import HEADER_BYTES, MAX_BODY_BYTES
from haptogram_protocol.rules import READ_CAPABILITIES
from haptogram_protocol.state import MuteReason, OutputState

from .board import Board
from .events import Latch
from .refusal import RefusalError

StatusFields: TypeAlias = tuple[
    OutputState, MuteReason, int, int, int, int, int, int, int, int, m.Counters
]

_CLOCK_HZ: Final = 1_000_000
_U32: Final = 0xFFFFFFFF
_NO_LATCH: Final = m.LatchKey(sequence=0, loop=0, index=0)


def board_identity(board: Board) -> m.HelloReply:
    """Return identity and capabilities of the board for the open session."""
    settings, array = board.settings, board.settings.model.array
    nx, ny = array.grid_shape or (0, 0)
    same_names = ("max_points", "queue_depth", "trace_ring", "max_horizon_us", "rx_window")
    times = ("latch_lead_us", "point_time_us")
    limits = ("max_sequence_frames", "max_upload_bytes", "max_playback_rate_hz")
    uploads = ("max_unattended_ms", "upload_window", "max_chunk", "boot_id", "firmware")
    return m.HelloReply(
        **{name: getattr(settings, name) for name in same_names + times + limits + uploads},
        major=m.VERSION_MAJOR,
        minor=m.VERSION_MINOR,
        nonce=board.output.session,
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
        sound_speed_mm_s=board.output.config.sound_speed_mm_s,
        state=board.output.state,
        max_frame_rate_hz=settings.carrier_hz,
        config_crc=board.config_crc,
    )


def board_counters(board: Board, link: Mapping[str, int], trace_dropped: int) -> dict[str, int]:
    """Return every counter by its name on the wire, modulo 2^32."""
    fields = dataclasses.fields(board.output.counters)
    own = {field.name: getattr(board.output.counters, field.name) for field in fields}
    merged = {**link, **own, "trace_dropped": trace_dropped}
    return {name: merged[name] & _U32 for name in m.Counters.WIRE}


def board_status(board: Board, counts: Mapping[str, int], *, free_bytes: int) -> StatusFields:
    """Return the fields of a status, in their order; the margins are reset."""
    margins, least_us, mean_us = board.margins.take()
    latched = board.output.latched
    return (
        board.output.state,
        board.output.reason,
        board.queued,
        free_bytes,
        board.last_stream_index & _U32,
        latched.t_latch_us & _U32 if latched else 0,
        min(margins, 0xFFFF),
        _clip_readout_i32(least_us),
        _clip_readout_i32(mean_us),
        board.config_crc,
        m.Counters(**counts),
    )


def board_geometry(board: Board, request: m.GetGeometry) -> m.GeometryReply:
    """Return positions and normals of some transducers, as many as fit one frame."""
    settings = board.settings
    first, stop = _readout_span(request, settings.count, m.GeometryReply, m.Element.LAYOUT.size)
    positions_um = settings.model.array.positions_um()[first:stop].tolist()
    normals = np.rint(settings.model.array.normals[first:stop] * 32767).astype(int).tolist()
    rows = zip(positions_um, normals, strict=True)
    elements = tuple(m.Element(*position, *normal) for position, normal in rows)
    return m.GeometryReply(total=settings.count, first=first, elements=elements)


def board_drive(board: Board, request: m.ReadDrive) -> m.DriveReply:
    """Return the codes of some transducers, latched or radiated, as many as fit one frame."""
    if not READ_CAPABILITIES[request.kind] & board.settings.features:
        raise RefusalError(m.ErrorCode.UNSUPPORTED, int(request.TYPE))
    first, stop = _readout_span(request, board.settings.count, m.DriveReply, 2)
    latch = board.output.latched
    if request.kind is m.DriveKind.RADIATED:
        shown = board.output.radiated(board.output.now_us)
    else:
        shown = latch.drive if latch else Drive.muted(board.settings.count)
    return m.DriveReply(
        kind=request.kind,
        key=latch.key if latch else _NO_LATCH,
        t_latch_us=latch.t_latch_us & _U32 if latch else 0,
        first=first,
        data=register_codes(shown, first, stop),
    )


def board_trace(board: Board, request: m.ReadTrace) -> m.TraceReply:
    """Return latches of the trace ring, from the number asked for on, as many as fit one frame."""
    ring = board.output.ring
    oldest = ring[0].number if ring else board.output.latches
    room = _tail_room(m.TraceReply) // m.TraceRecord.LAYOUT.size
    asked = range(request.first, request.first + request.count)
    kept = [latch for latch in ring if latch.number in asked][:room]
    records = tuple(map(_trace_readout_of, kept))
    return m.TraceReply(oldest=oldest & _U32, next=board.output.latches & _U32, records=records)


def register_codes(shown: Drive, first: int = 0, stop: int | None = None) -> bytes:
    """Return the phase codes, then the amplitude codes, of transducers *first* to *stop*."""
    phases, amplitudes = shown.phase_codes[first:stop], shown.amplitude_codes[first:stop]
    return phases.tobytes() + amplitudes.tobytes()


def _trace_readout_of(latch: Latch) -> m.TraceRecord:
    """Return a latch as a record of the trace ring."""
    return m.TraceRecord(
        number=latch.number & _U32,
        key=latch.key,
        t_latch_us=latch.t_latch_us & _U32,
        crc=latch.drive.digest(),
        flags=int(m.Flag.LATE) if latch.late else 0,
    )


def _tail_room(reply: type[m.Message]) -> int:
    """Return how many bytes of variable length one frame of the type *reply* can carry."""
    return MAX_BODY_BYTES - HEADER_BYTES - reply.LAYOUT.size


def _readout_span(
    request: m.GetGeometry | m.ReadDrive,
    total: int,
    reply: type[m.Message],
    unit: int,
) -> tuple[int, int]:
    """Return the range of transducers in a reply: first, and one after the last.

    As many as asked for and as fit into a *reply* with *unit* bytes each; NOT_FOUND if the first is
    not below *total*.
    """
    if request.first >= total:
        raise RefusalError(m.ErrorCode.NOT_FOUND, total)
    fits = _tail_room(reply) // unit
    return request.first, min(total, request.first + min(request.count, fits))


def _clip_readout_i32(value: int) -> int:
    """Return *value* limited to a signed integer of 32 bits."""
    return max(-(2**31), min(2**31 - 1, value))


def _arm(board: Board, _: m.Arm) -> m.ArmReply:
    """Arm the board; return the reply with its state."""
    board.arm()
    return m.ArmReply(board.output.state)


def _disarm(board: Board, _: m.Disarm) -> m.DisarmReply:
    """Disarm the board; return the reply with its state."""
    board.disarm()
    return m.DisarmReply(board.output.state)


def _stop(board: Board, _: m.Stop) -> m.StopReply:
    """Stop the playback; return the reply with the state."""
    board.stop()
    return m.StopReply(board.output.state)


def _begin_upload(board: Board, begin: m.UploadBegin) -> m.UploadBeginReply:
    """Begin an upload; return the largest chunk and how many may be under way."""
    board.begin_upload(begin)
    return m.UploadBeginReply(board.settings.max_chunk, board.settings.upload_window)


#: Answers by the type of the request, which the type checker cannot check.
ANSWERS: Final[Mapping[type[m.Message], Callable[[Board, Any], m.Message]]] = {
    m.Arm: _arm,
    m.Disarm: _disarm,
    m.GetConfig: lambda board, _: m.ConfigReply(board.config_crc, board.output.config),
    m.GetGeometry: board_geometry,
    m.ReadDrive: board_drive,
    m.ReadTrace: board_trace,
    m.UploadBegin: _begin_upload,
    m.UploadChunk: lambda board, chunk: m.UploadChunkReply(board.store_chunk(chunk)),
    m.UploadCommit: lambda board, commit: m.UploadCommitReply(board.commit_upload(commit)),
    m.Stop: _stop,
}
