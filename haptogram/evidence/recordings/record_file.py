"""File of a driver's records, written as they come and read back: a sink for long runs.

JSON lines.  What frames have in common, foci and drive, is written once for as long as it repeats:
``frame`` lines fill numbered slots, ``intended`` lines refer to the slot filled last.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, TypeAlias

from haptogram.acoustics.model.drive import Drive
from haptogram.errors import ConfigurationError, unreadable_file, unwritable_file
from haptogram.evidence.backdoor import drive_of_record
from haptogram.machine.closing import ClosedByWith
from haptogram.records.frame import Evidence, Focus, FrameKey, Intended, Observation
from haptogram.records.latch import Codes
from haptogram.settings.arguments import check_argument_kind

_SLOTS: Final = 4096  # frames that are remembered: some 5 MB
_DRIVE_FIELDS: Final = ("phase_codes", "amplitude_codes", "phase_bits")  # their order in a line
_Content: TypeAlias = tuple[tuple[Focus, ...], Drive, int, int | None, bool, str]


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
        self._slots: dict[_Content, int] = {}
        self._frames = self._entries = 0

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
            self._write("observation", **_record_of_observation(entry))
            return
        slot = self._slot_of(entry)
        key = dataclasses.astuple(entry.key)
        times = {"t": entry.t_apply_us, "latest": entry.t_latest_us, "sent": entry.t_sent_us}
        self._write("intended", number=entry.number, key=key, slot=slot, **times)

    def _slot_of(self, entry: Intended) -> int:
        """Return the slot that holds what *entry* is, filled if it was not."""
        content = (
            entry.foci,
            entry.drive,
            entry.phase_bits,
            entry.phase_steps,
            entry.board_computed,
            entry.solver,
        )
        if (slot := self._slots.get(content)) is not None:
            return slot
        slot = self._frames % _SLOTS
        self._frames += 1
        if self._frames > _SLOTS:  # the oldest one was in this slot
            del self._slots[next(iter(self._slots))]
        self._slots[content] = slot
        foci = [focus.as_numbers() for focus in entry.foci]
        self._write(
            "frame",
            slot=slot,
            foci=foci,
            drive=_record_of_drive(entry.drive),
            phase_bits=entry.phase_bits,
            phase_steps=entry.phase_steps,
            board_computed=entry.board_computed,
            solver=entry.solver,
        )
        return slot

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
    reader = _BoardRecordReader()
    try:
        with Path(path).open(encoding="utf-8") as file:
            for line in file:
                reader.take(line)
    except OSError as error:
        raise unreadable_file(path, error) from error
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        where = f"{path}:{reader.lines}"
        raise ConfigurationError(f"{where}: not a line of a record: {error!r}") from error
    if not reader.whole:
        raise ConfigurationError(
            f"{path}:{reader.lines}: the record has no end: its writer was cut off"
        )
    return reader.records


class _BoardRecordReader:
    def __init__(self) -> None:
        self.records = Records()
        self.whole = False
        self.lines = 0
        self._slots: dict[int, dict[str, Any]] = {}
        self._kinds: Final[Mapping[str, Callable[..., None]]] = {
            "frame": self._frame,
            "intended": self._intended,
            "observation": self._observation,
            "end": self._end,
        }

    def take(self, text: str) -> None:
        """Take a line."""
        self.lines += 1
        if self.whole:
            raise ValueError("a line after the end")
        line = json.loads(text)
        if not isinstance(line, dict):
            raise TypeError("no object")
        self._kinds[line.pop("kind")](**line)

    def _frame(self, slot: int, foci: list[list[float]], drive: Any, **others: Any) -> None:
        found = tuple(Focus.from_numbers(focus) for focus in foci)
        self._slots[slot] = {"foci": found, "drive": _drive_of_record(drive)} | others

    def _intended(
        self,
        number: int,
        key: list[int],
        t: int | None,
        slot: int,
        latest: int | None = None,
        sent: int | None = None,
    ) -> None:
        fields = self._slots[slot] | {"t_latest_us": latest, "t_sent_us": sent}
        self.records.intended.append(Intended(number, FrameKey(*key), t, **fields))

    def _observation(self, key: list[int], drive: Any, evidence: str, **others: Any) -> None:
        seen = Observation(
            FrameKey(*key), evidence=Evidence(evidence), drive=_drive_of_record(drive), **others
        )
        self.records.observations.append(seen)

    def _end(self, entries: int) -> None:
        found = len(self.records.intended) + len(self.records.observations)
        if entries != found:
            raise ValueError(f"{found} entries of {entries}")
        self.whole = True


def _record_of_observation(seen: Observation) -> dict[str, Any]:
    return {
        "key": dataclasses.astuple(seen.key),
        "t_latch_us": seen.t_latch_us,
        "late": seen.late,
        "evidence": str(seen.evidence),
        "drive": None if seen.drive is None else _record_of_drive(seen.drive),
        "drive_crc": seen.drive_crc,
    }


def _record_of_drive(drive: Drive) -> list[Any]:
    fields = Codes.of(drive).as_record()
    return [fields[name] for name in _DRIVE_FIELDS]


def _drive_of_record(values: Any) -> Drive | None:
    if values is None:
        return None
    return drive_of_record(dict(zip(_DRIVE_FIELDS, values, strict=True)))
