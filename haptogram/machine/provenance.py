"""The origin of a result: its date, version, machine and command line."""

from __future__ import annotations

import datetime
import time
from dataclasses import dataclass, field
from typing import Final, Self

import haptogram
from haptogram.errors import ConfigurationError

from .fingerprint import machine_text


@dataclass(frozen=True, slots=True)
class Provenance:
    """Origin of a result.

    Attributes
    ----------
    date : datetime.datetime or None
        When the run began; None: not stated.
    machine : str or None
        Processor, system and Python; None: not stated.
    command : str or None
        The command line; None: not stated.
    is_stamped : bool
        Whether the user gave the date.
    version : str
        Version of this program.
    """

    date: datetime.datetime | None = None
    machine: str | None = None
    command: str | None = None
    is_stamped: bool = False
    version: str = haptogram.__version__
    _start_s: float = field(default_factory=time.monotonic, compare=False, repr=False)

    @classmethod
    def of_run(cls, command: str, stamp: str | None) -> Self:
        """Return the origin of a run that begins now.

        Parameters
        ----------
        command : str
            The command line.
        stamp : str or None
            Date of ISO 8601 that stands for that of the run; without a zone it is UTC.

        Raises
        ------
        ConfigurationError
            If *stamp* is no date.
        """
        date = (
            datetime.datetime.now(datetime.UTC) if stamp is None else read_provenance_stamp(stamp)
        )
        return cls(date, machine_text(), command, is_stamped=stamp is not None)

    def of_virtual_time(self) -> Provenance:
        """Return the origin of a result that repeats byte for byte.

        It names the version only, unless the user gave a date.
        """
        return self if self.is_stamped else Provenance()

    @property
    def timestamp(self) -> str | None:
        """The date of ISO 8601 without its zone, which is UTC."""
        if self.date is None:
            return None
        return self.date.astimezone(datetime.UTC).replace(tzinfo=None).isoformat("T", "seconds")

    @property
    def elapsed_s(self) -> float:
        """Seconds since the run began."""
        return time.monotonic() - self._start_s

    def rows(self) -> list[tuple[str, str]]:
        """Return name and text of everything that is stated."""
        date = None if self.timestamp is None else f"{self.timestamp.replace('T', ' ')} UTC"
        stated = {
            "date": date,
            "version": f"haptogram {self.version}",
            "machine": self.machine,
            "command": self.command,
        }
        return [(name, text) for name, text in stated.items() if text is not None]


def read_provenance_stamp(text: str) -> datetime.datetime:
    """Return the date that *text* is; without a zone it is UTC.

    Raises
    ------
    ConfigurationError
        If it is none.

    Examples
    --------
    >>> read_provenance_stamp("2026-11-22T15:00+01:00").isoformat()
    '2026-11-22T14:00:00+00:00'
    """
    try:
        date = datetime.datetime.fromisoformat(text)
        zoned = date.replace(tzinfo=datetime.UTC) if date.tzinfo is None else date
        return zoned.astimezone(datetime.UTC)
    except (ValueError, OverflowError) as error:
        raise ConfigurationError(
            f"--stamp is {text!r}, must be a date of ISO 8601, as 2026-11-22 or 2026-11-22T15:00Z"
        ) from error


#: The origin of a result if only the version is stated.
UNSTATED: Final = Provenance()
