"""The settings of a verification run: of a TOML file and a command line, checked together."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

from haptogram.errors import ConfigurationError
from haptogram.settings.frozen import dataclass

from ..arguments import did_you_mean, option_word
from ..array import ArrayConfig, ElementConfig
from ..board import BoardConfig, FaultWords
from ..option import SettingError, Settings, option_group, options_of, unknown_setting_text
from ..shape import ModulationConfig, ShapeConfig
from ..text_file import read_toml_file
from ..tolerance import ToleranceConfig, UncertaintyConfig
from .files import CaptureConfig, OutputConfig
from .frames import DriveConfig, LimitConfig, LinkConfig, PaceConfig


@dataclass(frozen=True, kw_only=True)
class VerifyConfig(Settings):
    """The settings of ``haptogram verify``: one group for each room that takes them.

    :meth:`VerifyConfig.of` takes the options of all groups by name, with the units and defaults of
    the command line.

    Raises
    ------
    SettingError
        If a value is outside its limits, or contradicts another one.
    """

    shape: ShapeConfig = option_group(ShapeConfig)
    pace: PaceConfig = option_group(PaceConfig)
    modulation: ModulationConfig = option_group(ModulationConfig)
    drive: DriveConfig = option_group(DriveConfig)
    array: ArrayConfig = option_group(ArrayConfig)
    elements: ElementConfig = option_group(ElementConfig)
    tolerance: ToleranceConfig = option_group(ToleranceConfig)
    uncertainty: UncertaintyConfig = option_group(UncertaintyConfig)
    link: LinkConfig = option_group(LinkConfig)
    limits: LimitConfig = option_group(LimitConfig)
    faults: FaultWords = option_group(FaultWords)
    captures: CaptureConfig = option_group(CaptureConfig)
    outputs: OutputConfig = option_group(OutputConfig)

    def __post_init__(self) -> None:
        """Check the settings against each other."""
        super().__post_init__()
        if self.modulation.modulation is not None:
            self._check_modulation()
        solver = self.drive.solver
        if self.frame_kind == "points" and solver not in (None, "naive"):
            raise SettingError(
                "solver", f"is {solver!r}; the board solves frames of points, by superposition"
            )
        if self.elements.compensate and self.captures.from_recording is None:
            self._check_compensation()
        if self.outputs.pin_calibration is not None and not self.captures.capture:
            raise SettingError(
                "pin_calibration", "is of captured pins: name the --capture and its --channels"
            )
        if self.link.port is not None:
            self._check_port(self.link.port)
        elif self.captures.capture and self.captures.from_recording is None:
            raise SettingError(
                "capture",
                "is of a board at --port, or of the run in a --from-recording; a virtual board "
                "writes one of its own: haptogram board --capture",
            )

    def _check_modulation(self) -> None:
        """Refuse a modulation faster than half the frame rate, and "am" in the mode phases.

        "am" is modulation of the amplitude, which frames of the mode phases lack.
        """
        kind, rate_hz = self.modulation.modulation, self.pace.rate_hz
        if self.modulation.modulation_hz > rate_hz / 2.0:
            raise SettingError(
                "modulation_hz",
                f"is {self.modulation.modulation_hz:g}; at {rate_hz:g} frames/s it can be "
                f"{rate_hz / 2.0:g} at most",
            )
        if kind == "am" and self.drive.mode == "phases":
            raise SettingError(
                "modulation",
                "is 'am', whose frames have amplitudes; the mode phases drives every transducer in "
                "full, the modes points, drives and sequence do not",
            )

    def _check_compensation(self) -> None:
        """Refuse to compensate without a calibration, or where the board computes the drives."""
        if self.elements.calibration is None:
            raise SettingError(
                "compensate", "needs to know how the elements are: name the file of a calibration"
            )
        if self.frame_kind == "points":
            raise SettingError(
                "compensate",
                f"is for drives that the host computes; in the mode {self.drive.mode} with these "
                "settings the board does, and knows no calibration",
            )

    def _check_port(self, port: str) -> None:
        """Refuse options that act only on a virtual board started here, as *port* is another."""
        if self.link.virtual_time:
            raise SettingError(
                "virtual_time",
                f"runs on the board inside this program; port {port!r} has a clock of its own",
            )
        if self.elements.board_temperature_c is not None:
            raise SettingError(
                "board_temperature_c",
                "is the air over the virtual board that is started here; the judge of a board at a "
                "port takes that of the host: state it with --temperature-c",
            )
        faulty = next(iter(self.faults.non_default()), None)
        if faulty is not None:
            raise SettingError(
                faulty,
                f"is for the virtual board that is started here; the one at port {port!r} has its "
                "own (a virtual one takes them when it is started: docs/faults.md)",
            )

    @property
    def frame_kind(self) -> str:
        """Content of the frames: phases, drives or points; a sequence has no drives."""
        if self.drive.mode == "sequence":
            return "points" if self.modulation.modulation == "am" else "phases"
        return self.drive.mode

    @property
    def solver_of_host(self) -> str:
        """Solver of the drive of several foci; a board that solves it superposes them."""
        return self.drive.solver or ("naive" if self.frame_kind == "points" else "wgs")

    @property
    def least_verified(self) -> float:
        """Share of frames that must be verified: all in virtual time, 0.9 on the wall clock."""
        if self.limits.min_verified is not None:
            return self.limits.min_verified
        return 1.0 if self.link.virtual_time else 0.9

    @property
    def air_over_board_c(self) -> float:
        """Temperature of the air that the virtual board radiates into."""
        board_c = self.elements.board_temperature_c
        return self.array.temperature_c if board_c is None else board_c

    def virtual_board(self) -> BoardConfig:
        """Return the virtual board that is started here; a driver paces its line."""
        is_paced = self.link.virtual_time and self.link.dialect is None
        return BoardConfig.of(
            **self.dialect_options(),
            baud=self.link.baud if is_paced else None,
            pitch_mm=self.array.pitch_mm,
            temperature_c=self.air_over_board_c,
            calibration=self.elements.calibration,
            seed=self.limits.seed,
            simulator=self.link.simulator,
            fault=self.faults.fault,
            fault_plan=self.faults.fault_plan,
        )

    def dialect_options(self) -> dict[str, Any]:
        """Return the options of a virtual board that choose its dialect and the boards of it."""
        return {
            "array": self.array.array,
            "dialect": self.link.dialect,
            "dialect_option": self.link.dialect_option,
        }

    def result_options(self) -> dict[str, Any]:
        """Return the options that decide the result, for the report: JSON types, no output path."""
        outputs = options_of(OutputConfig)
        return {
            name: _setting_for_json(v) for name, v in self.values().items() if name not in outputs
        }


def _setting_for_json(value: Any) -> Any:
    """Return a value in JSON's types: paths as text, tuples as lists."""
    if isinstance(value, Path):
        return str(value)
    return [_setting_for_json(item) for item in value] if isinstance(value, tuple) else value


# --- Files ---------------------------------------------------------------------------------------

_SECTION: Final = "verify"


def load_verify_config(path: Path | None, overrides: Mapping[str, Any]) -> VerifyConfig:
    """Return the settings: defaults, then the ``[verify]`` table of *path*, then *overrides*."""
    return verify_config_of(path, {} if path is None else read_settings_table(path), overrides)


def verify_config_of(
    path: Path | None,
    in_file: Mapping[str, Any],
    overrides: Mapping[str, Any],
    usual: Mapping[str, Any] = MappingProxyType({}),
) -> VerifyConfig:
    """Return the settings: defaults, then a ``[verify]`` table, then *overrides*.

    Parameters
    ----------
    path : Path or None
        TOML file of the table.
    in_file : mapping
        The table, which :func:`read_settings_table` has read: a pipe is read but once.
    overrides : mapping
        Values from the command line; those that are None were not given.
    usual : mapping, optional
        Defaults of this run that are not those of every run.

    Raises
    ------
    ConfigurationError
        If a key is not known, or a value has the wrong type or size; the text names the setting as
        it was written: the key in the file, or the option.
    """
    given = {name: value for name, value in overrides.items() if value is not None}
    try:
        return VerifyConfig.of(**{**usual, **in_file, **given})
    except SettingError as error:
        is_in_file = error.name in in_file and error.name not in given
        written = f"{path}: {error.name}" if is_in_file else option_word(error.name)
        raise ConfigurationError(f"{written} {error.message}") from error


def read_settings_table(path: Path) -> dict[str, Any]:
    """Return the ``[verify]`` table of a TOML file.

    Raises
    ------
    ConfigurationError
        If the file cannot be read, or a table or a key is not known.
    """
    document = read_toml_file(path, "config")
    table = document.get(_SECTION)
    for name in document:
        if name != _SECTION:
            guess = did_you_mean(name, (_SECTION,))
            raise ConfigurationError(
                f"{path}: [{name}] is not read; all settings are in one table [{_SECTION}]{guess}"
            )
    if not isinstance(table, dict):
        raise ConfigurationError(f"{path}: must have one table [{_SECTION}]")
    for name in (name for name in table if name not in options_of(VerifyConfig)):
        known = unknown_setting_text(name, options_of(VerifyConfig))
        raise ConfigurationError(f"{path}: {name!r} is not a setting{known}")
    return table
