"""The URL ``haptogram://?name=value&...``: one reader, and one writer that is its inverse."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, Final
from urllib.parse import parse_qsl, urlencode, urlsplit

from haptogram.errors import ConfigurationError, refusals_of
from haptogram.settings.frozen import dataclass, field

from .board import BOARD_OPTIONS, BoardConfig
from .option import Option, Settings, option, options_of, unknown_setting_text

SCHEME: Final = "haptogram://"


@dataclass(frozen=True, kw_only=True)
class PortConfig(Settings):
    """A port in this process with a virtual board behind it.

    Attributes
    ----------
    board : BoardConfig
        The board.
    """

    clock: str = option("wall", choices=("wall", "virtual"), help="clock of the port")
    backdoor: str | None = option(
        None, unit="PATH|unix:PATH", help="file or socket for the drives that were radiated"
    )
    reconstruct: bool | None = option(
        None, help="whether the back door holds the field", absent="only if there is a back door"
    )
    shared: str | None = option(
        None,
        unit="NAME",
        absent="a board of its own",
        help="board of a VirtualBoard in this program",
    )
    board: BoardConfig = field(default_factory=BoardConfig)

    @property
    def is_virtual(self) -> bool:
        """True if the board's time is virtual."""
        return self.clock == "virtual"


#: Every parameter of the URL by name.
URL_OPTIONS: Final[Mapping[str, Option]] = MappingProxyType(
    {**options_of(PortConfig), **BOARD_OPTIONS}
)


def read_board_url(url: str, default: BoardConfig | None = None) -> PortConfig:
    """Return the port that a ``haptogram://`` URL names.

    Parameters
    ----------
    default : BoardConfig, optional
        The options that the URL does not give.

    Raises
    ------
    ConfigurationError
        For another scheme, and for a parameter that is not known or is refused; begins with the
        URL.
    """
    with refusals_of(f"{url}:"):
        return _port_config_of_url(url, default)


def _port_config_of_url(url: str, default: BoardConfig | None) -> PortConfig:
    """Return port and board of a haptogram:// URL; the rest is as in *default*, if given."""
    try:
        parts = urlsplit(url)
    except ValueError as error:  # a bracket that opens no IPv6 address
        raise ConfigurationError("must be haptogram://?name=value&...") from error
    if parts.scheme != "haptogram" or parts.netloc or parts.path.strip("/"):
        raise ConfigurationError("must be haptogram://?name=value&...")
    values: dict[str, Any] = {} if default is None else default.non_default()
    given: dict[str, Any] = {}
    for name, text in parse_qsl(parts.query, keep_blank_values=True, errors="surrogateescape"):
        if name not in URL_OPTIONS:
            guess = unknown_setting_text(name, URL_OPTIONS)
            if "dialect=" in parts.query:
                guess = f"; an option of the dialect is written {_dialect_option_text(name, text)}"
            raise ConfigurationError(f"there is no parameter {name!r}{guess}")
        row = URL_OPTIONS[name]
        value = row.read(text)
        given[name] = value if row.count is None else (*given.get(name, ()), value)
    values |= given
    port = {name: values.pop(name) for name in options_of(PortConfig) if name in values}
    return PortConfig(**port, board=BoardConfig.of(**values))


def _dialect_option_text(name: str, text: str) -> str:
    """Return a dialect option as URL query text, such as dialect_option=name=text."""
    return urlencode({"dialect_option": f"{name}={text}"}, safe="=", errors="surrogateescape")


def write_board_url(port: PortConfig) -> str:
    """Return the URL that :func:`read_board_url` takes, without the options at their default."""
    values = port.non_default() | port.board.non_default()
    words = [
        (name, text) for name, value in values.items() for text in _board_url_texts(name, value)
    ]
    return f"{SCHEME}?{urlencode(words, errors='surrogateescape')}" if words else SCHEME


def _board_url_texts(name: str, value: Any) -> list[str]:
    """Return the texts of an option in a URL, one for each item if it is a list."""
    row = URL_OPTIONS[name]
    return [row.write(item) for item in (value if row.count is not None else [value])]
