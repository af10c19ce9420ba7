"""The map of a capture: which channel is which element, and what the others carry."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, Self

from haptogram.errors import ConfigurationError, refusals_of
from haptogram.settings.option import Settings, option
from haptogram.settings.text_file import read_toml_file

from .capture import Capture
from .shift_registers import ShiftRegisters

_ELEMENTS: Final = "elements"
_SHIFT: Final = "shift"
_PLACEHOLDER: Final = "{}"


@dataclass(frozen=True, kw_only=True)
class ChannelMapSettings(Settings):
    """The keys of a map beside its table ``[elements]``."""

    reference: str | None = option(
        None,
        unit="CHANNEL",
        help="channel that phases are relative to: a carrier clock, or an element",
    )
    latch: str | None = option(None, unit="CHANNEL", help="channel that rises at every latch")
    to_board: str | None = option(
        None, unit="CHANNEL", help="line of the UART that carries the bytes of the host"
    )
    to_host: str | None = option(
        None, unit="CHANNEL", help="line of the UART that carries the bytes of the board"
    )
    baud: int = option(
        3_000_000, unit="BAUD", low=300, high=100_000_000, help="rate of to_board and to_host"
    )
    carrier_hz: float = option(
        40_000.0, unit="HZ", low=1_000.0, high=1_000_000.0, help="carrier that is meant"
    )
    carrier_tolerance_ppm: float = option(
        1000.0,
        unit="PPM",
        low=0.0,
        high=100_000.0,
        help="by how much the carrier may differ from it, on the analyser's clock",
    )
    sample_rate_hz: float | None = option(
        None,
        unit="HZ",
        low=1e4,
        high=1e11,
        help="sampling rate",
        absent="as the file states it, else estimated",
    )
    active_low: bool = option(False, help="a pin is low while its transducer is driven")
    skew_ns: float = option(
        0.0,
        unit="NS",
        low=0.0,
        high=10_000.0,
        help="largest difference of the delays of two channels: of probes, drivers, and of the "
        "steps in which the board moves its pins",
    )
    calibration: Path | None = option(
        None,
        unit="FILE",
        help="gain and phase of the elements at their pins that are known (verify "
        "--pin-calibration writes them): they are taken off, and what is left is judged",
    )
    latch_window_us: float = option(
        200.0,
        unit="US",
        low=25.0,
        high=1e6,
        help="changes that follow each other within this time belong to one latch",
    )


@dataclass(frozen=True)
class ChannelMap:
    """The channels of a capture.

    Attributes
    ----------
    path : Path
        The file, for messages.
    reference : str
        Channel that phases are relative to.
    settings : ChannelMapSettings
        Everything but the elements.
    elements : mapping of str to int
        Element by channel.
    pattern : str or None
        Name of the channels of many elements: ``{}`` stands for the number.
    shift : ShiftRegisters or None
        Registers whose outputs drive elements.

    Examples
    --------
    >>> from haptogram.evidence.captures.channel_map import ChannelMap
    >>> mapped = ChannelMap.of("map", {"reference": "D0", "elements": {"D1": 0, "D2": 16}})
    >>> mapped.elements, mapped.settings.carrier_hz
    ({'D1': 0, 'D2': 16}, 40000.0)
    """

    path: Path
    reference: str
    settings: ChannelMapSettings
    elements: Mapping[str, int] = field(default_factory=dict)
    pattern: str | None = None
    shift: ShiftRegisters | None = None

    @classmethod
    def from_file(cls, path: Path, option: str = "map") -> Self:
        """Return the map in a TOML file, whose name is the value of *option*.

        Raises
        ------
        ConfigurationError
            Names the file, the key and what is wrong with it.
        """
        return cls.of(path, read_toml_file(path, option))

    @classmethod
    def of(cls, path: Path | str, document: Mapping[str, Any]) -> Self:
        """Return the map that *document* describes, as a TOML file does."""
        values = dict(document)
        elements = values.pop(_ELEMENTS, None)
        shift = values.pop(_SHIFT, None)
        pattern = elements if isinstance(elements, str) else None
        with refusals_of(f"{path}:"):
            registers = None if shift is None else ShiftRegisters.of(shift)
            settings = ChannelMapSettings.of(**values)
            reference = settings.reference
            if reference is None and registers is not None:
                reference = registers.carrier
            if reference is None:
                raise ConfigurationError(
                    "no reference; name the channel that phases are relative to"
                )
            if pattern is not None and pattern.count(_PLACEHOLDER) != 1:
                raise ConfigurationError(
                    f'elements is {pattern!r}, must have one {{}}: "e{{}}", or a table'
                )
            if pattern is not None or (elements is None and registers is not None):
                elements = {}
            else:
                elements = _checked_channel_elements(elements)
        return cls(Path(path), reference, settings, elements, pattern, registers)

    def expanded(self, capture: Capture) -> Capture:
        """Return *capture* with the outputs of shift registers as channels."""
        with refusals_of(f"{self.path}:"):
            return capture if self.shift is None else self.shift.expanded(capture)

    def joined(self, capture: Capture) -> dict[str, int]:
        """Return the element of each channel that *capture* has, in the order of elements.

        Raises
        ------
        ConfigurationError
            A channel that the capture lacks, or no element at all.
        """
        settings = self.settings
        signals = self.reference, settings.latch, settings.to_board, settings.to_host
        with refusals_of(f"{self.path}:"):
            for name in (*signals, *self.elements):
                if name is not None:
                    capture.channel(name)
            found = dict(self.elements)
            if self.pattern is not None:
                found |= capture.numbered_channels(self.pattern)
            if self.shift is not None:
                found |= {
                    f"{name}.{output}": element
                    for name, elements in self.shift.chains_in(capture).items()
                    for output, element in enumerate(elements)
                    if element >= 0
                }
            if not found:
                raise ConfigurationError(
                    f"no channel of {capture.path} is mapped to an element; "
                    "write them in [elements]: D1 = 0"
                )
            _check_elements_named_once(found)
        return dict(sorted(found.items(), key=lambda item: item[1]))


def _checked_channel_elements(elements: object) -> dict[str, int]:
    """Return *elements*, a table of element numbers by channel, once it is checked.

    Raises ConfigurationError for no table or an empty one, for a number that is no integer from 0
    on, and for an element that two channels have.
    """
    if not isinstance(elements, dict) or not elements:
        raise ConfigurationError("no [elements]; map channels to elements: D1 = 0")
    for name, element in elements.items():
        if isinstance(element, bool) or not isinstance(element, int) or element < 0:
            raise ConfigurationError(
                f"channel {name} is element {element!r}, must be a whole number from 0"
            )
    _check_elements_named_once(elements)
    return elements


def _check_elements_named_once(elements: Mapping[str, int]) -> None:
    """Refuse two channels of the same element."""
    owners: dict[int, str] = {}
    for name, element in elements.items():
        if element in owners:
            raise ConfigurationError(
                f"channels {owners[element]} and {name} are both element {element}"
            )
        owners[element] = name
