"""File of a driver's records, written as they come and read back: a sink for long runs.

JSON lines, whose fields are those of a recording; a drive that comes again is written once.
"""

from __future__ import annotations

import dataclasses
import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from haptogram.acoustics.model.drive import Drive
from haptogram.errors import ConfigurationError, unreadable_file, unwritable_file
from haptogram.evidence.backdoor import drive_of_record
from haptogram.machine.closing import ClosedByWith
from haptogram.records.frame import Evidence, FrameKey, Intended, Observation
from haptogram.records.latch import Codes
from haptogram.settings.arguments import check_argument_kind

from .recorded_run import WrittenDrives, intended_fields, intended_of_fields

_DRIVES: Final = 4096  # that are remembered: some 3 MB


class RecordFile(ClosedByWith):
    """A sink of :class:`~haptogram.driver.driver.Driver` that writes a file.

    Memory stays bounded.  :func:`read_records` reads the file back.

    Parameters
    ----------
    path : str or Path
        Is written anew.

    Raises
    ------
    ConfigurationError
        If it cannot be written.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> with TemporaryDirectory() as folder:
    ...     path = f"{folder}/run.jsonl"
    ...     with RecordFile(path) as file, Driver(url, seed=1, sink=file) as driver:
    ...         state = driver.arm()
    ...         intended = driver.focus((0.0, 0.0, 0.15))
    ...     records = read_records(path)
    >>> records.intended == [intended]
    True
    """

    def __init__(self, path: str | Path) -> None:
        check_argument_kind("path", path, (str, Path), "the name of a file")
        try:
            self._file = Path(path).open("w", encoding="utf-8")  # noqa: SIM115  closed by close()
        except OSError as error:
            raise unwritable_file(path, error) from error
        self._drives = WrittenDrives(_DRIVES)
        self._entries = 0

    def __call__(self, entry: Intended | Observation) -> None:
        """Write *entry*.

        Raises
        ------
        ConfigurationError
            If it is no record of a driver, or the file is closed.
        """
        check_argument_kind(
            "entry", entry, (Intended, Observation), "an Intended or an Observation"
        )
        if self._file.closed:
            raise ConfigurationError(f"{self._file.name}: the record file was closed")
        self._entries += 1
        if isinstance(entry, Observation):
            if entry.radiated is not None or entry.reconstruction is not None:
                raise ConfigurationError(
                    "an observation with what was radiated, or its field, is none of a driver: a "
                    "record file holds latched drives only; the back door keeps its own file"
                )
            self._write("observation", **_observation_fields(entry))
        else:
            drive = self._drives.fields_of(self._entries, entry.drive)
            self._write("intended", **intended_fields(entry), **drive)

    def _write(self, kind: str, **fields: Any) -> None:
        self._file.write(json.dumps({"kind": kind} | fields, separators=(",", ":")) + "\n")

    def close(self) -> None:
        """Write the end, without which the file does not count as whole; twice does no harm."""
        if not self._file.closed:
            self._write("end", entries=self._entries)
            self._file.close()


@dataclass(slots=True)
class Records:
    """Records of one file.

    Attributes
    ----------
    intended : list of Intended
    observations : list of Observation
    """

    intended: list[Intended] = field(default_factory=list)
    observations: list[Observation] = field(default_factory=list)


def read_records(path: str | Path) -> Records:
    """Return the records that a :class:`RecordFile` wrote.

    Raises
    ------
    ConfigurationError
        A file that cannot be read, is not whole, or holds something else; names the line.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> with TemporaryDirectory() as folder:
    ...     path = f"{folder}/run.jsonl"
    ...     with RecordFile(path) as file, Driver(url, seed=1, sink=file) as driver:
    ...         state = driver.arm()
    ...         intended = driver.focus((0.0, 0.0, 0.15))
    ...     records = read_records(path)
    >>> len(records.intended), len(records.observations)
    (1, 0)
    """
    check_argument_kind("path", path, (str, Path), "the name of a file")
    reader = _RecordReader()
    try:
        with Path(path).open(encoding="utf-8") as file:
            for line in file:
                reader.take(line)
    except OSError as error:
        raise unreadable_file(path, error) from error
    except (ConfigurationError, ValueError, KeyError, TypeError, RecursionError) as error:
        where = f"{path}:{reader.lines}"
        raise ConfigurationError(f"{where}: not a line of a record: {error!r}") from error
    if not reader.whole:
        raise ConfigurationError(
            f"{path}:{reader.lines}: the record has no end: its writer was cut off"
        )
    return reader.records


class _RecordReader:
    def __init__(self) -> None:
        self.records = Records()
        self.whole = False
        self.lines = 0
        self._drives: dict[int, Drive] = {}

    def take(self, text: str) -> None:
        """Take a line."""
        self.lines += 1
        if self.whole:
            raise ValueError("a line after the end")
        fields = json.loads(text)
        found = self.records
        match fields["kind"]:
            case "intended":
                found.intended.append(intended_of_fields(fields, self.lines, self._drives))
            case "observation":
                found.observations.append(_observation_of_fields(fields))
            case "end":
                entries = len(found.intended) + len(found.observations)
                if entries != fields["entries"]:
                    raise ValueError(f"{entries} entries of {fields['entries']}")
                self.whole = True
            case kind:
                raise KeyError(kind)


def _observation_fields(seen: Observation) -> dict[str, Any]:
    return {
        **dataclasses.asdict(seen.key),
        "t_latch_us": seen.t_latch_us,
        "late": seen.late,
        "evidence": str(seen.evidence),
        "drive_crc": seen.drive_crc,
        **({} if seen.drive is None else Codes.of(seen.drive).as_record()),
    }


def _observation_of_fields(fields: dict[str, Any]) -> Observation:
    return Observation(
        FrameKey.from_record(fields),
        t_latch_us=fields["t_latch_us"],
        late=fields["late"],
        evidence=Evidence(fields["evidence"]),
        drive=drive_of_record(fields) if "phase_codes" in fields else None,
        drive_crc=fields["drive_crc"],
    )
