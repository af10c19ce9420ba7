"""The result of a run as JSON: the findings, and everything that is needed to repeat the run."""

from __future__ import annotations

import dataclasses
import enum
import json
import math
import os
import platform
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from haptogram.machine import files
from haptogram.machine.files import write_file_atomically
from haptogram.machine.fingerprint import package_version
from haptogram.verification import FrameVerdict, RunVerdict, Verdict

#: Number of the format; docs/api.md has a table of the keys that each format renamed.
FORMAT: Final = 2
_PACKAGES: Final = ("haptogram", "numpy", "scipy", "pyserial")


def run_result_dict(
    run: RunVerdict,
    *,
    configuration: Mapping[str, Any],
    seed: int,
    board: Mapping[str, Any],
    warnings: list[str],
    cut_short: str | None = None,
    host: Mapping[str, Any] | None = None,
    environment: Mapping[str, Any] | None = None,
    faults: Mapping[str, Any] | None = None,
    troubles: Mapping[str, Mapping[str, int]] | None = None,
) -> dict[str, Any]:
    """Return the result for JSON, in a fixed order, of JSON types only.

    Parameters
    ----------
    run : RunVerdict
        The judged run.
    configuration : mapping
        The settings of the run.
    seed : int
        Seed of everything random.
    board : mapping
        The board's description of itself.
    warnings : list of str
        Warnings of the run.
    cut_short : str or None
        Why the run did not come to its end; None: the run came to its end.
    host : mapping or None
        Delays and stalls of the host; None leaves the host out.
    environment : mapping or None
        :func:`run_environment`; None leaves it out, as in virtual time, where the result must not
        depend on the machine.
    faults : mapping or None
        Faults on purpose: ``plan``, ``seed``, and how often each ``fired``; None leaves it out.
    troubles : mapping or None
        Counters of ``board`` and ``host`` for frames that were damaged, lost or out of time.

    Raises
    ------
    ValueError
        If a run that was cut short passed, because ``verify_run`` was not given the cut.
    """
    if cut_short is not None and run.verdict is Verdict.PASS:
        raise ValueError(f"a run that was cut short ({cut_short}) cannot pass")
    result = (
        {"format": FORMAT}
        | run.as_dict()
        | {
            "cut_short": cut_short,
            "warnings": warnings,
            "seed": seed,
            "board": board,
            "troubles": troubles or {},
            "configuration": configuration,
        }
    )
    optional = {"faults": faults, "host": host, "environment": environment}
    result |= {name: value for name, value in optional.items() if value is not None}
    plain: dict[str, Any] = _plain_run_result(result)
    return plain


def run_environment() -> dict[str, str | int | None]:
    """Return versions of Python and packages, and the machine, without its name, user or date."""
    return {
        "python": platform.python_version(),
        **{name: package_version(name) for name in _PACKAGES},
        "platform": platform.platform(),
        "machine": platform.machine(),
        "cpus": os.cpu_count(),
    }


def run_frame_dict(frame: FrameVerdict) -> dict[str, Any]:
    """Return the verdict on one frame for JSON, with its join key and its line of text."""
    fields = {item.name: getattr(frame, item.name) for item in dataclasses.fields(frame)}
    key = fields.pop("key")
    plain: dict[str, Any] = _plain_run_result(
        dataclasses.asdict(key) | {"verdict": frame.status, "text": str(frame)} | fields
    )
    return plain


def write_run_json(path: Path, result: Mapping[str, Any]) -> None:
    """Write *result*, indented by 2; a number that is not finite becomes null.

    Raises
    ------
    ConfigurationError
        If *path* cannot be written.
    """
    files.write_json_file(path, _plain_run_result(result))


def _plain_run_result(value: Any) -> Any:
    """Return *value* in JSON's own types: arrays and tuples as lists, NaN and infinity as None."""
    match value:
        case np.generic() | np.ndarray():
            return _plain_run_result(value.tolist())
        case enum.Enum():
            return _plain_run_result(value.value)
        case float():
            return value if math.isfinite(value) else None
        case Mapping():
            return {str(name): _plain_run_result(item) for name, item in value.items()}
        case list() | tuple():
            return [_plain_run_result(item) for item in value]
        case set() | frozenset():
            return sorted(map(_plain_run_result, value))
        case None | bool() | int() | str():
            return value
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        named = {item.name: getattr(value, item.name) for item in dataclasses.fields(value)}
        return _plain_run_result(named)
    return str(value)


def write_run_frame_lines(path: Path, run: RunVerdict) -> None:
    """Write a line of JSON for each frame: its verdict, and the evidence for the verdict.

    Raises
    ------
    ConfigurationError
        If the file cannot be written.
    """
    lines = (json.dumps(run_frame_dict(frame), allow_nan=False) for frame in run.frames)
    write_file_atomically(path, "".join(f"{line}\n" for line in lines).encode())
