"""What holds for the boards of every dialect: any bytes, in any pieces, at any steps of time."""

import dataclasses
import json
import pickle
import random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dialect_boards import SENT, DialectBoard, blueprint_of_options
from haptogram.errors import ConfigurationError
from haptogram.settings.board import BoardConfig
from haptogram_protocol.dialects import sonicsurface
from haptogram_protocol.dialects.autd3.frame import Autd3DeviceFrame
from haptogram_protocol.dialects.autd3.link import Autd3HostEnd
from haptogram_protocol.dialects.autd3.messages import Hello, Open, Pose, Write
from haptogram_protocol.dialects.autd3.operations import Gain
from haptogram_protocol.dialects.fpga_bytes.operations import Swap
from haptogram_protocol.dialects.table import DIALECTS
from sim_device.backdoor.recorder import InlineReconstructionWorker
from sim_device.blueprint import blueprint_of
from sim_device.dialects.double_buffer import DoubleBuffer, Registers
from sim_device.dialects.foreign import OUTPUT_LIMIT
from sim_device.dialects.table import EMULATIONS
from strategies_dialects import WIRES, Wire
from strategies_protocol import chunkings

EMULATED = [wire for wire in WIRES if wire.dialect in EMULATIONS]
every_wire = pytest.mark.parametrize("wire", EMULATED, ids=str)
every_dialect = pytest.mark.parametrize("name", EMULATIONS)
LAYOUTS = {"ultraino-fpga-chained-4": "ultraino-sonicsurface"}  # of a wire without a layout


def power_up(wire: Wire) -> DialectBoard:
    options = tuple(f"{name}={value}" for name, value in wire.options.items())
    array = {"array": LAYOUTS[str(wire)]} if str(wire) in LAYOUTS else {}
    return DialectBoard(wire.dialect, *options, **array)


@st.composite
def lines(draw, wire):
    """Bytes of a client, some of them damaged, between others that nobody meant."""
    host = wire.host()
    line = b"".join(host.send(operation) for operation in draw(wire.operations))
    source = random.Random(draw(st.integers(0, 2**32)))
    for _ in range(draw(st.integers(0, 4))):
        at = source.randrange(len(line) + 1)
        line = (
            line[:at] + source.randbytes(source.randint(0, 3)) + line[at + source.randint(0, 2) :]
        )
    return draw(st.binary(max_size=40)) + line


def seen(board):
    """Return all that can be seen of a board from outside."""
    latches = [
        (latch.t_latch_us, latch.pulses, latch.cause, latch.index, latch.modulation, latch.number)
        for latch in board.latches
    ]
    counted = [dict(latch.counted) for latch in board.latches]
    counters = board.simulation.dialect.counters
    return latches, counted, board.notices, counters, board.simulation.host_read()


def test_every_dialect_of_the_table_has_boards():
    assert set(EMULATIONS) <= set(DIALECTS)
    assert {wire.dialect for wire in EMULATED} == set(EMULATIONS)
    assert all(emulation.dialect is DIALECTS[name] for name, emulation in EMULATIONS.items())


@every_dialect
def test_a_board_radiates_from_power_up_what_its_registers_hold(name):
    board = DialectBoard(name)
    wiring, latch = board.settings.wiring, board.latches[0]
    assert (latch.number, latch.cause, latch.t_latch_us) == (0, "power-up", board.settings.boot_us)
    assert latch.pulses.count == wiring.channel_count
    assert latch.radiated.shape == (board.settings.count,)
    assert np.array_equal(latch.radiated, latch.pulses.weights()[list(wiring.channels)])
    assert board.settings.line.baud == (DIALECTS[name].bauds or (None,))[0]


@pytest.mark.sampled(4)
@every_wire
@given(data=st.data())
def test_any_steps_of_time_give_the_same(wire, data):
    line = data.draw(lines(wire))
    times_ns = [1000 * t for t in sorted(data.draw(st.lists(st.integers(0, 200_000), max_size=12)))]
    end_ns = 2_500_000_000
    boards = [power_up(wire) for _ in range(2)]
    for board, steps in zip(boards, ([], times_ns), strict=True):
        board.simulation.host_write(line, 0)
        for t_ns in steps:
            board.simulation.advance_to(t_ns)
        board.simulation.advance_to(end_ns)
    assert seen(boards[0]) == seen(boards[1])


@pytest.mark.sampled(4)
@every_wire
@given(data=st.data())
def test_any_pieces_on_a_line_without_time_give_the_same(wire, data):
    line = data.draw(lines(wire))
    whole, pieces = [
        blueprint_of_options(wire.dialect, wire.options, LAYOUTS.get(str(wire))) for _ in range(2)
    ]
    results = []
    for blueprint, chunks in ((whole, [line]), (pieces, data.draw(chunkings(line)))):
        dialect = blueprint.parts.assemble(blueprint.settings)
        for chunk in chunks:
            dialect.receive(chunk, blueprint.settings.boot_us + 77)
            assert dialect.output_bytes <= OUTPUT_LIMIT
        latches = dialect.take_latches()
        results.append(
            (
                [(latch.pulses, latch.cause, latch.index) for latch in latches],
                [dict(latch.counted) for latch in latches],
                dialect.counters,
                dialect.take_output(),
            )
        )
    assert results[0] == results[1]


@pytest.mark.sampled(4)
@every_wire
@given(chunks=st.lists(st.binary(max_size=600), max_size=6))
def test_any_bytes_are_latches_or_counted(wire, chunks):
    board = power_up(wire)
    for chunk in chunks:
        board.send(chunk)
    board.pass_us(2_000_000)
    assert len(board.remarks) <= 2 * len(chunks) + 5  # one for each clue
    assert all(count > 0 for count in board.simulation.dialect.counters.values())
    total = {}
    for latch in board.latches:
        for kind, count in latch.counted.items():
            total[kind] = total.get(kind, 0) + count
    counters = board.simulation.dialect.counters
    assert all(counters[kind] >= count for kind, count in total.items())


@every_wire
def test_latches_travel_to_the_worker_and_become_records(wire):
    board = power_up(wire)
    source = random.Random(3)
    board.send(source.randbytes(3000))
    records = []
    recorder = InlineReconstructionWorker(board.settings, records.append, reconstruct=False)
    for latch in board.latches[:200]:
        again = pickle.loads(pickle.dumps(latch))
        assert (again.pulses, again.counted) == (latch.pulses, latch.counted)
        recorder.latch(again)
    recorder.finish()
    assert [record["kind"] for record in json.loads(json.dumps(records))] == [
        "board",
        *["pulses"] * len(board.latches[:200]),
        "end",
    ]


@every_dialect
@pytest.mark.parametrize(
    ("values", "says"),
    [
        ({"mutant": "mute-ignored"}, "mutant"),
        ({"fault": ("frame.crc",)}, "frame.crc"),
        ({"fault": ("device.clock",)}, "device.clock"),
        ({"fault": ("device.status",)}, "device.status"),
        ({"fault": ("clock.wrap",)}, "clock.wrap"),
        ({"dialect_option": ("nothing=1",)}, "nothing=1"),
        ({"array": "32x32"}, "1024 elements"),
    ],
)
def test_what_makes_no_sense_is_refused_by_name(name, values, says):
    if says == "1024 elements" and name == "autd3":
        pytest.skip("the clients of autd3 say how many devices there are")
    with pytest.raises(ConfigurationError, match=says):
        blueprint_of(BoardConfig.of(dialect=name, **values))


@every_dialect
def test_faults_of_transducers_and_line_act(name):
    faults = ("device.off transducer=0", "device.stuck transducer=1 code=64", "line.drop p=0.5")
    board, healthy = DialectBoard(name, fault=faults, seed=1), DialectBoard(name)
    for each in (board, healthy):
        each.send(bytes([0x51] * 200) + b"\x30" * 8 + b"\x10\x00")
    latch = board.latches[0]
    assert latch.radiated[0] == 0
    if abs(latch.radiated[1]) > 0:
        assert np.angle(latch.radiated[1]) == pytest.approx(np.pi / 2)
    assert np.array_equal(latch.radiated[2:], healthy.latches[0].radiated[2:])
    assert latch.is_faulty == bool(healthy.latches[0].radiated[:2].any())
    assert board.simulation.fault_counts["line.drop"] > 0


@every_dialect
@pytest.mark.parametrize("fault", ["ok bank=0", "delayed bank=0 code=0", "intermittent bank=0 p=0"])
def test_a_fault_that_changes_nothing_is_not_counted(fault, name):
    board = DialectBoard(name, fault=(f"device.{fault}",), seed=1)
    board.pass_us(1_100_000)  # InteractLab's is silent for a second
    board.send(SENT[name])
    board.pass_us(100_000)
    assert any(latch.radiated.any() for latch in board.latches[1:])
    assert set(board.simulation.fault_counts.values()) == {0}
    assert not any(latch.is_faulty for latch in board.latches)


def board_of_a_link():
    """Return a board at the end of a link, without time, whose power-up was taken."""
    blueprint = blueprint_of(BoardConfig.of(dialect="autd3"))
    dialect = blueprint.parts.assemble(blueprint.settings)
    dialect.take_latches()
    return dialect


def counts_of_a_client(dialect, wrong):
    """Return what the latch of a client's gain counts; *wrong* bytes follow the gain."""
    frame = Autd3DeviceFrame(1, (Gain(0, True, bytes([wrong, 255] * 249)),))
    asked = Hello(), Open((Pose((0, 0, 0), (1, 0, 0, 0)),)), Write((frame,))
    dialect.receive(b"".join(map(Autd3HostEnd().send, asked)) + b"\x77" * wrong, dialect.now_us)
    dialect.advance_to(dialect.now_us + 1000)
    return dialect.take_latches()[-1].counted


@pytest.mark.parametrize("wrong", [(4, 4), (4, 1), (4, 0), (0, 4)])
def test_a_latch_counts_nothing_of_a_client_that_has_left(wrong):
    dialect = board_of_a_link()
    for count in wrong:
        told = {"links_undecodable": 1, "bytes_after_end": count}
        assert counts_of_a_client(dialect, count) == (told if count else {})
        dialect.client_left()


def test_a_client_gets_no_answers_of_the_one_before_it():
    dialect = board_of_a_link()
    dialect.receive(Autd3HostEnd().send(Hello()), dialect.now_us)
    assert dialect.output_bytes == 1
    dialect.client_left()
    assert dialect.take_output() == b""


class LateUnit(DoubleBuffer):
    """A wrong board: a mutant of another dialect, which swaps its buffers twice."""

    def take(self, operation, t_us):
        replies = super().take(operation, t_us)
        return replies + (super().take(operation, t_us) if isinstance(operation, Swap) else [])


def test_a_wrong_board_takes_the_place_of_the_right_one():
    blueprint = blueprint_of(BoardConfig.of(dialect="sonicsurface"))
    registers = Registers(sonicsurface.RULES, steps=32, width=16)
    wrong = dataclasses.replace(
        EMULATIONS["sonicsurface"], unit=lambda _, now_us: LateUnit(registers, 1, now_us)
    )
    dialect = wrong.power_up(wrong.options(), blueprint.settings)
    dialect.receive(b"\xfe" + bytes([5] * 256) + b"\xfd", dialect.now_us)
    shown = [int(latch.pulses.rises[0]) for latch in dialect.take_latches()]
    assert shown == [0, 5, 0]
