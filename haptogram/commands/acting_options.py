"""Modes in which each option of a command acts; an option without effect is refused.

A row that is None acts in every mode.
"""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, Final, NamedTuple, TypeAlias

from haptogram.errors import ConfigurationError
from haptogram.settings.board import is_grid_setting

_URL: Final = "haptogram://"


class Acting(NamedTuple):
    """When an option acts.

    Attributes
    ----------
    where : str
        The modes in words, after "acts only".
    is_there : callable
        Returns True for the settings of a command in such a mode.
    """

    where: str
    is_there: Callable[[Any], bool]


Rows: TypeAlias = Mapping[str, Acting | None]


def refuse_idle_options(
    command: str,
    arguments: Namespace,
    settings: object = None,
    file: Path | None = None,
    in_file: Iterable[str] = (),
) -> None:
    """Refuse the first given option, or key of a file, that does nothing in this mode.

    Parameters
    ----------
    settings : object, optional
        The settings that *arguments* and a file make together; by default *arguments*.
    file : Path, optional
        The file with the keys *in_file*.

    Raises
    ------
    ConfigurationError
        Names the option and the modes in which it acts.
    """
    words = {name: f"--{name.replace('_', '-')}" for name in sorted(arguments.given)}
    keys = {name: f"{file}: {name}" for name in sorted(in_file) if name not in words}
    for name, told in (words | keys).items():
        row = ACTING[command][name]
        if row is not None and not row.is_there(arguments if settings is None else settings):
            raise ConfigurationError(f"{told} acts only {row.where}; leave it out")


def _option_acts_always(names: str) -> dict[str, Acting | None]:
    return dict.fromkeys(names.split())


def _acts_on_a_shape(settings: Any) -> bool:
    from haptogram.settings.shape import SHAPES

    return settings.object is None or settings.object in SHAPES


def _acts_on_a_size(settings: Any) -> bool:
    return settings.object != "point" and _acts_on_a_shape(settings)


def _acts_on_a_grid(settings: Any) -> bool:
    return settings.array is None or is_grid_setting(settings.array)


_PITCH: Final = Acting(
    "on an --array that is a grid (a file has its own positions)", _acts_on_a_grid
)
_RADIUS: Final = Acting(
    "on a shape that has a radius (a point and a mesh have none)", _acts_on_a_size
)
_RESOLUTION: Final = Acting(
    "on an object of several points (not on a point)", lambda s: s.object != "point"
)
_MESH: Final = Acting("on a mesh file", lambda s: not _acts_on_a_shape(s))
_AM: Final = Acting("with the modulation am", lambda s: _acts_on_modulation(s) == "am")
_LM: Final = Acting("with the modulation lm", lambda s: _acts_on_modulation(s) == "lm")


def _acts_on_modulation(settings: Any) -> str | None:
    kind: str | None = settings.kind if hasattr(settings, "kind") else settings.modulation
    return kind


_STAMPED: Final = Acting(
    "with --html, --junit or --summary",
    lambda s: any(getattr(s, name, None) is not None for name in ("html", "junit", "summary")),
)


# --- The commands ------------------------------------------------------------------------------

_VERIFY_RUN: Final[Rows] = {
    **_option_acts_always(
        "object center_mm rate_hz repeat modulation foci array temperature_c board_temperature_c "
        "calibration compensate port dialect baud virtual_time fault fault_plan record"
    ),
    "resolution_mm": _RESOLUTION,
    "radius_mm": _RADIUS,
    "unit": _MESH,
    "modulation_hz": Acting("with --modulation", lambda s: s.modulation is not None),
    "depth": _AM,
    "shift_mm": _LM,
    "dwell_ms": Acting("without --modulation stm", lambda s: s.modulation != "stm"),
    "solver": Acting("with --foci 2 or more", lambda s: s.foci > 1),
    "pitch_mm": Acting(
        "on a grid: without --port, or with --array NXxNY",
        lambda s: _acts_on_a_grid(s) and (s.port is None or s.array is not None),
    ),
    "dialect_option": Acting("with --dialect", lambda s: s.dialect is not None),
    "backdoor": Acting(
        "at a --port that is no haptogram:// URL, which has its own",
        lambda s: s.port is not None and not s.port.startswith(_URL),
    ),
    **dict.fromkeys(
        ("mode", "lead_ms"),
        Acting(
            "on Haptogram's own wire (without --dialect: other boards are given phases, and no "
            "times)",
            lambda s: s.dialect is None,
        ),
    ),
    "seed": Acting("on the virtual board that is started here", lambda s: s.port is None),
    "view": Acting(
        "on the virtual board and the wall clock (without --port and --virtual-time; --html holds "
        "the view of any run)",
        lambda s: s.port is None and not s.virtual_time,
    ),
}


def _acts_on_a_run(row: Acting | None) -> Acting:
    """Return the row of an option that does nothing where a recording is judged."""
    where = "on a run (a recording has its own; not with --from-recording)"
    if row is None:
        return Acting(where, lambda s: s.from_recording is None)
    return Acting(row.where, lambda s: s.from_recording is None and row.is_there(s))


_VERIFY: Final[Rows] = {
    **{name: _acts_on_a_run(row) for name, row in _VERIFY_RUN.items()},
    **_option_acts_always(
        "tolerance_mm tolerance_c tolerance_humidity uncertainty_c uncertainty_humidity "
        "uncertainty_position_mm uncertainty_phase_rad min_verified capture channels "
        "from_recording frames json junit html summary config quiet"
    ),
    "stamp": _STAMPED,
}


def _acts_in_conform_run(arguments: Namespace) -> bool:
    return not arguments.compare and not arguments.list


def _acts_in_resets_of_a_port(arguments: Namespace) -> bool:
    is_board = arguments.port is not None and not arguments.port.startswith(_URL)
    return arguments.spawn is not None or is_board


_RUN: Final = Acting(
    "where cases are run (not with --list, --compare or --from-recording)",
    lambda a: _acts_in_conform_run(a) and a.from_recording is None,
)
_RUN_OPTIONS: Final = (
    "port baud spawn port_regex reset_cmd fault_cmd dtr rts quick full explore strict timeout seed "
    "repeat quiet record"
)
_RESULT: Final = Acting(
    "where there is a result (not with --list or --compare)", _acts_in_conform_run
)
_RESULT_OPTIONS: Final = (
    "baseline junit json summary write_baseline verbose capture channels from_recording"
)
_CONFORM: Final[Rows] = {
    **dict.fromkeys(_RUN_OPTIONS.split(), _RUN),
    **dict.fromkeys(_RESULT_OPTIONS.split(), _RESULT),
    "boot_timeout": Acting(
        "on a board at --port or from --spawn",
        lambda a: _acts_in_conform_run(a) and _acts_in_resets_of_a_port(a),
    ),
    "clause": Acting(
        "without --compare and --from-recording",
        lambda a: not a.compare and a.from_recording is None,
    ),
    "html": Acting("without --list", lambda a: not a.list),
    "stamp": _STAMPED,
    "list": Acting("without --compare", lambda a: not a.compare),
    "compare": None,
}

_MODULATION: Final[Rows] = {
    **_option_acts_always(
        "object rate_hz center_mm preset array temperature_c bandwidth_hz at_mm picture csv json"
    ),
    "modulation_hz": Acting("with am, lm and stm", lambda a: a.kind != "dwell"),
    "depth": _AM,
    "shift_mm": _LM,
    "dwell_ms": Acting("with am, lm and dwell", lambda a: a.kind != "stm"),
    "radius_mm": Acting(
        _RADIUS.where,
        lambda a: _acts_on_a_size(a) and (a.object is not None or a.kind in ("stm", "dwell")),
    ),
    "resolution_mm": Acting(
        _RESOLUTION.where,
        lambda a: a.object != "point" and (a.object is not None or a.kind in ("stm", "dwell")),
    ),
    "unit": _MESH,
    "pitch_mm": _PITCH,
}


def _acts_for_an_ear(arguments: Namespace) -> bool:
    return arguments.ear_mm is not None and not arguments.object and not arguments.drive


_PICTURE: Final = Acting("with --picture", lambda a: a.picture is not None)
_FOR_AN_EAR: Final = Acting("on one focus, with --ear-mm", _acts_for_an_ear)
_FIELD: Final[Rows] = {
    **_option_acts_always(
        "focus_mm object drive phase_bits preset array temperature_c picture at_mm"
    ),
    "resolution_mm": Acting(
        "with --object, on other objects than a point",
        lambda a: a.object is not None and a.object != "point",
    ),
    "radius_mm": Acting(
        "with --object, on a shape that has a radius",
        lambda a: a.object is not None and _acts_on_a_size(a),
    ),
    "unit": Acting("with --object, on a mesh file", lambda a: a.object and not _acts_on_a_shape(a)),
    "center_mm": Acting("with --object", lambda a: a.object is not None),
    "rate_hz": Acting(
        "with --object, or on one focus with --ear-mm",
        lambda a: a.object is not None or _acts_for_an_ear(a),
    ),
    "modulation": _FOR_AN_EAR,
    "modulation_hz": _FOR_AN_EAR,
    "pitch_mm": _PITCH,
    "ear_mm": Acting("without --quiet", lambda a: not a.quiet),
    "quiet": _PICTURE,
    "view": _PICTURE,
    "quantity": _PICTURE,
    "half_width_mm": _PICTURE,
    "decibels": Acting(
        "with --picture, on pressure and force in --view plane or cuts",
        lambda a: a.picture is not None and a.quantity != "phase" and a.view != "isosurface",
    ),
    "plane": Acting(
        "with --picture and --view plane", lambda a: a.picture is not None and a.view == "plane"
    ),
    "step_mm": Acting(
        "with --picture and --view plane or isosurface",
        lambda a: a.picture is not None and a.view != "cuts",
    ),
}

#: For every command the options, and when each acts.
_OWN_BOARD: Final = Acting(
    "on a board that is started here, or on a file of bytes (not on a back door)",
    lambda s: s.source is None or (s.dialect is not None and not s.source.startswith("unix:")),
)
_EXPECTED: Final = Acting(
    "with --expect or --expect-file", lambda s: bool(s.expect) or s.expect_file is not None
)
_WATCH: Final[Rows] = {
    **_option_acts_always(
        "link as_device expect expect_file latches fail_on frames json junit html summary quiet"
    ),
    "stamp": _STAMPED,
    **dict.fromkeys(
        ("dialect", "dialect_option", "array", "temperature_c", "calibration"), _OWN_BOARD
    ),
    **dict.fromkeys(("tolerance_mm", "tolerance_c", "tolerance_humidity"), _EXPECTED),
}
ACTING: Final[Mapping[str, Rows]] = {
    "verify": _VERIFY,
    "conform": _CONFORM,
    "modulation": _MODULATION,
    "field": _FIELD,
    "soak": {
        **_option_acts_always(
            "hours fault_rate seed segment_minutes jobs resume json junit html summary record "
            "mutant quiet"
        ),
        "stamp": _STAMPED,
    },
    "bench": {
        **_option_acts_always(
            "port rate_hz seconds baud lead_ms trim spin_us realtime json html summary "
            "picture compare record quiet"
        ),
        "stamp": _STAMPED,
    },
    "budget": {
        **_option_acts_always("baud rate_hz transducers dialect"),
        "boards": Acting("with --dialect", lambda a: a.dialect is not None),
    },
    "view": {
        **dict.fromkeys(
            ("http", "open", "until_eof"),
            Acting("on a page that is served (not with --html)", lambda s: s.html is None),
        ),
        "html": None,
    },
    "watch": _WATCH,
    "capture": _option_acts_always("map json quiet"),
    "decode": _option_acts_always("dialect input from_board verbose json"),
    "replay": {
        **_option_acts_always("json show"),
        "port": None,
        "baud": Acting("with --port", lambda a: a.port is not None),
        **dict.fromkeys(
            ("healthy", "mutant", "array"), Acting("without --port", lambda a: a.port is None)
        ),
    },
    "repair": {},
    "presets": _option_acts_always("json"),
}
