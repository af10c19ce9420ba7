"""A line that is more than a wire: mismatched rates, FIFOs that overrun, a USB adapter."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptogram.errors import ConfigurationError
from haptogram.settings.line import LineSettings
from haptogram_protocol.framing import encode_frame, end_of_frame
from haptogram_protocol.messages import Ping
from sim_device.board.settings import board_settings
from sim_device.line.sampling import FRAMING_ERROR, is_baud_understood, sample_uart_characters
from sim_device.line.uart import PolledUart, Uart, UsbUart, uart_to_board, uart_to_host

MS = 1_000_000
BYTE_NS = 10_000  # at 1 Mbaud
RATES_PPM = [-200_000, -160_000, -70_000, 0, 70_000, 140_000, 200_000]
VIRTUAL = "haptogram://?clock=virtual&array=4x4&seed=1"
BURSTS = st.lists(
    st.tuples(st.integers(0, 5 * MS), st.binary(min_size=1, max_size=150)), min_size=1, max_size=6
)


def deliveries(line, bursts):
    """Send, go from event to event, and return when what was handed over."""
    t_ns, found = 0, []
    for wait_ns, data in bursts:
        t_ns += wait_ns
        line.send(data, t_ns)
    while (next_ns := line.next_event_ns(end_of_frame)) is not None:
        found.append((next_ns, line.receive(next_ns)))
    return found


# --- rates that differ -------------------------------------------------------------------------


@given(st.binary(max_size=60), st.floats(0.948, 1.052))
def test_every_character_survives_rates_within_half_a_bit_in_nine_and_a_half(data, ratio):
    assert is_baud_understood(ratio)
    assert sample_uart_characters(data, ratio) == (data, 0)


@pytest.mark.parametrize("ratio", [0.90, 0.94, 1.06, 1.10])
def test_beyond_that_characters_are_damaged(ratio):
    data = bytes(range(1, 256))
    received, errors = sample_uart_characters(data, ratio)
    assert not is_baud_understood(ratio)
    assert received != data
    assert 0 < errors <= received.count(FRAMING_ERROR)


def test_the_receiver_looks_in_the_middle_of_its_own_bits():
    """By hand: where the looks at bit 7 and at the stop bit fall, in bits of the sender."""
    # 6 % fast: 8.5 x 1.06 = 9.01 is the stop bit in place of bit 7, 9.5 x 1.06 what follows it.
    assert sample_uart_characters(b"\x55", 1.06) == (
        b"\xd5",
        0,
    )  # the idle line, as high as a stop bit
    assert sample_uart_characters(b"\x55\x55", 1.06)[0][:1] == bytes(
        [FRAMING_ERROR]
    )  # the next start bit
    # 12 % slow: 9.5 x 0.88 = 8.36 is bit 7 in place of the stop bit.
    assert sample_uart_characters(b"\x40", 0.88) == (bytes([FRAMING_ERROR]), 1)
    assert sample_uart_characters(b"\x80", 0.88) == (b"\x00", 0)


@pytest.mark.parametrize("way", [uart_to_board, uart_to_host])
def test_a_uart_that_is_too_fast_is_damage_in_both_directions_and_counted(way):
    for ppm, damaged in ((50_000, False), (70_000, True)):
        line = way(LineSettings(baud=1_000_000, baud_error_ppm=ppm))
        line.send(bytes([0x55] * 20), 0)
        received = line.receive(10**9)
        assert (received != bytes([0x55] * 20)) is damaged
        assert (line.framing > 0) is damaged


def test_the_rate_of_the_sender_paces_the_line():
    fast = uart_to_host(LineSettings(baud=1_000_000, baud_error_ppm=10_000))
    fast.send(bytes(101), 0)
    assert fast.free_ns == 1_000_000
    slow_receiver = uart_to_board(LineSettings(baud=1_000_000, baud_error_ppm=-10_000))
    slow_receiver.send(bytes(100), 0)
    assert slow_receiver.free_ns == 1_000_000


@given(st.binary(min_size=1, max_size=40), st.sampled_from(RATES_PPM))
def test_what_is_misread_comes_while_it_is_sent_however_much_it_is(data, ppm):
    line = uart_to_host(LineSettings(baud=1_000_000, baud_error_ppm=ppm))
    line.send(data, 0)
    received = sample_uart_characters(data, 1 + ppm / 1e6)[0]
    found = deliveries(line, [])
    assert line.free_ns == -(-len(data) * BYTE_NS * 1_000_000 // (1_000_000 + ppm))
    assert 0 < found[0][0] <= found[-1][0] == line.free_ns
    assert b"".join(part for _, part in found) == received
    assert line.in_transit == 0


def test_a_receiver_that_is_faster_reads_characters_that_were_not_sent():
    line = uart_to_board(LineSettings(baud=1_000_000, baud_error_ppm=190_000))
    line.send(bytes([0x55] * 20), 0)
    assert line.in_transit == 25
    assert len(line.receive(line.free_ns - 1)) == 24
    assert len(line.receive(line.free_ns)) == 1


def test_what_is_sent_behind_misread_characters_comes_behind_them():
    line = uart_to_host(LineSettings(baud=1_000_000, baud_error_ppm=-160_000))
    line.send(bytes([0x55] * 20), 0)
    first_ns = line.free_ns
    line.send(b"\x01", 0)
    assert len(line.receive(first_ns)) == 25
    assert line.arrival_ns(1) > first_ns


# --- the FIFO of the board ---------------------------------------------------------------------


@given(BURSTS, st.integers(1, 40), st.integers(1, 500))
def test_a_fifo_loses_what_finds_it_full_counts_it_and_nothing_else(bursts, fifo, poll_us):
    poll_ns = poll_us * 1000
    line = PolledUart(1_000_000, fifo, poll_ns, receiver_ppm=0)
    found = deliveries(line, bursts)
    plain, windows = Uart(1_000_000), {}
    t_ns = 0
    for wait_ns, data in bursts:
        t_ns += wait_ns
        plain.send(data, t_ns)
    while plain.in_transit:  # byte by byte, as the oracle
        arrival_ns = plain.arrival_ns(1)
        windows.setdefault(-(-arrival_ns // poll_ns), bytearray()).extend(plain.receive(arrival_ns))
    assert b"".join(data for _, data in found) == b"".join(w[:fifo] for w in windows.values())
    assert line.overrun == sum(max(0, len(window) - fifo) for window in windows.values())
    assert all(t_ns % poll_ns == 0 for t_ns, _ in found)
    assert line.in_transit == 0


def test_a_fifo_that_is_emptied_in_time_loses_nothing():
    line = PolledUart(1_000_000, 16, 160_000, receiver_ppm=0)
    data = bytes(range(1, 250))
    assert b"".join(d for _, d in deliveries(line, [(0, data)])) == data
    assert line.overrun == 0


# --- the USB adapter of the host ---------------------------------------------------------------


def test_a_packet_goes_when_it_is_full_and_the_rest_when_the_timer_runs_out():
    line = UsbUart(1_000_000, 16 * MS)
    found = deliveries(line, [(0, bytes(100))])
    assert [(t_ns, len(data)) for t_ns, data in found] == [
        (62 * BYTE_NS, 62),
        (62 * BYTE_NS + 16 * MS, 38),
    ]


@given(BURSTS, st.sampled_from([MS, 16 * MS]))
def test_an_adapter_loses_nothing_and_holds_nothing_longer_than_its_timer(bursts, latency_ns):
    usb, wire, t_ns = UsbUart(1_000_000, latency_ns), Uart(1_000_000), 0
    arrivals = []
    for wait_ns, data in bursts:
        t_ns += wait_ns
        wire.send(data, t_ns)
    while (next_ns := wire.arrival_ns(1)) is not None:
        arrivals += [next_ns] * len(wire.receive(next_ns))
    found = deliveries(usb, bursts)
    assert b"".join(data for _, data in found) == b"".join(data for _, data in bursts)
    delivered = [t_ns for t_ns, data in found for _ in data]
    waits = [t - arrival for t, arrival in zip(delivered, arrivals, strict=True)]
    assert min(waits) >= 0
    assert max(waits) <= latency_ns
    assert usb.in_transit == 0


@given(BURSTS, st.lists(st.integers(0, 60 * MS), max_size=8).map(sorted))
def test_when_one_looks_does_not_matter(bursts, looks):
    lines = [UsbUart(1_000_000, MS), UsbUart(1_000_000, MS)]
    expected = deliveries(lines[0], bursts)
    t_ns = 0
    for wait_ns, data in bursts:
        t_ns += wait_ns
        lines[1].send(data, t_ns)
    received = b""
    for look_ns in looks:
        received += lines[1].receive(look_ns)
        assert received == b"".join(data for t, data in expected if t <= look_ns)


@pytest.mark.parametrize(("latency_ms", "most_ms"), [(16, 17), (1, 2)])
def test_a_round_trip_takes_up_to_the_timer_longer(open_host, latency_ms, most_ms):
    taken_ns = {}
    for option in ("", f"&latency_ms={latency_ms}"):
        host = open_host(f"{VIRTUAL}&baud=3000000{option}")
        host.greet()
        trips = []
        for k in range(20):
            host.port.wait_until_ns(host.now_ns() + k * 313_000)
            start_ns = host.now_ns()
            host.ask(Ping(echo=k))
            trips.append(host.now_ns() - start_ns)
        taken_ns[option] = max(trips)
    assert latency_ms * MS * 0.8 < taken_ns[f"&latency_ms={latency_ms}"] < most_ms * MS
    assert taken_ns[""] < 0.3 * MS


# --- a whole board -----------------------------------------------------------------------------


def test_an_overrun_is_a_damaged_frame_to_the_board_and_a_count_in_the_last_record(open_host):
    url = f"{VIRTUAL}&baud=1000000&rx_fifo=4&rx_poll_us=100&reconstruct=0"
    host = open_host(url)
    host.port.write(encode_frame(bytes(range(1, 40))) * 20)
    host.port.wait_until_ns(20 * MS)
    counters = host.port.simulation.dialect.counters
    assert sum(counters[name] for name in ("crc", "cobs", "short")) > 0
    assert counters["frames"] == 0
    host.port.close()
    assert host.port.records[-1]["line"]["board_overrun"] > 0
    assert "faults" not in host.port.records[-1]


def test_a_host_that_does_not_read_loses_what_its_buffer_cannot_hold_and_it_is_counted(open_host):
    waiting = {}
    for option in ("", "&host_buffer=100"):
        host = open_host(f"{VIRTUAL}&baud=1000000{option}")
        for k in range(5):
            host.link.send_hello(k)
            host.port.write(host.link.data_to_send())
            host.port.wait_until_ns((k + 1) * 10 * MS)
        waiting[option] = host.port.in_waiting
    lost = host.port.simulation.line_counts
    assert waiting["&host_buffer=100"] == 100
    assert lost == {"board_overrun": 0, "host_overrun": waiting[""] - 100, "framing": 0}


@pytest.mark.parametrize("room", [65_535, 65_536, 70_000])
def test_no_buffer_of_the_host_is_so_large_that_the_board_waits(open_host, room):
    host = open_host(f"{VIRTUAL}&host_buffer={room}")
    host.greet()
    for k in range(15):
        for _ in range(100):
            host.link.send_hello(k)
            host.port.write(host.link.data_to_send())
        host.port.wait_until_ns((k + 1) * 10 * MS)
    assert host.port.in_waiting == room
    assert host.port.simulation.line_counts["host_overrun"] > 0
    assert host.port.simulation.dialect.output_bytes == 0


@pytest.mark.parametrize(
    ("options", "problem"),
    [
        ({"rx_fifo": 16}, "rx_fifo needs a baud rate"),
        ({"baud_error_ppm": 1}, "baud_error_ppm needs a baud rate"),
        ({"baud": 9600, "rx_fifo": 0}, "rx_fifo is 0, must be 1 to 65536"),
        ({"baud": 9600, "rx_poll_us": 9}, "give rx_fifo too"),
        ({"baud": 9600, "baud_error_ppm": 10**6}, "must be -200000 to 200000"),
        ({"latency_ms": 256}, "latency_ms is 256, must be 0.001 to 255"),
        ({"latency_ms": float("nan")}, "latency_ms is nan"),
        ({"host_buffer": 0}, "host_buffer is 0"),
    ],
)
def test_lines_that_make_no_sense_are_refused(options, problem):
    with pytest.raises(ConfigurationError, match=problem):
        board_settings(array="4x4", **options)
