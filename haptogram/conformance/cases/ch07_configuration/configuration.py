"""HG-7.1, HG-7.5, HG-7.9: the configuration, the correction and the ceiling; the geometry."""

from __future__ import annotations

import dataclasses
import zlib
from collections.abc import Sequence
from typing import Any, Final

from haptogram_protocol import messages as m
from haptogram_protocol.framing import HEADER_BYTES, encode_frame
from haptogram_protocol.rules import READ_BACKS, TRACE_CAPABILITIES

from ...case import Depth, case
from ...client import latching, uploads
from ...client.board_client import BoardClient
from ...client.capabilities import drive_kinds
from ...judge.refused_requests import OUT_OF_BOUNDS, other_config_than_judged
from ...judge.timers import HOLD, LEASE, judge_ramp_with_configuration, judge_status_period
from ...outcome import SELF_REPORTED, check, check_equal, check_fields, informational, require
from ..ch05_stream.drives import judge_corrected_drive

_MS: Final = 1000
_DEFAULT_MS: Final = 1500  # of default timers that are awaited
_LEAST_HOLD_MS: Final = 100  # of defaults that no SET_CONFIG extends
_LEAST_LEASE_MS: Final = 500
_JUST_RIGHT: Final[tuple[dict[str, Any], ...]] = (
    {"hold_ms": 1, "host_timeout_ms": 20, "sound_speed_mm_s": 300_000, "late_window_us": 0},
    {"hold_ms": 10_000, "ramp_ms": 2000, "host_timeout_ms": 10_000, "late_window_us": 100_000},
    {"sound_speed_mm_s": 380_000, "trace_divider": 0xFFFF, "status_period_ms": 65_535},
)
_FOCUS: Final = m.FocalPoint(11_000, -7_000, 120_000, 0xFFFF, 0x1234)
_STATUS_BYTES: Final = len(encode_frame(bytes(HEADER_BYTES + m.StatusReply.LAYOUT.size)))
_ELEMENTS_IN_FRAME: Final = (4075 - 14) // 18


@case("HG-7.1/1", needs=m.Feature.CONFIG)
def configuration_keeps_its_bounds(board: BoardClient) -> None:
    """values one beyond a bound are refused with their offset and change nothing; bounds are
    taken
    """
    before = board.read_config()
    for name, value in OUT_OF_BOUNDS:
        changes: dict[str, Any] = {"hold_ms": 777, name: value}
        wrong = dataclasses.replace(board.base_config, **changes)
        offset = m.Config.WIRE[name].offset
        board.link.refused(m.SetConfig(wrong), m.ErrorCode.BAD_VALUE, offset)
        text = f"{name} = {value} is refused, but has changed something"
        check_equal(board.read_config(), before, text)
    for values in _JUST_RIGHT:
        board.configure(**values)


@case("HG-7.1/2", needs=m.Feature.CONFIG)
def configuration_spares_the_line(board: BoardClient) -> None:
    """a status_period_ms at which STATUS takes more than a tenth of the line is refused"""
    least_ms = _STATUS_BYTES * 10 * 10 * 1000 // board.wire.baudrate
    require(least_ms > 10, "on a line this fast STATUS every 10 ms takes less than a tenth")
    if not board.wire.is_virtual:
        informational("whether this port is a line of that rate is not known here")
    period_ms = max(10, least_ms * 9 // 10)
    wrong = dataclasses.replace(board.base_config, status_period_ms=period_ms)
    offset = m.Config.WIRE["status_period_ms"].offset
    board.link.refused(m.SetConfig(wrong), m.ErrorCode.BAD_VALUE, offset)


@case("HG-7.1/3", needs=m.Feature.CONFIG, evidence=SELF_REPORTED)
def configuration_is_in_force_at_once(board: BoardClient) -> None:
    """STATUS period and late window are in force for the frame behind SET_CONFIG"""
    board.arm()
    period_ms = board.quick_status_ms
    wanted = dataclasses.replace(
        board.base_config, late_window_us=100_000, status_period_ms=period_ms
    )
    late_us = board.late_time_us(1000)
    with board.counting(late=1, latched=1):
        order, _ = board.link.request_wire(m.SetConfig(wanted))
        since = board.link.mark()
        board.link.exchange(order, board.link.stream_wire(board.flat_phases(), late_us))
        board.clock.wait_latched()
    board.config = wanted
    found = board.read_config()
    check_equal(found, wanted, "GET_CONFIG shows another configuration than was set")
    board.due_event(m.Status, since, 3 * period_ms * _MS, f"behind status_period_ms = {period_ms}")


@case("HG-7.1/3-ramp", needs=m.Feature.CONFIG | m.Feature.AMPLITUDE, depth=Depth.DEFAULT)
def configuration_lets_a_ramp_go_on(board: BoardClient) -> None:
    """a ramp that has begun goes on as it began"""
    judge_ramp_with_configuration(board, 50, 400, {"hold_ms": 5000, "ramp_ms": 0})


@case("HG-7.1/4", needs_reset=True)
def starts_with_the_default_configuration(board: BoardClient) -> None:
    """a configuration is gone after a reset, unless CONFIG_KEPT is advertised"""
    board.hello()
    board.need(m.Feature.CONFIG)
    found, set_before = board.read_config(), board.last_config
    require(set_before is not None, "nothing was set before the reset")
    kept = found == set_before
    if board.has(m.Feature.CONFIG_KEPT):
        check(kept, f"CONFIG_KEPT is advertised; before the reset {set_before}, now {found}")
    else:
        check(not kept, f"{found} has survived a reset, but CONFIG_KEPT is not advertised")


@case("HG-7.1/4-timers", needs_reset=True, depth=Depth.DEFAULT)
def follows_the_configuration_of_a_reset(board: BoardClient) -> None:
    """after a reset, without SET_CONFIG, STATUS, hold and lease are as the configuration says"""
    board.hello()
    if board.has(m.Feature.CONFIG | m.Feature.CONFIG_KEPT):
        board.config = board.read_config()
        board.configure(hold_ms=200, host_timeout_ms=400, status_period_ms=board.quick_status_ms)
        board = board.restarted()
    config = board.read_config()
    if not board.has(m.Feature.CONFIG):
        found = config.hold_ms, config.host_timeout_ms
        long_enough = config.hold_ms >= _LEAST_HOLD_MS and config.host_timeout_ms >= _LEAST_LEASE_MS
        check(long_enough, f"hold_ms, host_timeout_ms are {found}, and no SET_CONFIG extends them")
    ramp_ms = config.ramp_ms if board.has(m.Feature.AMPLITUDE) else 0  # HG-6.11/3
    longest_ms = max(config.hold_ms, config.host_timeout_ms) + ramp_ms
    text = f"the timers of this configuration take {longest_ms} ms"
    require(longest_ms <= _DEFAULT_MS, text)
    since = board.arm()
    start_us = latching.latch_timed(board)
    for timer, length_ms in ((HOLD, config.hold_ms), (LEASE, config.host_timeout_ms)):
        if timer is LEASE or config.hold_ms < config.host_timeout_ms:
            due_ms = length_ms + ramp_ms
            timer.judge(board, since, start_us, due_ms, f"{timer.name} after a reset")
        since = board.arm()
        start_us = board.clock.device_us()
    if config.status_period_ms and config.status_period_ms < longest_ms // 3:
        judge_status_period(board, 0, config.status_period_ms, 2, "after a reset")


@case("HG-7.1/4-fields", needs_reset=True, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def no_value_outlives_a_reset(board: BoardClient) -> None:
    """every field and the correction, set to other values, are the default again, or kept"""
    first = board.hello()
    board.need(m.Feature.CONFIG)
    kept = board.has(m.Feature.CONFIG_KEPT)
    board.config = default = board.read_config()
    if kept:
        board.configure()  # whatever was kept before
    shown = _drives_as_configured(board)
    other = board.link.call(m.SetConfig(_other_config_that_shows(board)), m.SetConfigReply)
    crc = other.config_crc
    if board.has(m.Feature.CORRECTION):
        uploads.upload_correction(board)
        assert board.correction is not None  # upload_correction
        crc = zlib.crc32(other.config.pack() + board.correction)
    if kept:
        shown = _drives_as_configured(board)
    board = board.restarted()
    again, found = board.identity, board.read_config()
    due, due_crc = (other.config, crc) if kept else (default, first.config_crc)
    how = "CONFIG_KEPT is advertised" if kept else "CONFIG_KEPT is not advertised"
    check_equal(found, due, f"the configuration after a reset, {how}")
    text, speed = f"after a reset, {how}: HELLO_REPLY", due.sound_speed_mm_s
    check_fields(again, text, config_crc=due_crc, sound_speed_mm_s=speed)
    check_equal(_drives_as_configured(board), shown, f"after a reset the drives are others: {how}")


def _other_config_that_shows(board: BoardClient) -> m.Config:
    """Return a configuration that differs from the board's in every field.

    Its timers are long enough that they do not expire at once.
    """
    hold_ms, lease_ms = board.config.hold_ms, board.config.host_timeout_ms
    return dataclasses.replace(
        other_config_than_judged(board),
        hold_ms=hold_ms - 1 or 2,
        host_timeout_ms=lease_ms - 1 if lease_ms > 20 else 21,
    )


def _drives_as_configured(board: BoardClient) -> list[bytes]:
    """Latch a frame; return each drive that can be read back: N phase, then N amplitude codes."""
    board.arm()
    has_points = board.has(m.Feature.POINTS)
    latching.latch_now(board, m.Points((_FOCUS,)) if has_points else board.flat_phases(0x40))
    found = [latching.read_back(board, kind) for kind in drive_kinds(board)]
    board.disarm()
    return [drive.phases + drive.amplitudes for drive in found]


@case("HG-7.1/5")
def configuration_has_its_crc(board: BoardClient) -> None:
    """config_crc is the CRC-32 of the 20 bytes in force and the N bytes of the correction"""
    corrections = [bytes(board.identity.transducers)]
    if board.has(m.Feature.CORRECTION):
        corrections.append(board.random_registers())
    for correction in corrections:
        if board.has(m.Feature.CORRECTION):
            uploads.upload_correction(board, correction)
        reply = board.link.call(m.GetConfig(), m.ConfigReply)
        due = zlib.crc32(reply.config.pack() + correction)
        for told in (reply, board.status(), board.hello()):
            check_fields(told, told.TYPE.name, config_crc=due)


@case("HG-7.1/6", needs=m.Feature.CONFIG)
def refuses_configuration_of_other_traces(board: BoardClient) -> None:
    """trace modes that are not advertised or not defined are refused"""
    lacking = [int(mode) for mode, feature in TRACE_CAPABILITIES.items() if not board.has(feature)]
    offset = m.Config.WIRE["trace_mode"].offset
    for mode in (*lacking, max(m.TraceMode) + 1, 0xFF):
        payload = bytearray(m.SetConfig(board.base_config).serialize())
        payload[offset] = mode
        board.link.refused_raw(m.SetConfig.TYPE, bytes(payload), m.ErrorCode.BAD_VALUE, offset)
    text = "a refused SET_CONFIG has changed the configuration"
    check_equal(board.read_config(), board.base_config, text)


@case("HG-7.9/1", needs=READ_BACKS | m.Feature.CORRECTION, evidence=SELF_REPORTED)
def adds_the_phase_correction(board: BoardClient) -> None:
    """the correction is added to the radiated phases, modulo 256; the latched drive stays"""
    registers, correction = board.random_registers(), board.random_registers()
    uploads.upload_correction(board, correction)
    board.arm()
    latching.latch_now(board, board.phases(registers))
    due = {"phases": registers, "amplitudes": b"\xff" * len(registers)}
    for codes in (correction, bytes(len(registers))):
        uploads.upload_correction(board, codes)
        check_fields(judge_corrected_drive(board, codes, "PHASES"), "the latched drive", **due)


@case("HG-7.9/2", needs=READ_BACKS | m.Feature.CONFIG | m.Feature.AMPLITUDE, evidence=SELF_REPORTED)
def keeps_under_the_amplitude_ceiling(board: BoardClient) -> None:
    """with a ceiling of 100 no radiated amplitude is above 100; the latched drive stays"""
    board.arm()
    for ceiling in (100, 1, 255):
        board.configure(amplitude_ceiling=ceiling)
        latching.latch_now(board)
        loudest = latching.read_back_radiated(board).loudest
        check(0 < loudest <= ceiling, f"ceiling {ceiling}: amplitude {loudest} is radiated")
        check_equal(
            latching.read_back(board).loudest, 255, f"ceiling {ceiling} changes the latched drive"
        )


def _judge_span(board: BoardClient, whole: Sequence[m.Element], first: int, asked: int) -> None:
    """FAILED unless GET_GEOMETRY of *asked* elements from *first* shows these, as in *whole*."""
    reply = board.link.call(m.GetGeometry(first, asked), m.GeometryReply)
    count = board.identity.transducers
    shown = tuple(whole[first : first + min(asked, _ELEMENTS_IN_FRAME)])
    text = f"GEOMETRY_REPLY of {asked} from {first}"
    check_fields(reply, text, total=count, first=first, elements=shown)


@case("HG-7.5/2")
def geometry_has_no_more_transducers(board: BoardClient) -> None:
    """GET_GEOMETRY from N on is refused with NOT_FOUND, detail N"""
    count = board.identity.transducers
    for first in (count, count + 1, 0xFFFF):
        board.link.refused(m.GetGeometry(first, 1), m.ErrorCode.NOT_FOUND, count)


@case("HG-7.5/3")
def geometry_is_the_grid(board: BoardClient) -> None:
    """GET_GEOMETRY is the grid of HELLO_REPLY: pitch, z = 0, normals (0, 0, 32767)"""
    nx, ny, pitch_um = board.identity.grid_nx, board.identity.grid_ny, board.identity.pitch_um
    require(bool(nx * ny), "this board is no grid")
    for n, element in enumerate(board.read_geometry()):
        ix, iy = divmod(n, ny)
        due_um = ((ix - (nx - 1) / 2) * pitch_um, (iy - (ny - 1) / 2) * pitch_um, 0)
        got_um = (element.x_um, element.y_um, element.z_um)
        near = all(abs(got - due) < 1 for got, due in zip(got_um, due_um, strict=True))
        grid = f"a grid of {nx} x {ny} and {pitch_um} µm"
        check(near, f"transducer {n} is at {got_um} µm, due by {grid} is {due_um}")
        normal = (element.nx, element.ny, element.nz)
        check_equal(normal, (0, 0, 32_767), f"the normal of transducer {n} is {normal}")


def spans_of_elements(count: int) -> list[tuple[int, int]]:
    """Return (first, count) at and around every edge of an array of *count*."""
    firsts = {0, 1, count // 2, count - 1} & set(range(count))
    counts = {0, 1, 2, count - 1, count, count + 1, 0xFFFF}
    return sorted((first, number) for first in firsts for number in counts if number >= 0)


def _judge_geometry(board: BoardClient) -> None:
    """FAILED unless spans from the first, second, middle and last element are as in the whole."""
    whole, total = board.read_geometry(), board.identity.transducers
    for first, count in spans_of_elements(total):
        _judge_span(board, whole, first, count)


@case("HG-7.5/1")
def shows_its_geometry(board: BoardClient) -> None:
    """GET_GEOMETRY of one, some and too many transducers shows those from first on"""
    _judge_geometry(board)


@case("HG-7.5/1-spans")
def every_span_of_the_geometry(board: BoardClient) -> None:
    """GET_GEOMETRY of spans at and around every edge shows the elements that the whole shows"""
    _judge_geometry(board)
    total = board.identity.transducers
    for first in (total, 0xFFFF):
        board.link.refused(m.GetGeometry(first, 1), m.ErrorCode.NOT_FOUND, total)
