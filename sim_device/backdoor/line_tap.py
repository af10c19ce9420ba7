"""The tap of a board's line for a recording: bytes both ways, latches, changes of the output.

The recording itself is the caller's: this package knows no file format.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Protocol, TypeAlias

from haptogram.records.latch import LatchRecord
from haptogram.settings.board import BoardConfig

from ..board.settings import BoardSettings
from .recorder import InlineReconstructionWorker


class LineTapRecording(Protocol):
    """A recording that is being written; times are nanoseconds."""

    failure: str

    def begin(self) -> None:
        """Replace the file that was there."""

    def opened(
        self, t_ns: int, board: Mapping[str, Any] | None, boot_ns: int | None, *, paced: bool
    ) -> None:
        """Write that a line to a board begins."""

    def to_board(self, t_ns: int, data: bytes, waited_ns: int = 0) -> None:
        """Write bytes that the port took from the host."""

    def to_host(self, t_ns: int, data: bytes) -> None:
        """Write bytes that the board handed to the port."""

    def departed(self, t_ns: int) -> None:
        """Write that the host closed the port."""

    def latch(self, latch: LatchRecord) -> None:
        """Write a latch."""

    def record(self, record: Mapping[str, Any]) -> None:
        """Write a record of the back door."""

    def close(self) -> None:
        """Write the end."""


#: Given a file and the options of the command, opens a recording.
OpenRecording: TypeAlias = Callable[[Path, Mapping[str, Any]], LineTapRecording]


class LineTap(InlineReconstructionWorker):
    """Writes down what a board does and what passes its port.

    Bytes have the time of the device clock at power-up plus what has passed since, so that they
    stand beside the latches on one scale.

    Parameters
    ----------
    recording : LineTapRecording
        Is closed with this.
    config : BoardConfig
        The board, as it can be built again.
    settings : BoardSettings
        The same, built.
    paced : bool, keyword-only
        Whether a simulated line carries the bytes.
    """

    def __init__(
        self,
        recording: LineTapRecording,
        config: BoardConfig,
        settings: BoardSettings,
        *,
        paced: bool,
    ) -> None:
        self._recording = recording
        self._boot_ns = settings.boot_us * 1000
        options = {"seed": config.seed} | config.non_default()
        recording.opened(self._boot_ns, options, self._boot_ns, paced=paced)
        super().__init__(settings, recording.record, reconstruct=False, direct=recording.latch)

    def begin(self) -> None:
        """Replace the file that was there: the port is open."""
        self._recording.begin()

    def to_board(self, t_ns: int, data: bytes, waited_ns: int) -> None:
        """Take down bytes that the board took at *t_ns* since power-up."""
        self._recording.to_board(self._boot_ns + t_ns, data, waited_ns)

    def to_host(self, t_ns: int, data: bytes) -> None:
        """Take down bytes that the port was given."""
        self._recording.to_host(self._boot_ns + t_ns, data)

    def departed(self, t_ns: int) -> None:
        """Take down that the host has closed the port."""
        self._recording.departed(self._boot_ns + t_ns)

    def close(self) -> str:
        """Write the end; return why the recording ended early, or nothing."""
        self.finish()
        self._recording.close()
        return self._recording.failure
