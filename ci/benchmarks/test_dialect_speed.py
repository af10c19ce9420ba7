"""Foreign wires: decoding alone and with their boards, against the line and the rate of frames."""

import random

import pytest

from haptogram.settings.board import BoardConfig
from haptogram_protocol.dialects.autd3 import messages as link
from haptogram_protocol.dialects.autd3.frame import Autd3DeviceFrame
from haptogram_protocol.dialects.autd3.operations import Gain
from haptogram_protocol.dialects.interactlab import QueueFrame
from haptogram_protocol.dialects.table import DIALECTS
from haptogram_protocol.dialects.ultraino.arduino import operations as nibbles
from sim_device.blueprint import blueprint_of

CHUNK = 4096  # bytes, as a pseudo-terminal hands them out
BITS = 10  # of a byte on a serial line, 8N1
TIMES_LINE = 10  # decoding is at least so many times as fast as the line
FRAMES_PER_S = 5_000  # of autd3, which has no baud rate
FRAMES = 50
FRAME_US = 25_000


def shown(dialect, codes, boards=1):
    """Return the operations that show *codes*."""
    return DIALECTS[dialect].display(boards).frame(codes)


source = random.Random(9)
codes = bytes(source.randrange(33) for _ in range(256))
# What a client sends over and over: options of both ends, the beginning, and a frame.
CLIENTS = {
    "sonicsurface": ({}, [], shown("sonicsurface", codes)),
    "sonicsurface-tactile": ({}, [], shown("sonicsurface", codes)),
    "ultraino-fpga": ({}, [], shown("ultraino-fpga", codes)),
    "ultraino-fpga-128": (
        {},
        [],
        shown("ultraino-fpga-128", source.randbytes(72).translate(bytes(range(128)) * 2)),
    ),
    "ultraino-fpga-chained": ({"boards": 2}, [], shown("ultraino-fpga-chained", codes * 2, 2)),
    "ultraino-mega64": (
        {},
        [],
        shown("ultraino-mega64", [source.randrange(10) for _ in range(64)]),
    ),
    "ultraino-nano8": ({}, [], [nibbles.SetPattern(0, 0, source.randbytes(24)), nibbles.Swap()]),
    "ultraino-nano16": ({}, [], [nibbles.SetPattern(0, 0, source.randbytes(32)), nibbles.Swap()]),
    "interactlab": ({}, [], [QueueFrame(codes, bytes([64] * 256), colour=77, divider=4)]),
    "autd3": (
        {},
        [link.Hello(), link.Open((link.Pose((0, 0, 0), (1, 0, 0, 0)),))],
        [
            link.Write((Autd3DeviceFrame(number, (Gain(0, True, source.randbytes(498)),)),))
            for number in range(2)  # ids must change
        ],
    ),
}


# Noise ends a link of autd3 with its first byte.
ROWS = [
    (name, content)
    for name, dialect in DIALECTS.items()
    for content in (["frames", "noise"] if dialect.bauds else ["frames"])
]


def chunks(line):
    return [line[at : at + CHUNK] for at in range(0, len(line), CHUNK)]


def decoding(name, line):
    """Return a call that decodes *line* and counts the operations."""
    options, beginning, _ = CLIENTS[name]
    board, host = DIALECTS[name].board(**options), DIALECTS[name].host(**options)
    board.receive_data(b"".join(map(host.send, beginning)))
    return lambda: sum(len(board.receive_data(chunk)) for chunk in chunks(line))


def frames(name):
    options, beginning, operations = CLIENTS[name]
    host = DIALECTS[name].host(**options)
    for operation in beginning:
        host.send(operation)
    return b"".join(map(host.send, operations)) * FRAMES


@pytest.mark.row("decoder of {dialect}, {content}")
@pytest.mark.parametrize(("dialect", "content"), ROWS)
def test_dialect_decoding(dialect, content, measure, benchmark):
    """The board's end, from bytes to operations; noise is random bytes of the same length."""
    line = frames(dialect)
    if content == "noise":
        line = random.Random(1).randbytes(len(line))
    decode = decoding(dialect, line)
    assert content == "noise" or decode() >= len(CLIENTS[dialect][2]) * FRAMES
    measure(decode, bytes=len(line))
    bytes_per_s = len(line) / benchmark.extra_info["ours_s"]
    baud = max(DIALECTS[dialect].bauds, default=None)
    if baud is not None:
        reached, least, of = bytes_per_s * BITS / baud, TIMES_LINE, "its line"
    else:
        per_s = 2 * FRAMES / benchmark.extra_info["ours_s"]
        reached, least, of = per_s, FRAMES_PER_S, "frames/s"
    benchmark.extra_info.update(reached=reached, least=least, of=of)


def latching(name, line):
    """Return a call that lets the boards of a dialect take *line*, and counts their latches."""
    options, beginning, _ = CLIENTS[name]
    words = tuple(f"{option}={value}" for option, value in options.items())
    blueprint = blueprint_of(BoardConfig.of(dialect=name, dialect_option=words))
    boards = blueprint.parts.assemble(blueprint.settings)
    host = DIALECTS[name].host(**options)
    boards.receive(b"".join(map(host.send, beginning)), boards.now_us)
    pieces, at = [], 0
    while at < len(line):
        pieces.append(line[at : at + len(line) // FRAMES])
        at += len(pieces[-1])

    def latch():
        count = 0
        for piece in pieces:
            boards.receive(piece, boards.now_us + FRAME_US)
            boards.take_output()
            count += len(boards.take_latches())
        return count

    return latch


@pytest.mark.row("boards of {dialect}, from bytes to latches")
@pytest.mark.parametrize("dialect", DIALECTS)
def test_dialect_boards(dialect, measure, benchmark):
    """Codec, boards and weights of their emitters, a frame every 25 ms."""
    line = frames(dialect)
    latch = latching(dialect, line)
    assert latch() > FRAMES // 2
    measure(latch, bytes=len(line))
    benchmark.extra_info.update(latches_per_s=FRAMES / benchmark.extra_info["ours_s"])
