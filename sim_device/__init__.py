"""The virtual board: an emulated ultrasonic phased array at the far end of a serial line.

Names are imported when they are asked for: ``python -m sim_device`` has to settle the number of
numerical threads before numpy is imported, and importing this package does nothing.
"""

from __future__ import annotations

TYPE_CHECKING = False  # without typing: Ctrl-C is answered once .__main__ is loaded

if TYPE_CHECKING:
    from typing import Any, Final

    from .backdoor.recorder import InlineReconstructionWorker as InlineReconstructionWorker
    from .backdoor.worker import ReconstructionWorker as ReconstructionWorker
    from .board.board import Board as Board
    from .board.events import Latch as Latch
    from .board.settings import BoardSettings as BoardSettings
    from .board.settings import board_settings as board_settings
    from .board.stream_queue import StreamFrame as StreamFrame
    from .protocol_haptogram import register_url_handler as register_url_handler
    from .simulation import Simulation as Simulation

_HOME: Final = {
    "Board": "board.board",
    "BoardSettings": "board.settings",
    "InlineReconstructionWorker": "backdoor.recorder",
    "Latch": "board.events",
    "ReconstructionWorker": "backdoor.worker",
    "Simulation": "simulation",
    "StreamFrame": "board.stream_queue",
    "board_settings": "board.settings",
    "register_url_handler": "protocol_haptogram",
}


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    import importlib

    return getattr(importlib.import_module(f".{_HOME[name]}", __name__), name)


__all__ = [*_HOME]
