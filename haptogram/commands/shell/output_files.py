"""The files that a command writes: checked before its work begins; - is standard output."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Final, TextIO

from haptogram.machine.files import (
    STANDARD_OUTPUT,
    check_distinct_files,
    check_files_writable,
    is_standard_output,
)
from haptogram.machine.terminal import paint_verdicts_on_terminal
from haptogram.settings.board import is_grid_setting
from haptogram.settings.shape import SHAPES

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FILE_HELP: Final = "With - a file is standard output, and the text goes to standard error."

#: Every option that reads a file, of all commands, and which of its values are files.
INPUTS: Final[Mapping[str, Callable[[str], bool]]] = {
    "array": lambda value: not is_grid_setting(value),
    "source": lambda value: not value.startswith("unix:"),
    "object": lambda value: value not in SHAPES,
    **dict.fromkeys(
        ("baseline", "calibration", "compare", "config", "drive", "expect_file", "fault_plan"), bool
    ),
    **dict.fromkeys(("capture", "channels", "file", "map", "from_recording"), bool),
}

_POSITIONAL: Final = ("file", "source")


class CommandOutputs:
    """The files that the options of a command name.

    Parameters
    ----------
    settings : object
        Has the options as attributes, those of :data:`INPUTS` among them.
    *names : str
        The options that name a file; ``picture`` must be a format of pictures, and ``html`` needs
        the extra for pages.
    pictures : bool
        Whether the page holds pictures.

    Attributes
    ----------
    paths : dict of str to Path
        The files by option, of those that were asked for.

    Raises
    ------
    ConfigurationError
        If two options name one file, an output names an input, or an output cannot be written.
    """

    def __init__(self, settings: object, *names: str, pictures: bool = True) -> None:
        given = {_output_as_option(name): getattr(settings, name) for name in names}
        self.paths: dict[str, Path] = {
            option: Path(path) for option, path in given.items() if path is not None
        }
        check_distinct_files(self.paths, _input_files_of(settings))
        check_files_writable(self.paths)
        for option, path in self.paths.items():
            if is_standard_output(path):
                self.paths[option] = STANDARD_OUTPUT
        self._check_formats(pictures=pictures)
        for folder in dict.fromkeys(path.parent for path in self.paths.values()):
            if not folder.exists():
                print(f"{folder}: a new folder, to be made for what is written", file=sys.stderr)

    def _check_formats(self, *, pictures: bool) -> None:
        if "--picture" in self.paths:
            _check_output_picture(self.paths["--picture"])
        if "--html" in self.paths:
            from haptogram.report.formats.html import check_html_page

            check_html_page(pictures=pictures)

    @property
    def text(self) -> TextIO:
        """The stream for text: standard output, unless that is one of the files."""
        return sys.stderr if STANDARD_OUTPUT in self.paths.values() else sys.stdout

    def print(self, text: str) -> None:
        """Print *text* to the stream for text, its verdicts in their colours."""
        print(paint_verdicts_on_terminal(text, self.text), file=self.text, flush=True)

    def announce(self) -> None:
        """Say on standard error what was written."""
        for path in self.paths.values():
            announce_output_file(path)


def _input_files_of(settings: object) -> Iterator[tuple[str, Path]]:
    """Yield the files that the command reads, with their options."""
    for name, is_file in INPUTS.items():
        value = getattr(settings, name, None)
        for path in value if isinstance(value, list | tuple) else [value]:
            if path is not None and is_file(str(path)):
                yield "this command" if name in _POSITIONAL else _output_as_option(name), Path(path)


def _output_as_option(name: str) -> str:
    return f"--{name.replace('_', '-')}"


def announce_output_file(path: Path) -> None:
    """Say on standard error that *path* was written, unless that is standard output."""
    if not is_standard_output(path):
        print(f"wrote {path}", file=sys.stderr)


def announce_interrupted_output(program: str) -> None:
    """Say on standard error that the result so far is worked out, which may take seconds."""
    what = "the result of what was seen is worked out and written; Ctrl-C again ends at once"
    print(f"{program}: interrupted; {what}", file=sys.stderr, flush=True)


def _check_output_picture(path: Path) -> None:
    """Raise unless the suffix of *path* names a format of pictures."""
    from haptogram.report.figures import check_picture_format

    if path != STANDARD_OUTPUT:
        check_picture_format(path)


def write_picture_output(path: Path, figure: Figure) -> None:
    """Write *figure* in the format of the suffix of *path*; to standard output, as PNG.

    Raises
    ------
    ConfigurationError
        A path that cannot be written.
    """
    from haptogram.machine.files import write_file_atomically
    from haptogram.report.figures import encode_figure

    suffix = ".png" if is_standard_output(path) else path.suffix.lower()
    write_file_atomically(path, encode_figure(figure, suffix))
