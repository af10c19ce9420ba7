"""HG-7.5: positions of the transducers, and every span of them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from haptogram_protocol.messages import (
    Element,
    ErrorCode,
    GeometryReply,
    GetGeometry,
)

from ...case import case
from ...client.board_client import BoardClient
from ...outcome import check, check_equal, require

_ELEMENTS_IN_FRAME: Final = (4075 - 14) // 18


def _judge_span(board: BoardClient, whole: Sequence[Element], first: int, asked: int) -> None:
    """FAILED unless GET_GEOMETRY shows the elements of a span that *whole* shows."""
    reply = board.link.call(GetGeometry(first, asked), GeometryReply)
    count = board.identity.transducers
    got = (reply.total, reply.first, len(reply.elements))
    due = (count, first, min(asked, count - first, _ELEMENTS_IN_FRAME))
    check(got == due, f"{asked} from {first}: (total, first, count) is {got}, due {due}")
    known = tuple(whole[first : first + asked][: len(reply.elements)])
    text = f"{asked} from {first}: others are shown than in a reply from 0 on"
    check_equal(reply.elements[: len(known)], known, text)


@case("HG-7.5/2")
def geometry_has_no_more_transducers(board: BoardClient) -> None:
    """GET_GEOMETRY from N on is refused with NOT_FOUND, detail N"""
    count = board.identity.transducers
    for first in (count, count + 1, 0xFFFF):
        board.link.refused(GetGeometry(first, 1), ErrorCode.NOT_FOUND, count)


@case("HG-7.5/3")
def geometry_is_the_grid(board: BoardClient) -> None:
    """GET_GEOMETRY is the grid of HELLO_REPLY: pitch, z = 0, normals (0, 0, 32767)"""
    nx, ny, pitch_um = board.identity.grid_nx, board.identity.grid_ny, board.identity.pitch_um
    require(bool(nx * ny), "this board is no grid")
    for n, element in enumerate(board.read_geometry()):
        ix, iy = divmod(n, ny)
        due_um = ((ix - (nx - 1) / 2) * pitch_um, (iy - (ny - 1) / 2) * pitch_um, 0)
        got_um = (element.x_um, element.y_um, element.z_um)
        near = all(abs(got - due) < 1 for got, due in zip(got_um, due_um, strict=True))
        grid = f"a grid of {nx} x {ny} and {pitch_um} µm"
        check(near, f"transducer {n} is at {got_um} µm, due by {grid} is {due_um}")
        normal = (element.nx, element.ny, element.nz)
        check_equal(normal, (0, 0, 32_767), f"the normal of transducer {n} is {normal}")


def spans_of_elements(count: int) -> list[tuple[int, int]]:
    """Return (first, count) at and around every edge of an array of *count*."""
    firsts = {0, 1, count // 2, count - 1} & set(range(count))
    counts = {0, 1, 2, count - 1, count, count + 1, 0xFFFF}
    return sorted((first, number) for first in firsts for number in counts if number >= 0)


def _judge_geometry(board: BoardClient) -> None:
    """FAILED unless spans at and around every edge show the elements that the whole shows."""
    whole, total = board.read_geometry(), board.identity.transducers
    for first, count in spans_of_elements(total):
        _judge_span(board, whole, first, count)


@case("HG-7.5/1")
def shows_its_geometry(board: BoardClient) -> None:
    """GET_GEOMETRY of one, some and too many transducers shows those from first on"""
    _judge_geometry(board)


@case("HG-7.5/1-spans")
def every_span_of_the_geometry(board: BoardClient) -> None:
    """GET_GEOMETRY of spans at and around every edge shows the elements that the whole shows"""
    _judge_geometry(board)
    total = board.identity.transducers
    for first in (total, 0xFFFF):
        board.link.refused(GetGeometry(first, 1), ErrorCode.NOT_FOUND, total)
