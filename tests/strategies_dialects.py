"""Every wire of a foreign board as a row: its dialect, options, and sequences of its operations."""

import dataclasses
from typing import Any

from hypothesis import strategies as st

from haptogram_protocol.dialects import sonicsurface
from haptogram_protocol.dialects.autd3 import messages as link
from haptogram_protocol.dialects.autd3 import operations as device
from haptogram_protocol.dialects.autd3.frame import Autd3DeviceFrame, Autd3DeviceState
from haptogram_protocol.dialects.autd3.payload import PAYLOAD_BYTES, pack_autd3_operation
from haptogram_protocol.dialects.codec import BoardEnd, Dialect, HostEnd, Operation
from haptogram_protocol.dialects.fpga_bytes.operations import (
    Begin,
    BeginAmplitudes,
    FpgaByteRules,
    Select,
    SetAmplitudes,
    SetPhases,
    Swap,
)
from haptogram_protocol.dialects.interactlab import CHANNELS, QueueFrame
from haptogram_protocol.dialects.table import DIALECTS
from haptogram_protocol.dialects.ultraino import fpga
from haptogram_protocol.dialects.ultraino.arduino import operations as nibbles
from haptogram_protocol.dialects.ultraino.arduino import slots as arduino

Operations = st.SearchStrategy[list[Operation]]


@dataclasses.dataclass(frozen=True)
class Wire:
    """A dialect with options, what its operations are, and how much an end may hold back."""

    dialect: str
    options: dict[str, Any]
    operations: Operations
    pending_limit: int

    @property
    def facts(self) -> Dialect:
        return DIALECTS[self.dialect]

    def board(self) -> BoardEnd:
        return self.facts.board(**self.options)

    def host(self) -> HostEnd:
        return self.facts.host(**self.options)

    def __str__(self) -> str:
        return "-".join([self.dialect, *map(str, self.options.values())])


@st.composite
def of_fpga(draw: st.DrawFn, rules: FpgaByteRules, boards: int = 1) -> list[Operation]:
    """Commands in any order, with codes between them that fit where they would go."""
    listening, written = tuple(range(boards)), [0] * boards
    kind: type[SetPhases] | type[SetAmplitudes] = SetPhases
    made: list[Operation] = []
    for command in draw(st.lists(st.sampled_from(list(rules.commands.values())), max_size=8)):
        made.append(command)
        if isinstance(command, Swap):
            written, kind = [0] * boards, SetPhases
        elif isinstance(command, Select):
            listening = (command.board,) if command.board < boards else ()
        elif isinstance(command, Begin | BeginAmplitudes) and listening:
            written = [0 if board in listening else at for board, at in enumerate(written)]
            kind = SetPhases if isinstance(command, Begin) else SetAmplitudes
        at = written[listening[0]] if listening else rules.channels
        room = rules.channels - (at % rules.channels if rules.wraps else at)
        size = draw(st.integers(0, room)) if listening else 0
        if size:
            codes = bytes(draw(st.lists(st.integers(0, rules.limit(kind)), min_size=1, max_size=4)))
            run = (codes * size)[:size]
            made.append(kind(listening, at % rules.channels, run))
            written = [at + size if b in listening else old for b, old in enumerate(written)]
    return [*made, Swap()]


@st.composite
def of_arduinos(draw: st.DrawFn, firmware: arduino.ArduinoFirmware, boards: int) -> list[Operation]:
    """Frames of whole patterns and durations, some cut short by the swap."""
    made: list[Operation] = []
    for _ in range(draw(st.integers(1, 3))):
        counts = [draw(st.integers(0, min(2, firmware.patterns))) for _ in range(boards)]
        made += [
            nibbles.SetPattern(board, pattern, draw(slots(firmware.pattern_bytes)))
            for board, count in enumerate(counts)
            for pattern in range(count)
        ]
        if firmware.durations and draw(st.booleans()):
            periods = draw(st.binary(min_size=1, max_size=firmware.durations))
            made += [nibbles.SetDurations(periods), nibbles.CommitDurations()]
        for board, count in enumerate(counts):
            size = draw(st.integers(0, firmware.pattern_bytes - 1))
            if size and count < firmware.patterns:
                made.append(nibbles.SetPattern(board, count, draw(slots(size))))
        restarts = not firmware.durations and draw(st.booleans())
        made.append(nibbles.Restart() if restarts else nibbles.Swap())
    return made


def slots(size: int) -> st.SearchStrategy[bytes]:
    return st.binary(min_size=1, max_size=8).map(lambda some: (some * size)[:size])


bits_7 = st.binary(min_size=1, max_size=8).map(
    lambda some: bytes(byte & 0x7F for byte in (some * CHANNELS)[:CHANNELS])
)
of_interactlab: Operations = st.lists(
    st.builds(
        QueueFrame,
        bits_7,
        bits_7,
        st.none() | st.integers(0, 2**24 - 1),
        st.none() | st.integers(0, 255),
    ),
    max_size=3,
)

u8, u16, u64 = st.integers(0, 0xFF), st.integers(0, 0xFFFF), st.integers(0, 2**64 - 1)
segments = st.integers(0, 1)
without_length: st.SearchStrategy[Operation] = st.one_of(
    st.sampled_from([device.Nop(), device.Clear(), device.Sync()]),
    st.builds(device.FirmwareInfo, u8),
    st.builds(device.Silencer, st.booleans(), st.booleans(), u16, u16),
    st.builds(device.SwapSegment, st.just(device.Tag.GAIN_SWAP), u8),
    st.builds(
        device.SwapSegment,
        st.sampled_from([device.Tag.MODULATION_SWAP, device.Tag.FOCI_STM_SWAP]),
        u8,
        u8,
        u64,
    ),
    st.builds(
        device.Unsupported, st.sampled_from([0x41, 0x43, 0x60, 0x61, 0x72, 0x80, 0xF2, 0xFF])
    ),
)


@st.composite
def device_operations(draw: st.DrawFn, foci_of_pattern: int) -> Operation:
    """One operation of any type, as long as a frame may have it."""
    kind = draw(st.sampled_from(["short", "gain", "modulation", "foci"]))
    end, update = draw(st.booleans()), draw(st.booleans())
    if kind == "gain":
        drives = draw(st.binary(min_size=1, max_size=8)) * 2 * device.CHANNELS
        return device.Gain(draw(u8), update, drives[: 2 * device.CHANNELS])
    if kind == "modulation":
        start = draw(st.none() | st.builds(device.ModulationStart, u8, u16, u16, u64))
        samples = draw(st.binary(max_size=255 if start else 600))
        return device.Modulation(draw(segments), samples, start, end, update)
    if kind == "foci":
        number = st.integers(1, 8)
        start = draw(st.none() | st.builds(device.FociStart, u8, number, u16, u16, u16, u64))
        of_one = 8 * (start.foci_of_pattern if start else foci_of_pattern)
        patterns = draw(st.integers(0, (PAYLOAD_BYTES - 24) // of_one))
        foci = (draw(st.binary(min_size=8, max_size=8)) * 80)[: patterns * of_one]
        return device.FociSTM(draw(u8), patterns, foci, start, end, update)
    return draw(without_length)


@st.composite
def of_autd3(draw: st.DrawFn) -> list[Operation]:
    """A session of one to three devices: hello, open, anything, perhaps close."""
    number = draw(st.integers(1, 3))
    f32 = st.floats(width=32, allow_nan=False)
    poses = st.builds(link.Pose, st.tuples(f32, f32, f32), st.tuples(f32, f32, f32, f32))
    geometry = st.lists(poses, min_size=number, max_size=number).map(tuple)
    made: list[Operation] = [link.Hello(), link.Open(draw(geometry))]
    foci = [1] * number
    message_id = draw(st.integers(0, 15))
    for kind in draw(st.lists(st.sampled_from(["read", "write", "update"]), max_size=6)):
        if kind == "read":
            made.append(link.Read())
        elif kind == "update":
            made.append(link.Update(draw(geometry)))
        else:
            message_id = (message_id + 1) % 16
            frames = []
            for index in range(number):
                operations = [draw(device_operations(foci[index]))]
                second = draw(without_length)
                size = sum(map(len, map(pack_autd3_operation, (operations[0], second))))
                if size <= PAYLOAD_BYTES and draw(st.booleans()):
                    operations.append(second)
                start = getattr(operations[0], "start", None)
                foci[index] = getattr(start, "foci_of_pattern", foci[index])
                frames.append(Autd3DeviceFrame(message_id, tuple(operations)))
            made.append(link.Write(tuple(frames)))
    return [*made, *([link.Close()] if draw(st.booleans()) else [])]


device_states = st.builds(Autd3DeviceState, st.integers(0, 15), st.integers(0, 15), u8)


def arduinos(name: str, firmware: arduino.ArduinoFirmware, boards: int) -> Wire:
    limit = boards * firmware.half_bytes + 4 * firmware.durations
    return Wire(name, {"boards": boards}, of_arduinos(firmware, boards), limit)


WIRES = [
    Wire("sonicsurface", {}, of_fpga(sonicsurface.RULES), 255),
    Wire("sonicsurface", {"boards": 2}, of_fpga(sonicsurface.RULES, 2), 255),
    Wire("sonicsurface-tactile", {}, of_fpga(sonicsurface.TACTILE_RULES), 255),
    *(Wire("ultraino-fpga", {"fb": fb}, of_fpga(rules), 255) for fb, rules in fpga.RULES.items()),
    Wire("ultraino-fpga-128", {}, of_fpga(fpga.RULES_128), 71),
    *(
        Wire(
            "ultraino-fpga-chained", {"boards": n}, of_fpga(fpga.chained_ultraino_rules(n), n), 255
        )
        for n in (1, 4)
    ),
    *(arduinos("ultraino-mega64", arduino.MEGA64_FIRMWARE, boards) for boards in (1, 4)),
    arduinos("ultraino-nano16", arduino.NANO16_FIRMWARE, 1),
    arduinos("ultraino-nano8", arduino.NANO8_FIRMWARE, 2),
    Wire("interactlab", {}, of_interactlab, 511),
    Wire("autd3", {}, of_autd3(), 64 * 626),
]


def sent(operations: list[Operation]) -> list[Operation]:
    """Return *operations* without those that only a board's end makes."""
    return [operation for operation in operations if not isinstance(operation, nibbles.Forward)]
