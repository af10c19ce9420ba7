"""The options of ``haptogram verify``: those of its settings, in groups."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from haptogram.settings import command_line
from haptogram.settings.array import ArrayConfig, ElementConfig
from haptogram.settings.board import FaultWords
from haptogram.settings.option import options_of
from haptogram.settings.parser import Acting, Parser, add_file_option, add_flag
from haptogram.settings.run.files import CaptureConfig, OutputConfig
from haptogram.settings.run.frames import LinkConfig
from haptogram.settings.run.verify import VerifyConfig
from haptogram.settings.shape import ModulationConfig, ShapeConfig
from haptogram.settings.tolerance import ToleranceConfig, UncertaintyConfig

from ..acting_options import AM, LM, MESH, RADIUS, RESOLUTION, acts_on_a_grid, with_option
from ..shell.output_files import FILE_HELP

_TOLERANCE: Final = (
    "A tolerance decides which miss passes, on top of what rounding of the phases makes; the "
    "default is none. Of an uncertainty the result tells what it makes in mm; one that is stated "
    "of the elements also says by how much one of them may be off where a miss is tolerated."
)
#: The names of the options by group, in the order of the help text.
GROUPS: Final[Mapping[str, tuple[str, ...]]] = {
    "tactile object": (
        *options_of(ShapeConfig),
        *("rate_hz", "repeat"),
        *options_of(ModulationConfig),
        *("foci", "solver"),
    ),
    "array and air": (*options_of(ArrayConfig), *options_of(ElementConfig)),
    "tolerance and uncertainty": (*options_of(ToleranceConfig), *options_of(UncertaintyConfig)),
    "board and link": (
        *options_of(LinkConfig),
        *("mode", "lead_ms", "seed"),
        *options_of(FaultWords),
    ),
    "drive pins": tuple(options_of(CaptureConfig)),
    "result": ("min_verified", *options_of(OutputConfig)),
}
_PINS: Final = (
    "Evidence that is not the firmware's own word, for the elements that were captured: "
    "docs/captures.md."
)
_DESCRIPTIONS: Final = {
    "drive pins": _PINS,
    "tolerance and uncertainty": _TOLERANCE,
    "result": FILE_HELP,
}


#: Further requirements of an option of a run.
_ACTING_ON_A_RUN: Final = {
    "resolution_mm": RESOLUTION,
    "radius_mm": RADIUS,
    "unit": MESH,
    "modulation_hz": with_option("modulation"),
    "depth": AM,
    "shift_mm": LM,
    "dwell_ms": Acting("without --modulation stm", lambda s: s.modulation != "stm"),
    "solver": Acting("with --foci 2 or more", lambda s: s.foci > 1),
    "pitch_mm": Acting(
        "on a grid: with --array NXxNY, or without --port and --dialect",
        lambda s: acts_on_a_grid(s) and (s.array is not None or s.port is s.dialect is None),
    ),
    "dialect_option": with_option("dialect"),
    "backdoor": Acting(
        "at a --port that is no haptogram:// URL, which has its own",
        lambda s: s.port is not None and not s.port.startswith("haptogram://"),
    ),
    **dict.fromkeys(
        ("mode", "lead_ms"),
        Acting(
            "on Haptogram's own wire (without --dialect: other boards are given phases, and no "
            "times)",
            lambda s: s.dialect is None,
        ),
    ),
    "simulator": Acting(
        "with --virtual-time (on a pty: haptogram board)",
        lambda s: s.port is None and s.virtual_time,
    ),
    "seed": Acting("on the virtual board that is started here", lambda s: s.port is None),
    "view": Acting(
        "on the virtual board and the wall clock (without --port and --virtual-time; --html holds "
        "the view of any run)",
        lambda s: s.port is None and not s.virtual_time,
    ),
}


_JUDGING: Final = (ToleranceConfig, UncertaintyConfig, CaptureConfig, OutputConfig)
_OF_A_RUN: Final = {"record", "view", *options_of(VerifyConfig)} - {
    "min_verified",
    *(name for settings in _JUDGING for name in options_of(settings) if name != "record"),
}


def _acts_on_a_run(row: Acting | None) -> Acting:
    """Return *row*, which says when an option acts, limited to runs without --from-recording.

    None: it acts on every run.
    """
    where = "on a run (a recording has its own; not with --from-recording)"
    if row is None:
        return Acting(where, lambda s: s.from_recording is None)
    return Acting(row.where, lambda s: s.from_recording is None and row.is_there(s))


_ACTING: Final = {name: _acts_on_a_run(_ACTING_ON_A_RUN.get(name)) for name in sorted(_OF_A_RUN)}


def add_verify_options(verify: Parser) -> None:
    """Add every option; one that is not given is None, so that a file can set it."""
    verify.acting = _ACTING
    rows = options_of(VerifyConfig)
    for title, names in GROUPS.items():
        group = verify.add_argument_group(title, _DESCRIPTIONS.get(title))
        command_line.add_setting_options(group, [rows[name] for name in names])
    add_file_option(verify, "--config", help="TOML file with a [verify] table of these options")
    add_flag(verify, "--quiet", help="no progress bar")
    add_flag(
        verify,
        "--view",
        help="show what the virtual board radiates, live, in a browser (see haptogram view)",
    )
