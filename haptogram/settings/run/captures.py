"""Settings of the captures of drive pins that a run is judged by."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ..option import SettingError, Settings, option


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
