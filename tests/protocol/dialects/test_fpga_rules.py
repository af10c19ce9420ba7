"""SonicSurface and Ultraino FPGAs: byte tables typed from the HDL, and what is counted."""

from typing import Any

import pytest

from haptogram_protocol.dialects.fpga_bytes.operations import (
    Begin,
    BeginAmplitudes,
    Clocks,
    ModulationStep,
    Select,
    SetAmplitudes,
    SetPhases,
    Swap,
    ToggleMultiplex,
)
from haptogram_protocol.dialects.sonicsurface import TACTILE_CORRECTION
from haptogram_protocol.dialects.table import DIALECTS
from haptogram_protocol.errors import LocalProtocolError

RAMP = bytes(range(32)) * 8
OFF = bytes([32] * 256)
BOTH = {"boards": 2}


def phases(codes: bytes, first: int = 0, boards: tuple[int, ...] = (0,)) -> SetPhases:
    return SetPhases(boards, first, codes)


# dialect, options, bytes, operations, counters
ROWS: list[tuple[str, dict[str, Any], bytes, list[Any], dict[str, int]]] = [
    # the frame, the toggle, the clocks
    ("sonicsurface", {}, b"\xfe" + RAMP + b"\xfd", [Begin(), phases(RAMP), Swap()], {}),
    ("sonicsurface", {}, b"\xfd\xfd", [Swap(), Swap()], {}),
    ("sonicsurface", {}, b"\x96\x97", [Clocks(False), Clocks(True)], {}),
    # a plain frame drives both boards of a stack; C0 and C1 choose one; the ESP32's frame of 516
    ("sonicsurface", BOTH, b"\xfe" + OFF + b"\xfd", [Begin(), phases(OFF, 0, (0, 1)), Swap()], {}),
    (
        "sonicsurface",
        BOTH,
        b"\xfe\xc0" + RAMP + b"\xc1" + OFF + b"\xfd",
        [Begin(), Select(0), phases(RAMP), Select(1), phases(OFF, 0, (1,)), Swap()],
        {},
    ),
    ("sonicsurface", {}, b"\xc1\x05\xfd", [Select(1), Swap()], {"codes_unheard": 1}),
    # masks, and bytes that the HDL takes as codes
    (
        "sonicsurface",
        {},
        b"\xfe\x21\x7f\xa3\x20\xfd",
        [Begin(), phases(b"\x01\x1f\x03\x20"), Swap()],
        {"codes_out_of_range": 3, "frames_short": 1},
    ),
    (
        "sonicsurface",
        {},
        b"\xfe" + RAMP + b"\x07\xfd",
        [Begin(), phases(RAMP), phases(b"\x07"), Swap()],
        {"codes_beyond_array": 1},
    ),
    (
        "sonicsurface",
        {},
        b"\x07\xfd",
        [phases(b"\x07"), Swap()],
        {"codes_outside_frame": 1, "frames_short": 1},
    ),
    (
        "sonicsurface",
        {},
        b"\xfe\x01\x02\xfe" + RAMP + b"\xfe" + OFF + b"\xfd",
        [Begin(), phases(b"\x01\x02"), Begin(), phases(RAMP), Begin(), phases(OFF), Swap()],
        {"frames_cut_short": 1, "frames_without_commit": 1},
    ),
    # tactile: the modulation's step; C0, C1, 96 and 97 are codes
    (
        "sonicsurface-tactile",
        {},
        b"\xa0\xaa\xbf",
        [ModulationStep(0), ModulationStep(10), ModulationStep(31)],
        {},
    ),
    (
        "sonicsurface-tactile",
        {},
        b"\xfe\xc0\xc1\x96\x97\xfd",
        [Begin(), phases(b"\x00\x01\x16\x17"), Swap()],
        {"codes_out_of_range": 4, "frames_short": 1},
    ),
    # Ultraino: FB and FC by option; C0 + number alone; 72 channels
    (
        "ultraino-fpga",
        {"fb": "amplitude"},
        b"\xfe" + RAMP + b"\xfb" + bytes([16] * 256) + b"\xfd\xfc",
        [
            *(Begin(), phases(RAMP), BeginAmplitudes()),
            *(SetAmplitudes((0,), 0, bytes([16] * 256)), Swap(), ToggleMultiplex()),
        ],
        {},
    ),
    (
        "ultraino-fpga",
        {},
        b"\xfe\xfb\xfc\xfd",
        [Begin(), phases(b"\x1b\x1c"), Swap()],
        {"codes_out_of_range": 2, "frames_short": 1},
    ),
    (
        "ultraino-fpga-chained",
        {"boards": 3},
        b"\xc2" + RAMP + b"\xc0" + OFF + b"\xfd",
        [Select(2), phases(RAMP, 0, (2,)), Select(0), phases(OFF), Swap()],
        {},
    ),
    # torn frames of a chain, and frames of amplitudes
    (
        "ultraino-fpga-chained",
        {"boards": 2},
        b"\xc0" + RAMP + b"\xc1\x01\xc0" + OFF + b"\xc1\x02\xfd",
        [
            *(Select(0), phases(RAMP), Select(1), phases(b"\x01", 0, (1,))),
            *(Select(0), phases(OFF), Select(1), phases(b"\x02", 1, (1,)), Swap()),
        ],
        {
            "frames_without_commit": 1,
            "codes_beyond_array": 256,
            "frames_cut_short": 1,
            "frames_short": 1,
        },
    ),
    (
        "ultraino-fpga",
        {"fb": "amplitude"},
        b"\xfe\x01\xfb\x10\x11\xfe",
        [
            *(Begin(), phases(b"\x01"), BeginAmplitudes()),
            *(SetAmplitudes((0,), 0, b"\x10\x11"), Begin()),
        ],
        {"frames_cut_short": 2, "codes_out_of_range": 1},
    ),
    (
        "ultraino-fpga-128",
        {},
        b"\xfe" + bytes(range(57, 129)) + b"\x01\xfd",
        [Begin(), phases(bytes(range(57, 129))), Swap()],
        {"codes_beyond_array": 1},
    ),
]


@pytest.mark.parametrize(("dialect", "options", "line", "operations", "counters"), ROWS)
@pytest.mark.parametrize("chunk", [1, 1000])
def test_bytes_are_these_operations_and_counts(
    dialect: str,
    options: dict[str, Any],
    line: bytes,
    operations: list[Any],
    counters: dict[str, int],
    chunk: int,
) -> None:
    board = DIALECTS[dialect].board(**options)
    chunks = [line[at : at + chunk] for at in range(0, len(line), chunk)]
    assert [found for part in chunks for found in board.receive_data(part)] == operations
    assert board.counters == counters


def test_one_lost_byte_shifts_the_channels_behind_it_until_the_swap() -> None:
    board = DIALECTS["sonicsurface"].board()
    line = b"\xfe" + RAMP[:100] + RAMP[101:] + b"\xfd" + b"\xfe" + RAMP + b"\xfd"
    _, torn, _, _, whole, _ = board.receive_data(line)
    assert torn == phases(RAMP[:100] + RAMP[101:])
    assert whole == phases(RAMP)
    assert board.counters == {"frames_short": 1}


def test_the_tactile_table_turns_117_emitters_round() -> None:
    assert len(TACTILE_CORRECTION) == 256
    assert sum(12 <= steps <= 20 for steps in TACTILE_CORRECTION) == 117


@pytest.mark.parametrize(
    ("dialect", "options", "operations", "message"),
    [
        ("sonicsurface", {}, [Begin(), phases(b"\x21")], "code 33 .* largest one is 32"),
        ("sonicsurface", {}, [ModulationStep(3)], "sonicsurface has no bytes for ModulationStep"),
        ("sonicsurface", {}, [phases(RAMP, 0, (0, 1))], r"boards \(0,\) listen"),
        ("sonicsurface", BOTH, [Select(1), phases(RAMP)], r"boards \(1,\) listen"),
        ("sonicsurface", {}, [Select(1), phases(b"", 0, ())], None),
        ("sonicsurface", {}, [Begin(), phases(b"\x01", 7)], "write channel 0 next"),
        ("sonicsurface", {}, [phases(RAMP + b"\x01")], "257 codes .* have 256 channels"),
        ("ultraino-fpga-128", {}, [phases(bytes(73))], "73 codes .* have 72 channels"),
        ("ultraino-fpga", {}, [BeginAmplitudes()], "no bytes for BeginAmplitudes"),
        (
            "ultraino-fpga",
            {"fb": "amplitude"},
            [BeginAmplitudes(), SetAmplitudes((0,), 0, b"\x11")],
            "code 17 .* largest one is 16",
        ),
        ("ultraino-fpga", {"fb": "amplitude"}, [SetAmplitudes((0,), 0, b"")], "select and begin"),
    ],
)
def test_the_host_sends_only_what_arrives_as_meant(
    dialect: str, options: dict[str, Any], operations: list[Any], message: str | None
) -> None:
    host = DIALECTS[dialect].host(**options)
    *before, last = operations
    for operation in before:
        host.send(operation)
    if message is None:
        assert host.send(last) == b""
        return
    with pytest.raises(LocalProtocolError, match=message):
        host.send(last)


@pytest.mark.parametrize(
    ("dialect", "options", "message"),
    [
        ("sonicsurface", {"boards": 0}, "0 boards; a wire has at least one"),
        (
            "ultraino-fpga",
            {"fb": "phases"},
            "fb='phases'; it is one of 'falls-through', 'amplitude'",
        ),
        ("ultraino-fpga-chained", {"boards": 17}, "a chain of 17 boards; it has 1 to 16"),
    ],
)
def test_options_out_of_range_are_refused(
    dialect: str, options: dict[str, Any], message: str
) -> None:
    for end in (DIALECTS[dialect].board, DIALECTS[dialect].host):
        with pytest.raises(LocalProtocolError, match=message):
            end(**options)
