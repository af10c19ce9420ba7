"""Settings of the files that a command writes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ..option import Option, Settings, option, options_of


@dataclass(frozen=True, kw_only=True)
class OutputConfig(Settings):
    """The files to be written, of every command that judges or measures, and their date."""

    record: Path | None = option(
        None,
        unit="FILE",
        help="write the bytes in both directions, the latches and what was made of them, as MCAP "
        "(docs/recordings.md)",
    )
    frames: Path | None = option(
        None,
        unit="FILE",
        help="write a line of JSON for every frame: where its focus is, what that rests on, and "
        "which miss would have shown",
    )
    json: Path | None = option(None, unit="FILE", help="write the result as JSON")
    junit: Path | None = option(None, unit="FILE", help="write the result as JUnit XML")
    html: Path | None = option(
        None, unit="FILE", help="write the result as a page of HTML that needs no other file"
    )
    summary: Path | None = option(
        None, unit="FILE", help="write a summary in Markdown, for the page of a CI job"
    )
    pin_calibration: Path | None = option(
        None,
        unit="FILE",
        help="write gain and phase of each element as the captured pins show them: the calibration "
        "of a map of channels, which is taken off",
    )
    stamp: str | None = option(
        None,
        unit="DATE",
        help="date that --html, --junit and --summary state (ISO 8601; UTC without a zone)",
        absent="when the run began; in virtual time none, so that results repeat byte for byte",
    )


def output_options(names: str) -> list[Option]:
    """Return the options of the files with these *names*, apart by spaces."""
    return [options_of(OutputConfig)[name] for name in names.split()]
