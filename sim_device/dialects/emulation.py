"""Everything that the boards of a dialect need: wire, boards, emitters and options.

An entry point of the group ``haptogram.dialects`` names an :class:`Emulation` of another package;
docs/dialects.md has a worked example.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Final, Self

from haptogram.acoustics import Calibration, TransducerArray
from haptogram.acoustics.model.boards.layout import BoardLayout
from haptogram.acoustics.model.boards.table import LAYOUTS
from haptogram.settings.frozen import dataclass
from haptogram.settings.option import Settings
from haptogram_protocol.dialects.codec import BoardEnd, Dialect

from ..board.settings import BoardSettings, Wiring
from .foreign import VirtualForeignDialect
from .simulated.unit import SimulatedUnit
from .unit import Unit

INTERFACE: Final = 1


@dataclass(frozen=True, kw_only=True)
class NoOptions(Settings):
    """A dialect without options."""


def _boards_option(options: Any) -> dict[str, int]:
    """Return {"boards": number} as an option of the wire; {} if the dialect has none."""
    return {"boards": options.boards} if hasattr(options, "boards") else {}


@dataclass(frozen=True)
class Emulation:
    """A dialect as the virtual board speaks it.

    The callables take the options of the dialect, an object of *options*.

    Attributes
    ----------
    dialect : Dialect
        The wire.
    end : callable
        ``end(options)`` returns the board's end of the wire.
    unit : callable
        ``unit(options, now_us)`` returns the boards, powered up at the device time *now_us*.
    layout : callable
        ``layout(options)`` returns their emitters, unless the user gives others.
    options : type of Settings
        The options of the dialect.
    boards : callable
        ``boards(options)`` returns the number of boards on the line.
    mounting : callable or None
        From the array of *layout* to how its emitters are mounted, if not all alike: a phase of pi
        is the other way round.
    numbered_by : str
        Property of a transducer in Ultraino's array files that is its channel.
    interface : int
        Version of this interface that the emulation was written for.
    """

    dialect: Dialect
    end: Callable[[Any], BoardEnd]
    unit: Callable[[Any, int], Unit]
    layout: Callable[[Any], BoardLayout]
    options: type[Settings] = NoOptions
    boards: Callable[[Any], int] = lambda _: 1
    mounting: Callable[[TransducerArray], Calibration] | None = None
    numbered_by: str = "orderNumber"
    interface: int = INTERFACE

    @classmethod
    def of(cls, dialect: Dialect, unit: Callable[[Any, int], Unit], **more: Any) -> Self:
        """Return the emulation of a dialect that says the rest itself, unless *more* does.

        The option ``boards``, if there is one, is the number of boards on the line; the emitters
        are those of the dialect's layout.
        """
        usual: dict[str, Any] = {
            "end": lambda options: dialect.board(**_boards_option(options)),
            "layout": lambda _: LAYOUTS[dialect.layout],
            "boards": lambda options: _boards_option(options).get("boards", 1),
        }
        return cls(dialect, unit=unit, **usual | more)

    def wiring(self, options: Settings, channels: Sequence[int]) -> Wiring:
        """Return the wiring of emitters that are driven by *channels*.

        Raises
        ------
        ConfigurationError
            If the boards do not have them.
        """
        return Wiring(
            dialect=self.dialect.name,
            steps=self.dialect.steps,
            channels=tuple(channels),
            channel_count=self.dialect.channels * self.boards(options),
            bauds=self.dialect.bauds,
            client_axes=self.layout(options).client_axes,
        )

    def power_up(self, options: Settings, settings: BoardSettings) -> VirtualForeignDialect:
        """Return the boards of *settings* at the end of their line."""
        unit = self.unit(options, settings.boot_us)
        if settings.simulator is not None:
            unit = SimulatedUnit(settings, unit)
        boards = self.boards(options)
        return VirtualForeignDialect(
            self.dialect, lambda: self.end(options), unit, settings, boards
        )
