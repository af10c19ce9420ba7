"""The array and the air of a command that needs no board: a preset, a grid or a file."""

from __future__ import annotations

import argparse
import functools
from typing import TYPE_CHECKING

from haptogram.errors import ConfigurationError
from haptogram.settings.arguments import option_word
from haptogram.settings.array import ArrayConfig
from haptogram.settings.board import DEFAULT_ARRAY
from haptogram.settings.command_line import add_setting_options, settings_of
from haptogram.settings.option import options_of
from haptogram.settings.parser import name_option

if TYPE_CHECKING:
    from haptogram.acoustics import AcousticModel

_OWN = ("pitch_mm", "temperature_c")


def add_array_options(group: argparse._ArgumentGroup) -> None:
    """Add the options to *group*."""
    system = group.add_mutually_exclusive_group()
    system.add_argument(
        "--preset",
        type=functools.partial(name_option, what="the name of a preset"),
        metavar="NAME",
        help="a known system; 'haptogram presets' lists them",
    )
    rows = options_of(ArrayConfig)
    add_setting_options(system, [rows["array"]], array=DEFAULT_ARRAY)
    add_setting_options(group, [rows[name] for name in _OWN])


def array_model(arguments: argparse.Namespace) -> AcousticModel:
    """Return the model that the options ask for.

    Raises
    ------
    ConfigurationError
        An unknown preset, or settings beside one; a grid, a file or air that cannot be used.
    """
    from haptogram.objects.run_frames import host_model_of_run_frames
    from haptogram.published import find_preset

    if not arguments.preset:
        return host_model_of_run_frames(settings_of(arguments, ArrayConfig))
    for name in _OWN:
        if getattr(arguments, name) is not None:
            raise ConfigurationError(
                f"{option_word(name)} is {getattr(arguments, name):g}; --preset "
                f"{arguments.preset} brings its own array and air"
            )
    return find_preset(arguments.preset).build()
