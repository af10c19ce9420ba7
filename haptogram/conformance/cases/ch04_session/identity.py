"""HG-4.1, HG-4.2, HG-4.3, HG-4.4, HG-4.5, HG-4.7: a session opens; identity and capabilities."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from typing import Final

from haptogram_protocol.framing import HEADER_BYTES, MAX_BODY_BYTES, MAX_ENCODED_BYTES
from haptogram_protocol.messages import (
    VERSION_MAJOR,
    ErrorCode,
    Feature,
    FocalPoint,
    Hello,
    HelloReply,
    Ping,
    UploadChunk,
)
from haptogram_protocol.state import OutputState

from ...case import case, case_about_host
from ...client.board_client import BoardClient
from ...client.malformed_frames import ValueByte
from ...outcome import check, check_fields

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
_LISTEN_US: Final = 300_000
_LONGEST_CHUNK: Final = MAX_BODY_BYTES - HEADER_BYTES - UploadChunk.LAYOUT.size


OF_HOST: Final = tuple(
    map(case_about_host, ("HG-4.1/1", "HG-4.1/2", "HG-4.4/2", "HG-4.5/1", "HG-4.5/2"))
)


@case("HG-4.3/1")
def greets_in_every_state(board: BoardClient) -> None:
    """HELLO is answered while DISARMED, ARMED and MUTED"""
    board.hello()
    board.arm()
    board.hello()
    board.mute()
    check_fields(board.hello(), "HELLO_REPLY of a muted board", state=OutputState.MUTED)


@case("HG-4.3/2")
def carrier_divides_the_second(board: BoardClient) -> None:
    """carrier_hz divides 1000000"""
    carrier = board.identity.carrier_hz
    check(0 < carrier <= 1_000_000 and 1_000_000 % carrier == 0, f"carrier_hz is {carrier}")


@case("HG-4.3/3")
def clock_is_one_megahertz(board: BoardClient) -> None:
    """clock_hz is 1000000"""
    check_fields(board.identity, "HELLO_REPLY", clock_hz=1_000_000)


@case("HG-4.3/4")
def grid_holds_all_transducers(board: BoardClient) -> None:
    """grid_nx grid_ny is N, or both are 0"""
    nx, ny = board.identity.grid_nx, board.identity.grid_ny
    count = board.identity.transducers
    check((nx, ny) == (0, 0) or nx * ny == count, f"grid of {nx} x {ny}, {count} transducers")


@case("HG-4.3/5", needs_reset=True)
def boot_identity_differs(board: BoardClient) -> None:
    """boot_id after a reset is not the one before"""
    board.hello()
    now = board.identity.boot_id
    check(now != board.last_boot_id, f"boot_id is {now:#x} after a reset, as before")


@case("HG-4.3/6")
def hash_is_of_geometry(board: BoardClient) -> None:
    """geometry_hash is the CRC-32 of the geometry records of all transducers"""
    records = b"".join(element.pack() for element in board.read_geometry())
    check_fields(board.identity, "HELLO_REPLY", geometry_hash=zlib.crc32(records))


@case("HG-4.3/8")
def limits_are_large_enough(board: BoardClient) -> None:
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
def window_fits_rx_window(board: BoardClient) -> None:
    """rx_window has room for upload_window of the longest chunks"""
    identity = board.identity
    board.need_any(_UPLOADS)
    longest = UploadChunk(0xFFFFFFFF, b"\xff" * min(identity.max_chunk, _LONGEST_CHUNK))
    window = identity.upload_window * len(board.link.request_wire(longest)[0])
    chunks = f"{identity.upload_window} chunks of {identity.max_chunk} bytes"
    text = f"rx_window is {identity.rx_window}; {chunks} are {window} on the line"
    check(identity.rx_window >= window, text)


@case("HG-4.1/3")
def refuses_nonce_0(board: BoardClient) -> None:
    """HELLO with the nonce 0 is refused with BAD_VALUE, detail 2; nothing changes"""
    board.link.refused(board.hello_message(0), ErrorCode.BAD_VALUE, 2)
    board.link.ping(1)


@case("HG-4.1/4")
def opens_one_session(board: BoardClient) -> None:
    """after a second HELLO the first session is stale, for requests and stream"""
    old = board.link.session
    board.hello()
    board.link.refused(Ping(0), ErrorCode.STALE_SESSION, board.link.session, session=old)
    with board.counting(stale_session=1):
        board.link.stream(board.flat_phases(), seq=0xFFF0, session=old)


@case("HG-4.1/4-reset", needs_reset=True)
def no_session_at_reset(board: BoardClient) -> None:
    """after a reset no session is open"""
    board.link.refused(Ping(0), ErrorCode.STALE_SESSION, 0, session=board.new_nonce())


@case("HG-4.2/1")
def hello_states_the_version(board: BoardClient) -> None:
    """HELLO_REPLY states the version that the board has"""
    reply = board.hello()
    check_fields(reply, "HELLO_REPLY", major=VERSION_MAJOR)
    for minor in (0, 1, 255):
        hello = Hello(VERSION_MAJOR, minor, board.new_nonce(), 0xFFFFFFFF)
        again = board.link.call(hello, HelloReply)
        board.adopt(again)
        check_fields(again, f"to HELLO of minor {minor}: HELLO_REPLY", minor=reply.minor)
    hello = Hello(VERSION_MAJOR + 1, 0, board.new_nonce(), 0)
    board.link.refused(hello, ErrorCode.VERSION, reply.major)


@case("HG-4.4/1-majors")
def every_other_major(board: BoardClient) -> None:
    """HELLO of each other major version: ERROR(VERSION), and the session goes on"""
    byte = ValueByte("major", Hello.WIRE["major"].offset, (VERSION_MAJOR,))
    _judge_majors(board, byte.wrong_values(thorough=board.thorough))


@case("HG-4.4/1")
def refuses_other_majors(board: BoardClient) -> None:
    """HELLO of other major versions is refused with VERSION; the session goes on"""
    _judge_majors(board, (0, VERSION_MAJOR + 1, 255))


def _judge_majors(board: BoardClient, majors: Sequence[int]) -> None:
    """FAILED unless HELLO of each of *majors* is refused, and an ARMED board stays so."""
    board.arm()
    with board.counting(requests=len(majors)):
        for major in majors:
            hello = Hello(major, 0, board.new_nonce(), 0)
            board.link.refused(hello, ErrorCode.VERSION, VERSION_MAJOR)
    board.check_status("a refused HELLO", state=OutputState.ARMED)


@case("HG-4.7/1", needs_reset=True)
def no_event_without_session(board: BoardClient) -> None:
    """for 0.3 s after a reset and a PING without a session no event comes"""
    board.link.refused(Ping(0), ErrorCode.STALE_SESSION, 0, session=77)
    board.mute()
    board.wire.idle(_LISTEN_US)
    events = [piece for piece in board.wire.received if piece.is_event]
    check(not events, f"{len(events)} events came before the first HELLO")
