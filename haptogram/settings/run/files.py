"""Settings of the files of a run: captures of drive pins that it is judged by, and its outputs."""

from __future__ import annotations

from pathlib import Path

from haptogram.settings.frozen import dataclass

from ..option import Option, SettingError, Settings, option, options_of


@dataclass(frozen=True, kw_only=True)
class CaptureConfig(Settings):
    """The captures of drive pins that are judged, and what they are judged by."""

    capture: tuple[Path, ...] = option(
        (),
        unit="FILE",
        help="capture of drive pins (VCD, or .sr of sigrok) of the run at --port, or of the one in "
        "--from-recording; may be repeated: captures of all elements are joined",
        absent="none",
    )
    channels: tuple[Path, ...] = option(
        (),
        unit="FILE",
        help="TOML map of the channels of --capture (docs/captures.md); repeated, one for each",
        absent="none",
    )
    from_recording: Path | None = option(
        None,
        unit="FILE",
        help="judge --capture by the frames of this recording (--record), and run nothing",
        absent="run",
    )

    def __post_init__(self) -> None:
        """Check that there is a map for every capture."""
        super().__post_init__()
        if self.from_recording is not None and not self.capture:
            raise SettingError(
                "from_recording", "is what a capture is judged by: name the --capture"
            )
        if self.capture and not self.channels:
            raise SettingError("channels", "is missing: a capture needs the map of its channels")
        if self.capture and len(self.channels) not in (1, len(self.capture)):
            captures = len(self.capture)
            for_them = (
                "1 capture, must be one"
                if captures == 1
                else f"{captures} captures, must be one for all or one for each"
            )
            raise SettingError("channels", f"names {len(self.channels)} maps for {for_them}")
        if self.channels and not self.capture:
            raise SettingError("channels", "is the map of a capture: name the --capture")


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
