"""The options of ``haptogram verify``; names, units and defaults are those of its settings."""

from __future__ import annotations

import argparse

from haptogram.settings.array import ArrayConfig
from haptogram.settings.board import DEFAULT_ARRAY
from haptogram.settings.parser import file_name, whole_number
from haptogram.settings.shape import MESH_SUFFIXES, MODULATIONS, SHAPES, UNITS_M, ShapeConfig
from haptogram.settings.tolerance import (
    GUESS_C,
    GUESS_HUMIDITY_PERCENT,
    GUESS_PHASE_RAD,
    GUESS_POSITION_MM,
    ToleranceConfig,
)
from haptogram.settings.verify_config import (
    MODES,
    PHASE_BITS,
    SOLVERS,
    DriveConfig,
    LimitConfig,
    LinkConfig,
    PaceConfig,
)

from ..modulation.options import add_modulation
from ..shell.output_files import FILE_HELP
from ..shell.positions import position_mm
from ..shell.setting_types import setting_type


def add_options(verify: argparse.ArgumentParser) -> None:
    """Add every option; one that is not given is None, so that a file can set it."""
    shape = verify.add_argument_group("what is displayed")
    shape.add_argument(
        "--object",
        metavar="SHAPE",
        help=f"{', '.join(SHAPES)}, or a mesh file ({', '.join(MESH_SUFFIXES)}) "
        f"[{ShapeConfig.object}]",
    )
    shape.add_argument(
        "--unit",
        choices=tuple(UNITS_M),
        help="unit of the lengths in a mesh file [mm]",
    )
    shape.add_argument(
        "--resolution-mm",
        type=setting_type("resolution_mm"),
        metavar="MM",
        help=f"spacing of the points [{ShapeConfig.resolution_mm:g}]",
    )
    shape.add_argument(
        "--radius-mm",
        type=setting_type("radius_mm"),
        metavar="MM",
        help=f"radius of the shape; half the length of a line [{ShapeConfig.radius_mm:g}]",
    )
    shape.add_argument(
        "--center-mm",
        type=position_mm,
        metavar="X,Y,Z",
        help="centre of the shape above the array [0,0,100]",
    )
    shape.add_argument(
        "--rate-hz",
        type=setting_type("rate_hz"),
        metavar="HZ",
        help=f"points per second [{PaceConfig.rate_hz:g}]",
    )
    shape.add_argument(
        "--repeat",
        type=setting_type("repeat"),
        metavar="N",
        help=f"how often the object is displayed [{PaceConfig.repeat}]",
    )
    shape.add_argument(
        "--modulation",
        choices=MODULATIONS,
        help="what makes it felt: am, amplitude; lm, lateral; stm, along the object in rounds, at "
        "constant speed; 'haptogram modulation' shows what arrives [none]",
    )
    add_modulation(shape)
    shape.add_argument(
        "--foci",
        type=setting_type("foci"),
        metavar="N",
        help=f"foci in every frame, evenly apart along the object [{DriveConfig.foci}]",
    )
    shape.add_argument(
        "--solver",
        choices=SOLVERS,
        help="how the host makes the drive of several foci: docs/performance.md compares them "
        "[wgs; --mode points: naive, by the board]",
    )

    array = verify.add_argument_group("array and air")
    array.add_argument(
        "--array",
        metavar="NXxNY|FILE",
        help="grid, or a CSV file of positions in mm "
        f"[virtual board: {DEFAULT_ARRAY}; --port: what the board says]",
    )
    array.add_argument(
        "--pitch-mm",
        type=setting_type("pitch_mm"),
        metavar="MM",
        help=f"pitch of the grid [{ArrayConfig.pitch_mm:g}]",
    )
    array.add_argument(
        "--temperature-c",
        type=setting_type("temperature_c"),
        metavar="C",
        help=f"air temperature that the host assumes [{ArrayConfig.temperature_c:g}]",
    )
    array.add_argument(
        "--board-temperature-c",
        type=setting_type("board_temperature_c"),
        metavar="C",
        help="air temperature over the virtual board [the host's]",
    )

    array.add_argument(
        "--calibration",
        type=file_name,
        metavar="FILE",
        help="CSV file with gain, phase and position of each element, as they really are: of the "
        "virtual board that is started here, and for the judge of any board; docs/calibration.md "
        "has its format [all equal, in place]",
    )
    array.add_argument(
        "--compensate",
        action=argparse.BooleanOptionalAction,
        help="the host computes its drives for the elements of the calibration [it does not]",
    )

    _add_tolerance(verify)

    link = verify.add_argument_group("board and link")
    link.add_argument(
        "--port",
        metavar="URL",
        help="a board on any pyserial URL (/dev/ttyUSB0, /dev/pts/7, socket://...); "
        "without it a virtual board is started on a pty in a process of its own",
    )
    link.add_argument(
        "--baud",
        type=setting_type("baud"),
        metavar="BAUD",
        help=f"speed of the line [{LinkConfig.baud}]",
    )
    link.add_argument(
        "--mode",
        choices=MODES,
        help="phases: the host computes every drive; drives: with amplitudes; points: the board "
        "does; "
        f"sequence: uploaded once, played on the board's clock [{DriveConfig.mode}]",
    )
    link.add_argument(
        "--phase-bits",
        type=whole_number(5, 8, "bits"),
        choices=PHASE_BITS,
        help=f"bits per phase on the wire [{DriveConfig.phase_bits}]",
    )
    link.add_argument(
        "--lead-ms",
        type=setting_type("lead_ms"),
        metavar="MS",
        help="how long before its time a frame is sent [100, or 3/4 of the board's queue]",
    )
    link.add_argument(
        "--virtual-time",
        action=argparse.BooleanOptionalAction,
        help="no wall clock at all: the same inputs give the same result, byte for byte",
    )
    link.add_argument(
        "--fault",
        action="append",
        metavar="FAULT",
        help="something that goes wrong with the virtual board's line, clock or transducers, such "
        'as "line.flip ber=1e-5" or "device.stuck column=3 from=2s"; may be repeated. from= and '
        "until= are times since power-up, a moment before the first frame: in virtual time the "
        "session is up after some milliseconds, over a pty after a second or so. What there is "
        "before it hits the handshake as well. All faults: docs/faults.md",
    )
    link.add_argument(
        "--fault-plan",
        type=file_name,
        metavar="FILE",
        help="faults from a TOML file, as python -m sim_device takes it, before those of --fault: "
        "seed = N, and tables [[fault]] with name and parameters",
    )
    link.add_argument(
        "--seed",
        type=setting_type("seed"),
        metavar="N",
        help=f"seed of everything random, faults among it [{LimitConfig.seed}]",
    )

    result = verify.add_argument_group(
        "result",
        f"Folders of these files are made where needed. {FILE_HELP}",
    )
    result.add_argument(
        "--min-verified",
        type=setting_type("min_verified"),
        metavar="SHARE",
        help="share of frames that must be verified [1 in virtual time, else 0.9]",
    )
    result.add_argument(
        "--frames",
        type=file_name,
        metavar="FILE",
        help="write a line for every frame: where its focus is, what that rests on, and which miss "
        "would have shown",
    )
    result.add_argument("--json", type=file_name, metavar="FILE", help="write the result as JSON")
    result.add_argument(
        "--junit", type=file_name, metavar="FILE", help="write the result as JUnit XML"
    )
    result.add_argument(
        "--html", type=file_name, metavar="FILE", help="write the result as HTML with pictures"
    )
    verify.add_argument(
        "--config",
        type=file_name,
        metavar="FILE",
        help="TOML file with a [verify] table of these options",
    )
    verify.add_argument("--quiet", action="store_true", help="no progress bar")


def _add_tolerance(verify: argparse.ArgumentParser) -> None:
    """Add what is tolerated, and how well air and elements are known."""
    group = verify.add_argument_group(
        "tolerance and uncertainty",
        "A tolerance decides which miss passes, on top of what rounding of the phases makes; the "
        "default is none. An uncertainty decides nothing: the result tells what it makes in mm.",
    )
    group.add_argument(
        "--tolerance-mm",
        type=setting_type("tolerance_mm"),
        metavar="MM",
        help="distance of a focus from its target that passes, if there is such a focus: at most "
        f"half of its width [{ToleranceConfig.tolerance_mm:g}]",
    )
    group.add_argument(
        "--tolerance-c",
        type=setting_type("tolerance_c"),
        metavar="C",
        help="difference between the air that the host assumes and that over the board "
        f"[{ToleranceConfig.tolerance_c:g}]",
    )
    group.add_argument(
        "--tolerance-humidity",
        type=setting_type("tolerance_humidity"),
        metavar="PERCENT",
        help=f"the same of the relative humidity [{ToleranceConfig.tolerance_humidity:g}]",
    )
    real = "virtual board: 0; --port:"
    group.add_argument(
        "--uncertainty-c",
        type=setting_type("uncertainty_c"),
        metavar="C",
        help=f"standard uncertainty of the air temperature [{real} {GUESS_C:g}]",
    )
    group.add_argument(
        "--uncertainty-humidity",
        type=setting_type("uncertainty_humidity"),
        metavar="PERCENT",
        help=f"of the relative humidity [{real} {GUESS_HUMIDITY_PERCENT:g}]",
    )
    group.add_argument(
        "--uncertainty-position-mm",
        type=setting_type("uncertainty_position_mm"),
        metavar="MM",
        help=f"of each coordinate of each element [{real} {GUESS_POSITION_MM:g}]",
    )
    group.add_argument(
        "--uncertainty-phase-rad",
        type=setting_type("uncertainty_phase_rad"),
        metavar="RAD",
        help=f"of the phase that each element adds [{real} {GUESS_PHASE_RAD:g}]",
    )
