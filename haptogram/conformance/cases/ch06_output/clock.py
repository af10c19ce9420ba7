"""HG-6.9: the device clock."""

from __future__ import annotations

from typing import Final

from haptogram_protocol import messages as m

from ...case import Depth, case, case_about_host
from ...client import latching, malformed_frames
from ...client.board_client import BoardClient
from ...client.board_clock import BOOT_US
from ...outcome import SELF_REPORTED, check, check_equal, require

_LIMIT_US: Final = 10
_SAMPLES: Final = 24
_PAUSE_US: Final = 2000
_AHEAD_US: Final = 1_000_000
_AT_BOOT_US: Final = 2**32 - BOOT_US
_BOOTED_US: Final = 9_000_000  # by when a board that was reset has been asked for its time


host_subtracts = case_about_host("HG-6.9/3")


class _OutputClockWatch:
    """Compares the device clock with that of the transport, PING by PING."""

    def __init__(self, board: BoardClient) -> None:
        self._board = board
        self._first: tuple[int, int, int] | None = None
        self._device_us = 0

    def look(self) -> None:
        """FAILED if the device clock has left the band that clock_ppm allows."""
        board = self._board
        start_us = board.wire.now_us()
        pong = board.link.ping(start_us)
        trip_us = board.wire.now_us() - start_us
        if self._first is None:
            self._device_us = pong.t_rx_us
            self._first = (start_us, self._device_us, trip_us)
            return
        self._device_us += m.signed_difference(pong.t_rx_us, self._device_us & 0xFFFFFFFF, 32)
        host_us, device_us, first_trip_us = self._first
        passed_us = start_us - host_us
        error_us = (self._device_us - device_us) - passed_us
        drift_us = passed_us * board.identity.clock_ppm / 1e6
        bound_us = drift_us + max(trip_us, first_trip_us) + 2
        check(
            abs(error_us) <= bound_us,
            f"after {passed_us / 1e6:.3f} s the device clock is off by {error_us:+d} µs; "
            f"{board.identity.clock_ppm} ppm and the round trips allow {bound_us:.0f} µs",
        )


@case("HG-6.9/1", depth=Depth.DEFAULT)
def output_clock_keeps_time(board: BoardClient) -> None:
    """over 10 s (1 s in wall time) the clock keeps its rate and makes no step"""
    duration_us = 10_000_000 if board.wire.is_virtual else 1_000_000
    watch = _OutputClockWatch(board)
    for _ in range(_SAMPLES + 1):
        watch.look()
        board.wire.idle(duration_us // _SAMPLES)


@case("HG-6.9/1-wrap", needs_reset=True, before_wrap_us=400_000, depth=Depth.DEFAULT)
def output_clock_crosses_the_wrap(board: BoardClient) -> None:
    """the clock goes on across 2^32, 10 s after a reset"""
    board.prepare()
    watch = _OutputClockWatch(board)
    watch.look()
    board.clock.require_before(2**32, "a look before the wrap")
    board.wire.idle(max(0, _clock_to_the_wrap_us(board) - 200_000))
    for _ in range(_SAMPLES):
        watch.look()
        board.wire.idle(20_000)


def _clock_to_the_wrap_us(board: BoardClient) -> int:
    """Return the µs until the device clock wraps at 2^32; negative in the first half of its range.

    There it is the time since the last wrap.
    """
    return -m.signed_difference(board.link.ping(0).t_rx_us, 0, 32)


@case("HG-6.9/4", needs_reset=True)
def clock_starts_ten_seconds_before_the_wrap(board: BoardClient) -> None:
    """soon after a reset the clock is little past 2^32 - 10 s"""
    board.prepare()
    up_us = _AT_BOOT_US - _clock_to_the_wrap_us(board)
    check(0 <= up_us < _BOOTED_US, f"soon after a reset the clock is {up_us} µs past 2^32 - 10 s")


@case(
    "HG-6.9/5", needs_reset=True, evidence=SELF_REPORTED, depth=Depth.DEFAULT, wall_depth=Depth.FULL
)
def clock_counts_beyond_32_bits(board: BoardClient) -> None:
    """behind 2^32 drives are latched on carrier periods of the whole count, which has a bit 32"""
    board.prepare()
    require(2**32 % board.clock.carrier_us != 0, "2^32 µs are whole carrier periods of this board")
    board.wire.idle(max(0, _clock_to_the_wrap_us(board) + 10_000))
    board.clock.device_us()
    board.arm()
    for _ in range(4):
        t_us = latching.latch_timed(board)
        off_us = t_us % board.clock.carrier_us
        check(t_us > 2**32, f"the latch at {t_us} µs is not behind 2^32 µs")
        check_equal(off_us, 0, f"the latch at {t_us} µs is {off_us} µs past a carrier period")


def _pong_to_last(board: BoardClient, *wires: bytes) -> m.Pong:
    """Send *wires*, of which the last is a PING, back to back; return the reply to that one."""
    return board.link.reply_in(board.link.exchange(*wires)[-1], m.Pong)


@case("HG-6.9/2")
def clock_stamps_pings(board: BoardClient) -> None:
    """t_rx is not after t_tx, and both lie within the round trip"""
    for number in range(_SAMPLES):
        start_us = board.wire.now_us()
        pong = board.link.ping(number)
        trip_us = board.wire.now_us() - start_us
        inside_us = m.signed_difference(pong.t_tx_us, pong.t_rx_us, 32)
        check(
            0 <= inside_us <= trip_us + _LIMIT_US,
            f"t_tx - t_rx is {inside_us} µs, the round trip took {trip_us} µs",
        )


@case("HG-6.9/2-margin", evidence=SELF_REPORTED)
def clock_stamps_agree(board: BoardClient) -> None:
    """a stream frame and the PING behind it arrive together, by the frame's margin and by t_rx"""
    board.arm()
    good, apart = board.flat_phases(), []
    for _ in range(min(_SAMPLES // 3, board.identity.queue_depth)):
        board.status()  # margins begin anew
        t_us = board.clock.ahead_us(_AHEAD_US)
        ping, _ = board.link.request_wire(m.Ping(t_us))
        pong = _pong_to_last(board, board.link.stream_wire(good, t_us), ping)
        margin_us = board.clock.ready_us(board.status().margin_min_us)
        apart.append(m.signed_difference(pong.t_rx_us, (t_us - margin_us) & 0xFFFFFFFF, 32))
    sent_us = board.wire.period_us(len(ping))
    least_us = min(apart, key=abs)  # a host may send in two parts
    check(
        -_LIMIT_US <= least_us <= sent_us + _LIMIT_US,
        f"t_rx is {least_us} µs behind the arrival of the frame right before the PING, by its "
        f"margin; the PING takes {sent_us} µs on the line",
    )


@case("HG-6.9/2-pieces", depth=Depth.DEFAULT)
def clock_stamps_the_end_of_a_ping(board: BoardClient) -> None:
    """t_rx of a PING in two parts is the arrival of its end, however much came before a pause"""
    for number in range(3):
        ping, seq = board.link.request_wire(m.Ping(number))
        before = (2, len(ping) // 2, len(ping) - 1)[number]
        since = board.link.mark()
        board.link.send(ping[:before])
        board.wire.idle_beyond(_PAUSE_US)
        resumed_us = board.clock.device_least_us()
        board.link.send(ping[before:])
        pong = board.link.reply_in(board.link.answer_to(m.Ping.TYPE, seq, since), m.Pong)
        early_us = resumed_us - board.clock.unwrap(pong.t_rx_us)
        check(
            early_us <= 0,
            f"t_rx of a PING lies {early_us} µs before the rest of it was sent, all behind its "
            f"first {before} bytes",
        )


@case("HG-6.9/2-exact")
def clock_stamps_exactly(board: BoardClient) -> None:
    """behind 4000 bytes t_rx is the end of the PING itself; behind a reply t_tx waits for the
    line
    """
    board.wire.require_exact_times()
    ping, _ = board.link.request_wire(m.Ping(1))
    encoded, _ = malformed_frames.malformed_mute_of_size(board.link, 4000)
    sent_us = board.wire.now_us()
    base_us = board.link.ping(0).t_rx_us - sent_us - board.wire.period_us(len(ping))
    ping, first = board.link.request_wire(m.Ping(2))
    before = b"\x00" + encoded + b"\x00"
    sent_us = board.wire.now_us()
    pong = _pong_to_last(board, before, ping)
    due_us = base_us + sent_us + board.wire.period_us(len(before) + len(ping))
    off_us = m.signed_difference(pong.t_rx_us, due_us & 0xFFFFFFFF, 32)
    took_us = board.wire.line_us(len(ping))
    text = f"t_rx of PING seq {first} is {off_us:+d} µs from its end; it takes {took_us} µs"
    check(abs(off_us) <= _LIMIT_US, text)
    _check_clock_of_first_byte(board, base_us)


def _check_clock_of_first_byte(board: BoardClient, base_us: int) -> None:
    """FAILED unless a PONG after a long reply names the time at which its own first byte left.

    *base_us* is the device clock minus the transport's clock; 10 µs of error are allowed.
    """
    wires = (board.link.request_wire(one)[0] for one in (m.GetGeometry(0, 0xFFFF), m.Ping(3)))
    *_, answer = board.link.exchange(*wires)
    due_us = base_us + board.wire.begun_us(answer)
    t_tx_us = board.link.reply_in(answer, m.Pong).t_tx_us
    off_us = m.signed_difference(t_tx_us, due_us & 0xFFFFFFFF, 32)
    check(abs(off_us) <= _LIMIT_US, f"t_tx of a PONG behind a long reply is off by {off_us:+d} µs")
