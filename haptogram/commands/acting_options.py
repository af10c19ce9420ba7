"""Modes in which an option of a command acts; an option without effect is refused."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Final

from haptogram.errors import ConfigurationError
from haptogram.settings.arguments import option_word
from haptogram.settings.board import is_grid_setting
from haptogram.settings.parser import Acting
from haptogram.settings.shape import SHAPES


def refuse_idle_options(
    arguments: Namespace,
    settings: object = None,
    file: Path | None = None,
    in_file: Iterable[str] = (),
) -> None:
    """Refuse the first given option, or key of a file, that does nothing in this mode.

    Parameters
    ----------
    arguments : Namespace
        Of a command whose parser says when each option acts.
    settings : object, optional
        The settings that *arguments* and a file make together; by default *arguments*.
    file : Path, optional
        The file with the keys *in_file*.

    Raises
    ------
    ConfigurationError
        Names the option and the modes in which it acts.
    """
    words = {name: option_word(name) for name in sorted(arguments.given)}
    keys = {name: f"{file}: {name}" for name in sorted(in_file) if name not in words}
    for name, source in (words | keys).items():
        acting = (_EVERYWHERE | arguments.parser.acting).get(name)
        if acting is not None and not acting.is_there(arguments if settings is None else settings):
            raise ConfigurationError(f"{source} acts only {acting.where}; leave it out")


def with_option(*names: str) -> Acting:
    """Return that an option acts with any of the options *names*."""
    *others, last = map(option_word, names)
    where = f"with {', '.join(others)} or {last}" if others else f"with {last}"
    return Acting(where, lambda s: any(getattr(s, name, None) for name in names))


def without_option(name: str) -> Acting:
    """Return that an option acts without the option *name*."""
    return Acting(f"without --{name}", lambda s: not getattr(s, name))


def acts_on_a_shape(settings: Any) -> bool:
    """Return True unless the object is a mesh."""
    return settings.object is None or settings.object in SHAPES


def acts_on_a_size(settings: Any) -> bool:
    """Return True for an object that has a radius."""
    return settings.object != "point" and acts_on_a_shape(settings)


def acts_on_a_grid(settings: Any) -> bool:
    """Return True unless the array is a file."""
    return settings.array is None or is_grid_setting(settings.array)


PITCH: Final = Acting("on an --array that is a grid (a file has its own positions)", acts_on_a_grid)
RADIUS: Final = Acting(
    "on a shape that has a radius (a point and a mesh have none)", acts_on_a_size
)
RESOLUTION: Final = Acting(
    "on an object of several points (not on a point)", lambda s: s.object != "point"
)
MESH: Final = Acting("on a mesh file", lambda s: not acts_on_a_shape(s))
AM: Final = Acting("with the modulation am", lambda s: _acts_on_modulation(s) == "am")
LM: Final = Acting("with the modulation lm", lambda s: _acts_on_modulation(s) == "lm")


def _acts_on_modulation(settings: Any) -> str | None:
    """Return the modulation in *settings* (am, lm, stm) for which options act; None without one."""
    kind: str | None = settings.kind if hasattr(settings, "kind") else settings.modulation
    return kind


#: Of every command.
_EVERYWHERE: Final = {"stamp": with_option("html", "junit", "summary")}
