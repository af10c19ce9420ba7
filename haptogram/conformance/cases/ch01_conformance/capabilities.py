"""HG-1.2: a board does all that its capabilities say, and refuses everything else."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from haptogram_protocol import messages as m
from haptogram_protocol.rules import PLAYBACK

from ...case import case
from ...client import latching, uploads
from ...client.board_client import BoardClient
from ...outcome import SELF_REPORTED, check, require

_POINT: Final = m.FocalPoint(0, 0, 150_000, 65_535, 0)
_LATCHED, _RADIATED = (
    m.ReadDrive(m.DriveKind.LATCHED, 0, 1),
    m.ReadDrive(m.DriveKind.RADIATED, 0, 1),
)
_USES: Final[dict[m.Feature, Callable[[BoardClient], object]]] = {
    m.Feature.AMPLITUDE: lambda b: _latches_as_advertised(b, _advertised_drives(b)),
    m.Feature.POINTS: lambda b: _latches_as_advertised(b, m.Points((_POINT,))),
    m.Feature.SEQUENCE_PHASES: lambda b: uploads.upload_to_board(
        b, m.UploadKind.PHASES, 1, _zeros(b)
    ),
    m.Feature.SEQUENCE_POINTS: lambda b: uploads.upload_to_board(
        b, m.UploadKind.POINTS, 2, _POINT.pack(), 1
    ),
    m.Feature.CONFIG: lambda b: b.link.call(m.SetConfig(b.base_config), m.SetConfigReply),
    m.Feature.CORRECTION: lambda b: uploads.upload_to_board(
        b, m.UploadKind.CORRECTION, 0, _zeros(b)
    ),
    m.Feature.READ_LATCHED: lambda b: b.link.call(_LATCHED, m.DriveReply),
    m.Feature.READ_RADIATED: lambda b: b.link.call(_RADIATED, m.DriveReply),
    m.Feature.TRACE: lambda b: _traces_as_advertised(b, m.TraceMode.CRC, m.Trace),
    m.Feature.TRACE_DRIVE: lambda b: _traces_as_advertised(b, m.TraceMode.DRIVE, m.TraceDrive),
    m.Feature.TRACE_RING: lambda b: b.link.call(m.ReadTrace(0, 1), m.TraceReply),
}
# Requests that are right in everything but the capability that they need.
_REQUESTS: Final[tuple[tuple[m.Feature, Callable[[BoardClient], m.Message]], ...]] = (
    (m.Feature.CONFIG, lambda b: m.SetConfig(b.config)),
    (m.Feature.READ_LATCHED, lambda _: _LATCHED),
    (m.Feature.READ_RADIATED, lambda _: _RADIATED),
    (m.Feature.TRACE_RING, lambda _: m.ReadTrace(0, 1)),
    (PLAYBACK, lambda _: m.Play(1, 1000, 1, 100)),
    (
        m.Feature.SEQUENCE_PHASES,
        lambda b: m.UploadBegin(m.UploadKind.PHASES, 0, 1, len(_zeros(b)), 0),
    ),
    (m.Feature.SEQUENCE_POINTS, lambda _: m.UploadBegin(m.UploadKind.POINTS, 1, 1, 16, 0)),
    (
        m.Feature.CORRECTION,
        lambda b: m.UploadBegin(m.UploadKind.CORRECTION, 0, 0, len(_zeros(b)), 0),
    ),
)


def _zeros(board: BoardClient) -> bytes:
    """Return code 0, one byte, for each transducer."""
    return bytes(board.identity.transducers)


def _advertised_drives(board: BoardClient) -> m.Drives:
    """Return a DRIVES frame with phase and amplitude code 255 for each transducer."""
    return m.Drives(bytes([255]) * 2 * board.identity.transducers)


def _latches_as_advertised(board: BoardClient, message: m.Message) -> None:
    """FAILED unless the armed board latches *message*, a frame of a type that it advertises."""
    board.arm()
    with board.counting(latched=1):
        index = latching.latch_now(board, message)
    board.check_status(f"{message.TYPE.name} are advertised", last_seq=index)


def _traces_as_advertised(board: BoardClient, mode: m.TraceMode, kind: type[m.Message]) -> None:
    """FAILED unless the board sends an event of type *kind* for a latch in trace mode *mode*."""
    since = board.arm(trace_mode=mode)
    latching.latch_now(board)
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
        board.link.refused(message, m.ErrorCode.UNSUPPORTED, message.TYPE)


@case("HG-1.2/3", evidence=SELF_REPORTED)
def drops_frames_of_capabilities_not_advertised(board: BoardClient) -> None:
    """DRIVES and POINTS are dropped and counted in unknown_type where they are not advertised"""
    frames: dict[m.Feature, m.Message] = {
        m.Feature.AMPLITUDE: _advertised_drives(board),
        m.Feature.POINTS: m.Points((_POINT,)),
    }
    lacking = [message for feature, message in frames.items() if not board.has(feature)]
    require(bool(lacking), "the board advertises every capability that a stream frame can need")
    board.arm()
    with board.counting(unknown_type=len(lacking), latched=0):
        for message in lacking:
            board.link.stream(message)
        board.clock.wait_latched()
