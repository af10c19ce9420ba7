"""Ultraino's Arduinos: byte tables typed from the firmware (Nano8, Nano16: not captured)."""

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptogram_protocol.dialects.table import DIALECTS
from haptogram_protocol.dialects.ultraino.arduino.operations import (
    CommitDurations,
    Forward,
    Restart,
    SetDurations,
    SetPattern,
    Swap,
)
from haptogram_protocol.dialects.ultraino.arduino.slots import (
    MEGA64_FIRMWARE,
    NANO8_FIRMWARE,
    NANO16_FIRMWARE,
    ArduinoFirmware,
    Pulse,
)
from haptogram_protocol.errors import LocalProtocolError

LAYOUTS = [MEGA64_FIRMWARE, NANO16_FIRMWARE, NANO8_FIRMWARE]
SWAP = [Swap(), Forward(0x00)]


def on_wire(slots: bytes, hops: int = 1) -> bytes:
    """Two bytes for a slot byte, typed another way than the codec does it."""
    digits = slots.hex()
    return bytes(int(digit, 16) * 16 + hops for digit in digits)


def forwards(line: bytes) -> list[Forward]:
    return [Forward(byte) for byte in line]


A, B = bytes(range(100)), bytes(range(100, 200))
# dialect, boards, bytes, operations, counters
ROWS: list[tuple[str, int, bytes, list[Any], dict[str, int]]] = [
    ("ultraino-mega64", 1, on_wire(A) + b"\x00", [SetPattern(0, 0, A), *SWAP], {}),
    (
        "ultraino-mega64",
        1,
        on_wire(A) + on_wire(B) + b"\x00",
        [SetPattern(0, 0, A), SetPattern(0, 1, B), *SWAP],
        {},
    ),
    (
        "ultraino-mega64",
        1,
        b"\x30\x30\x30\x70\xf0\xb0\x70\x30\x10",
        [
            *forwards(b"\x30\x30\x30\x70\xf0\xb0\x70\x30"),
            SetDurations(b"\x01\xe4"),
            CommitDurations(),
            Forward(0x10),
        ],
        {},
    ),
    # a chain: the second board's bytes arrive with one hop less; the third's leave the chain
    (
        "ultraino-mega64",
        2,
        on_wire(A, 1) + on_wire(B, 2) + b"\xa3\x00",
        [SetPattern(0, 0, A), SetPattern(1, 0, B), Forward(0xA1), *SWAP],
        {"bytes_beyond_chain": 1},
    ),
    # unknown bytes with a low nibble of 0 go on as byte - 1, at every board
    ("ultraino-mega64", 1, b"\x20\x80\xe0", forwards(b"\x1f\x7f\xdf"), {"bytes_strange": 3}),
    ("ultraino-mega64", 3, b"\x20", forwards(b"\x1d"), {"bytes_strange": 1}),
    # torn: half a byte keeps its high half, durations that are not four bytes count
    (
        "ultraino-mega64",
        1,
        b"\x51\xa1\x71\x00",
        [SetPattern(0, 0, b"\x5a\x70"), *SWAP],
        {"frames_short": 1},
    ),
    (
        "ultraino-mega64",
        1,
        b"\x70\x00",
        [Forward(0x70), SetDurations(b"\x40"), *SWAP],
        {"durations_short": 1, "durations_without_commit": 1},
    ),
    # behind the memory nothing is taken
    (
        "ultraino-mega64",
        1,
        on_wire(A) * 32 + b"\x11\x00",
        [*(SetPattern(0, number, A) for number in range(32)), *SWAP],
        {"halves_beyond_memory": 1},
    ),
    (
        "ultraino-mega64",
        1,
        b"\xf0" * 129 + b"\x10",
        [*forwards(b"\xf0" * 129), SetDurations(b"\xff" * 32), CommitDurations(), Forward(0x10)],
        {"durations_beyond_memory": 1},
    ),
    # Nano: 48 and 64 bytes; 10h starts over, and there are no durations
    ("ultraino-nano8", 1, on_wire(A[:24]) + b"\x00", [SetPattern(0, 0, A[:24]), *SWAP], {}),
    ("ultraino-nano16", 1, on_wire(A[:32]) + b"\x00", [SetPattern(0, 0, A[:32]), *SWAP], {}),
    (
        "ultraino-nano16",
        1,
        b"\x51\x10" + on_wire(A[:32]) + b"\x00",
        [SetPattern(0, 0, b"\x50"), Restart(), Forward(0x10), SetPattern(0, 0, A[:32]), *SWAP],
        {},
    ),
    ("ultraino-nano16", 1, b"\x30", [Forward(0x2F)], {"bytes_strange": 1}),
]


@pytest.mark.parametrize(("dialect", "boards", "line", "operations", "counters"), ROWS)
@pytest.mark.parametrize("chunk", [1, 10_000])
def test_bytes_are_these_operations_and_counts(
    dialect: str,
    boards: int,
    line: bytes,
    operations: list[Any],
    counters: dict[str, int],
    chunk: int,
) -> None:
    board = DIALECTS[dialect].board(boards=boards)
    chunks = [line[at : at + chunk] for at in range(0, len(line), chunk)]
    assert [found for part in chunks for found in board.receive_data(part)] == operations
    assert board.counters == counters


def passed_on(byte: int) -> int | None:
    """What one MEGA64 sends for *byte*, as the firmware's branches read; None if it keeps it."""
    if byte == 0x00 or byte & 0x3F == 0x30 or byte == 0x10:
        return byte
    return None if byte & 0x0F == 1 else byte - 1


@pytest.mark.parametrize("boards", [1, 2, 14])
def test_a_chain_forwards_as_its_boards_do_one_after_the_other(boards: int) -> None:
    for first in range(256):
        byte: int | None = first
        keeper = None
        for number in range(boards):
            if byte is not None:
                byte = passed_on(byte)
                keeper = number if byte is None and keeper is None else keeper
        operations = DIALECTS["ultraino-mega64"].board(boards=boards).receive_data(bytes([first]))
        assert [op.byte for op in operations if isinstance(op, Forward)] == (
            [] if byte is None else [byte]
        )
        if byte is None:
            chain = DIALECTS["ultraino-mega64"].board(boards=boards)
            found = chain.receive_data(bytes([first, 0x00]))
            assert [op.board for op in found if isinstance(op, SetPattern)] == [keeper]


@pytest.mark.parametrize("layout", LAYOUTS)
@given(data=st.data())
def test_pulses_come_back_from_their_slots(layout: ArduinoFirmware, data: st.DataObject) -> None:
    widths = st.integers(1, layout.steps - 1)
    pulse = st.builds(Pulse, st.integers(0, layout.steps - 1), widths)
    ends = st.sampled_from([Pulse(0, 0), Pulse(0, layout.steps)])
    count = len(layout.pins)
    pulses = data.draw(st.lists(pulse | ends, min_size=count, max_size=count))
    assert layout.pulses(layout.slots(pulses)) == pulses


def test_what_is_no_single_pulse_is_none_and_missing_slots_are_low() -> None:
    assert NANO8_FIRMWARE.pulses(b"\x01\x00\x01")[:2] == [None, Pulse(0, 0)]
    assert NANO8_FIRMWARE.pulses(b"\x03\x01")[:2] == [Pulse(0, 2), Pulse(0, 1)]


@pytest.mark.parametrize(
    ("pulses", "message"),
    [
        ([Pulse(0, 1)] * 7, "7 pulses; there are 8 channels"),
        ([Pulse(24, 1)] * 8, "a period has 24 slots"),
        ([Pulse(0, 25)] * 8, "a period has 24 slots"),
    ],
)
def test_pulses_that_do_not_fit_are_refused(pulses: list[Pulse], message: str) -> None:
    with pytest.raises(LocalProtocolError, match=message):
        NANO8_FIRMWARE.slots(pulses)


@pytest.mark.parametrize(
    ("dialect", "operation", "message"),
    [
        ("ultraino-mega64", SetPattern(1, 0, b""), "board 1; the chain has 1"),
        ("ultraino-mega64", SetPattern(0, 0, bytes(101)), "101 bytes; it has 100"),
        ("ultraino-mega64", SetDurations(b""), "0 durations; there are 1 to 32"),
        ("ultraino-mega64", Restart(), "ultraino-mega64 has no bytes for Restart"),
        ("ultraino-mega64", Forward(7), "no bytes for Forward"),
        ("ultraino-nano16", CommitDurations(), "no bytes for CommitDurations"),
        ("ultraino-nano16", SetDurations(b"\1"), "no bytes for SetDurations"),
    ],
)
def test_the_host_refuses_what_no_board_takes(dialect: str, operation: Any, message: str) -> None:
    with pytest.raises(LocalProtocolError, match=message):
        DIALECTS[dialect].host().send(operation)


def test_a_chain_has_up_to_14_boards() -> None:
    for boards in (0, 15):
        with pytest.raises(LocalProtocolError, match=f"{boards} boards; it has 1 to 14"):
            DIALECTS["ultraino-mega64"].board(boards=boards)


def test_echoes_are_ignored_and_counted() -> None:
    host = DIALECTS["ultraino-mega64"].host()
    assert host.receive_data(b"\x30\x00") == []
    assert host.counters == {"bytes_ignored": 2}
