"""The text, the files and the recording of a command, checked before its work; - is stdout."""

from __future__ import annotations

import contextlib
import functools
import sys
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TextIO, TypeAlias

from haptogram.errors import ConfigurationError, DeviceError, LinkError
from haptogram.machine import files, terminal
from haptogram.settings.arguments import option_word
from haptogram.settings.board import is_grid_setting
from haptogram.settings.shape import SHAPES

if TYPE_CHECKING:
    from haptogram.evidence.recordings.writer import RecordingWriter
    from haptogram.report.formats.document import Document

WriteFile: TypeAlias = Callable[[Path], object]

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
    """The text of a command, and the files that its options name.

    Parameters
    ----------
    settings : object
        Has the options as attributes, those of :data:`INPUTS` among them, and the ``parser``.
    *names : str
        The options that name a file; ``picture`` must be a format of pictures, and ``html`` needs
        the extra for pages.
    pictures : bool
        Whether the page holds pictures.

    Attributes
    ----------
    paths : dict of str to Path
        The files by option, of those that were asked for.
    provenance : Provenance
        Origin of the result of a command that writes pages: of a run that begins now.

    Raises
    ------
    ConfigurationError
        If two options name one file, an output names an input, an output cannot be written, or
        ``stamp`` is no date.
    """

    def __init__(self, settings: Any, *names: str, pictures: bool = False) -> None:
        self._program: str = settings.parser.prog
        given = {option_word(name): getattr(settings, name) for name in names}
        self.paths: dict[str, Path] = {
            option: Path(path) for option, path in given.items() if path is not None
        }
        files.check_distinct_files(self.paths, _input_files_of(settings))
        files.check_files_writable(self.paths)
        for option, path in self.paths.items():
            if files.is_standard_output(path):
                self.paths[option] = files.STANDARD_OUTPUT
        self._check_formats(pictures=pictures)
        for folder in dict.fromkeys(path.parent for path in self.paths.values()):
            if not folder.exists():
                print(f"{folder}: a new folder, to be made for what is written", file=sys.stderr)
        if "html" in names:
            from haptogram.machine.provenance import Provenance

            stamp = getattr(settings, "stamp", None)
            self.provenance = Provenance.of_run(settings.command_line, stamp)

    def _check_formats(self, *, pictures: bool) -> None:
        """Raise ConfigurationError, before the run, if a picture or page cannot be written.

        *pictures*: the page draws some, for which matplotlib is needed.
        """
        if self.paths.get("--picture", files.STANDARD_OUTPUT) != files.STANDARD_OUTPUT:
            from haptogram.report.figures import check_picture_format

            check_picture_format(self.paths["--picture"])
        if "--html" in self.paths:
            from haptogram.report.formats.html import check_html_page

            check_html_page(pictures=pictures)

    @property
    def text(self) -> TextIO:
        """The stream for text: standard output, unless that is one of the files."""
        return sys.stderr if files.STANDARD_OUTPUT in self.paths.values() else sys.stdout

    def print(self, text: str) -> None:
        """Print *text* to the stream for text, its verdicts in their colours."""
        print(terminal.paint_verdicts_on_terminal(text, self.text), file=self.text, flush=True)

    @property
    def wants_document(self) -> bool:
        """True if a document is shown where no file was asked for: in a job of GitHub."""
        return terminal.is_terminal_of_github_job()

    def write(
        self, document: Document, *, in_virtual_time: bool = False, **writers: WriteFile
    ) -> bool:
        """Write *document* in every format that was asked for, and annotate a job of GitHub.

        Parameters
        ----------
        in_virtual_time : bool
            Whether the files must repeat byte for byte, without a date.
        writers
            Further files, as of :meth:`write_files`.
        """
        from haptogram.report.formats.html import write_document_page
        from haptogram.report.formats.job_summary import github_job_annotations, write_job_summary
        from haptogram.report.formats.junit import write_document_junit

        if terminal.is_terminal_of_github_job():
            for line in github_job_annotations(document):
                print(line, file=self.text, flush=True)
        formats: dict[str, Callable[..., None]] = {
            "junit": write_document_junit,
            "html": write_document_page,
            "summary": write_job_summary,
        }
        origin = self.provenance.of_virtual_time() if in_virtual_time else self.provenance
        every: dict[str, WriteFile] = {
            name: functools.partial(write, document=document, provenance=origin)
            for name, write in formats.items()
        }
        return self.write_files(**every | writers)

    def write_files(self, **writers: WriteFile) -> bool:
        """Write each file that was asked for by the writer with the name of its option.

        Returns
        -------
        bool
            False if one could not be written, which was said; it does not cost the others.
        """
        by_option = {option_word(name): write for name, write in writers.items()}
        written = [
            self._is_written(path, by_option[option])
            for option, path in self.paths.items()
            if option in by_option
        ]
        return all(written)

    def _is_written(self, path: Path, write: WriteFile) -> bool:
        """Write a file and announce it; return False, after the error text, if it failed."""
        try:
            write(path)
        except ConfigurationError as error:
            print_command_error(self._program, error)
            return False
        announce_output_file(path)
        return True

    @contextlib.contextmanager
    def recording(self, configuration: Mapping[str, Any]) -> Iterator[RecordingWriter | None]:
        """Give the recording of ``--record``, of a run with *configuration*; None without one.

        A run that is refused, or whose board says nothing, leaves the file as it was.

        Raises
        ------
        ConfigurationError
            If it cannot be written.
        """
        if (path := self.paths.get("--record")) is None:
            yield None
            return
        from haptogram.evidence.recordings.writer import RecordingWriter

        command = self._program.rpartition(" ")[2]
        with RecordingWriter(
            path, command=command, configuration=configuration, waits=True
        ) as writer:
            try:
                yield writer
            except (LinkError, DeviceError):
                if writer.has_heard:  # the bytes say what went wrong
                    writer.begin()
                raise

    def is_recorded(self, writer: RecordingWriter | None) -> bool:
        """Return True unless the recording ended early; say on standard error how it ended."""
        if writer is None:
            return True
        writer.begin()
        writer.close()
        if writer.failure:
            print_command_error(self._program, writer.failure)
            return False
        announce_output_file(writer.path)
        return True


def _input_files_of(settings: object) -> Iterator[tuple[str, Path]]:
    """Yield option and path of each file that the command reads; "this command" if positional."""
    for name, is_file in INPUTS.items():
        value = getattr(settings, name, None)
        for path in value if isinstance(value, list | tuple) else [value]:
            if path is not None and is_file(str(path)):
                yield "this command" if name in _POSITIONAL else option_word(name), Path(path)


def print_command_error(program: str, error: object) -> None:
    """Print *error* on standard error, after the name of *program*."""
    print(terminal.terminal_error_line(program, str(error), sys.stderr), file=sys.stderr)


def announce_output_file(path: Path) -> None:
    """Say on standard error that *path* was written, unless that is standard output."""
    if not files.is_standard_output(path):
        print(f"wrote {path}", file=sys.stderr)


def announce_interrupted_output(program: str) -> None:
    """Say on standard error that the result so far is worked out, which may take seconds."""
    what = "the result of what was seen is worked out and written; Ctrl-C again ends at once"
    print(f"{program}: interrupted; {what}", file=sys.stderr, flush=True)
