"""HG-1.2: a board does all that its capabilities say, and refuses everything else."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from haptogram_protocol.messages import (
    DriveKind,
    DriveReply,
    Drives,
    ErrorCode,
    Feature,
    FocalPoint,
    Message,
    Play,
    Points,
    ReadDrive,
    ReadTrace,
    SetConfig,
    SetConfigReply,
    Trace,
    TraceDrive,
    TraceMode,
    TraceReply,
    UploadBegin,
    UploadKind,
)
from haptogram_protocol.rules import PLAYBACK

from ...case import case
from ...client.board_client import BoardClient
from ...client.latching import latch_now
from ...client.uploads import upload_to_board
from ...outcome import SELF_REPORTED, check, require

_POINT: Final = FocalPoint(0, 0, 150_000, 65_535, 0)
_LATCHED, _RADIATED = ReadDrive(DriveKind.LATCHED, 0, 1), ReadDrive(DriveKind.RADIATED, 0, 1)
_USES: Final[dict[Feature, Callable[[BoardClient], object]]] = {
    Feature.AMPLITUDE: lambda b: _is_advertised_drive_latched(b, _advertised_drives(b)),
    Feature.POINTS: lambda b: _is_advertised_drive_latched(b, Points((_POINT,))),
    Feature.SEQUENCE_PHASES: lambda b: upload_to_board(b, UploadKind.PHASES, 1, _zeros(b)),
    Feature.SEQUENCE_POINTS: lambda b: upload_to_board(b, UploadKind.POINTS, 2, _POINT.pack(), 1),
    Feature.CONFIG: lambda b: b.link.call(SetConfig(b.base_config), SetConfigReply),
    Feature.CORRECTION: lambda b: upload_to_board(b, UploadKind.CORRECTION, 0, _zeros(b)),
    Feature.READ_LATCHED: lambda b: b.link.call(_LATCHED, DriveReply),
    Feature.READ_RADIATED: lambda b: b.link.call(_RADIATED, DriveReply),
    Feature.TRACE: lambda b: _traces_as_advertised(b, TraceMode.CRC, Trace),
    Feature.TRACE_DRIVE: lambda b: _traces_as_advertised(b, TraceMode.DRIVE, TraceDrive),
    Feature.TRACE_RING: lambda b: b.link.call(ReadTrace(0, 1), TraceReply),
}
# Requests that are right in everything but the capability that they need.
_REQUESTS: Final[tuple[tuple[Feature, Callable[[BoardClient], Message]], ...]] = (
    (Feature.CONFIG, lambda b: SetConfig(b.config)),
    (Feature.READ_LATCHED, lambda _: _LATCHED),
    (Feature.READ_RADIATED, lambda _: _RADIATED),
    (Feature.TRACE_RING, lambda _: ReadTrace(0, 1)),
    (PLAYBACK, lambda _: Play(1, 1000, 1, 100)),
    (Feature.SEQUENCE_PHASES, lambda b: UploadBegin(UploadKind.PHASES, 0, 1, len(_zeros(b)), 0)),
    (Feature.SEQUENCE_POINTS, lambda _: UploadBegin(UploadKind.POINTS, 1, 1, 16, 0)),
    (Feature.CORRECTION, lambda b: UploadBegin(UploadKind.CORRECTION, 0, 0, len(_zeros(b)), 0)),
)


def _zeros(board: BoardClient) -> bytes:
    return bytes(board.identity.transducers)


def _advertised_drives(board: BoardClient) -> Drives:
    return Drives(bytes([255]) * 2 * board.identity.transducers)


def _is_advertised_drive_latched(board: BoardClient, message: Message) -> None:
    board.arm()
    with board.counting(latched=1):
        index = latch_now(board, message)
    board.check_status(f"{message.TYPE.name} are advertised", last_seq=index)


def _traces_as_advertised(board: BoardClient, mode: TraceMode, kind: type[Message]) -> None:
    since = board.arm(trace_mode=mode)
    latch_now(board)
    board.link.barrier()
    told = bool(board.link.events(kind, since))
    check(told, f"{kind.TYPE.name} is advertised, but a latch gives no event")


@case("HG-1.2/1")
def advertised_capabilities_are_there(board: BoardClient) -> None:
    """every capability that the board advertises is used once, and works"""
    for feature, use in _USES.items():
        if board.has(feature):
            board.hello()
            use(board)


@case("HG-1.2/2")
def refuses_capabilities_not_advertised(board: BoardClient) -> None:
    """requests that need a capability which is not advertised are refused: UNSUPPORTED"""
    lacking = [make for any_of, make in _REQUESTS if not board.identity.features & any_of]
    require(bool(lacking), "the board advertises every capability that a request can need")
    for make in lacking:
        message = make(board)
        board.link.refused(message, ErrorCode.UNSUPPORTED, message.TYPE)


@case("HG-1.2/3", evidence=SELF_REPORTED)
def drops_frames_of_capabilities_not_advertised(board: BoardClient) -> None:
    """DRIVES and POINTS are dropped and counted in unknown_type where they are not advertised"""
    frames: dict[Feature, Message] = {
        Feature.AMPLITUDE: _advertised_drives(board),
        Feature.POINTS: Points((_POINT,)),
    }
    lacking = [message for feature, message in frames.items() if not board.has(feature)]
    require(bool(lacking), "the board advertises every capability that a stream frame can need")
    board.arm()
    with board.counting(unknown_type=len(lacking), latched=0):
        for message in lacking:
            board.link.stream(message)
        board.clock.wait_latched()
