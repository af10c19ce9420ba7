"""Standard output and error that may fail: a full disk, a reader that went away.

What is written last is written when the interpreter ends, where an error becomes a status of its
own.  So the errors are kept until the command is over: it writes its files and knows its verdict
whatever happened to its words.
"""

from __future__ import annotations

import contextlib
import io
import os
import sys
from collections.abc import Iterator
from typing import Any, Final

from haptogram.errors import plain_reason

from .exit_status import USAGE

#: Signs that not every terminal has (LANG=C without UTF-8), and what stands for them there.
_PLAIN: Final = str.maketrans(
    {"µ": "u", "–": "-", "−": "-", "×": "x", "°": " deg ", "±": "+-", "…": "...", "π": "pi"}
)


def text_for_standard_stream(text: str, encoding: str, errors: str = "strict") -> str:
    """Return *text* as a stream can write it: in plain signs where it has no others.

    Examples
    --------
    >>> text_for_standard_stream("25 µs", "utf-8"), text_for_standard_stream("25 µs", "ascii")
    ('25 µs', '25 us')
    """
    if _can_standard_stream_encode(text, encoding, "strict"):
        return text
    plain = text.translate(_PLAIN)
    if _can_standard_stream_encode(plain, encoding, errors):
        return plain
    return plain.encode(encoding, "backslashreplace").decode(encoding)


def _can_standard_stream_encode(text: str, encoding: str, errors: str) -> bool:
    """Return True if *text* can be written in this encoding."""
    try:
        text.encode(encoding, errors)
    except UnicodeEncodeError:
        return False
    return True


class PatientStandardStream:
    """A text stream that keeps its first error instead of raising it, and drops what follows.

    It writes in plain signs what the encoding of the stream does not have.

    Attributes
    ----------
    error : OSError or None
        Why it could not be written.
    closed : bool
        Whether there was no stream from the start (``>&-``): the words go nowhere.
    """

    def __init__(self, stream: Any) -> None:
        self.error: OSError | None = None
        self.closed = stream is None
        self._stream = stream or io.TextIOWrapper(io.BytesIO(), encoding="utf-8")

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    @property
    def buffer(self) -> PatientBytes:
        """The stream below, for bytes."""
        return PatientBytes(self)

    def write(self, text: str) -> int:
        """Write *text*, if that is possible."""
        encoding, errors = self._stream.encoding or "utf-8", self._stream.errors or "strict"
        self._attempt(lambda: self._stream.write(text_for_standard_stream(text, encoding, errors)))
        return len(text)

    def write_bytes(self, content: bytes) -> int:
        """Write *content*, if that is possible."""
        self._attempt(lambda: self._stream.buffer.write(content))
        return len(content)

    def flush(self) -> None:
        """Pass on what waits, if that is possible."""
        self._attempt(self._stream.flush)

    def _attempt(self, write: Any) -> None:
        """Write, unless it failed before; on an error keep that, and write no more."""
        if self.error is not None:
            return
        try:
            write()
        except OSError as error:
            self.error = error
            self._give_up()

    def _give_up(self) -> None:
        """Redirect the stream to the null device after a write error."""
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, self._stream.fileno())
        os.close(nowhere)


class PatientBytes:
    """The stream of bytes below a :class:`PatientStandardStream`."""

    def __init__(self, text: PatientStandardStream) -> None:
        self.write, self.flush = text.write_bytes, text.flush


@contextlib.contextmanager
def patient_standard_streams() -> Iterator[None]:
    """Let a command come to its end whatever happens to what it says.

    A reader that went away (``| head -1``) is no error: it has read what it wanted.

    Raises
    ------
    SystemExit
        With the status of an environment error, if standard output could not be written.
    """
    output, complaints = PatientStandardStream(sys.stdout), PatientStandardStream(sys.stderr)
    with contextlib.redirect_stdout(output), contextlib.redirect_stderr(complaints):
        try:
            yield
        finally:
            output.flush()
            if output.error is not None and not isinstance(output.error, BrokenPipeError):
                reason = plain_reason(output.error)
                print(f"haptogram: standard output cannot be written: {reason}", file=sys.stderr)
                raise SystemExit(USAGE)
            complaints.flush()
