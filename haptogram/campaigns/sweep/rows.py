"""Rows of a sweep: what each keeps of the JSON result of its command, and files of all of them."""

from __future__ import annotations

import csv
import io
import json
import re
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple, TypeAlias

from haptogram.errors import ConfigurationError, missing_extra
from haptogram.machine.files import is_standard_output, write_file_atomically
from haptogram.machine.terminal import terminal_command_line
from haptogram.settings.text_file import flat_document

from .plan import SweepPoint

Row: TypeAlias = dict[str, Any]

PARQUET: Final = ".parquet"
_SUFFIXES: Final = (".csv", PARQUET)
#: Verdicts of points by exit status; any other status is an error.
_VERDICTS: Final = {0: "pass", 1: "fail", 3: "inconclusive"}
ERROR: Final = "error"
#: Verdicts, the worst first.
VERDICTS: Final = ("fail", ERROR, "inconclusive", "pass")
_PAINT: Final = re.compile(r"\x1b\[[\d;]*m")


class Measure(NamedTuple):
    """A figure that tells how bad a point is: its column, and its text in tables."""

    column: str
    text: str


#: The figures of each command; the first is drawn, the last one says which point is worse.
MEASURES: Final = {
    "verify": (
        Measure("miss_mm", "largest miss (mm)"),
        Measure("bad_frames", "frames not on target"),
    ),
    "conform": (Measure("failed", "failed cases"),),
    "soak": (Measure("violations", "violations"),),
}
_MISSES: Final = ("lateral_error_mm.max", "axial_error_mm.max", "effect.farthest_mm")
#: The parts of a JSON result that become columns, by command; none depends on the machine.
_PARTS: Final = {
    "verify": (
        *("evidence", "frames", "lateral_error_mm", "axial_error_mm", "smallest_miss_mm"),
        *("effect", "coherence", "pressure_rms_pa", "force_mn", "lateness_us"),
    ),
    "conform": ("counts",),
    "soak": ("tally.totals", "tally.violations"),
}


def row_of_point(point: SweepPoint, status: int, content: bytes, said: str) -> Row:
    """Return the row of a point.

    Parameters
    ----------
    status : int
        Exit status of its command.
    content : bytes
        Its result as JSON; empty if it has none.
    said : str
        Its text on standard error; the last line is the reason if there is no result.
    """
    row = _first_row_columns(point) | {"verdict": _VERDICTS.get(status, ERROR)}
    if not content:
        lines = _PAINT.sub("", said).strip().splitlines() or [f"exit status {status}"]
        return row | {"reason": lines[-1].removeprefix(f"haptogram {point.words[0]}: ")}
    result = json.loads(content)
    row["reason"] = "; ".join(result.get("reasons", ())) or None
    columns: Row = {}
    for part in _PARTS[point.words[0]]:
        found: Any = result
        for name in part.split("."):
            found = found[name]
        fields = flat_document(found, part)
        # One name for a million rows.
        columns |= {sys.intern(name): value for name, value in fields if value is not None}
    figures = _row_figures(point.words[0], columns)
    named = zip(MEASURES[point.words[0]], figures, strict=True)
    return row | {measure.column: figure for measure, figure in named} | columns


def row_of_crash(point: SweepPoint, reason: str) -> Row:
    """Return the row of a point that came to no end."""
    return _first_row_columns(point) | {"verdict": ERROR, "reason": reason}


def _first_row_columns(point: SweepPoint) -> Row:
    """Return the first columns of a row: number, command and values of its point."""
    command = terminal_command_line(["haptogram", *point.words])
    return {"point": point.number, "command": command, **point.values}


def _row_figures(command: str, columns: Row) -> tuple[float | None, ...]:
    """Return the figures of :data:`MEASURES` that a command has; None where it was not measured.

    For verify the largest miss (mm) and the frames off target, for conform the failed cases, else
    the violations.
    """
    if command == "verify":
        miss_mm = max((columns[name] for name in _MISSES if name in columns), default=None)
        return miss_mm, columns["frames.sent"] - columns["frames.on_target"]
    if command == "conform":
        return (columns["counts.FAILED"],)
    return (sum(n for name, n in columns.items() if name.startswith("tally.violations.")),)


def badness(row: Row, measures: Sequence[Measure]) -> tuple[float, ...]:
    """Return a key that puts the worst row first: by verdict, then by the last figure.

    Examples
    --------
    >>> rows = [{"verdict": v, "failed": n, "point": n} for v, n in (("pass", 0), ("fail", 3))]
    >>> min(rows, key=lambda row: badness(row, MEASURES["conform"]))["failed"]
    3
    """
    figures = [row.get(measure.column) for measure in reversed(measures)]
    known = [0.0 if figure is None else -figure for figure in figures]
    return (VERDICTS.index(row["verdict"]), *known, row["point"])


# --- Files ---------------------------------------------------------------------------------------


def check_rows_file(path: Path) -> None:
    """Raise, before the work begins, unless rows can be written in the format of *path*.

    Raises
    ------
    ConfigurationError
        A suffix that is not a format, or no pyarrow.
    """
    if is_standard_output(path):
        return
    if path.suffix not in _SUFFIXES:
        raise ConfigurationError(
            f"--rows '{path}' ends in {path.suffix or 'nothing'!r}; possible are "
            f"{', '.join(_SUFFIXES)}"
        )
    if path.suffix == PARQUET:
        try:
            import pyarrow  # noqa: F401
        except ImportError as error:
            raise missing_extra("--rows: Parquet needs pyarrow", "sweep") from error


def write_rows(path: Path, rows: Sequence[Row]) -> None:
    """Write *rows* in the format of *path*; to standard output, as CSV.

    Raises
    ------
    ConfigurationError
        If it cannot be written.
    """
    columns = list(dict.fromkeys(name for row in rows for name in row))
    is_table = path.suffix == PARQUET and not is_standard_output(path)
    encoded = _parquet_bytes if is_table else _csv_bytes
    write_file_atomically(path, encoded(columns, rows))


def _csv_bytes(columns: Sequence[str], rows: Sequence[Row]) -> bytes:
    """Return rows as a CSV file in UTF-8; a missing value is an empty cell."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows([row.get(name) for name in columns] for row in rows)
    return text.getvalue().encode("utf-8", errors="replace")


def _parquet_bytes(columns: Sequence[str], rows: Sequence[Row]) -> bytes:
    """Return rows as a Parquet file; a missing value is null."""
    import pyarrow
    from pyarrow import parquet

    buffer = io.BytesIO()
    values = {name: _parquet_column([row.get(name) for row in rows]) for name in columns}
    parquet.write_table(pyarrow.table(values), buffer)
    return buffer.getvalue()


def _parquet_column(values: list[Any]) -> list[Any]:
    """Return *values*; if one of them is text, all as text but None: a column has one type."""
    if not any(isinstance(value, str) for value in values):
        return values
    return [None if value is None else str(value) for value in values]
