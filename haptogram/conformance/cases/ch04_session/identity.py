"""HG-4.3, HG-4.5: the identity in HELLO_REPLY, and the capabilities."""

from __future__ import annotations

import zlib
from typing import Final

from haptogram_protocol.framing import HEADER_BYTES, MAX_BODY_BYTES, MAX_ENCODED_BYTES
from haptogram_protocol.messages import Feature, FocalPoint, Mute, UploadChunk
from haptogram_protocol.state import OutputState

from ...case import case, case_about_host
from ...client.board_client import BoardClient
from ...outcome import check, check_equal

_PLAYS: Final = Feature.SEQUENCE_PHASES | Feature.SEQUENCE_POINTS
_UPLOADS: Final = _PLAYS | Feature.CORRECTION
_ALWAYS: Final = Feature(0)
#: Limits, their least values, and the capabilities of which one has to be advertised.  HG-4.3/8.
LEAST_LIMITS: Final = (
    ("queue_depth", 4, _ALWAYS),
    ("max_horizon_us", 100_000, _ALWAYS),
    ("max_frame_rate_hz", 100, _ALWAYS),
    ("rx_window", MAX_ENCODED_BYTES + 2, _ALWAYS),
    ("max_points", 1, Feature.POINTS | Feature.SEQUENCE_POINTS),
    ("trace_ring", 16, Feature.TRACE_RING),
    ("upload_window", 1, _UPLOADS),
    ("max_chunk", 64, _UPLOADS),
    ("max_upload_bytes", FocalPoint.LAYOUT.size, Feature.SEQUENCE_POINTS),
    ("max_sequence_frames", 16, _PLAYS),
    ("max_playback_rate_hz", 1, _PLAYS),
    ("max_unattended_ms", 1000, _PLAYS),
)
_LONGEST_CHUNK: Final = MAX_BODY_BYTES - HEADER_BYTES - UploadChunk.LAYOUT.size


host_uses = case_about_host("HG-4.5/1")


host_ignores = case_about_host("HG-4.5/2")


@case("HG-4.3/1")
def greets_hello_in_every_state(board: BoardClient) -> None:
    """HELLO is answered while DISARMED, ARMED and MUTED"""
    board.hello()
    board.arm()
    board.hello()
    board.link.ask(Mute())
    state = board.hello().state
    check_equal(state, OutputState.MUTED, f"HELLO_REPLY of a muted board says {state.name}")


@case("HG-4.3/2")
def identity_has_a_whole_carrier(board: BoardClient) -> None:
    """carrier_hz divides 1000000"""
    carrier = board.identity.carrier_hz
    check(0 < carrier <= 1_000_000 and 1_000_000 % carrier == 0, f"carrier_hz is {carrier}")


@case("HG-4.3/3")
def identity_has_a_clock_of_a_megahertz(board: BoardClient) -> None:
    """clock_hz is 1000000"""
    check_equal(board.identity.clock_hz, 1_000_000, f"clock_hz is {board.identity.clock_hz}")


@case("HG-4.3/4")
def identity_has_a_whole_grid(board: BoardClient) -> None:
    """grid_nx grid_ny is N, or both are 0"""
    nx, ny, count = (
        board.identity.grid_nx,
        board.identity.grid_ny,
        board.identity.transducers,
    )
    check((nx, ny) == (0, 0) or nx * ny == count, f"grid of {nx} x {ny}, {count} transducers")


@case("HG-4.3/5", needs_reset=True)
def boot_identity_differs(board: BoardClient) -> None:
    """boot_id after a reset is not the one before"""
    board.hello()
    now = board.identity.boot_id
    check(now != board.last_boot_id, f"boot_id is {now:#x} after a reset, as before")


@case("HG-4.3/6")
def identity_has_the_geometry_hash(board: BoardClient) -> None:
    """geometry_hash is the CRC-32 of the geometry records of all transducers"""
    records = b"".join(element.pack() for element in board.read_geometry())
    got, due = board.identity.geometry_hash, zlib.crc32(records)
    check(got == due, f"geometry_hash is {got:#010x}, that of the records {due:#010x}")


@case("HG-4.3/8")
def identity_has_large_enough_limits(board: BoardClient) -> None:
    """every limit of what is advertised has the least value that a host may rely on"""
    identity = board.identity
    for name, least, features in LEAST_LIMITS:
        if not features or identity.features & features:
            got = getattr(identity, name)
            check(got >= least, f"{name} is {got}, must be {least} or more")
    if identity.features & (Feature.SEQUENCE_PHASES | Feature.CORRECTION):
        got, least = identity.max_upload_bytes, identity.transducers
        check(got >= least, f"max_upload_bytes is {got}, a frame has {least}")
    if identity.features & _UPLOADS:
        got = identity.max_chunk
        check(got <= _LONGEST_CHUNK, f"max_chunk is {got}; a frame holds {_LONGEST_CHUNK}")


@case("HG-4.3/9")
def identity_has_room_for_a_window(board: BoardClient) -> None:
    """rx_window has room for upload_window of the longest chunks"""
    identity = board.identity
    board.need_any(_UPLOADS)
    longest = UploadChunk(0xFFFFFFFF, b"\xff" * min(identity.max_chunk, _LONGEST_CHUNK))
    window = identity.upload_window * len(board.link.request_wire(longest)[0])
    check(
        identity.rx_window >= window,
        f"rx_window is {identity.rx_window}; {identity.upload_window} chunks of "
        f"{identity.max_chunk} bytes are {window} on the line",
    )
