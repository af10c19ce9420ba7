"""Fuzz the decoder, both ends of the link and other dialects, guided by what their code does.

::

    ci/fuzz [INPUTS [SEED]]

Needs atheris, which marks the branches of the protocol as it is imported.
What must hold of any bytes whatever: nothing is raised; what comes in one piece is found as what
comes in many; what was taken for a frame is a frame when it is built again; every frame is
counted once; and nothing is kept that was not bounded.
"""

from __future__ import annotations

import struct
import sys
from pathlib import Path
from typing import Any

_INPUTS, _SEED = 50_000, 1
_LONGEST = 5000  # longer than any frame, so that a run can be too long
_MAX_INPUT = 600  # two frames of 16 x 16 transducers
_BYTEWISE = 100  # shorter inputs come byte by byte,
_MAX_PENDING = 64 * 626  # the largest message of a dialect: frames of 64 devices of autd3
_PIECE = 61  # longer ones in pieces, for the sake of speed
_DAMAGE = ("crc", "cobs", "short", "oversize")
_MISSING = "ci/fuzz: atheris is not installed; it has wheels for CPython 3.11 to 3.13 on Linux"


def main(arguments: list[str]) -> int:
    """Run; libFuzzer ends the process itself, with status 0 if nothing was found."""
    if len(arguments) > 2 or not all(word.isdecimal() for word in arguments):
        sys.stderr.write("usage: ci/fuzz [INPUTS [SEED]]\n")
        return 2
    inputs, seed = (*(int(word) for word in arguments), *(_INPUTS, _SEED)[len(arguments) :])
    try:
        import atheris
    except ImportError:
        sys.stderr.write(f"{_MISSING}\n")
        return 2
    root = Path(__file__).resolve().parent.parent
    sys.path[:0] = [str(root / "protocol"), str(root)]
    with atheris.instrument_imports(include=["haptogram_protocol"]):
        import haptogram_protocol.connection
        import haptogram_protocol.dialects.table
        import haptogram_protocol.messages  # noqa: F401
    options = [
        f"-runs={inputs}",
        f"-seed={seed}",
        f"-max_len={_MAX_INPUT}",
        "-artifact_prefix=out/",
        "-print_final_stats=1",
    ]
    atheris.Setup([sys.argv[0], *options], check, enable_python_coverage=True)
    atheris.Fuzz()
    return 0


def check(data: bytes) -> None:
    """Check decoder, board and host with *data*; the first byte chooses its form."""
    if not data:
        return
    wire = _as_frames(data[1:]) if data[0] % 2 else data[1:]
    if data[0] % 4 == 2 and wire and 0 not in wire:  # a run that is too long, of a short input
        wire = (wire * _LONGEST)[:_LONGEST]
    _check_decoder(wire)
    _check_board(wire)
    _check_host(wire)
    _check_dialect(data[0], data[1:])


def _as_frames(data: bytes) -> bytes:
    """Return *data* as frames with valid CRCs, cut at every ``FF``: a fuzzer guesses no CRC."""
    from haptogram_protocol.framing import MAX_BODY_BYTES, encode_frame

    return b"".join(encode_frame(body[:MAX_BODY_BYTES]) for body in data.split(b"\xff"))


def _check_decoder(wire: bytes) -> None:
    from haptogram_protocol.errors import RemoteProtocolError
    from haptogram_protocol.framing import (
        MAX_ENCODED_BYTES,
        FrameDecoder,
        decode_frame,
        encode_frame,
    )

    whole, pieces = FrameDecoder(), FrameDecoder()
    found = whole.feed(wire)
    again: list[bytes | RemoteProtocolError] = []
    step = 1 if len(wire) < _BYTEWISE else _PIECE
    for place in range(0, len(wire), step):
        again += pieces.feed(wire[place : place + step])
        assert pieces.buffered <= MAX_ENCODED_BYTES
    assert [_name(item) for item in found] == [_name(item) for item in again]
    for body in found:
        if isinstance(body, bytes):
            assert decode_frame(encode_frame(body)[1:-1]) == body


def _name(found: Any) -> Any:
    return found if isinstance(found, bytes) else found.reason


def _check_board(wire: bytes) -> None:
    from haptogram_protocol.connection import NEED_DATA, OUTPUT_LIMIT, BoardConnection, FrameDropped

    board = BoardConnection()
    board.open_session(0xFFFF)
    board.receive_data(wire, 0)
    events = []
    while (event := board.next_event()) is not NEED_DATA:
        events.append(event)
    reasons = [event.reason for event in events if isinstance(event, FrameDropped)]
    damaged = sum(reason in _DAMAGE for reason in reasons)
    assert board.counters["frames"] == len(events) - damaged
    for reason in _DAMAGE:
        assert board.counters[reason] == reasons.count(reason)
    assert board.output_bytes <= OUTPUT_LIMIT


def _check_host(wire: bytes) -> None:
    from haptogram_protocol.connection import NEED_DATA, FrameDropped, HostConnection

    host = HostConnection(nonce=1)
    host.send_hello(0)
    host.receive_data(wire, 0)
    events = []
    while (event := host.next_event()) is not NEED_DATA:
        events.append(event)
    damaged = sum(isinstance(e, FrameDropped) and e.reason in _DAMAGE for e in events)
    assert host.counters["frames"] == len(events) - damaged
    assert host.outstanding <= 1


def _check_dialect(number: int, wire: bytes) -> None:
    """Check the board's end of another dialect: the same in pieces, and nothing without a bound."""
    from haptogram_protocol.dialects.table import DIALECTS

    dialect = list(DIALECTS.values())[number % len(DIALECTS)]
    whole, pieces = dialect.board(), dialect.board()
    if dialect.name == "autd3":
        wire = _as_session(wire)
    found, again, place = whole.receive_data(wire), list[Any](), 0
    while place < len(wire):
        end = pieces.next_frame_end(wire, place)
        assert place < end <= len(wire)
        again += pieces.receive_data(wire[place:end])
        assert pieces.pending <= _MAX_PENDING
        place = end
    assert found == again
    assert whole.counters == pieces.counters
    assert whole.pending == pieces.pending
    _check_boards(dialect.name, found)


def _as_session(data: bytes) -> bytes:
    """Return *data* as what a client of AUTD3 sends to one device: a fuzzer guesses no handshake.

    Each piece between bytes FFh is the payload of a frame; an empty one asks for the answer.
    """
    line = bytes.fromhex("10 0100") + b"AUTD3REMOTE" + b"\x01" + struct.pack("<I7f", 1, *[0.0] * 7)
    for number, piece in enumerate(data.split(b"\xff")):
        head = struct.pack("<BxH", number % 16, piece[0] if number % 3 == 2 and piece else 0)
        line += b"\x03" + (head + piece).ljust(626, b"\0")[:626] if piece else b"\x04"
    return line


def _check_boards(name: str, operations: list[Any]) -> None:
    """Check the boards of a dialect: whatever they are asked, they latch all channels."""
    from sim_device.dialects.table import EMULATIONS

    emulation = EMULATIONS[name]
    options = emulation.options.of()
    unit, end, t_us = emulation.unit(options, 0), emulation.end(options), 0
    for operation in operations:
        for reply in unit.take(operation, t_us):
            end.send(reply)
        t_us += 20_000
        while (next_us := unit.next_event_us()) is not None and next_us <= t_us:
            unit.advance_to(next_us)
    assert len({latch.pulses.count for latch in unit.take_latches()}) == 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
