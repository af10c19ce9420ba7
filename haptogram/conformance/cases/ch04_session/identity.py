"""HG-4.3, HG-4.5: the identity in HELLO_REPLY, and the capabilities."""

from __future__ import annotations

import zlib

from haptogram_protocol.messages import (
    Mute,
)
from haptogram_protocol.state import OutputState

from ...case import about_host, case
from ...client.board_client import BoardClient
from ...outcome import check

host_uses = about_host("HG-4.5/1")


host_ignores = about_host("HG-4.5/2")


@case("HG-4.3/1", "HELLO is answered while DISARMED, ARMED and MUTED")
def greets_in_every_state(board: BoardClient) -> None:
    board.hello()
    board.arm()
    board.hello()
    board.link.ask(Mute())
    state = board.hello().state
    check(state is OutputState.MUTED, f"HELLO_REPLY of a muted board says {state.name}")


@case("HG-4.3/2", "carrier_hz divides 1000000")
def carrier_divides(board: BoardClient) -> None:
    carrier = board.identity.carrier_hz
    check(0 < carrier <= 1_000_000 and 1_000_000 % carrier == 0, f"carrier_hz is {carrier}")


@case("HG-4.3/3", "clock_hz is 1000000")
def clock_is_a_megahertz(board: BoardClient) -> None:
    check(board.identity.clock_hz == 1_000_000, f"clock_hz is {board.identity.clock_hz}")


@case("HG-4.3/4", "grid_nx grid_ny is N, or both are 0")
def grid_is_whole(board: BoardClient) -> None:
    nx, ny, count = (
        board.identity.grid_nx,
        board.identity.grid_ny,
        board.identity.transducers,
    )
    check((nx, ny) == (0, 0) or nx * ny == count, f"grid of {nx} x {ny}, {count} transducers")


@case("HG-4.3/5", "boot_id after a reset is not the one before", needs_reset=True)
def boot_id_differs(board: BoardClient) -> None:
    board.hello()
    now = board.identity.boot_id
    check(now != board.last_boot_id, f"boot_id is {now:#x} after a reset, as before")


@case("HG-4.3/6", "geometry_hash is the CRC-32 of the geometry records of all transducers")
def geometry_hash_is_right(board: BoardClient) -> None:
    records = b"".join(element.pack() for element in board.read_geometry())
    got, due = board.identity.geometry_hash, zlib.crc32(records)
    check(got == due, f"geometry_hash is {got:#010x}, that of the records {due:#010x}")
