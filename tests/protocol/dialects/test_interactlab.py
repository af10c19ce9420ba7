"""InteractLab: byte tables typed from the HDL (no client was captured that sends side data)."""

from typing import Any

import pytest

from haptogram_protocol.dialects.interactlab import (
    InteractlabBoardEnd,
    InteractlabHostEnd,
    QueueFrame,
)
from haptogram_protocol.errors import LocalProtocolError

PHASES = bytes(range(128)) * 2
DUTIES = bytes([64] * 256)


def marked(*places: int) -> bytes:
    """A frame with bit 7 at byte 0 and at *places*."""
    frame = bytearray(PHASES + DUTIES)
    for place in (0, *places):
        frame[place] |= 0x80
    return bytes(frame)


# bytes, frames, counters
ROWS: list[tuple[bytes, list[QueueFrame], dict[str, int]]] = [
    (marked(), [QueueFrame(PHASES, DUTIES)], {}),
    (marked(25), [QueueFrame(PHASES, DUTIES, colour=0)], {}),
    (marked(1, 9, 24, 25), [QueueFrame(PHASES, DUTIES, colour=0x800101)], {}),
    (marked(28, 34), [QueueFrame(PHASES, DUTIES, divider=4)], {}),
    (
        marked(*range(1, 35)),
        [QueueFrame(PHASES, DUTIES, colour=0xFFFFFF, divider=0xFF)],
        {},
    ),
    (marked(1, 26), [QueueFrame(PHASES, DUTIES)], {}),  # colour and divider that nothing applies
    (b"\x00\x7f" + marked(), [QueueFrame(PHASES, DUTIES)], {"bytes_outside_frame": 2}),
    (marked(35, 255, 256, 511), [QueueFrame(PHASES, DUTIES)], {"start_bits_in_frame": 4}),
    (
        b"\x80" + bytes(255) + b"\x41\x40\x7f" + bytes(253),
        [QueueFrame(bytes(256), b"\x41\x40\x7f" + bytes(253))],
        {"duties_above_full": 2},
    ),
    (marked()[:511], [], {}),
]


@pytest.mark.parametrize(("line", "frames", "counters"), ROWS)
@pytest.mark.parametrize("chunk", [1, 5000])
def test_bytes_are_these_frames_and_counts(
    line: bytes, frames: list[QueueFrame], counters: dict[str, int], chunk: int
) -> None:
    board = InteractlabBoardEnd()
    chunks = [line[at : at + chunk] for at in range(0, len(line), chunk)]
    assert [found for part in chunks for found in board.receive_data(part)] == frames
    assert board.counters == counters
    assert board.pending == (len(line) if not frames else 0)


def test_after_a_lost_byte_frames_stay_out_of_step() -> None:
    """511 more bytes are always taken: the start of the next frame is its last byte."""
    board = InteractlabBoardEnd()
    assert board.receive_data(marked()[:-1] + marked()) == [
        QueueFrame(PHASES, DUTIES[:-1] + PHASES[:1])
    ]
    assert board.counters == {"start_bits_in_frame": 1, "bytes_outside_frame": 511}


@pytest.mark.parametrize(
    ("frame", "message"),
    [
        (QueueFrame(PHASES[:255], DUTIES), "phases: 256 values of 0 to 127"),
        (QueueFrame(PHASES, b"\x80" + DUTIES[1:]), "duties: 256 values of 0 to 127"),
        (QueueFrame(PHASES, DUTIES, colour=1 << 24), "colour 16777216; it has 24 bits"),
        (QueueFrame(PHASES, DUTIES, divider=-1), "divider -1; it has 8 bits"),
    ],
)
def test_the_host_refuses_values_that_do_not_fit(frame: Any, message: str) -> None:
    with pytest.raises(LocalProtocolError, match=message):
        InteractlabHostEnd().send(frame)
