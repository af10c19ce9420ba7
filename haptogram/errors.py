"""Errors of the host package, one root, split by who can mend them.

::

    HaptogramError
    +-- ConfigurationError        an argument, a file or a target that cannot be used
    +-- LinkError                 the line between host and board
    |   +-- PortNotFoundError     there is no such port
    |   +-- PortBusyError         another program holds the port
    |   +-- NoAnswerError         the port is silent
    |   +-- WrongProtocolError    something answers, but not a Haptogram board
    |   +-- VersionMismatchError  a board of another major version
    |   +-- LinkLostError         the port closed or stopped taking bytes during the run
    +-- DeviceError               the board refused a request, and said why
    +-- VerificationError         a verification that was asked to pass did not
"""

from __future__ import annotations

import contextlib
import errno
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final, TypeAlias

_Kinds: TypeAlias = tuple[type[Exception], ...]
#: Causes of the system's errors, where its own words are jargon or say too little.
_REASONS: Final = {
    errno.ENOENT: "there is no such file",
    errno.EISDIR: "it is a folder; name a file",
    errno.ENOTDIR: "a folder of its path is a file",
    errno.EACCES: "there is no permission",
    errno.EPERM: "there is no permission",
    errno.EROFS: "the file system is read-only",
    errno.ENOSPC: "the disk is full",
    errno.ENOTTY: "it is no serial port",
    errno.ENAMETOOLONG: "the name is too long",
    errno.EADDRNOTAVAIL: "this machine has no such address",
    errno.EADDRINUSE: "another program listens at that address",
}


class HaptogramError(Exception):
    """Root of every error that this package raises on purpose.

    Examples
    --------
    >>> try:
    ...     Driver("/dev/no-such-port")
    ... except HaptogramError as error:
    ...     print(type(error).__name__)
    PortNotFoundError
    """


class ConfigurationError(HaptogramError, ValueError):
    """An argument, a file or a target that cannot be used; names the value and the limit.

    Examples
    --------
    >>> Focus((0.0, 0.0, 0.15), amplitude=1.5)
    Traceback (most recent call last):
        ...
    haptogram.errors.ConfigurationError: amplitude of a focus is 1.5, must be 0 to 1
    """


class LinkError(HaptogramError):
    """The line between host and board failed.

    Examples
    --------
    >>> try:
    ...     Driver("/dev/no-such-port")
    ... except LinkError as error:
    ...     print(type(error).__name__)
    PortNotFoundError
    """


class PortNotFoundError(LinkError):
    """There is no such port."""


class PortBusyError(LinkError):
    """Another program holds the port."""


class NoAnswerError(LinkError, TimeoutError):
    """Nothing came back within the time allowed."""


class WrongProtocolError(LinkError):
    """Bytes came back, but none of them were a valid frame."""


class VersionMismatchError(LinkError):
    """The board speaks another major version of the protocol."""


class LinkLostError(LinkError):
    """The port closed, or stopped taking bytes, while it was in use."""


class DeviceError(HaptogramError):
    """The board refused a request.

    Attributes
    ----------
    code : int
        Error code of SPEC.md, chapter 10.
    detail : int
        The number that belongs to the code (a limit, an offset, ...).

    Examples
    --------
    >>> with Driver(url, seed=1) as driver:
    ...     try:
    ...         config = driver.configure(sound_speed_mm_s=1)
    ...     except DeviceError as error:
    ...         print(error)
    SET_CONFIG was refused: BAD_VALUE, detail 12
    """

    def __init__(self, message: str, *, code: int, detail: int = 0) -> None:
        super().__init__(message)
        self.code = code
        self.detail = detail


class VerificationError(HaptogramError, AssertionError):
    """A verification did not pass; the text says what failed.

    Examples
    --------
    >>> with Driver(url, seed=1) as driver:
    ...     state = driver.arm()
    ...     wanted = driver.focus((0.0, 0.0, 0.15))
    ...     verdict = verify_run([wanted], [], model=driver.model)
    >>> try:
    ...     verdict.raise_for_verdict()
    ... except VerificationError as error:
    ...     print(str(error).splitlines()[0])
    INCONCLUSIVE: 0 of 1 frames were verified; 100 % must be
    """


def missing_extra(subject: str, extra: str) -> ConfigurationError:
    """Return the error for packages of *extra* that are not installed, with the way to have them.

    A checkout is installed by its path: no package index has this package.

    Examples
    --------
    >>> print(missing_extra("pages need jinja2", "report"))  # doctest: +ELLIPSIS
    pages need jinja2: pip install ...[report]'
    """
    checkout = Path(__file__).resolve().parents[1]
    is_checkout = (checkout / "pyproject.toml").is_file()
    what = f"-e '{checkout}[{extra}]'" if is_checkout else f"'haptogram[{extra}]'"
    return ConfigurationError(f"{subject}: pip install {what}")


def unreadable_file(path: str | Path, error: BaseException, option: str = "") -> ConfigurationError:
    """Return the error for a file that cannot be read; *option* is the one that names it.

    Examples
    --------
    >>> print(unreadable_file("no.csv", FileNotFoundError(errno.ENOENT, ""), "--drive"))
    --drive 'no.csv' cannot be read: there is no such file
    """
    return ConfigurationError(f"{option} '{path}' cannot be read: {plain_reason(error)}".lstrip())


def unwritable_file(path: str | Path, error: BaseException, option: str = "") -> ConfigurationError:
    """Return the error for a file that cannot be written; *option* is the one that names it.

    Examples
    --------
    >>> print(unwritable_file("a.json", OSError(errno.ENOSPC, ""), "--json"))
    --json 'a.json' cannot be written: the disk is full
    """
    is_absent = isinstance(error, FileNotFoundError)  # a file that is absent would be made
    reason = "there is no such folder" if is_absent else plain_reason(error)
    return ConfigurationError(f"{option} '{path}' cannot be written: {reason}".lstrip())


@contextlib.contextmanager
def refusals_of(origin: str) -> Iterator[None]:
    """Begin every refusal with its *origin*: an option, a file, a table.

    Examples
    --------
    >>> with refusals_of("map.toml:"):
    ...     raise ConfigurationError("no reference")
    Traceback (most recent call last):
    haptogram.errors.ConfigurationError: map.toml: no reference
    """
    try:
        yield
    except ConfigurationError as error:
        raise ConfigurationError(f"{origin} {error}") from error


def reading_file(
    path: str | Path, option: str = "", kinds: _Kinds = (OSError,)
) -> contextlib.AbstractContextManager[None]:
    """Raise :func:`unreadable_file` for an error of one of the *kinds*, here of the system."""
    return _errors_as_refusals(lambda error: unreadable_file(path, error, option), kinds)


def writing_file(
    path: str | Path, option: str = "", kinds: _Kinds = (OSError,)
) -> contextlib.AbstractContextManager[None]:
    """Raise :func:`unwritable_file` for an error of one of the *kinds*, here of the system."""
    return _errors_as_refusals(lambda error: unwritable_file(path, error, option), kinds)


#: Errors of code that reads a document which holds something else.
_OTHER_CONTENT: Final = (ArithmeticError, AttributeError, LookupError, TypeError, ValueError)


def reads_as(kind: str) -> contextlib.AbstractContextManager[None]:
    """Refuse a record of a back door that is none of its *kind*: "a latch record"."""
    return _errors_as_refusals(
        lambda error: ConfigurationError(f"not {kind} of a back door: {error!r}"), _OTHER_CONTENT
    )


def refusing_other_content(refusal: str) -> contextlib.AbstractContextManager[None]:
    """Raise *refusal* for the errors of a document that holds something else than expected."""
    return _errors_as_refusals(lambda _: ConfigurationError(refusal), _OTHER_CONTENT)


@contextlib.contextmanager
def _errors_as_refusals(
    refusal: Callable[[BaseException], ConfigurationError], kinds: _Kinds
) -> Iterator[None]:
    """Convert errors of these *kinds* into the ConfigurationError that *refusal* makes.

    A ConfigurationError stays as it is.
    """
    try:
        yield
    except ConfigurationError:  # a refusal already, though it may be one of the kinds
        raise
    except kinds as error:
        raise refusal(error) from error


def plain_reason(error: BaseException) -> str:
    """Return the cause of an error of the system, or of a text, without codes and jargon.

    Examples
    --------
    >>> print(plain_reason(PermissionError(errno.EACCES, "Permission denied")))
    there is no permission
    """
    if isinstance(error, UnicodeDecodeError):
        return f"it is no text in UTF-8, from byte {error.start} on"
    if isinstance(error, RecursionError):
        return "it is nested too deeply"
    codes = map(_system_error_code, _causes_of(error))
    code = next((code for code in codes if code is not None), None)
    if code is None:
        return " ".join(str(error).split())
    # A code below zero is of a name that no server knows.
    text = _REASONS.get(code) or (os.strerror(code) if code > 0 else "there is no such host")
    return text[:1].lower() + text[1:]


def _causes_of(error: BaseException | None) -> Iterator[BaseException]:
    """Yield an error and its causes or contexts, one after the other; nothing for None."""
    while error is not None:
        yield error
        error = error.__cause__ if error.__suppress_context__ else error.__context__


def _system_error_code(error: BaseException) -> int | None:
    """Return the errno of an OSError or a termios.error; None for other errors."""
    code = error.errno if isinstance(error, OSError) else next(iter(error.args), None)
    return code if isinstance(code, int) else None
