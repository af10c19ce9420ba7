"""The virtual boards of the commands: in this program, in virtual time, or behind a URL.

Everything else in the host meets a board through a port.
"""

from __future__ import annotations

import contextlib
import dataclasses
import functools
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from ..errors import ConfigurationError

if TYPE_CHECKING:
    from ..campaigns.soak.comparison import MakeBoard
    from ..conformance.run.access import VirtualAccess
    from ..driver.line.port import Transport
    from ..evidence.boards import BoardUnderTest
    from ..evidence.recordings.replay import RecordingReplayBoard
    from ..evidence.recordings.tap import RecordedBoards
    from ..evidence.recordings.writer import RecordingWriter
    from ..evidence.run_record import DialectBoardsUnderTest
    from ..settings.board import BoardConfig
    from ..settings.board_url import PortConfig
    from ..settings.run.verify import VerifyConfig

# Boards that take time to start, such as InteractLab's, have done so before a client comes.
_STARTED_NS: Final = 1_500_000_000
_LAST_FRAMES_NS: Final = 50_000_000
_PIECE_BYTES: Final = 64  # bytes at once of a line without a rate; no two messages that radiate fit
_BETWEEN_PIECES_NS: Final = 300_000  # longer than the latches of AUTD3 are apart


def prepare_simulator(config: VerifyConfig) -> BoardConfig:
    """Open the way to a board in this program, and return the settings of the virtual board.

    Raises
    ------
    ConfigurationError
        For a URL or a fault that is refused, or a plan that cannot be read.
    """
    import sim_device

    from ..settings.board_url import SCHEME, read_board_url

    sim_device.register_url_handler()
    if config.link.port is not None and config.link.port.startswith(SCHEME):
        board = read_board_url(config.link.port).board
        if config.link.dialect is None and board.dialect is not None:
            raise ConfigurationError(
                f"port {config.link.port} is a board of another dialect: give --dialect "
                f"{board.dialect} as well"
            )
        return board
    board = config.virtual_board()
    if board.faults:
        from sim_device.blueprint import blueprint_of

        blueprint_of(board)  # refuses a fault that this board cannot have, before one is started
    return board


@contextlib.contextmanager
def board_in_virtual_time(
    config: BoardConfig, *, searches: bool = True
) -> Iterator[BoardUnderTest]:
    """Make a virtual board in this program, behind the same bytes as any other.

    *searches* False: its back door lacks the fields that only a search of the whole volume tells,
    as that of several foci.
    """
    from ..settings.board_url import PortConfig

    reconstruct = config.dialect is None  # else whoever knows the frames does
    port = PortConfig(board=config, clock="virtual", reconstruct=reconstruct)
    label = "virtual board" if config.simulator is None else f"simulated by {config.simulator!r}"
    with _board_in_program(port, f"{label}, in virtual time", searches=searches) as board:
        yield board


@contextlib.contextmanager
def board_behind_url(url: str) -> Iterator[BoardUnderTest]:
    """Make the virtual board in this program that *url* describes, whose back door is at hand.

    Raises
    ------
    ConfigurationError
        For a URL that gives the back door to somebody else.
    """
    from ..settings.board_url import read_board_url

    port = read_board_url(url)
    if port.backdoor is not None:
        raise ConfigurationError(
            f"port {url}: backdoor writes {port.backdoor}, and verify judges by the back door "
            "itself: leave backdoor out"
        )
    with _board_in_program(dataclasses.replace(port, reconstruct=False), url) as board:
        yield board


@contextlib.contextmanager
def _board_in_program(
    config: PortConfig, label: str, *, searches: bool = True
) -> Iterator[BoardUnderTest]:
    """Run a virtual board in this program; yield it as a board under test with the name *label*.

    *searches* is that of :func:`board_in_virtual_time`.
    """
    from sim_device.protocol_haptogram import open_virtual_port

    from ..driver.line.port import PyserialTransport
    from ..evidence.boards import InProcessBoardUnderTest

    with contextlib.closing(open_virtual_port(config)) as port:
        if not searches:
            port.skip_searches()
        model = port.simulation.settings.truth
        transport = PyserialTransport(port, label)
        yield InProcessBoardUnderTest(
            transport,
            lambda: port.records,
            port.wait_until_ns,
            model,
            label,
            lambda: port.observations,
            lambda: port.brief_records,
        )


def boards_of_dialect(config: VerifyConfig) -> DialectBoardsUnderTest:
    """Return the boards of the dialect that *config* names, of ours or of another package.

    Raises
    ------
    ConfigurationError
        For a dialect, an option of it or an array that is refused.
    """
    from sim_device.blueprint import blueprint_of
    from sim_device.dialects.table import emulation_of

    from ..evidence.run_record import DialectBoardsUnderTest
    from ..settings.board import BoardConfig

    pitch_mm = config.array.pitch_mm
    blueprint = blueprint_of(BoardConfig.of(**config.dialect_options(), pitch_mm=pitch_mm))
    settings = blueprint.settings
    if settings.wiring is None:
        raise ConfigurationError(f"dialect is {config.link.dialect!r}, whose boards have no wiring")
    return DialectBoardsUnderTest(
        emulation_of(settings.wiring.dialect).dialect,
        settings.model.array,
        settings.wiring.channels,
        settings.calibration,
    )


def access_in_program(
    url: str | None, baudrate: int, seed: int, boards: RecordedBoards | None = None
) -> VirtualAccess:
    """Return a virtual board in this program that restarts whenever its port is opened.

    Without a URL its time is virtual; *baudrate* and *seed* hold unless the URL gives others.
    With *boards* every board goes into their recording.
    """
    from sim_device.protocol_haptogram import Serial, open_virtual_port

    from ..conformance.run.access import VirtualAccess
    from ..driver.line.port import PyserialTransport
    from ..settings.board import BoardConfig
    from ..settings.board_url import PortConfig, read_board_url, write_board_url

    defaults = BoardConfig.of(baud=baudrate, seed=seed)
    first = (
        PortConfig(clock="virtual", board=defaults)
        if url is None
        else read_board_url(url, defaults)
    )

    opened: list[Serial] = []

    def start(number: int) -> Transport:
        # Another seed gives another boot_id, as a reset does.
        board = dataclasses.replace(first.board, seed=first.board.seed + number)
        config = dataclasses.replace(first, board=board)
        name = write_board_url(config)
        if boards is not None and config.backdoor is None and config.reconstruct is None:
            config = dataclasses.replace(config, reconstruct=False)
        port = open_virtual_port(config)
        opened[:] = [port]
        if boards is None:
            return PyserialTransport(port, name)
        return boards(
            PyserialTransport(port, name),
            board.non_default(),
            lambda: port.records,
            just_powered=config.is_virtual,
        )

    def raise_fault() -> None:
        if boards is not None:
            boards.hardware_fault()
        opened[0].raise_hardware_fault()

    simulator = first.board.simulator
    name = url or write_board_url(first)
    return VirtualAccess(
        name if simulator is None else f"simulated by {simulator!r}",
        start,
        baudrate=first.board.line.baud or baudrate,
        virtual=first.is_virtual,
        raise_fault=raise_fault if simulator is None else None,
    )


def replayed_board(options: Mapping[str, Any], paced: bool) -> RecordingReplayBoard:
    """Return a virtual board that recorded bytes are fed to.

    Raises
    ------
    ConfigurationError
        If there is no such board.
    """
    from sim_device.driven.replay_board import VirtualReplayBoard

    from ..settings.board import BoardConfig

    return VirtualReplayBoard(BoardConfig.of(**options), paced=paced)


def open_recording_of_board(path: Path, options: Mapping[str, Any]) -> RecordingWriter:
    """Return the recording that a virtual board writes.

    Raises
    ------
    ConfigurationError
        If it cannot be written.
    """
    from ..evidence.recordings.writer import RecordingWriter

    return RecordingWriter(path, command="board", configuration=options, waits=True)


def board_without_a_line(mutant: str | None) -> MakeBoard:
    """Return a function that powers up virtual boards whose line is the caller's.

    Raises
    ------
    ConfigurationError
        If there is no such mutant.
    """
    from sim_device.driven.soak_board import VirtualSoakBoard
    from sim_device.mutants import mutant_parts

    mutant_parts(mutant)
    return functools.partial(VirtualSoakBoard.power_up, mutant=mutant)


def records_of_bytes(config: BoardConfig, data: bytes) -> list[dict[str, Any]]:
    """Return the back door of a virtual board in this program that takes the bytes of a client.

    Raises
    ------
    ConfigurationError
        If the board cannot be built.
    """
    from haptogram_protocol.dialects.table import DIALECTS
    from sim_device.protocol_haptogram import open_virtual_port

    from ..settings.board_url import PortConfig

    with contextlib.closing(
        open_virtual_port(PortConfig(board=config, clock="virtual", reconstruct=False))
    ) as port:
        port.wait_until_ns(port.now_ns() + _STARTED_NS)
        # On a line without a rate a message that comes at once would hide the one before.
        has_rate = config.dialect is None or DIALECTS[config.dialect].bauds
        size = max(1, len(data)) if has_rate else _PIECE_BYTES
        for begin in range(0, len(data), size):
            port.write(data[begin : begin + size])
            port.flush()
            port.wait_until_ns(port.now_ns() + _BETWEEN_PIECES_NS)
        # What waits in the board, such as a FIFO of frames, is shown as well.
        port.wait_until_ns(port.now_ns() + _LAST_FRAMES_NS)
        port.simulation.unplug()  # it is looked at once more when its client leaves
    return list(port.records)
