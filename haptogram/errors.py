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

from pathlib import Path


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
