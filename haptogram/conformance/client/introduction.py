"""What is at the other end of a port: a board, and which, or why none is."""

from __future__ import annotations

from haptogram_protocol.messages import Feature, HelloReply

from .board_client import Bench


def explain_silence(bench: Bench) -> str:
    """Return why HELLO was not answered, from what came instead."""
    wire = bench.wire
    if not wire.heard:
        return "the port is silent: nothing came back to HELLO"
    if not any(piece.header is not None for piece in wire.received):
        return f"{wire.heard} bytes came, but no frame: not a board, or another line rate"
    if not any(piece.is_response or piece.is_event for piece in wire.received):
        return "the port sends back what is written to it; no board answers"
    return "frames came, but no answer to HELLO"


def describe_device(reply: HelloReply) -> dict[str, object]:
    """Return what a board says of itself, for reports."""
    known = Feature(reply.features & sum(Feature))
    return {
        "firmware": reply.firmware,
        "protocol": f"{reply.major}.{reply.minor}",
        "boot_id": f"{reply.boot_id:#010x}",
        "transducers": reply.transducers,
        "carrier_hz": reply.carrier_hz,
        "features": [str(feature.name) for feature in known],
    }
