"""What unmodified clients sent decodes to their own figures, code for code, and re-encodes."""

import cmath
import json
import math
from pathlib import Path
from typing import Any

import pytest

from dialect_frames import (
    chained_ultraino_frame,
    mega64_frame,
    sonicsurface_frame,
    ultraino_fpga_frame,
)
from haptogram_protocol.dialects.codec import Operation
from haptogram_protocol.dialects.fpga_bytes.operations import Begin, SetAmplitudes, SetPhases, Swap
from haptogram_protocol.dialects.interactlab import FULL_DUTY, QueueFrame
from haptogram_protocol.dialects.table import DIALECTS
from haptogram_protocol.dialects.ultraino.arduino import operations as nibbles
from haptogram_protocol.dialects.ultraino.arduino.slots import MEGA64_FIRMWARE, Pulse

DATA = Path(__file__).parents[2] / "data" / "dialects"
EXPECTED: dict[str, Any] = json.loads((DATA / "expected.json").read_text())
# For each device what decodes it; a board with amplitudes takes all that SimpleFPGA sends.
DEVICES = {
    "SimpleFPGA": ("ultraino-fpga", {"fb": "amplitude"}),
    "SimpleFPGA_128": ("ultraino-fpga-128", {}),
    "ChainedFPGA": ("ultraino-fpga-chained", {"boards": 2}),
    "MEGA": ("ultraino-mega64", {}),
    "MEGA_Anim": ("ultraino-mega64", {}),
}


def line(name: str) -> bytes:
    return (DATA / f"{name}.bin").read_bytes()


def dialect(name: str) -> tuple[str, dict[str, Any]]:
    device = EXPECTED[name].get("device")
    return DEVICES[device] if device else (name.split("/")[0], {})


def decoded(name: str, **options: Any) -> list[Operation]:
    wire, usual = dialect(name)
    board = DIALECTS[wire].board(**(usual | options))
    operations = board.receive_data(line(name))
    assert not board.pending
    return operations


def named(*parts: str) -> list[str]:
    return [name for name in EXPECTED if any(name.startswith(part) for part in parts)]


def latched(operations: list[Operation], channels: int, boards: int = 1) -> list[int]:
    """Play the operations on two buffers that swap; return the codes that radiate in the end."""
    shown, next_ = [[0] * channels for _ in range(boards)], [[0] * channels for _ in range(boards)]
    for operation in operations:
        if isinstance(operation, SetPhases):
            for board in operation.boards:
                end = operation.first + len(operation.codes)
                next_[board][operation.first : end] = operation.codes
        elif isinstance(operation, Swap):
            shown, next_ = next_, shown
    return [code for of_board in shown for code in of_board]


@pytest.mark.parametrize("name", named("sonicsurface"))
def test_sonicsurface(name: str) -> None:
    operations = decoded(name)
    assert sum(isinstance(operation, Swap) for operation in operations) == EXPECTED[name]["commits"]
    assert latched(operations, 256) == EXPECTED[name]["codes"]


@pytest.mark.parametrize("name", named("ultraino/simplefpga_", "ultraino/chained"))
def test_ultraino_fpga(name: str) -> None:
    expected = EXPECTED[name]["codes"]
    codes = latched(decoded(name), 256, len(expected) // 256)
    assert codes == expected


def test_ultraino_fpga_128_drives_72_of_the_client_s_channels() -> None:
    name = "ultraino/simplefpga128_ss_focus_0_120_0"
    assert latched(decoded(name), 72) == EXPECTED[name]["codes"][:72]


def test_amplitudes_fall_through_as_phases_on_the_published_board() -> None:
    """The client's amplitudes leave none of 256 codes right."""
    name = "ultraino/simplefpga_ss_amp50_0_120_0"
    operations = decoded(name, fb="falls-through")
    codes, expected = latched(operations, 256), EXPECTED[name]["codes"]
    assert codes == [8] * 256
    assert sum(code == right for code, right in zip(codes, expected, strict=True)) == 0
    board = DIALECTS["ultraino-fpga"].board()
    board.receive_data(line(name))
    assert board.counters == {"codes_beyond_array": 257, "codes_out_of_range": 1}
    amplitudes = [op for op in decoded(name) if isinstance(op, SetAmplitudes)]
    assert [op.codes for op in amplitudes] == [bytes([8] * 256)]  # half of 16


@pytest.mark.parametrize("name", named("ultraino/mega"))
def test_ultraino_mega(name: str) -> None:
    expected = EXPECTED[name]
    operations = decoded(name)
    patterns = [op for op in operations if isinstance(op, nibbles.SetPattern)]
    assert [(op.board, op.pattern) for op in patterns] == [(0, 0)]
    amplitudes = expected.get("amplitudes", [1] * 64)
    widths = [round(amplitude * 5 + 1e-9) for amplitude in amplitudes]  # Java rounds halves up
    wanted = [
        Pulse(code if width else 0, width)
        for code, width in zip(expected["codes"], widths, strict=True)
    ]
    assert MEGA64_FIRMWARE.pulses(patterns[0].slots) == wanted
    assert MEGA64_FIRMWARE.slots(wanted) == patterns[0].slots
    forwarded = bytes(op.byte for op in operations if isinstance(op, nibbles.Forward))
    assert forwarded == line(name)[200:]
    durations = (1, 0) if expected["device"] == "MEGA" else (0,)
    assert nibbles.SetDurations(bytes(durations)) in operations


def test_interactlab_focuses_where_the_client_aimed() -> None:
    name = "interactlab/levitate_focus_0_0_100"
    expected = EXPECTED[name]
    off, focus = decoded(name)
    assert off == QueueFrame(bytes(256), bytes(256))
    assert isinstance(focus, QueueFrame)
    assert focus.duties == bytes([FULL_DUTY] * 256)
    total = best = 0j
    for code, position in zip(focus.phases, expected["positions_m"], strict=True):
        distance = math.dist(position, expected["target_m"])
        phase = 2 * math.pi * code / 128 + expected["k"] * distance
        total += cmath.exp(-1j * phase) / distance
        best += 1 / distance
    assert abs(total / best) == pytest.approx(0.9999, abs=1e-4)
    assert decoded("interactlab/levitate_off") == [off, off]


@pytest.mark.parametrize("name", EXPECTED)
def test_the_host_end_makes_the_same_bytes(name: str) -> None:
    wire, options = dialect(name)
    host = DIALECTS[wire].host(**options)
    operations = [op for op in decoded(name) if not isinstance(op, nibbles.Forward)]
    assert b"".join(map(host.send, operations)) == line(name)


def test_frames_are_what_the_clients_send() -> None:
    codes = {name: bytes(of["codes"]) for name, of in EXPECTED.items() if "codes" in of}
    rows = {
        "sonicsurface/focus_0_120_0": lambda c: sonicsurface_frame(c),
        "ultraino/simplefpga_ss_focus_0_120_0": lambda c: ultraino_fpga_frame(c),
        "ultraino/simplefpga_ss_amp50_0_120_0": lambda c: ultraino_fpga_frame(c, bytes([8] * 256)),
        "ultraino/simplefpga128_ss_focus_0_120_0": lambda c: [
            Begin(),
            SetPhases((0,), 0, c[:72]),
            Swap(),
        ],
        "ultraino/chainedfpga_512_ramp": lambda c: chained_ultraino_frame([c[:256], c[256:]]),
        "ultraino/mega_flat8x8_focus": lambda c: mega64_frame(
            [MEGA64_FIRMWARE.slots([Pulse(code, 5) for code in c])]
        ),
    }
    for name, operations in rows.items():
        wire, options = dialect(name)
        host = DIALECTS[wire].host(**options)
        assert b"".join(map(host.send, operations(codes[name]))) == line(name)
