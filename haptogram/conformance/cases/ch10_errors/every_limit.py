"""HG-5.7, HG-7.1, HG-7.2, HG-7.3, HG-7.4, HG-7.5, HG-7.6, HG-8.6: limits, passed by each bit."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, Final, TypeAlias

from haptogram_protocol import messages as m
from haptogram_protocol.rules import CONFIG_BOUNDS

from ...case import Case, Depth, case
from ...client import playback, uploads
from ...client.board_client import BoardClient
from ...outcome import SELF_REPORTED, check_equal, named

_SEQUENCE: Final = 5
_SIZE_FRAMES: Final = 3
_HALF: Final = 1 << 31
_SPARE_US: Final = 1 << 22  # more than a slow line takes for all of these frames
_WIDTHS: Final[dict[str, int]] = {
    name: 8 * field.size
    for kind in (m.Config, m.GetGeometry, m.Play, m.UploadBegin, m.UploadChunk)
    for name, field in kind.WIRE.items()
}

#: A request beyond a limit: name of the value, request, code and detail of its refusal, header.
_Beyond: TypeAlias = tuple[str, m.Message, m.ErrorCode, int | None, dict[str, Any]]


def _values_beyond(least: int, most: int, bits: int) -> list[int]:
    """Return 0 and values of *bits* bits outside the limits, off by one, a bit or a power of two.

    Examples
    --------
    >>> _values_beyond(2, 5, 4)
    [0, 1, 6, 7, 9, 10, 13, 15]
    """
    found = {0, least - 1, most + 1, (1 << bits) - 1, (1 << bits - 1) - 1}
    for bit in range(bits):
        found |= {edge ^ 1 << bit for edge in (least, most)}
        found |= {edge + (1 << bit) for edge in (least, most)}
    beyond = (value for value in found if not least <= value <= most)
    return sorted(value for value in beyond if 0 <= value < 1 << bits)


def _settings_beyond_limits(board: BoardClient) -> Iterator[_Beyond]:
    """Yield SET_CONFIG requests with one value outside its limits, and the ERROR due."""
    for name, (least, most) in CONFIG_BOUNDS.items():
        for value in _values_beyond(least, most, _WIDTHS[name]):
            if name == "status_period_ms" and value == 0:
                continue  # none
            changes: dict[str, Any] = {name: value}
            wrong = m.SetConfig(dataclasses.replace(board.config, **changes))
            yield f"{name} = {value}", wrong, m.ErrorCode.BAD_VALUE, m.Config.WIRE[name].offset, {}


def _sizes_beyond_limits(board: BoardClient) -> Iterator[_Beyond]:
    """Yield uploads of more frames than the board has room for, and the ERROR due."""
    for form in uploads.upload_forms(board, _SEQUENCE):
        if not form.target:
            continue
        unit = form.frame_bytes
        for frames in _values_beyond(1, form.most_frames(board), _WIDTHS["size"]):
            if 0 < frames * unit < 1 << _WIDTHS["size"]:
                name = f"{frames} frames of {form.kind.name}, {unit} bytes each"
                yield name, form.request(frames * unit), m.ErrorCode.TOO_LARGE, None, {}


def _targets_beyond_limits(board: BoardClient) -> Iterator[_Beyond]:
    """Yield uploads of a correction with a target other than 0, and the ERROR due."""
    offset = m.UploadBegin.WIRE["target"].offset
    for target in _values_beyond(0, 0, _WIDTHS["target"]):
        begin = m.UploadBegin(m.UploadKind.CORRECTION, 0, target, board.identity.transducers, 0)
        yield f"a correction for {target:#06x}", begin, m.ErrorCode.BAD_VALUE, offset, {}


def _offsets_beyond_limits(board: BoardClient) -> Iterator[_Beyond]:
    """Begin an upload; yield chunks with an offset outside it, and the ERROR due."""
    size = _begin_upload_with_limits(board)
    for offset in _values_beyond(0, size - 1, _WIDTHS["offset"]):
        for length in (1, 2):
            chunk = m.UploadChunk(offset, bytes(length))
            yield f"{length} bytes at {offset} of {size}", chunk, m.ErrorCode.BAD_VALUE, 0, {}


def _commits_beyond_limits(board: BoardClient) -> Iterator[_Beyond]:
    """Begin an upload; yield commits that name another target, and the ERROR due."""
    _begin_upload_with_limits(board)
    for target in _values_beyond(_SEQUENCE, _SEQUENCE, _WIDTHS["target"]):
        commit = m.UploadCommit(target)
        yield f"a commit of {target:#06x} for 5", commit, m.ErrorCode.BAD_VALUE, 0, {}


def _begin_upload_with_limits(board: BoardClient) -> int:
    """Begin an upload of a sequence, and return its size in bytes."""
    form = uploads.upload_forms(board, _SEQUENCE)[0]
    size = min(_SIZE_FRAMES, form.most_frames(board)) * form.frame_bytes
    uploads.announce_upload(board, form.request(size))
    return size


def _elements_beyond_limits(
    make: Callable[[int, int], m.Message], board: BoardClient
) -> Iterator[_Beyond]:
    """Yield requests by *make* (first, number) from beyond the last element, and the ERROR due."""
    count = board.identity.transducers
    for first in _values_beyond(0, count - 1, _WIDTHS["first"]):
        for number in (1, 0xFFFF):
            name = f"{number} from {first} of {count}"
            yield name, make(first, number), m.ErrorCode.NOT_FOUND, count, {}


def _play_within_limits(board: BoardClient) -> m.Play:
    """Return a PLAY that an ARMED board carries out."""
    playback.send_phases_to_store(board, _SEQUENCE, frames=1)
    board.arm()
    return playback.play_request(board, _SEQUENCE, loops=1, unattended_ms=1000)


def _sequences_beyond_limits(board: BoardClient) -> Iterator[_Beyond]:
    """Yield PLAY requests of sequences that are not stored, and the ERROR due."""
    right = _play_within_limits(board)
    for sequence in _values_beyond(_SEQUENCE, _SEQUENCE, _WIDTHS["sequence"]):
        if sequence not in uploads.SEQUENCES:
            wrong = dataclasses.replace(right, sequence=sequence)
            header = {"flags": int(m.Flag.IMMEDIATE)}
            yield f"sequence {sequence:#06x}", wrong, m.ErrorCode.NOT_FOUND, None, header


def _playbacks_beyond_limits(board: BoardClient) -> Iterator[_Beyond]:
    """Yield PLAY requests with period, unattended time or start out of bounds, and the ERROR."""
    right, identity, bad = _play_within_limits(board), board.identity, m.ErrorCode.BAD_VALUE
    header = {"flags": int(m.Flag.IMMEDIATE)}
    bounds = {
        "period_us": (playback.least_period_us(board), (1 << _WIDTHS["period_us"]) - 1),
        "unattended_ms": (1, identity.max_unattended_ms),
    }
    for name, (least, most) in bounds.items():
        for value in _values_beyond(least, most, _WIDTHS[name]):
            changes: dict[str, Any] = {name: value}
            wrong = dataclasses.replace(right, **changes)
            yield f"{name} = {value}", wrong, bad, m.Play.WIRE[name].offset, header
    for off_us in _times_beyond_limits(board):
        time_us = board.clock.device_us() + off_us
        yield f"a start {off_us} µs from now", right, bad, 0, {"time_us": time_us}


def _times_beyond_limits(board: BoardClient) -> list[int]:
    """Return offsets from now in µs that lie before the late window or 4 s beyond the horizon.

    None of the latter where that is 2^31 µs ahead.
    """
    passed = [-board.config.late_window_us - (1 << bit) for bit in range(10, 31)]
    horizon_us = board.identity.max_horizon_us + _SPARE_US
    ahead = [horizon_us + (1 << bit) for bit in range(31) if horizon_us + (1 << bit) < _HALF - 1]
    return [*passed, *ahead, *({horizon_us, _HALF - _SPARE_US} if ahead else set())]


_DRIVES_BEYOND_LIMITS: Final = partial(
    _elements_beyond_limits, partial(m.ReadDrive, m.DriveKind.LATCHED)
)
_REQUESTS: Final[
    tuple[tuple[str, m.Feature, str, Callable[[BoardClient], Iterator[_Beyond]]], ...]
] = (
    ("HG-7.1/1", m.Feature.CONFIG, "settings", _settings_beyond_limits),
    ("HG-7.2/1", m.Feature.SEQUENCE_PHASES, "uploads of sizes", _sizes_beyond_limits),
    ("HG-7.2/3", m.Feature.CORRECTION, "targets of a correction", _targets_beyond_limits),
    ("HG-7.3/4", m.Feature.SEQUENCE_PHASES, "offsets of a chunk", _offsets_beyond_limits),
    ("HG-7.4/4", m.Feature.SEQUENCE_PHASES, "targets of a commit", _commits_beyond_limits),
    (
        "HG-7.5/2",
        m.Feature(0),
        "first transducers",
        partial(_elements_beyond_limits, m.GetGeometry),
    ),
    ("HG-7.6/1", m.Feature.SEQUENCE_PHASES, "sequences of PLAY", _sequences_beyond_limits),
    ("HG-7.6/2", m.Feature.SEQUENCE_PHASES, "periods, times, starts", _playbacks_beyond_limits),
    ("HG-8.6/2", m.Feature.READ_LATCHED, "first transducers", _DRIVES_BEYOND_LIMITS),
)


def _case_of_limits(
    clause: str, needs: m.Feature, names: str, beyond: Callable[[BoardClient], Iterator[_Beyond]]
) -> Case:
    """Return the case that sends the requests of *beyond*; FAILED unless each is refused.

    *names* says in the summary what is beyond its limit.
    """

    def body(board: BoardClient) -> None:
        before = board.link.call(m.GetConfig(), m.ConfigReply)
        for name, message, code, detail, header in beyond(board):
            with named(name):
                board.link.refused(message, code, detail, **header)
        after = board.link.call(m.GetConfig(), m.ConfigReply)
        check_equal(after, before, "refused requests changed the configuration")

    summary = f"{names} beyond a limit by each bit of their field, and the sign, are refused"
    return Case(clause, summary, body, "bits", needs, depth=Depth.DEFAULT)


LIMITS_OF_REQUESTS: Final = tuple(_case_of_limits(*row) for row in _REQUESTS)


def _judge_times_beyond_limits(board: BoardClient, counter: str, offs_us: list[int]) -> None:
    """FAILED unless frames for these offsets from now are dropped and counted in *counter*."""
    board.arm()
    now_us = board.clock.device_us()
    frame = board.shortest_stream()
    with board.counting(**{counter: len(offs_us)}, accepted=0):
        board.link.send(*(board.link.stream_wire(frame, now_us + off_us) for off_us in offs_us))
        board.link.barrier()


@case("HG-5.7/4-bits", evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def every_time_beyond_the_horizon_is_a_limit(board: BoardClient) -> None:
    """frames beyond the horizon by each power of two of microseconds are dropped_future"""
    ahead = [off_us for off_us in _times_beyond_limits(board) if off_us > 0]
    _judge_times_beyond_limits(board, "dropped_future", ahead)


@case("HG-5.7/5-bits", evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def every_time_that_has_passed_is_a_limit(board: BoardClient) -> None:
    """frames by each power of two of microseconds beyond the late window are dropped_late"""
    passed = [off_us for off_us in _times_beyond_limits(board) if off_us < 0]
    _judge_times_beyond_limits(board, "dropped_late", passed)
